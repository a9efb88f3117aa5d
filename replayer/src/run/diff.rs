//! Where two runs part.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use slam_math::Digest;

use super::records::{Block, FieldEntry, FrameEntry, RecordReader, RunEnd, RunHeader};
use super::{RECORDS_BIN, RunError};

/// One thing that is not the same on both sides.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Frame of the runs; none for what concerns the whole run.
    pub frame: Option<u32>,
    /// Its sensor time, seconds.
    pub stamp: Option<String>,
    /// Stage within the frame.
    pub stage: Option<&'static str>,
    /// What differs.
    pub field: String,
    /// Value on either side.
    pub values: [String; 2],
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(frame), Some(stamp)) = (self.frame, &self.stamp) {
            write!(f, "frame {frame} at {stamp} s, ")?;
        }
        if let Some(stage) = self.stage {
            write!(f, "stage {stage}, ")?;
        }
        let [a, b] = &self.values;
        write!(f, "{}:\n  {a}\n  {b}", self.field)
    }
}

impl Difference {
    /// Between things that concern the whole run.
    pub(super) fn whole(field: impl Into<String>, a: impl Into<String>, b: impl Into<String>) -> Self {
        Self { frame: None, stamp: None, stage: None, field: field.into(), values: [a.into(), b.into()] }
    }
}

/// Two runs side by side.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DiffReport {
    /// The runs.
    pub runs: [PathBuf; 2],
    /// Their fingerprints.
    pub fingerprints: [String; 2],
    /// What was different from the start: program, log, layer, frames, keys of the configuration.
    pub header: Vec<Difference>,
    /// Frames that are the same before the first difference.
    pub equal_frames: usize,
    /// The first difference in frames, number of frames or trajectories.
    pub first: Option<Difference>,
}

impl DiffReport {
    /// Whether nothing differs.
    #[must_use]
    pub fn same(&self) -> bool {
        self.header.is_empty() && self.first.is_none()
    }
}

impl fmt::Display for DiffReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (run, fingerprint) in self.runs.iter().zip(&self.fingerprints) {
            writeln!(f, "{fingerprint}  {}", run.display())?;
        }
        for difference in &self.header {
            writeln!(f, "{difference}")?;
        }
        match &self.first {
            Some(first) => write!(f, "{} frames are the same, then {first}", self.equal_frames),
            None => write!(f, "all {} frames and the trajectories are the same", self.equal_frames),
        }
    }
}

/// Compares the records of two runs.
///
/// # Errors
/// Missing or damaged records.
pub fn diff(run_a: &Path, run_b: &Path) -> Result<DiffReport, RunError> {
    let mut a = RecordReader::open(&run_a.join(RECORDS_BIN))?;
    let mut b = RecordReader::open(&run_b.join(RECORDS_BIN))?;
    let header = header_differences(a.header(), b.header());
    let (mut equal_frames, mut first) = (0, None);
    loop {
        // Both are read to their end, for the fingerprints and to find damage.
        let blocks = (a.next_block()?, b.next_block()?);
        if blocks == (None, None) {
            break;
        }
        if first.is_none() {
            first = block_difference(blocks.0.as_ref(), blocks.1.as_ref());
            equal_frames += usize::from(first.is_none() && matches!(blocks.0, Some(Block::Frame(_))));
        }
    }
    let fingerprints = [a.fingerprint().to_string(), b.fingerprint().to_string()];
    Ok(DiffReport { runs: [run_a.to_owned(), run_b.to_owned()], fingerprints, header, equal_frames, first })
}

/// What two runs were made from; of configurations each key that differs.
pub(super) fn header_differences(a: &RunHeader, b: &RunHeader) -> Vec<Difference> {
    let layer = |header: &RunHeader| header.layer.clone().unwrap_or_else(|| "none".to_owned());
    let frames = |header: &RunHeader| format!("{}..{}", header.frames.start, header.frames.end);
    let mut pairs = vec![
        ("program".to_owned(), a.program.clone(), b.program.clone()),
        ("log (BLAKE3)".to_owned(), a.log_blake3.clone(), b.log_blake3.clone()),
        ("layer".to_owned(), layer(a), layer(b)),
        ("frames".to_owned(), frames(a), frames(b)),
    ];
    pairs.retain(|(_, a, b)| a != b);
    pairs.extend(
        config_differences(&a.config, &b.config).into_iter().map(|(key, a, b)| (format!("config {key}"), a, b)),
    );
    pairs.into_iter().map(|(field, a, b)| Difference::whole(field, a, b)).collect()
}

/// Keys of two TOML texts whose values differ, with both values, sorted.
pub(crate) fn config_differences(a: &str, b: &str) -> Vec<(String, String, String)> {
    let (keys_a, keys_b) = (config_keys(a), config_keys(b));
    let mut keys: Vec<&String> = keys_a.keys().chain(keys_b.keys()).collect();
    keys.sort();
    keys.dedup();
    let value =
        |keys: &BTreeMap<String, String>, key| keys.get(key).cloned().unwrap_or_else(|| "(no such key)".to_owned());
    let pairs = keys.into_iter().map(|key| (key.clone(), value(&keys_a, key), value(&keys_b, key)));
    pairs.filter(|(_, a, b)| a != b).collect()
}

/// Every key of a TOML text with its sections, and its value as text.
fn config_keys(text: &str) -> BTreeMap<String, String> {
    fn walk(prefix: &str, table: toml::Table, keys: &mut BTreeMap<String, String>) {
        for (key, value) in table {
            let key = if prefix.is_empty() { key } else { format!("{prefix}.{key}") };
            match value {
                toml::Value::Table(table) => walk(&key, table, keys),
                value => {
                    keys.insert(key, value.to_string());
                }
            }
        }
    }
    let mut keys = BTreeMap::new();
    match text.parse() {
        Ok(table) => walk("", table, &mut keys),
        Err(_) => {
            keys.insert("text".to_owned(), text.to_owned());
        }
    }
    keys
}

fn block_difference(a: Option<&Block>, b: Option<&Block>) -> Option<Difference> {
    match (a, b) {
        (Some(Block::Frame(a)), Some(Block::Frame(b))) => frame_difference(a, b),
        (Some(Block::End(a)), Some(Block::End(b))) => end_difference(a, b),
        (a, b) => {
            let text = |block: Option<&Block>| match block {
                Some(Block::Frame(frame)) => format!("goes on with frame {}", frame.frame),
                _ => "has ended".to_owned(),
            };
            Some(Difference::whole("number of frames", text(a), text(b)))
        }
    }
}

/// The first field that differs between two accounts of the same frame.
pub(super) fn frame_difference(a: &FrameEntry, b: &FrameEntry) -> Option<Difference> {
    let at = |stage, field: &str, values| Difference {
        frame: Some(a.frame),
        stamp: Some(a.stamp.to_decimal9()),
        stage,
        field: field.to_owned(),
        values,
    };
    if (a.frame, a.stamp) != (b.frame, b.stamp) {
        return Some(at(
            None,
            "stamp",
            [a, b].map(|entry| format!("frame {} at {} s", entry.frame, entry.stamp.to_decimal9())),
        ));
    }
    for i in 0..a.fields.len().max(b.fields.len()) {
        let (field_a, field_b) = (a.fields.get(i), b.fields.get(i));
        if field_a != field_b {
            let named = field_a.or(field_b)?;
            let same_place = |f: &&FieldEntry| (f.stage, &f.field) == (named.stage, &named.field);
            let text = |f: Option<&FieldEntry>| match f.filter(same_place) {
                Some(FieldEntry { value, digest, .. }) if value.is_empty() => format!("digest {digest}"),
                Some(FieldEntry { value, digest, .. }) => format!("{value} (digest {digest})"),
                None => "no such field".to_owned(),
            };
            return Some(at(Some(named.stage.name()), &named.field, [text(field_a), text(field_b)]));
        }
    }
    None
}

/// Trajectories that differ though all frames agree: where the online one is the same, what came after the last frame
/// made the other.
pub(super) fn end_difference(a: &RunEnd, b: &RunEnd) -> Option<Difference> {
    let digests = |a: Digest, b: Digest| [format!("digest {a}"), format!("digest {b}")];
    let both =
        [("online trajectory", None, a.online, b.online), ("trajectory", Some("final"), a.trajectory, b.trajectory)];
    let (field, stage, a, b) = both.into_iter().find(|(.., a, b)| a != b)?;
    Some(Difference { stage, values: digests(a, b), ..Difference::whole(field, "", "") })
}
