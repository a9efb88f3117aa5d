//! Where depth comes from.

use serde::{Deserialize, Serialize};

sections! {
    /// The sensor, and the depth image.
    SensorConfig {
        /// What to use of what a log holds; read by whoever opens the log.
        kind: SensorChoice,
        /// Virtual baseline times focal length, pixels x metres.
        bf: f64,
        /// Depth up to which a single view fixes a point, in virtual baselines.
        close_baselines: f64,
        /// Constant part of the depth noise, metres.
        sigma_base_m: f64,
        /// Quadratic part of the depth noise, 1/metres.
        sigma_quadratic: f64,
        /// Find out on the way how good depth is; the values above are where that starts.
        learn_noise: bool,
        /// Nearest trusted depth, metres.
        min_depth_m: f64,
        /// Farthest trusted depth, metres.
        max_depth_m: f64,
        /// Side of the window read at a keypoint, pixels, odd.
        depth_window_px: u32,
        /// Share of the depth that a slanted surface may change within the window.
        depth_step_share: f64,
    }

    /// Depth from two rectified pictures.
    StereoConfig {
        /// Hamming distance of a match along a row.
        hamming: u32,
        /// How far the rows of a match may differ on level 0, pixels.
        row_px: f64,
        /// Half side of the window that is compared for the last fraction of a pixel.
        window_px: u32,
        /// How far that window slides to either side, pixels.
        slide_px: u32,
        /// Matches whose windows differ by more than this times the median are dropped.
        outlier_factor: f64,
        /// Standard deviation of a disparity on level 0, pixels.
        sigma_px: f64,
    }

    /// The start of a map without depth.
    MonocularConfig {
        /// Usable keypoints that both views must have, and matches between them.
        min_matches: u32,
        /// Search radius between the two views, pixels.
        search_px: f64,
        /// Best over second best distance.
        ratio: f64,
        /// RANSAC draws.
        iterations: usize,
        /// Standard deviation of a keypoint in the two-view geometry, pixels.
        sigma_px: f64,
        /// Angle between the rays that a good share of the points must have, degrees.
        min_parallax_deg: f64,
        /// Points that the first map must have.
        min_points: u32,
        /// Camera motion over median depth below which two keyframes make no points.
        min_baseline_share: f64,
        /// Weight (observations) that a young point needs.
        min_weight: u32,
        /// Neighbours for triangulation.
        neighbours: usize,
        /// Share of the reference keyframe's points below which a keyframe is due.
        tracked_share: f64,
    }
}

/// What to use of what a log holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SensorChoice {
    /// Depth images if there are any, else a second picture if there is one, else one picture.
    Auto,
    /// Depth images.
    Rgbd,
    /// Two pictures.
    Stereo,
    /// One picture.
    Monocular,
}

impl SensorConfig {
    /// Standard deviation of a depth measurement, metres.
    #[must_use]
    pub fn depth_sigma(&self, depth_m: f64) -> f64 {
        self.sigma_base_m + self.sigma_quadratic * depth_m * depth_m
    }
}
