//! What a recovery kept and lost.

use schemas::Stamp;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

/// A stretch of the damaged file that was not passed on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Damage {
    /// Where it starts.
    pub offset: u64,
    /// Its size.
    pub bytes: u64,
    /// What it is, in words.
    pub what: String,
}

/// The messages of one topic.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ChannelReport {
    /// Messages recovered.
    pub messages: u64,
    /// Messages that the damaged file had, if its summary is intact.
    pub expected: Option<u64>,
    /// Missing sequence numbers as ranges, both ends included, before the last recovered one. Empty for writers that do
    /// not count up.
    pub missing_sequences: Vec<(u32, u32)>,
    /// Log time of the last recovered message.
    pub last_stamp: Option<Stamp>,
    #[serde(skip)]
    next_sequence: u32,
    #[serde(skip)]
    uncounted: bool,
}

impl ChannelReport {
    pub(super) fn count(&mut self, sequence: u32, log_time: u64) {
        self.messages += 1;
        self.last_stamp = Some(Stamp(i64::try_from(log_time).unwrap_or(i64::MAX)));
        if self.uncounted || sequence < self.next_sequence {
            self.uncounted = true;
            self.missing_sequences.clear();
            return;
        }
        if sequence > self.next_sequence {
            self.missing_sequences.push((self.next_sequence, sequence - 1));
        }
        self.next_sequence = sequence.saturating_add(1);
    }

    pub(super) fn lost_some(&self) -> bool {
        self.expected.is_some_and(|expected| expected != self.messages)
    }
}

/// What a recovery did.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RecoverReport {
    /// The damaged file.
    pub damaged: PathBuf,
    /// Its size.
    pub damaged_bytes: u64,
    /// The new log.
    pub recovered: PathBuf,
    /// Its size.
    pub recovered_bytes: u64,
    /// False only if a checksum proves that every message, attachment and metadata record is in the new log.
    pub lossy: bool,
    /// Whether the summary at the file's end is there and its checksum agrees.
    pub summary_intact: bool,
    /// Whether the checksum over the data section agrees.
    pub data_section_intact: bool,
    /// Chunks taken over.
    pub chunks: u64,
    /// Messages taken over.
    pub messages: u64,
    /// Attachments taken over.
    pub attachments: u64,
    /// Metadata records taken over.
    pub metadata: u64,
    /// Messages in intact chunks whose channel's definition is lost.
    pub messages_without_channel: u64,
    /// Earliest log time of all recovered messages.
    pub first_stamp: Option<Stamp>,
    /// Latest log time of all recovered messages.
    pub last_stamp: Option<Stamp>,
    /// By topic.
    pub channels: BTreeMap<String, ChannelReport>,
    /// What was not passed on, in file order.
    pub damage: Vec<Damage>,
    /// Whether the scan was broken off, because the file is made to cost endless work.
    pub gave_up: bool,
}

impl RecoverReport {
    /// What the new log tells about its origin.
    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        let name = self.damaged.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let entries = [
            ("damaged_file", name),
            ("damaged_bytes", self.damaged_bytes.to_string()),
            ("lossy", self.lossy.to_string()),
            ("messages", self.messages.to_string()),
            ("damaged_ranges", self.damage.len().to_string()),
        ];
        entries.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }
}

impl fmt::Display for RecoverReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let intact = |good: bool| if good { "intact" } else { "damaged or missing" };
        writeln!(f, "recovered      {} ({:.1} MB)", self.recovered.display(), self.recovered_bytes as f64 / 1e6)?;
        write!(f, "kept           {} messages in {} chunks", self.messages, self.chunks)?;
        writeln!(f, ", {} attachments, {} metadata records", self.attachments, self.metadata)?;
        writeln!(f, "data section   {}", intact(self.data_section_intact))?;
        writeln!(f, "summary        {}", intact(self.summary_intact))?;
        if let (Some(first), Some(last)) = (self.first_stamp, self.last_stamp) {
            writeln!(f, "time           {first} .. {last} s")?;
        }
        for damage in &self.damage {
            writeln!(f, "lost           bytes {} to {}: {}", damage.offset, damage.offset + damage.bytes, damage.what)?;
        }
        for (topic, channel) in &self.channels {
            let missing = channel.missing_sequences.iter().map(|(first, last)| format!("{first}-{last}"));
            let missing: Vec<String> = missing.collect();
            if let Some(expected) = channel.expected.filter(|_| channel.lost_some()) {
                write!(
                    f,
                    "lost           {topic}: {} of {expected} messages",
                    expected.saturating_sub(channel.messages)
                )?;
            } else if !missing.is_empty() {
                write!(f, "lost           {topic}: messages")?;
            } else {
                continue;
            }
            writeln!(
                f,
                ", sequence {}",
                if missing.is_empty() { "at the end".to_owned() } else { missing.join(", ") }
            )?;
        }
        if self.messages_without_channel > 0 {
            writeln!(f, "lost           {} messages whose channel is unknown", self.messages_without_channel)?;
        }
        if self.gave_up {
            writeln!(f, "lost           the rest of the file: scanning it would take too long")?;
        }
        let verdict = if self.lossy { "LOSSY: the new log lacks data" } else { "complete: nothing is lost" };
        writeln!(f, "result         {verdict}")
    }
}
