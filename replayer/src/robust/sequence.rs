//! A log in memory.

use std::path::Path;

use slam::{Config, FrameInput, Sensor, Setup};

use crate::eval::{Alignment, Trajectory};
use crate::run::{RunError, frames_of};

/// The frames of a log as the slam takes them, and the truth.
#[derive(Debug, Clone)]
pub struct Sequence {
    /// In order, numbered from 0.
    pub frames: Vec<FrameInput>,
    /// The camera and the label set.
    pub setup: Setup,
    /// Path of the camera.
    pub truth: Trajectory,
}

impl Sequence {
    /// Reads a log with one of its layers, the default one if none is named. About 1.5 MiB a frame of 640 x 480.
    ///
    /// # Errors
    /// An unreadable log or frame.
    pub fn open(log: &Path, config: &Config, layer: Option<&str>) -> Result<Self, RunError> {
        let (frames, setup, truth) = frames_of(log, config, layer)?;
        Ok(Self { frames, setup, truth })
    }

    /// How its trajectories are aligned with the truth: without depth lengths have no unit.
    #[must_use]
    pub fn alignment(&self) -> Alignment {
        if self.setup.sensor == Sensor::Monocular { Alignment::Sim3 } else { Alignment::Se3 }
    }
}
