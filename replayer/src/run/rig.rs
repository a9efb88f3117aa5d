//! The cameras of a log as the slam takes them: which of them, and rectified.

use nalgebra::Matrix3;
use schemas::calibration::{self, CameraModel};
use schemas::topics;
use slam::Sensor;
use slam::config::SensorChoice;
use slam_math::Se3;
use slam_vision::{Camera, Distortion, GrayImage, Rectifier};

use super::RunError;
use crate::log::{Log, LogError, Timeline};

/// What the slam sees with.
pub(super) struct Rig {
    pub sensor: Sensor,
    /// The camera of the pictures that the slam gets.
    pub camera: Camera,
    /// `slam_camera_from_recorded_camera`: rectification turns the camera.
    pub slam_from_recorded: Se3,
    /// Left and right, where the log's pictures are not rectified yet.
    rectifiers: Option<[Rectifier; 2]>,
}

impl Rig {
    /// Chooses by what there is in the log, unless `choice` says what to take.
    pub fn new(log: &Log, timeline: &Timeline, choice: SensorChoice) -> Result<Self, RunError> {
        let has_depth = timeline.frames().iter().any(|frame| frame.depth_stamp().is_some());
        let has_right = timeline.frames().iter().any(|frame| frame.right_stamp().is_some());
        let missing = |what: &str, topic| {
            let what = format!("sensor.kind wants {what}, but none on {topic} goes with a picture");
            Err(LogError::missing(log.path(), what).into())
        };
        match choice {
            SensorChoice::Rgbd if !has_depth => missing("depth images", topics::DEPTH),
            SensorChoice::Stereo if !has_right => missing("right pictures", topics::RIGHT),
            SensorChoice::Auto if has_depth => Self::single(log, Sensor::Rgbd),
            SensorChoice::Auto if !has_right => Self::single(log, Sensor::Monocular),
            SensorChoice::Rgbd => Self::single(log, Sensor::Rgbd),
            SensorChoice::Monocular => Self::single(log, Sensor::Monocular),
            SensorChoice::Auto | SensorChoice::Stereo => Self::pair(log),
        }
    }

    fn single(log: &Log, sensor: Sensor) -> Result<Self, RunError> {
        let camera = slam_camera(&log.camera()?);
        Ok(Self { sensor, camera, slam_from_recorded: Se3::identity(), rectifiers: None })
    }

    fn pair(log: &Log) -> Result<Self, RunError> {
        let missing = || LogError::missing(log.path(), format!("no calibration on {}", topics::RIGHT_INFO));
        let stereo = log.stereo()?.ok_or_else(missing)?;
        let camera = slam_camera(&stereo.rectified);
        let rotation = |rows: &[f64; 9]| Matrix3::from_row_slice(rows);
        let table = |recorded: &CameraModel, rows| Rectifier::new(&slam_camera(recorded), &camera, &rotation(rows));
        let rectifiers = if stereo.is_rectified() {
            None
        } else {
            let left = table(&stereo.left, &stereo.rectified_from_left)?;
            Some([left, table(&stereo.right, &stereo.rectified_from_right)?])
        };
        let rotation = rotation(&stereo.rectified_from_left);
        let slam_from_recorded = Se3 { rotation, ..Se3::identity() }.normalized();
        Ok(Self { sensor: Sensor::Stereo { bf: stereo.bf }, camera, slam_from_recorded, rectifiers })
    }

    /// False when the slam sees the log's pictures as they are.
    pub fn rectifies(&self) -> bool {
        self.rectifiers.is_some()
    }

    /// The left (or only) picture as the slam takes it.
    pub fn left(&self, picture: GrayImage) -> GrayImage {
        match &self.rectifiers {
            Some([left, _]) => left.picture(&picture),
            None => picture,
        }
    }

    /// The right picture as the slam takes it.
    pub fn right(&self, picture: GrayImage) -> GrayImage {
        match &self.rectifiers {
            Some([_, right]) => right.picture(&picture),
            None => picture,
        }
    }

    /// Labels of the left picture as the slam takes them.
    pub fn labels(&self, ids: Vec<u16>) -> Vec<u16> {
        match &self.rectifiers {
            Some([left, _]) => left.labels(&ids),
            None => ids,
        }
    }
}

fn slam_camera(model: &CameraModel) -> Camera {
    let CameraModel { width, height, fx, fy, cx, cy, distortion } = *model;
    let distortion = match distortion {
        calibration::Distortion::None => Distortion::None,
        calibration::Distortion::Radtan { k1, k2, p1, p2, k3 } => Distortion::Radtan { k1, k2, p1, p2, k3 },
        calibration::Distortion::ModifiedRadtan { k1, k2, p1, p2, k3 } => {
            Distortion::ModifiedRadtan { k1, k2, p1, p2, k3 }
        }
    };
    Camera { fx, fy, cx, cy, width, height, distortion }
}
