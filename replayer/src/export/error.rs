use crate::OutputError;
use crate::log::LogError;

/// Why a log cannot be exported.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The folder cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// What is asked for makes no sense for this log and format.
    #[error("{0}")]
    Refused(String),
    /// A picture could not be encoded.
    #[error("picture at {stamp} s: {reason}")]
    Picture {
        /// Its stamp.
        stamp: schemas::Stamp,
        /// What is wrong.
        reason: String,
    },
}
