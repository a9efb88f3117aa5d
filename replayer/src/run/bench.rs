//! How fast a replay is.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::drive::drive;
use super::records::{Block, RecordWriter};
use super::source::Source;
use super::{Progress, ReplayOptions, RunError, Timing};
use crate::eval::Trajectory;
use crate::log::Log;

/// What a replay cost, and what it came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// The log.
    pub log: PathBuf,
    /// How the user called the configuration.
    pub config_name: String,
    /// Frames replayed.
    pub frames: usize,
    /// Frames with a pose.
    pub tracked: usize,
    /// As of a run written to disk.
    pub fingerprint: String,
    /// The times.
    pub timing: Timing,
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { log, config_name, frames, tracked, fingerprint, timing } = self;
        writeln!(f, "{}, config {config_name}: {frames} frames, {tracked} tracked", log.display())?;
        writeln!(f, "{timing}")?;
        write!(f, "fingerprint {fingerprint}")
    }
}

/// The camera's path as the map says at the end of a replay of which nothing is written. `force` and `rrd` mean nothing
/// here.
///
/// # Errors
/// As [`super::replay`], but for writing.
pub fn trajectory(log: &Path, options: &ReplayOptions, progress: Progress<'_>) -> Result<Trajectory, RunError> {
    let source = Source::new(Log::open(log)?, &options.config, options.layer.as_deref(), options.frames.clone())?;
    let outcome = drive(&source, options.threads, options.unrest.as_ref(), progress, &mut |_| Ok(true))?;
    Ok(outcome.expect("the replay is never ended early").trajectory)
}

/// Replays a log without writing anything; records are made as in a run. `force` and `rrd` mean nothing here.
///
/// # Errors
/// As [`super::replay`], but for writing.
pub fn bench(log: &Path, options: &ReplayOptions, progress: Progress<'_>) -> Result<BenchReport, RunError> {
    let source = Source::new(Log::open(log)?, &options.config, options.layer.as_deref(), options.frames.clone())?;
    let mut writer = RecordWriter::default();
    writer.block(&Block::Header(source.header()));
    let outcome = drive(&source, options.threads, options.unrest.as_ref(), progress, &mut |stepped| {
        writer.block(&Block::Frame(stepped.entry.clone()));
        Ok(true)
    })?;
    let outcome = outcome.expect("the replay is never ended early");
    writer.block(&Block::End(outcome.end()));
    Ok(BenchReport {
        log: log.to_owned(),
        config_name: options.config_name.clone(),
        frames: outcome.result.frames,
        tracked: outcome.result.tracked,
        fingerprint: writer.fingerprint().to_string(),
        timing: outcome.timing,
    })
}
