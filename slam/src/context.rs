//! What every stage may read: configuration, calibration and tables made from them once.

use nalgebra::Vector3;
use slam_math::{Buffers, float};
use slam_optimize::{DepthCamera, Measurement, Pinhole};
use slam_vision::Camera;

use crate::config::Config;
use crate::depth::DepthModel;
use crate::input::{Category, Sensor, Setup};
use crate::observation::Observation;

/// 95 % of chi-square with 2 degrees of freedom: a pixel.
pub const CHI2_2: f64 = 5.991;
/// 95 % of chi-square with 3 degrees of freedom: a pixel and its depth.
pub const CHI2_3: f64 = 7.815;

/// Configuration and calibration, with the tables made from them.
#[derive(Debug, Clone)]
pub struct Context {
    /// The constants.
    pub config: Config,
    /// The camera.
    pub camera: Camera,
    /// Where depth comes from.
    pub sensor: Sensor,
    /// Baseline times focal length, metres x pixels: of a stereo camera its own, else the virtual one that turns depth
    /// into a disparity.
    pub bf: f64,
    /// Its undistorted pinhole.
    pub pinhole: Pinhole,
    /// The label set, sorted by id.
    pub categories: Vec<Category>,
    /// Categories that are filtered a priori.
    pub people: Vec<u16>,
    /// Scale of each pyramid level.
    pub scales: Vec<f64>,
    /// Depth up to which one view fixes a point, metres.
    pub close_m: f64,
    /// What the run has found out about the noise of depth so far.
    pub depth: DepthModel,
    /// Factor on the information of measured depth; 1 but where the final stage finds out what depth is worth.
    pub depth_weight: f64,
    /// Where stages take the memory of their lists from.
    pub buffers: Buffers,
}

impl Context {
    /// Builds the tables.
    #[must_use]
    pub fn new(config: &Config, setup: &Setup, scales: &[f64]) -> Self {
        let (camera, sensor) = (setup.camera, setup.sensor);
        let bf = if let Sensor::Stereo { bf } = sensor { bf } else { config.sensor.bf };
        let mut categories = setup.categories.clone();
        categories.sort_by_key(|c| c.id);
        let is_person = |c: &&Category| config.panoptic.people_names.contains(&c.name);
        Self {
            config: config.clone(),
            camera,
            sensor,
            bf,
            pinhole: Pinhole { fx: camera.fx, fy: camera.fy, cx: camera.cx, cy: camera.cy },
            people: categories.iter().filter(is_person).map(|c| c.id).collect(),
            categories,
            scales: scales.to_vec(),
            close_m: config.sensor.close_baselines * bf / camera.fx,
            depth: DepthModel::default(),
            depth_weight: 1.0,
            buffers: Buffers::default(),
        }
    }

    /// Whether a category is a Thing; a category that the label set does not name counts as one.
    #[must_use]
    pub fn is_thing(&self, category: u16) -> bool {
        self.categories.binary_search_by_key(&category, |c| c.id).map_or(true, |i| self.categories[i].is_thing)
    }

    /// True when lengths have no unit, so that no distance in metres means anything.
    #[must_use]
    pub fn is_monocular(&self) -> bool {
        self.sensor == Sensor::Monocular
    }

    /// Standard deviation of a depth measured on pyramid level 0, metres.
    #[must_use]
    pub fn depth_sigma(&self, depth_m: f64) -> f64 {
        match self.sensor {
            Sensor::Stereo { bf } => depth_m * depth_m / bf * self.config.stereo.sigma_px,
            Sensor::Rgbd | Sensor::Monocular => self.config.sensor.depth_sigma(depth_m) * self.depth.factor(depth_m),
        }
    }

    /// How much farther than a surface at this depth a measurement must be to have gone through it, metres: where that was, is
    /// free space. What is nearer to the surface than this, on either side, is the surface itself.
    #[must_use]
    pub fn free_space_margin(&self, depth_m: f64) -> f64 {
        let m = &self.config.panoptic.motion;
        m.free_space_m + m.free_space_sigmas * self.depth_sigma(depth_m)
    }

    /// Standard deviation of the disparity `bf / z` of a depth, pixels. A stereo match is as fine as the pixels of the
    /// level it was made on.
    fn disparity_sigma(&self, depth_m: f64, scale: f64) -> f64 {
        match self.sensor {
            Sensor::Stereo { .. } => self.config.stereo.sigma_px * scale,
            Sensor::Rgbd | Sensor::Monocular => self.bf * self.depth_sigma(depth_m) / (depth_m * depth_m),
        }
    }

    /// Keypoint `i` as the optimisers want it: pixel noise grows with the pyramid level, depth noise with the sensor's
    /// model (as noise of the disparity `bf / z`).
    #[must_use]
    pub fn measurement(&self, obs: &Observation, i: usize) -> Measurement {
        self.measure(obs.pixel[i], obs.octave[i], obs.depth(i))
    }

    /// The same of an undistorted pixel on a pyramid level, with its depth in metres where that was measured.
    #[must_use]
    pub fn measure(&self, pixel: [f64; 2], octave: u8, depth: Option<f64>) -> Measurement {
        let scale = self.scales[usize::from(octave)];
        let disparity_sigma = depth.map_or(1.0, |z| self.disparity_sigma(z, scale));
        Measurement {
            pixel,
            disparity: depth.map(|z| self.bf / z),
            weight: 1.0 / (scale * scale),
            weight_disparity: self.depth_weight / (disparity_sigma * disparity_sigma),
        }
    }

    /// Whether a point (camera frame, metres) lies on keypoint `i` within the noise of pixel and depth, at 95 %.
    #[must_use]
    pub fn fits(&self, obs: &Observation, i: usize, in_camera: &Vector3<f64>) -> bool {
        let m = self.measurement(obs, i);
        let limit = if m.disparity.is_some() { CHI2_3 } else { CHI2_2 };
        let camera = DepthCamera { pinhole: self.pinhole, bf: self.bf };
        camera.chi2(in_camera, &m).is_some_and(|chi2| chi2 <= limit)
    }

    /// Pyramid level at which a point with this farthest distance appears at distance `d`.
    #[must_use]
    pub fn predict_octave(&self, farthest_m: f64, d: f64) -> u8 {
        let level = float::ln(farthest_m / d) / float::ln(self.config.orb.scale_factor);
        level.ceil().clamp(0.0, (self.scales.len() - 1) as f64) as u8
    }

    /// Distances `[nearest, farthest]` at which a point seen at distance `d` on a level can be seen on some level.
    #[must_use]
    pub fn range_of(&self, d: f64, octave: u8) -> [f64; 2] {
        let farthest = d * self.scales[usize::from(octave)];
        [farthest / self.scales[self.scales.len() - 1], farthest]
    }
}
