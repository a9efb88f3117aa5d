//! What an edit did, for people, programs and the log itself.

use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

/// Messages by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Byte for byte as they were.
    pub kept: u64,
    /// With other contents.
    pub changed: u64,
    /// Not in the result.
    pub dropped: u64,
    /// Only in the result.
    pub added: u64,
}

impl Counts {
    fn plus(self, other: &Self) -> Self {
        Self {
            kept: self.kept + other.kept,
            changed: self.changed + other.changed,
            dropped: self.dropped + other.dropped,
            added: self.added + other.added,
        }
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { kept, changed, dropped, added } = self;
        write!(f, "kept {kept}, changed {changed}, dropped {dropped}, added {added}")
    }
}

/// A log that was read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SourceFile {
    /// The file as it was named.
    pub file: PathBuf,
    /// Its size.
    pub bytes: u64,
    /// BLAKE3 of the file, 64 hexadecimal digits.
    pub blake3: String,
}

/// What an edit did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EditSummary {
    /// Version of this form; grows when a field changes its meaning.
    pub version: u32,
    /// `slice`, `redact`, ...
    pub operation: String,
    /// What was asked for.
    pub arguments: BTreeMap<String, serde_json::Value>,
    /// What was read.
    pub sources: Vec<SourceFile>,
    /// The new log; none in a dry run.
    pub out: Option<PathBuf>,
    /// Its size; 0 in a dry run.
    pub out_bytes: u64,
    /// All messages.
    pub messages: Counts,
    /// By topic of the new log, or of the source where a topic is dropped.
    pub topics: BTreeMap<String, Counts>,
}

impl EditSummary {
    pub(super) fn new(operation: &str, arguments: BTreeMap<String, serde_json::Value>) -> Self {
        Self {
            version: 1,
            operation: operation.to_owned(),
            arguments,
            sources: Vec::new(),
            out: None,
            out_bytes: 0,
            messages: Counts::default(),
            topics: BTreeMap::new(),
        }
    }

    pub(super) fn add_up(&mut self) {
        self.messages = self.topics.values().fold(Counts::default(), Counts::plus);
    }

    /// The log's own record of it. It names no file: the same sources give the same bytes, and a path may be private.
    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        let mut values = BTreeMap::from([
            ("operation".to_owned(), self.operation.clone()),
            ("program".to_owned(), concat!("pslam ", env!("CARGO_PKG_VERSION")).to_owned()),
            ("arguments".to_owned(), serde_json::json!(self.arguments).to_string()),
            ("messages".to_owned(), self.messages.to_string()),
        ]);
        for (number, source) in self.sources.iter().enumerate() {
            values.insert(format!("source/{number}/blake3"), source.blake3.clone());
            values.insert(format!("source/{number}/bytes"), source.bytes.to_string());
        }
        values.extend(self.topics.iter().map(|(topic, counts)| (format!("topic/{topic}"), counts.to_string())));
        values
    }
}

impl fmt::Display for EditSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for source in &self.sources {
            writeln!(f, "read     {} ({} bytes, blake3 {})", source.file.display(), source.bytes, source.blake3)?;
        }
        for (topic, counts) in &self.topics {
            writeln!(f, "  {topic:<40} {counts}")?;
        }
        writeln!(f, "messages {}", self.messages)?;
        match &self.out {
            Some(out) => writeln!(f, "written  {} ({} bytes)", out.display(), self.out_bytes),
            None => writeln!(f, "nothing is written (dry run)"),
        }
    }
}
