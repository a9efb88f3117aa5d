//! Binary words: a tree of descriptors that turns a picture into a bag of weighted words.
//!
//! Galvez-Lopez and Tardos, "Bags of binary words for fast place recognition in image sequences", T-RO 2012. A
//! descriptor goes down the tree to the nearest child until it meets a leaf, its word. Words that few pictures have weigh
//! most (TF-IDF). [`WordIndex`] finds the keyframes that share words with a query.

mod index;
mod text;
mod train;

pub use index::WordIndex;
pub use text::{LineProblem, VocabularyError};
pub use train::VocabularyOptions;

use crate::{Descriptor, hamming};

/// Bounds of the file format's first program (DBoW2).
const MAX_BRANCHING: u32 = 20;
const MAX_DEPTH: u32 = 10;
/// Stands for the word of a node that is no leaf.
const NO_WORD: u32 = u32::MAX;

/// A tree of binary words with their weights; from [`train`](Self::train) or [`parse`](Self::parse).
#[derive(Debug, Clone, PartialEq)]
pub struct Vocabulary {
    branching: u32,
    depth: u32,
    /// The root first, every node behind its parent.
    nodes: Vec<Node>,
    /// Children of node `i`: `children[first_child[i]..first_child[i + 1]]`, ascending.
    first_child: Vec<u32>,
    children: Vec<u32>,
    /// Node of each word.
    words: Vec<u32>,
}

#[derive(Debug, Clone, PartialEq)]
struct Node {
    parent: u32,
    descriptor: Descriptor,
    /// Number of the leaf among the leaves, or [`NO_WORD`].
    word: u32,
    /// Inverse document frequency of the word.
    weight: f64,
}

impl Node {
    const ROOT: Self = Self { parent: 0, descriptor: [0; 4], word: NO_WORD, weight: 0.0 };
}

impl Vocabulary {
    /// Links nodes to their children and numbers the leaves.
    fn assemble(branching: u32, depth: u32, mut nodes: Vec<Node>) -> Self {
        let mut first_child = vec![0; nodes.len() + 1];
        for node in &nodes[1..] {
            first_child[node.parent as usize + 1] += 1;
        }
        for i in 1..first_child.len() {
            first_child[i] += first_child[i - 1];
        }
        let mut free = first_child.clone();
        let mut children = vec![0; nodes.len() - 1];
        for (id, node) in (1..).zip(&nodes[1..]) {
            let slot = &mut free[node.parent as usize];
            children[*slot as usize] = id;
            *slot += 1;
        }
        let leaves = (1..nodes.len()).filter(|&id| first_child[id] == first_child[id + 1]);
        let words: Vec<u32> = leaves.map(|id| id as u32).collect();
        for (word, &id) in (0..).zip(&words) {
            nodes[id as usize].word = word;
        }
        Self { branching, depth, nodes, first_child, children, words }
    }

    /// Children that a node has at most.
    #[must_use]
    pub fn branching(&self) -> u32 {
        self.branching
    }

    /// Levels below the root at most.
    #[must_use]
    pub fn depth(&self) -> u32 {
        self.depth
    }

    /// Number of words.
    #[must_use]
    pub fn len(&self) -> usize {
        self.words.len()
    }

    /// Never: a vocabulary has a word at least.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.words.is_empty()
    }

    /// What stands for a word, and its weight, at least 0; `None` from [`len`](Self::len) on.
    #[must_use]
    pub fn entry(&self, word: u32) -> Option<(&Descriptor, f64)> {
        let node = &self.nodes[*self.words.get(word as usize)? as usize];
        Some((&node.descriptor, node.weight))
    }

    /// The word of a descriptor: down the tree to the nearest child, of equally near ones to the first.
    #[must_use]
    pub fn word(&self, descriptor: &Descriptor) -> u32 {
        self.leaf(descriptor).word
    }

    fn leaf(&self, descriptor: &Descriptor) -> &Node {
        let mut at = 0;
        loop {
            let children = &self.children[self.first_child[at] as usize..self.first_child[at + 1] as usize];
            let distance = |id: &&u32| hamming(descriptor, &self.nodes[**id as usize].descriptor);
            let Some(nearest) = children.iter().min_by_key(distance) else { return &self.nodes[at] };
            at = *nearest as usize;
        }
    }

    /// Words of a picture by ascending number, each with its share of the weight of all (they sum to 1). Words of
    /// weight 0 are left out, so a picture that has no others gives an empty bag.
    #[must_use]
    pub fn bag<'a>(&self, descriptors: impl IntoIterator<Item = &'a Descriptor>) -> Vec<(u32, f64)> {
        let leaves = descriptors.into_iter().map(|d| self.leaf(d)).filter(|leaf| leaf.weight > 0.0);
        let mut bag: Vec<(u32, f64)> = leaves.map(|leaf| (leaf.word, leaf.weight)).collect();
        bag.sort_unstable_by_key(|(word, _)| *word);
        bag.dedup_by(|next, kept| {
            let same = next.0 == kept.0;
            kept.1 += if same { next.1 } else { 0.0 };
            same
        });
        let total: f64 = bag.iter().map(|(_, weight)| weight).sum();
        bag.iter_mut().for_each(|(_, weight)| *weight /= total);
        bag
    }
}

/// Likeness of two bags, 0 (no word in common) to 1 (the same): 1 - |a - b| / 2 in the L1 norm. For weights of one sign
/// that is the sum of the smaller weight of each common word.
#[must_use]
pub fn bag_score(a: &[(u32, f64)], b: &[(u32, f64)]) -> f64 {
    let (mut i, mut j, mut score) = (0, 0, 0.0);
    while let (Some((word_a, weight_a)), Some((word_b, weight_b))) = (a.get(i), b.get(j)) {
        if word_a == word_b {
            score += slam_math::float::min(*weight_a, *weight_b);
        }
        i += usize::from(word_a <= word_b);
        j += usize::from(word_b <= word_a);
    }
    score
}
