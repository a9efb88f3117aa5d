//! Recomputing a run.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::diff::{Difference, end_difference, frame_difference, header_differences};
use super::drive::{Stops, drive};
use super::records::{Block, RecordReader, RunEnd, digest_of};
use super::retrace::Retrace;
use super::{CONFIG_TOML, Progress, RECORDS_BIN, RunError, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT};

/// Whether a run is what its log gives.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VerifyReport {
    /// The run.
    pub run: PathBuf,
    /// The log it was recomputed from.
    pub log: PathBuf,
    /// Frames that came out the same, up to the first difference.
    pub equal_frames: usize,
    /// As recorded.
    pub fingerprint: String,
    /// What is different with this program: its version, keys of the configuration. Not a failure by itself, but it
    /// changes the fingerprint.
    pub notes: Vec<Difference>,
    /// The first difference; recorded value first, recomputed one second.
    pub difference: Option<Difference>,
}

impl VerifyReport {
    /// Whether everything came out the same.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.difference.is_none()
    }
}

impl fmt::Display for VerifyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for note in &self.notes {
            writeln!(f, "note: recorded and here, {note}")?;
        }
        match &self.difference {
            None => write!(f, "verified: {} frames, fingerprint {}", self.equal_frames, self.fingerprint),
            Some(difference) => {
                write!(f, "NOT the same: {} frames agree, then (recorded, here) {difference}", self.equal_frames)
            }
        }
    }
}

/// Recomputes a run from its recorded configuration and its log, and stops at the first difference. Without `log`, the
/// log is looked for where it was.
///
/// # Errors
/// Missing or damaged records, another log, or a log that can no longer be read.
pub fn verify(
    run_dir: &Path,
    log: Option<&Path>,
    threads: usize,
    progress: Progress<'_>,
) -> Result<VerifyReport, RunError> {
    let summary = RunSummary::read(run_dir)?;
    let records = run_dir.join(RECORDS_BIN);
    let (end, fingerprint) = read_through(&records)?;
    let Retrace { header, log_path, source, .. } = Retrace::open(run_dir, log)?;
    let mut reader = RecordReader::open(&records)?;
    let notes = header_differences(&header, &source.header());
    let mut report = VerifyReport {
        run: run_dir.to_owned(),
        log: log_path,
        equal_frames: 0,
        fingerprint: fingerprint.clone(),
        notes,
        difference: files_difference(run_dir, &header.config, &summary, &end, &fingerprint)?,
    };
    if report.difference.is_some() {
        return Ok(report);
    }
    let outcome = drive(&source, threads, None, Stops::default(), progress, &mut |stepped| {
        report.difference = match reader.next_block()? {
            Some(Block::Frame(recorded)) => frame_difference(&recorded, &stepped.entry),
            _ => Some(Difference::whole("number of frames", end.frames.to_string(), source.range.len().to_string())),
        };
        report.equal_frames += usize::from(report.difference.is_none());
        Ok(report.difference.is_none())
    })?;
    if let Some(outcome) = outcome {
        report.difference = end_difference(&end, &outcome.end());
    }
    Ok(report)
}

/// The last block and the fingerprint; finds damage before the long work begins.
fn read_through(records: &Path) -> Result<(RunEnd, String), RunError> {
    let mut reader = RecordReader::open(records)?;
    let mut last = None;
    while let Some(block) = reader.next_block()? {
        last = Some(block);
    }
    match last {
        Some(Block::End(end)) => Ok((end, reader.fingerprint().to_string())),
        _ => unreachable!("a file without its end is refused as damaged"),
    }
}

/// The other files must be those that the records speak of.
fn files_difference(
    run_dir: &Path,
    config: &str,
    summary: &RunSummary,
    end: &RunEnd,
    fingerprint: &str,
) -> Result<Option<Difference>, RunError> {
    if summary.fingerprint != fingerprint {
        return Ok(Some(Difference::whole("fingerprint in run.json", fingerprint, &summary.fingerprint)));
    }
    let files = [
        (TRAJECTORY_TXT, end.trajectory),
        (TRAJECTORY_ONLINE_TXT, end.online),
        (CONFIG_TOML, digest_of(config.as_bytes())),
    ];
    for (name, recorded) in files {
        let path = run_dir.join(name);
        let found = digest_of(&std::fs::read(&path).map_err(RunError::io(&path))?);
        if found != recorded {
            return Ok(Some(Difference::whole(name, format!("digest {recorded}"), format!("digest {found}"))));
        }
    }
    Ok(None)
}
