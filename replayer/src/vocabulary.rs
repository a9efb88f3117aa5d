//! A vocabulary of the user's, from its file.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use slam_vision::{Vocabulary, VocabularyError};

/// Largest file that is read: four times the nodes of the published vocabulary at 150 bytes a line.
const MAX_BYTES: u64 = 600_000_000;
/// Stands before the digest of a vocabulary where a configuration of a run names it.
pub(crate) const DIGEST_PREFIX: &str = "blake3:";

/// Why a vocabulary cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum VocabularyFileError {
    /// The file system refuses.
    #[error("vocabulary {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Its answer.
        source: std::io::Error,
    },
    /// More than any vocabulary holds.
    #[error("vocabulary {}: more than {MAX_BYTES} bytes; is it the text format of DBoW2?", path.display())]
    Large {
        /// The file.
        path: PathBuf,
    },
    /// Not the text format.
    #[error("{}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong where.
        source: VocabularyError,
    },
    /// The configuration of an earlier run was given: it holds a digest where a path is wanted.
    #[error("looping.vocabulary = {name:?} tells what a run used: give the path of that file in its place")]
    Digest {
        /// The value.
        name: String,
    },
    /// Another file than the run's.
    #[error("vocabulary {} is {found}, but the run was made with {wanted}: give the right file", path.display())]
    Other {
        /// The file.
        path: PathBuf,
        /// Its digest.
        found: String,
        /// The run's.
        wanted: String,
    },
}

/// A vocabulary and what identifies it.
#[derive(Debug, Clone)]
pub(crate) struct VocabularyFile {
    pub vocabulary: Arc<Vocabulary>,
    /// `blake3:` and the hexadecimal digest of the file.
    pub digest: String,
    /// Absolute.
    pub path: PathBuf,
}

impl VocabularyFile {
    /// Reads the file that `looping.vocabulary` names; none when it is empty.
    pub fn named(name: &str) -> Result<Option<Self>, VocabularyFileError> {
        match name {
            "" => Ok(None),
            digest if digest.starts_with(DIGEST_PREFIX) => Err(VocabularyFileError::Digest { name: digest.to_owned() }),
            path => Self::read(Path::new(path)).map(Some),
        }
    }

    /// The vocabulary of an earlier run, which `wanted` identifies.
    pub fn expect(path: &Path, wanted: &str) -> Result<Self, VocabularyFileError> {
        let file = Self::read(path)?;
        if file.digest == wanted {
            return Ok(file);
        }
        let (path, found, wanted) = (path.to_owned(), file.digest, wanted.to_owned());
        Err(VocabularyFileError::Other { path, found, wanted })
    }

    fn read(path: &Path) -> Result<Self, VocabularyFileError> {
        let io = |source| VocabularyFileError::Io { path: path.to_owned(), source };
        let mut text = Vec::new();
        File::open(path).map_err(io)?.take(MAX_BYTES + 1).read_to_end(&mut text).map_err(io)?;
        if text.len() as u64 > MAX_BYTES {
            return Err(VocabularyFileError::Large { path: path.to_owned() });
        }
        let content = |source| VocabularyFileError::Content { path: path.to_owned(), source };
        let vocabulary = Arc::new(Vocabulary::parse(&text).map_err(content)?);
        let digest = format!("{DIGEST_PREFIX}{}", blake3::hash(&text).to_hex());
        Ok(Self { vocabulary, digest, path: std::path::absolute(path).map_err(io)? })
    }
}
