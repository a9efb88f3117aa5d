//! Replays of frames that are in memory.

use std::path::Path;
use std::sync::Arc;

use slam::{Config, FrameInput, Setup};
use slam_vision::Workspace;

use super::drive::{Drive, Outcome};
use super::source::Source;
use super::workers::{FrameTask, Prepared, with_workers};
use super::{ReplayOptions, RunError};
use crate::eval::Trajectory;
use crate::stopwatch::Stopwatch;
use crate::vocabulary::VocabularyFile;

/// All frames of a log, decoded, what is known before the first one, and the ground truth.
pub(crate) fn frames_of(
    log: &Path,
    config: &Config,
    layer: Option<&str>,
) -> Result<(Vec<FrameInput>, Setup, Trajectory), RunError> {
    let options = ReplayOptions { config: config.clone(), layer: layer.map(str::to_owned), ..ReplayOptions::default() };
    let source = Source::open(log, &options)?;
    let frames = source.timeline.stream(source.range.clone())?.map(|raw| Ok(source.input(&raw?)?.0));
    let frames = frames.collect::<Result<Vec<_>, RunError>>()?;
    Ok((frames, source.setup.clone(), source.log.ground_truth().clone()))
}

/// Replays frames without a log and without writing anything.
pub(crate) fn replay_frames(
    frames: &[FrameInput],
    setup: &Setup,
    config: &Config,
    threads: usize,
) -> Result<Outcome, RunError> {
    let vocabulary = VocabularyFile::named(&config.looping.vocabulary)?.map(|file| file.vocabulary);
    let drive = Drive::new(config, setup, vocabulary, frames.len())?;
    let front_end = drive.slam.front_end().clone();
    let mut feed = frames.iter().map(|input| {
        let front_end = &front_end;
        Ok(Box::new(move |workspace: &mut Workspace| {
            let mut watch = Stopwatch::start();
            let observation = Arc::new(front_end.observe(input, workspace)?);
            let (input, events, decode_time) = (input.clone(), Vec::new(), std::time::Duration::ZERO);
            Ok(Prepared { input, observation, color: None, events, decode_time, features_time: watch.lap() })
        }) as FrameTask<'_>)
    });
    let outcome = with_workers(threads, None, &mut feed, |foreman| {
        drive.run(threads, foreman, &mut |_, _| {}, &mut |_| Ok(true))
    })?;
    Ok(outcome.expect("the replay is never ended early"))
}
