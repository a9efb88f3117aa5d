//! Going through a run again, to see what its records hold only as digests: pictures, keypoints, regions.

use std::path::{Path, PathBuf};

use slam::{Config, FrameInput, FrameReport, Setup};

use super::diff::{Difference, end_difference, frame_difference};
use super::drive::{Stops, drive};
use super::records::{Block, RecordReader, RunHeader};
use super::source::Source;
use super::{Progress, RECORDS_BIN, RunError, RunSummary};
use crate::log::{EncodedImage, Log};
use crate::vocabulary::VocabularyFile;

/// A run with the log it was made from.
pub struct Retrace {
    records: PathBuf,
    pub(super) header: RunHeader,
    pub(super) log_path: PathBuf,
    pub(super) source: Source,
}

/// One frame of the run, seen again.
#[derive(Debug, Clone, Copy)]
pub struct Retraced<'a> {
    /// What the slam got.
    pub input: &'a FrameInput,
    /// The picture as logged; none where the slam's pictures are rectified.
    pub color: Option<&'a EncodedImage>,
    /// What it found.
    pub report: &'a FrameReport,
}

impl Retrace {
    /// Opens the log of a run: `log`, or the one at the place where it was.
    ///
    /// # Errors
    /// Damaged records, an unreadable log, or another one than that of the run.
    pub fn open(run_dir: &Path, log: Option<&Path>) -> Result<Self, RunError> {
        let records = run_dir.join(RECORDS_BIN);
        let header = RecordReader::open(&records)?.header().clone();
        let summary = RunSummary::read(run_dir)?;
        let log_path = log.map_or(summary.log, Path::to_owned);
        let log = Log::open(&log_path)?;
        if log.blake3() != header.log_blake3 {
            let (found, wanted) = (log.blake3().to_owned(), header.log_blake3);
            return Err(RunError::OtherLog { log: log_path, found, wanted });
        }
        let config = Config::from_toml(&header.config)?;
        let vocabulary = summary.vocabulary.as_deref();
        let vocabulary = vocabulary.map(|path| VocabularyFile::expect(path, &config.looping.vocabulary)).transpose()?;
        let source = Source::new(log, &config, header.layer.as_deref(), Some(header.frames.clone()), vocabulary)?;
        Ok(Self { records, header, log_path, source })
    }

    /// The log.
    #[must_use]
    pub fn log(&self) -> &Log {
        &self.source.log
    }

    /// What the slam was told about camera and categories.
    #[must_use]
    pub fn setup(&self) -> &Setup {
        &self.source.setup
    }

    /// Replays all frames and shows each to `each`; gives the first difference from the records (recorded value first),
    /// as another version of the program may make.
    ///
    /// # Errors
    /// As a replay; damaged records; what `each` returns.
    pub fn frames(
        &self,
        threads: usize,
        progress: Progress<'_>,
        each: &mut dyn FnMut(Retraced<'_>) -> Result<(), RunError>,
    ) -> Result<Option<Difference>, RunError> {
        let mut reader = RecordReader::open(&self.records)?;
        let mut difference = None;
        let outcome = drive(&self.source, threads, None, Stops::default(), progress, &mut |stepped| {
            let prepared = stepped.prepared;
            if difference.is_none() {
                difference = match reader.next_block()? {
                    Some(Block::Frame(recorded)) => frame_difference(&recorded, &stepped.entry),
                    _ => Some(Difference::whole("number of frames", stepped.entry.frame.to_string(), "more")),
                };
            }
            each(Retraced { input: &prepared.input, color: prepared.color.as_ref(), report: stepped.report })?;
            Ok(true)
        })?;
        if let (None, Some(outcome), Some(Block::End(end))) = (&difference, outcome, reader.next_block()?) {
            difference = end_difference(&end, &outcome.end());
        }
        Ok(difference)
    }
}
