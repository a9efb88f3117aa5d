//! How much does a result depend on what must not matter?
//!
//! A [`Sequence`] is a log's frames in memory; a [`Perturbation`] changes it in a way that leaves the camera's path as easy
//! to find as it was; [`judge`] replays it and compares with the truth, which is changed alike.

mod labels;
mod parallel;
mod perturbation;
mod sequence;

use serde::Serialize;
use slam::Config;

pub use parallel::{Verdict, judge_all};
pub use perturbation::Perturbation;
pub use sequence::Sequence;

use crate::eval::{Alignment, EvalError, EvalOptions, Statistics, Trajectory, evaluate};
use crate::run::{RunError, replay_frames};

/// Truth within so many metres of its mean is a camera that stands still: there is no path to align.
const STILL_M: f64 = 0.005;

/// What a replay of a perturbed sequence came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judged {
    /// Frames replayed.
    pub frames: usize,
    /// Of them with a pose in the final trajectory.
    pub tracked: usize,
    /// Error of the final trajectory.
    pub error_m: Statistics,
    /// The same of the trajectory as it was known at each frame.
    pub online_m: Statistics,
    /// The same of the trajectory as the last frame left it, before the final stage.
    pub unrefined_m: Statistics,
}

/// Why a sequence has no errors.
#[derive(Debug, thiserror::Error)]
pub enum JudgeError {
    /// It cannot be replayed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// Too little is left to compare.
    #[error(transparent)]
    Eval(#[from] EvalError),
}

/// Replays a sequence and compares its trajectories with the truth: positions after alignment, or around their mean where the
/// camera stands still.
///
/// # Errors
/// As a replay, or when too few poses are left to compare.
pub fn judge(sequence: &Sequence, config: &Config, threads: usize) -> Result<Judged, JudgeError> {
    let done = replay_frames(&sequence.frames, &sequence.setup, config, threads)?;
    let error = |path: &Trajectory| error_of(&sequence.truth, path, sequence.alignment());
    Ok(Judged {
        frames: sequence.frames.len(),
        tracked: done.result.in_trajectory,
        error_m: error(&done.trajectory)?,
        online_m: error(&done.online)?,
        unrefined_m: error(&done.unrefined)?,
    })
}

fn error_of(truth: &Trajectory, path: &Trajectory, alignment: Alignment) -> Result<Statistics, EvalError> {
    if !is_still(truth) {
        let options = EvalOptions { alignment, rpe: Vec::new(), ..EvalOptions::default() };
        return Ok(evaluate(truth, path, None, &options)?.ate_m);
    }
    let n = path.poses.len() as f64;
    let positions = || path.poses.iter().map(|pose| pose.world_from_camera.translation);
    let mean = positions().fold(nalgebra::Vector3::zeros(), |sum, p| sum + p) / n;
    let from_mean: Vec<f64> = positions().map(|p| (p - mean).norm()).collect();
    Statistics::of(&from_mean).ok_or(EvalError::Degenerate { pairs: path.poses.len() })
}

/// Without truth nobody knows.
fn is_still(truth: &Trajectory) -> bool {
    let Some(first) = truth.poses.first() else { return false };
    let start = first.world_from_camera.translation;
    truth.poses.iter().all(|pose| (pose.world_from_camera.translation - start).norm() < STILL_M)
}
