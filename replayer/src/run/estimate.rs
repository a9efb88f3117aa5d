//! What a run's folder tells about its trajectory.

use std::path::{Path, PathBuf};

use super::{MapFrames, RunError, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT};
use crate::eval::{Coverage, EvalError, Trajectory};

/// An estimated trajectory, and what is known about where it comes from.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The poses.
    pub trajectory: Trajectory,
    /// Frames in the trajectory, of all; of a run only.
    pub coverage: Option<Coverage>,
    /// The log that was replayed, where it was then; of a run only.
    pub log: Option<PathBuf>,
    /// What the run saw with, as in [`RunResult::sensor`](super::RunResult).
    pub sensor: Option<String>,
    /// Maps that were never joined to the one whose trajectory this is.
    pub never_joined: Vec<MapFrames>,
}

impl Estimate {
    /// Reads a run's folder, or a trajectory as TUM text; `online` takes the poses as they were known at each frame.
    ///
    /// # Errors
    /// No run, no trajectory, or one without a pose.
    pub fn read(run: &Path, online: bool) -> Result<Self, RunError> {
        if !run.is_dir() {
            let trajectory = Trajectory::read_tum(run)?;
            return Ok(Self { trajectory, coverage: None, log: None, sensor: None, never_joined: Vec::new() });
        }
        Self::of_run(run, &RunSummary::read(run)?, online)
    }

    /// The same, of a run whose summary is at hand.
    pub(crate) fn of_run(run: &Path, summary: &RunSummary, online: bool) -> Result<Self, RunError> {
        let name = if online { TRAJECTORY_ONLINE_TXT } else { TRAJECTORY_TXT };
        let trajectory = match Trajectory::read_tum(&run.join(name)) {
            // A run that was lost throughout is a run.
            Err(EvalError::Empty { .. }) if summary.result.in_trajectory == 0 => Trajectory::default(),
            read => read?,
        };
        // Frames of other maps than the written one do not count: they are not judged.
        let coverage = Coverage { tracked: trajectory.poses.len(), frames: summary.result.frames };
        let main = summary.result.main_map;
        let never_joined = summary.result.maps.iter().filter(|part| Some(part.map) != main).copied().collect();
        let (log, sensor) = (Some(summary.log.clone()), Some(summary.result.sensor.clone()));
        Ok(Self { trajectory, coverage: Some(coverage), log, sensor, never_joined })
    }
}
