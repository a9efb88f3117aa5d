//! One more segmentation layer for a log.
//!
//! First every colour picture is labelled (`label`, pictures in parallel, results in order) into a journal beside the new
//! log, then the log is rewritten with the labels in it. What an interrupted run had labelled is taken from the journal
//! by the next one, picture by picture, if it was made from the same pixels in the same way.

mod insert;
mod journal;
mod label;
mod pictures;
mod ready;

pub use ready::{ReadyMasks, ReadySource};

use crate::edit::{EditError, EditOptions, EditSummary, rewrite};
use crate::layer::{Layer, LayerSpec};
use crate::log_writer::{LogOptions, LogWriter, WriteError};
use crate::picture::PictureError;
use insert::Insert;
use journal::Journal;
use schemas::Stamp;
use segment::{SegmentError, Segmenter};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Makes a segmenter for one thread.
pub type MakeSegmenter<'a> = &'a (dyn Fn() -> Result<Box<dyn Segmenter>, SegmentError> + Sync);

/// What is asked for.
#[derive(Debug, Clone)]
pub struct AnnotateOptions {
    /// The new layer.
    pub layer: LayerSpec,
    /// How its labels are made: models, thresholds, runtime, as it shall stand in the log. The same values mean the same
    /// labels.
    pub record: BTreeMap<String, String>,
    /// When, in words; left away: no word about it.
    pub time: Option<String>,
    /// Only the first pictures.
    pub limit: Option<usize>,
    /// Pictures labelled at once; the result does not depend on it.
    pub threads: NonZeroUsize,
    /// How to write.
    pub log: LogOptions,
}

/// What was done to one log.
#[derive(Debug, Clone, Serialize)]
pub struct Annotated {
    /// The new log.
    pub edit: EditSummary,
    /// The layer.
    pub layer: String,
    /// Colour pictures of the log.
    pub pictures: usize,
    /// Those with labels.
    pub labelled: usize,
    /// Those whose labels an interrupted run had made.
    pub resumed: usize,
    /// BLAKE3 over all labels: the same labels, the same value.
    pub labels_blake3: String,
}

/// Why a log cannot be annotated.
#[derive(Debug, thiserror::Error)]
pub enum AnnotateError {
    /// The log.
    #[error("{0}")]
    Edit(#[from] EditError),
    /// The labels.
    #[error("{0}")]
    Segment(#[from] SegmentError),
    /// The labels of one picture.
    #[error("{}: picture {index} at {stamp} s: {source}", log.display())]
    Frame {
        /// The log.
        log: PathBuf,
        /// Its number, from 0.
        index: usize,
        /// Its stamp.
        stamp: Stamp,
        /// What went wrong.
        source: SegmentError,
    },
    /// A picture that cannot be decoded.
    #[error("{}: picture {index} at {stamp} s: {source}", log.display())]
    Picture {
        /// The log.
        log: PathBuf,
        /// Its number, from 0.
        index: usize,
        /// Its stamp.
        stamp: Stamp,
        /// What is wrong.
        source: PictureError,
    },
    /// A log that cannot take the layer.
    #[error("{}: {reason}", log.display())]
    Refused {
        /// The log.
        log: PathBuf,
        /// Why, and what to do.
        reason: String,
    },
    /// The journal of finished labels.
    #[error("{}: {source}", path.display())]
    Journal {
        /// The file.
        path: PathBuf,
        /// The file system's answer.
        source: io::Error,
    },
}

impl From<WriteError> for AnnotateError {
    fn from(error: WriteError) -> Self {
        Self::Edit(error.into())
    }
}

/// Writes `log` with one more layer to `out`. `progress` gets pictures done and, as far as known, in all.
///
/// # Errors
/// See [`AnnotateError`]; the journal stays for the next run.
pub fn annotate(
    log: &Path,
    out: &Path,
    options: &AnnotateOptions,
    make: MakeSegmenter<'_>,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Annotated, AnnotateError> {
    let layer = Layer::new(&options.layer)?;
    refuse_what_stands(out, options)?;
    let all = pictures::survey(log, &options.layer.name)?.min(options.limit.unwrap_or(usize::MAX));
    let mut journal = Journal::open(out, &request(options))?;
    let labelled = label::label(log, all, options, make, &mut journal, progress)?;
    let mut record = layer.record(&options.layer.origin);
    record.extend(options.record.clone());
    record.extend(options.time.iter().map(|time| ("time".to_owned(), time.clone())));
    record.insert("pictures".to_owned(), all.to_string());
    record.insert("labelled".to_owned(), labelled.count.to_string());
    record.insert("labels_blake3".to_owned(), labelled.blake3.clone());
    let arguments = BTreeMap::from([("layer".to_owned(), serde_json::Value::from(options.layer.name.as_str()))]);
    let mut edit = EditOptions::new("annotate", arguments);
    edit.log = options.log.clone();
    // Labelling takes hours, in which others write too. Only the half that an earlier run of ours began may be replaced.
    refuse_what_stands(out, options)?;
    edit.log.force |= labelled.resumed > 0;
    let mut insert = Insert::new(layer, record, journal.reader()?);
    let edit = rewrite(log, out, &edit, &mut insert, &mut |_, _| {})?;
    journal.remove()?;
    Ok(Annotated {
        edit,
        layer: options.layer.name.clone(),
        pictures: all,
        labelled: labelled.count,
        resumed: labelled.resumed,
        labels_blake3: labelled.blake3,
    })
}

/// Whether `out` is a finished log with this layer, made from `log` in this way.
///
/// # Errors
/// A file that cannot be read.
pub fn is_annotated(log: &Path, out: &Path, options: &AnnotateOptions) -> Result<bool, AnnotateError> {
    if !out.is_file() {
        return Ok(false);
    }
    let source = crate::edit::SourceFile { file: log.to_owned(), ..pictures::hashed(log)? };
    Ok(pictures::records(out)?.is_some_and(|records| {
        let layer = records.get(&format!("{}{}", schemas::metadata::SEGMENTATION_PREFIX, options.layer.name));
        let same = layer.is_some_and(|layer| options.record.iter().all(|(key, value)| layer.get(key) == Some(value)));
        let prefix = schemas::metadata::PROVENANCE_PREFIX;
        let mut provenance = records.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, values)| values);
        same && provenance.any(|values| values.get("source/0/blake3") == Some(&source.blake3))
    }))
}

/// Something else at the place of the new log is not written over unless that is wished, be it unfinished: without a journal
/// no run of ours began it.
fn refuse_what_stands(out: &Path, options: &AnnotateOptions) -> Result<(), WriteError> {
    let partial = LogWriter::partial_of(out);
    if options.log.force {
        Ok(())
    } else if out.exists() {
        Err(WriteError::Exists(out.to_owned()))
    } else if partial.exists() && !Journal::path_of(out).exists() {
        Err(WriteError::Unfinished(partial))
    } else {
        Ok(())
    }
}

/// BLAKE3 over everything but the pictures that decides on the labels.
fn request(options: &AnnotateOptions) -> [u8; 32] {
    let mut hash = blake3::Hasher::new();
    let texts = options.record.iter().flat_map(|(key, value)| [key, value]).chain([&options.layer.name]);
    for text in texts {
        hash.update(&(text.len() as u64).to_le_bytes());
        hash.update(text.as_bytes());
    }
    *hash.finalize().as_bytes()
}
