//! How fast a replay is.

use std::fmt;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use slam::{FrameInput, Setup};
use slam_math::{FrameId, Stamp};
use slam_vision::Workspace;

use super::drive::{Drive, Outcome, Stepped, Stops, drive};
use super::records::{Block, RecordWriter, RunHeader};
use super::source::Source;
use super::workers::{FrameTask, Prepared, with_workers};
use super::{Progress, ReplayOptions, RunError, Timing};
use crate::eval::Trajectory;
use crate::stopwatch::{Stopwatch, resident_memory_bytes};
use crate::vocabulary::VocabularyFile;

/// How often the growth of memory is looked at.
const SIZES: usize = 10;

/// What a replay cost, and what it came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchReport {
    /// The log, or what stood for one.
    pub input: String,
    /// How the user called the configuration.
    pub config_name: String,
    /// Frames replayed.
    pub frames: usize,
    /// Frames with a pose.
    pub tracked: usize,
    /// As of a run written to disk.
    pub fingerprint: String,
    /// Opening the log: one pass over the whole file with all checks.
    pub open_s: f64,
    /// The times.
    pub timing: Timing,
    /// Memory and map on the way.
    pub growth: Vec<Size>,
}

/// How much there is at some point of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Size {
    /// Frames done.
    pub frames: usize,
    /// Resident memory of the process, MiB.
    pub resident_mib: Option<u64>,
    /// Keyframes alive.
    pub keyframes: usize,
    /// Map points alive.
    pub map_points: usize,
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { input, config_name, frames, tracked, fingerprint, open_s, timing, growth } = self;
        writeln!(f, "{input}, config {config_name}: {frames} frames, {tracked} tracked")?;
        writeln!(f, "{timing}, opening the log {open_s:.2} s")?;
        writeln!(f, "{:>10}{:>14}{:>12}{:>12}", "frames", "memory (MiB)", "keyframes", "points")?;
        for Size { frames, resident_mib, keyframes, map_points } in growth {
            let memory = resident_mib.map_or("?".to_owned(), |mib| mib.to_string());
            writeln!(f, "{frames:>10}{memory:>14}{keyframes:>12}{map_points:>12}")?;
        }
        write!(f, "fingerprint {fingerprint}")
    }
}

/// The camera's path as the map says at the end of a replay of which nothing is written. `force` and `rrd` mean nothing
/// here.
///
/// # Errors
/// As [`super::replay`], but for writing.
pub fn trajectory(log: &Path, options: &ReplayOptions, progress: Progress<'_>) -> Result<Trajectory, RunError> {
    let source = Source::open(log, options)?;
    let outcome =
        drive(&source, options.threads, options.unrest.as_ref(), Stops::default(), progress, &mut |_| Ok(true))?;
    Ok(outcome.expect("the replay is never ended early").trajectory)
}

/// Replays a log without writing anything; records are made as in a run. `force` and `rrd` mean nothing here.
///
/// # Errors
/// As [`super::replay`], but for writing.
pub fn bench(log: &Path, options: &ReplayOptions, progress: Progress<'_>) -> Result<BenchReport, RunError> {
    let mut watch = Stopwatch::start();
    let source = Source::open(log, options)?;
    let open_s = watch.lap().as_secs_f64();
    let mut meter = Meter::new(Some(source.header()), source.range.len());
    let (unrest, stops) = (options.unrest.as_ref(), Stops::default());
    let outcome = drive(&source, options.threads, unrest, stops, progress, &mut |s| meter.frame(s))?;
    Ok(meter.finish(log.display().to_string(), options, open_s, &outcome.expect("the replay is never ended early")))
}

/// Replays `count` frames that run through a few given ones forth and back, again and again, at 30 Hz: what a long log
/// would need, without the log. Decoding is left out. Of the options, `config`, `threads` and `unrest` count.
///
/// # Errors
/// Pictures that do not fit the calibration.
pub fn bench_looped(
    name: &str,
    frames: &[FrameInput],
    setup: &Setup,
    count: usize,
    options: &ReplayOptions,
    progress: Progress<'_>,
) -> Result<BenchReport, RunError> {
    let vocabulary = VocabularyFile::named(&options.config.looping.vocabulary)?.map(|file| file.vocabulary);
    let drive = Drive::new(&options.config, setup, vocabulary, count)?;
    let front_end = drive.slam.front_end().clone();
    let mut feed = (0..count).map(|index| {
        let front_end = &front_end;
        Ok(Box::new(move |workspace: &mut Workspace| {
            let mut watch = Stopwatch::start();
            let (id, stamp) = (FrameId::from(index), Stamp(index as i64 * 1_000_000_000 / 30));
            let input = FrameInput { id, stamp, ..frames[forth_and_back(index, frames.len())].clone() };
            let decode_time = watch.lap();
            let observation = Arc::new(front_end.observe(&input, workspace)?);
            let features_time = watch.lap();
            Ok(Prepared { input, observation, color: None, events: Vec::new(), decode_time, features_time })
        }) as FrameTask<'_>)
    });
    let mut meter = Meter::new(None, count);
    let outcome = with_workers(options.threads, options.unrest.as_ref(), &mut feed, |foreman| {
        drive.run(options.threads, foreman, progress, &mut |s| meter.frame(s))
    })?;
    Ok(meter.finish(name.to_owned(), options, 0.0, &outcome.expect("the replay is never ended early")))
}

/// 0, 1, ... n - 1, n - 2, ... 1, 0, 1, ...
fn forth_and_back(index: usize, n: usize) -> usize {
    let turn = (2 * n).saturating_sub(2).max(1);
    let at = index % turn;
    at.min(turn - at)
}

/// Watches a replay.
struct Meter {
    writer: RecordWriter,
    frames: usize,
    growth: Vec<Size>,
}

impl Meter {
    fn new(header: Option<RunHeader>, frames: usize) -> Self {
        let mut writer = RecordWriter::default();
        header.into_iter().for_each(|header| drop(writer.block(&Block::Header(header))));
        Self { writer, frames, growth: Vec::new() }
    }

    fn frame(&mut self, stepped: &Stepped<'_>) -> Result<bool, RunError> {
        self.writer.block(&Block::Frame(stepped.entry.clone()));
        let done = stepped.report.id.index() + 1;
        if done * SIZES / self.frames > (done - 1) * SIZES / self.frames {
            let resident_mib = resident_memory_bytes().map(|bytes| bytes >> 20);
            let (keyframes, map_points) = (stepped.slam.map().keyframe_count(), stepped.slam.map().point_count());
            self.growth.push(Size { frames: done, resident_mib, keyframes, map_points });
        }
        Ok(true)
    }

    fn finish(mut self, input: String, options: &ReplayOptions, open_s: f64, outcome: &Outcome) -> BenchReport {
        self.writer.block(&Block::End(outcome.end()));
        BenchReport {
            input,
            config_name: options.config_name.clone(),
            frames: outcome.result.frames,
            tracked: outcome.result.tracked,
            fingerprint: self.writer.fingerprint().to_string(),
            open_s: (open_s * 1e3).round() / 1e3,
            timing: outcome.timing.clone(),
            growth: self.growth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loop_has_no_jumps() {
        let order = |n| (0..8).map(|i| forth_and_back(i, n)).collect::<Vec<_>>();
        assert_eq!(order(4), [0, 1, 2, 3, 2, 1, 0, 1]);
        assert_eq!(order(2), [0, 1, 0, 1, 0, 1, 0, 1]);
        assert_eq!(order(1), [0; 8]);
    }
}
