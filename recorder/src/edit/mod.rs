//! A log to another log: one core for everything that cuts, merges, filters, redacts or adds.
//!
//! [`rewrite`] streams a source through an [`Edit`], which keeps, changes, drops or adds messages; what it does not touch
//! goes over byte for byte, other programs' channels included. Stamps and log times never change, messages stay in the
//! order of the file, the result is complete before it gets its name, and its last record
//! ([`schemas::metadata::PROVENANCE_PREFIX`]) tells what was done. A damaged source is refused: `recover` comes first.

mod compress;
mod filter;
mod merge;
mod output;
pub mod redact;
mod rewrite;
mod slice;
mod source;
mod summary;
mod survey;

pub use crate::recover::SchemaDefinition;
pub use compress::{Compress, Compressed, Level, compress};
pub use filter::Filter;
pub use merge::{LayerNames, merge};
pub use output::{EditOptions, Output};
pub use rewrite::{Edit, rewrite};
pub use slice::{Cut, slice};
pub use source::{Channel, Item, RawMessage, Source};
pub use summary::{Counts, EditSummary, SourceFile};
pub use survey::{Frame, Survey};

use crate::log_writer::WriteError;
use schemas::Stamp;
use std::io;
use std::path::PathBuf;

/// Why a log cannot be edited.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// The source cannot be read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The file system's answer.
        source: io::Error,
    },
    /// The source is something else.
    #[error("{} is not an MCAP log: import a data set folder with `pslam import`", .0.display())]
    NotALog(PathBuf),
    /// The source ends inside a record, or before its closing records.
    #[error(
        "{}: ends in or before the record at byte {offset}: a recording was cut off; `pslam recover` keeps what is whole",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the incomplete record starts.
        offset: u64,
    },
    /// A record of the source that is damaged or breaks the format's rules.
    #[error("{}: {what} at byte {offset}: {reason}; `pslam recover` keeps what is whole", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Kind of record.
        what: &'static str,
        /// Where it starts.
        offset: u64,
        /// What is wrong, with the numbers.
        reason: String,
    },
    /// A message of the source that does not hold what its topic promises.
    #[error("message {sequence} on {topic} at {stamp} s: {reason}")]
    Message {
        /// Topic.
        topic: String,
        /// Its number on the topic, as the writer counted.
        sequence: u32,
        /// Its log time.
        stamp: Stamp,
        /// What is wrong.
        reason: String,
    },
    /// The result would replace a source.
    #[error("{} is the source itself: write the new log elsewhere", .0.display())]
    SameFile(PathBuf),
    /// What was asked for makes no sense for these logs, in words.
    #[error("{0}")]
    Refused(String),
    /// The result is not what it should be: a bug of this program. The source still stands.
    #[error("the new log does not hold what {} holds: {what}; it was thrown away", source_log.display())]
    Differs {
        /// What it was made from.
        source_log: PathBuf,
        /// What differs.
        what: String,
    },
    /// The result cannot be written.
    #[error("{0}")]
    Write(#[from] WriteError),
}

impl EditError {
    /// About a message of the source.
    pub fn message(message: &RawMessage<'_>, reason: impl Into<String>) -> Self {
        let (topic, sequence, stamp) = (message.topic().to_owned(), message.sequence, message.log_time);
        Self::Message { topic, sequence, stamp, reason: reason.into() }
    }
}
