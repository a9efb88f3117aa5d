//! What a run's folder tells about its trajectory.

use anyhow::Context as _;
use replayer::eval::{Coverage, Trajectory};
use replayer::run::{MapFrames, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT};
use std::path::{Path, PathBuf};

/// An estimated trajectory, and what is known about where it comes from.
pub struct Estimate {
    /// The poses.
    pub trajectory: Trajectory,
    /// Frames in the trajectory, of all.
    pub coverage: Option<Coverage>,
    /// The log that was replayed.
    pub log: Option<PathBuf>,
    /// What the run saw with.
    pub sensor: Option<String>,
    /// Maps that were never joined to the one whose trajectory this is.
    pub never_joined: Vec<MapFrames>,
}

impl Estimate {
    /// Reads a run's folder, or a trajectory as TUM text.
    pub fn read(run: &Path, online: bool) -> anyhow::Result<Self> {
        if !run.is_dir() {
            let trajectory = Trajectory::read_tum(run)?;
            return Ok(Self { trajectory, coverage: None, log: None, sensor: None, never_joined: Vec::new() });
        }
        let summary = RunSummary::read(run).context("not the folder of a finished run")?;
        let name = if online { TRAJECTORY_ONLINE_TXT } else { TRAJECTORY_TXT };
        let trajectory = Trajectory::read_tum(&run.join(name))?;
        // Frames of other maps than the written one do not count: they are not judged.
        let coverage = Coverage { tracked: trajectory.poses.len(), frames: summary.result.frames };
        let main = summary.result.main_map;
        let never_joined = summary.result.maps.into_iter().filter(|part| Some(part.map) != main).collect();
        let (log, sensor) = (Some(summary.log), Some(summary.result.sensor));
        Ok(Self { trajectory, coverage: Some(coverage), log, sensor, never_joined })
    }
}
