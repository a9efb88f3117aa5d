//! Ground truth from wherever it stands.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::eval::{EvalError, Trajectory};
use crate::log::{Log, LogError};

/// Why there is no ground truth.
#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    /// The text file cannot be read.
    #[error(transparent)]
    Text(#[from] EvalError),
    /// The log cannot be read, or has none.
    #[error(transparent)]
    Log(#[from] LogError),
}

/// Ground truth from a log, or from a TUM text file (`groundtruth.txt`); which of them it is, its first bytes tell.
///
/// # Errors
/// A file that is neither, is damaged, or holds no pose.
pub fn read_truth(path: &Path) -> Result<Trajectory, TruthError> {
    let mut magic = [0; mcap::MAGIC.len()];
    let is_log = File::open(path).and_then(|mut file| file.read_exact(&mut magic)).is_ok() && magic == mcap::MAGIC;
    if !is_log {
        return Ok(Trajectory::read_tum(path)?);
    }
    let truth = Log::open(path)?.ground_truth().clone();
    if truth.poses.is_empty() {
        let topic = schemas::topics::GROUND_TRUTH;
        let what =
            format!("no ground truth on {topic} and no single mocap body; give a text file, or `pslam sync` the log");
        return Err(LogError::missing(path, what).into());
    }
    Ok(truth)
}
