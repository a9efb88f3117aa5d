//! What a run's folder tells about its trajectory.

use anyhow::Context as _;
use replayer::eval::{Coverage, Trajectory};
use std::path::{Path, PathBuf};

/// An estimated trajectory, and what is known about where it comes from.
pub struct Estimate {
    /// The poses.
    pub trajectory: Trajectory,
    /// Tracked frames of all.
    pub coverage: Option<Coverage>,
    /// The log that was replayed.
    pub log: Option<PathBuf>,
}

impl Estimate {
    /// Reads a run's folder, or a trajectory as TUM text.
    pub fn read(run: &Path, online: bool) -> anyhow::Result<Self> {
        if !run.is_dir() {
            return Ok(Self { trajectory: Trajectory::read_tum(run)?, coverage: None, log: None });
        }
        let name = if online { "trajectory_online.txt" } else { "trajectory.txt" };
        let trajectory = Trajectory::read_tum(&run.join(name)).context("not the folder of a finished run")?;
        Ok(Self { trajectory, coverage: None, log: None })
    }
}
