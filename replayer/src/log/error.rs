use std::path::{Path, PathBuf};

use schemas::Stamp;

/// Why a log cannot be read. Each tells where; damage is repaired, as far as it can be, by `pslam recover`.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The file system refuses.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: std::io::Error,
    },
    /// The first bytes are not those of an MCAP file.
    #[error("{} is not an MCAP log: import a data set folder with `pslam import`", .0.display())]
    NotALog(PathBuf),
    /// The file ends inside a record, or before its closing records.
    #[error(
        "{}: ends at byte {file_bytes} {what} (byte {offset}): a recording was cut off; `pslam recover` keeps what is whole",
        path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the incomplete record starts.
        offset: u64,
        /// Size of the file.
        file_bytes: u64,
        /// What is incomplete.
        what: &'static str,
    },
    /// A record that is damaged or breaks the format's rules.
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
    /// A message that does not hold what its topic promises.
    #[error("{}: message {sequence} on {topic} at {stamp} s: {reason}", path.display())]
    Message {
        /// The file.
        path: PathBuf,
        /// Topic.
        topic: String,
        /// Its number on the topic, as the writer counted.
        sequence: u32,
        /// Its log time.
        stamp: Stamp,
        /// What is wrong.
        reason: String,
    },
    /// Something that the caller needs is not in the log.
    #[error("{}: {what}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
        /// What is missing and what there is instead.
        what: String,
    },
}

impl LogError {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_owned(), source }
    }

    pub(crate) fn damaged(path: &Path, what: &'static str, offset: u64, reason: impl Into<String>) -> Self {
        Self::Damaged { path: path.to_owned(), what, offset, reason: reason.into() }
    }

    pub(crate) fn missing(path: &Path, what: impl Into<String>) -> Self {
        Self::Missing { path: path.to_owned(), what: what.into() }
    }
}
