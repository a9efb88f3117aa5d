//! What can go wrong while writing a viewer file.

use std::io;
use std::path::PathBuf;

/// Failure of a call of this crate. After one, the file is best given up: drop the writer and remove the `.partial` file.
#[derive(Debug, thiserror::Error)]
pub enum RrdError {
    /// The target or its `.partial` file is there already.
    #[error("{path} exists already: remove it, choose another name, or ask for overwriting")]
    Exists {
        /// The file in the way.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file concerned.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Arrays that belong together differ in length.
    #[error("{entity}: {got} {what} given, expected {expected}")]
    Length {
        /// Entity path of the log call.
        entity: String,
        /// Which array.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length it should have.
        expected: usize,
    },
    /// A blueprint container has other than one share a child.
    #[error("blueprint: container {name:?} has {children} children but {shares} shares: give one a child, or none")]
    Shares {
        /// Name of the container.
        name: String,
        /// Number of children.
        children: usize,
        /// Number of shares.
        shares: usize,
    },
    /// The encoder refused the data.
    #[error("{entity}: cannot be encoded: {reason}")]
    Encode {
        /// Entity path of the log call, or the part of the file.
        entity: String,
        /// The encoder's own words.
        reason: String,
    },
}

impl RrdError {
    /// Wraps an encoder's error, which is flattened to text so that the encoder's types stay inside this crate.
    pub(crate) fn encode(entity: &str, reason: &dyn std::fmt::Display) -> Self {
        Self::Encode { entity: entity.to_owned(), reason: reason.to_string() }
    }
}
