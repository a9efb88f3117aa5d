//! The text format of DBoW2 vocabularies such as the published `ORBvoc.txt`.
//!
//! The first line is `k L scoring weighting`; every other one a node, `parent isLeaf d0..d31 weight`. The root, 0, has no
//! line; the nodes count from 1 in the order of the lines. Byte `j` of a descriptor holds its bits `8 j` to `8 j + 7`, the
//! lowest first.

use std::fmt::Write as _;
use std::str::FromStr;

use super::{MAX_BRANCHING, MAX_DEPTH, Node, Vocabulary};

/// Bytes of a line at most; a node takes about 130.
const MAX_LINE: usize = 1024;
/// Nodes at most, four times those of the published vocabulary: 250 MB.
const MAX_NODES: usize = 4_000_000;
/// Numbers of a node's line.
const FIELDS: usize = 35;

/// Why there is no vocabulary.
#[derive(Debug, thiserror::Error)]
pub enum VocabularyError {
    /// A line is not what it should be.
    #[error("vocabulary, line {line}: {problem}; get the file anew")]
    Line {
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        problem: LineProblem,
    },
    /// Training options out of range.
    #[error("a vocabulary of {branching} children a node and {depth} levels: give 2 to 20 and 1 to 10")]
    Shape {
        /// Children of a node.
        branching: u32,
        /// Levels.
        depth: u32,
    },
    /// Training pictures without descriptors.
    #[error("{pictures} pictures without a single descriptor train no vocabulary")]
    NothingToTrainOn {
        /// Number of pictures.
        pictures: usize,
    },
}

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum LineProblem {
    /// More bytes than a line may have.
    #[error("longer than {MAX_LINE} bytes")]
    Long,
    /// Another number of fields.
    #[error("{found} numbers instead of {expected}")]
    Fields {
        /// Number there should be.
        expected: usize,
        /// Number there is.
        found: usize,
    },
    /// A field that is no number of its kind.
    #[error("field {field} is {found:?}, not {expected}")]
    Number {
        /// Field, from 1.
        field: usize,
        /// What stands there.
        found: String,
        /// What should, in words.
        expected: &'static str,
    },
    /// The first line tells of another kind of tree.
    #[error("`k L scoring weighting` = {found:?}: only k 2-20, L 1-10, scoring 0 (L1), weighting 0 (TF-IDF) are known")]
    Header {
        /// The four numbers.
        found: [u32; 4],
    },
    /// The parent has no line before this one.
    #[error("parent {parent} of node {node} does not stand before it")]
    NoParent {
        /// The node.
        node: usize,
        /// Its parent.
        parent: u32,
    },
    /// The parent is a leaf.
    #[error("parent {parent} of node {node} is a leaf")]
    LeafParent {
        /// The node.
        node: usize,
        /// Its parent.
        parent: u32,
    },
    /// The parent has all the children it may have.
    #[error("parent {parent} has more than {branching} children")]
    Siblings {
        /// The parent.
        parent: u32,
        /// Children it may have.
        branching: u32,
    },
    /// Deeper than the first line says.
    #[error("node {node} lies deeper than {depth} levels")]
    Deep {
        /// The node.
        node: usize,
        /// Levels there may be.
        depth: u32,
    },
    /// Neither a leaf nor anybody's parent.
    #[error("node {node} is no leaf but has no children: the file may be cut off")]
    Childless {
        /// The node; 0 is the root, all of the file.
        node: usize,
    },
    /// More nodes than can be held.
    #[error("more than {MAX_NODES} nodes")]
    Many,
}

impl Vocabulary {
    /// Reads a vocabulary from the text of its file; memory is in proportion to what is there, whatever the file says.
    ///
    /// # Errors
    /// The first line that is wrong. Empty lines at the end are allowed.
    pub fn parse(text: &[u8]) -> Result<Self, VocabularyError> {
        let mut lines = (1..).zip(text.split(|byte| *byte == b'\n'));
        let wrong = |line| move |problem| VocabularyError::Line { line, problem };
        let first = lines.next().map_or(&[][..], |(_, text)| text);
        let (branching, depth) = short(first).and_then(header).map_err(wrong(1))?;
        let mut tree = Growing { branching, depth, nodes: vec![Node::ROOT], shape: vec![Shape::default()] };
        let mut blank = None;
        for (line, text) in lines {
            if text.trim_ascii().is_empty() {
                blank = blank.or(Some(line));
            } else if let Some(line) = blank {
                let problem = LineProblem::Fields { expected: FIELDS, found: 0 };
                return Err(VocabularyError::Line { line, problem });
            } else {
                short(text).and_then(|text| tree.push(text)).map_err(wrong(line))?;
            }
        }
        if let Some(node) = tree.shape.iter().position(|shape| !shape.is_leaf && shape.children == 0) {
            return Err(VocabularyError::Line { line: node + 1, problem: LineProblem::Childless { node } });
        }
        Ok(Self::assemble(branching, depth, tree.nodes))
    }

    /// The text of its file; [`parse`](Self::parse) gives the vocabulary back as it was.
    #[must_use]
    pub fn to_text(&self) -> String {
        let mut text = format!("{} {} 0 0\n", self.branching, self.depth);
        // Writing into a String cannot fail.
        for (id, node) in self.nodes.iter().enumerate().skip(1) {
            let is_leaf = self.first_child[id] == self.first_child[id + 1];
            let _ = write!(text, "{} {} ", node.parent, u8::from(is_leaf));
            for byte in node.descriptor.iter().flat_map(|word| word.to_le_bytes()) {
                let _ = write!(text, "{byte} ");
            }
            let _ = writeln!(text, "{}", node.weight);
        }
        text
    }
}

/// A line that may be looked at.
fn short(text: &[u8]) -> Result<&[u8], LineProblem> {
    if text.len() > MAX_LINE { Err(LineProblem::Long) } else { Ok(text) }
}

fn header(text: &[u8]) -> Result<(u32, u32), LineProblem> {
    let fields: [&[u8]; 4] = split(text)?;
    let mut found = [0; 4];
    for (i, found) in found.iter_mut().enumerate() {
        *found = number(&fields, i, "a count")?;
    }
    match found {
        [k, l, 0, 0] if (2..=MAX_BRANCHING).contains(&k) && (1..=MAX_DEPTH).contains(&l) => Ok((k, l)),
        _ => Err(LineProblem::Header { found }),
    }
}

/// A tree of which more lines may come.
struct Growing {
    branching: u32,
    depth: u32,
    nodes: Vec<Node>,
    shape: Vec<Shape>,
}

/// What the lines so far say of a node.
#[derive(Clone, Copy, Default)]
struct Shape {
    level: u32,
    children: u32,
    is_leaf: bool,
}

impl Growing {
    fn push(&mut self, text: &[u8]) -> Result<(), LineProblem> {
        let node = self.nodes.len();
        if node > MAX_NODES {
            return Err(LineProblem::Many);
        }
        let fields: [&[u8]; FIELDS] = split(text)?;
        let parent: u32 = number(&fields, 0, "the number of a node")?;
        let is_leaf = match number::<u8>(&fields, 1, "0 or 1")? {
            flag @ 0..=1 => flag == 1,
            _ => return Err(unexpected(&fields, 1, "0 or 1")),
        };
        let mut descriptor = [0; 4];
        for byte in 0..32 {
            let value: u8 = number(&fields, 2 + byte, "a byte, 0 to 255")?;
            descriptor[byte / 8] |= u64::from(value) << (8 * (byte % 8));
        }
        const WEIGHT: &str = "a weight, 0 to 1000000";
        let weight: f64 = number(&fields, FIELDS - 1, WEIGHT)?;
        // Logarithms of picture counts are far smaller; sums of these stay finite.
        if !(0.0..=1e6).contains(&weight) {
            return Err(unexpected(&fields, FIELDS - 1, WEIGHT));
        }
        let level = self.adopt(node, parent)?;
        self.nodes.push(Node { parent, descriptor, weight, ..Node::ROOT });
        self.shape.push(Shape { level, children: 0, is_leaf });
        Ok(())
    }

    /// Counts a child of `parent` and returns its level.
    fn adopt(&mut self, node: usize, parent: u32) -> Result<u32, LineProblem> {
        let (branching, depth) = (self.branching, self.depth);
        let Some(above) = self.shape.get_mut(parent as usize) else {
            return Err(LineProblem::NoParent { node, parent });
        };
        above.children += 1;
        match *above {
            Shape { is_leaf: true, .. } => Err(LineProblem::LeafParent { node, parent }),
            Shape { children, .. } if children > branching => Err(LineProblem::Siblings { parent, branching }),
            Shape { level, .. } if level >= depth => Err(LineProblem::Deep { node, depth }),
            Shape { level, .. } => Ok(level + 1),
        }
    }
}

/// The fields of a line, exactly `N`.
fn split<const N: usize>(text: &[u8]) -> Result<[&[u8]; N], LineProblem> {
    let mut fields: [&[u8]; N] = [&[]; N];
    let mut found = 0;
    for field in text.split(u8::is_ascii_whitespace).filter(|field| !field.is_empty()) {
        if let Some(slot) = fields.get_mut(found) {
            *slot = field;
        }
        found += 1;
    }
    if found == N { Ok(fields) } else { Err(LineProblem::Fields { expected: N, found }) }
}

fn number<T: FromStr>(fields: &[&[u8]], i: usize, expected: &'static str) -> Result<T, LineProblem> {
    let parsed = std::str::from_utf8(fields[i]).ok().and_then(|text| text.parse().ok());
    parsed.ok_or_else(|| unexpected(fields, i, expected))
}

fn unexpected(fields: &[&[u8]], i: usize, expected: &'static str) -> LineProblem {
    let found = &fields[i][..fields[i].len().min(40)];
    LineProblem::Number { field: i + 1, found: String::from_utf8_lossy(found).into_owned(), expected }
}
