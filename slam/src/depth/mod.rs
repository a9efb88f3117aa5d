//! How good measured depth is, found out on the way: by points that pixels alone fix as well.
//!
//! The configuration's noise model is where it starts. Local mapping compares each depth of a keyframe with where the pixels of
//! all keyframes put the point; what is left after their own uncertainty is the noise of depth, per range of distance, with all
//! that makes depth wrong there: the sensor, its registration to the picture, smooth bias. A common factor on all lengths can't
//! show: the map takes it over.

mod fit;
mod view;

pub use fit::{DepthFit, Estimated, Miscalibration, Normal, Residual};
pub use view::{DepthView, Motion, Slope};

use serde::{Deserialize, Serialize};
use slam_math::float;

/// Middles of the ranges, metres.
const MIDDLES_M: [f64; RANGES] = [0.75, 1.25, 1.75, 2.25, 2.75, 3.5, 4.75, 6.5];
const RANGES: usize = 8;
/// The configured model counts as so many comparisons.
const PRIOR: f64 = 100.0;
/// Comparisons after which older ones fade: a sensor warms up, a scene changes.
const MEMORY: f64 = 20_000.0;
/// Bounds of the factor on the configured standard deviation. While frames come in depth is never believed more than configured:
/// what is wrong with it is wrong for many points at once (registration, smooth bias), and no point's own residual shows that.
/// With 0.5 as the lower bound the rendered worlds gain a fifth, but a kitchen's static sequence has 11.2 mm instead of 6.0.
const FACTORS: [f64; 2] = [1.0, 4.0];

/// Sums over comparisons in one range of distance.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RangeSums {
    /// Comparisons.
    pub count: f64,
    /// Squared differences beyond those that pixels explain, over the configured variance.
    pub variance: f64,
    /// Measured minus triangulated depth, over the depth.
    pub bias: f64,
}

/// What is known about the noise of depth; as a [`Default`], nothing beyond the configuration.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthModel {
    ranges: [RangeSums; RANGES],
    /// What is wrong everywhere.
    fit: DepthFit,
    /// What of it was told, a bit each.
    told: u8,
}

/// What one keyframe tells.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthFound {
    /// Depths compared, range by range.
    pub model: DepthModel,
    /// Against pixels alone, one keyframe's.
    pub normal: Normal,
}

impl DepthModel {
    /// A comparison: depth as measured and as pixels have it, metres, the variance of the latter, and the configured variance
    /// of the former, square metres. What is beyond three sigmas of both counts as three: mismatches are no noise.
    pub fn compare(&mut self, measured_m: f64, triangulated_m: f64, variance: f64, configured: f64) {
        let difference = measured_m - triangulated_m;
        let most = 9.0 * (configured + variance);
        let sums = &mut self.ranges[nearest_range(triangulated_m)];
        sums.count += 1.0;
        sums.variance += (float::min(difference * difference, most) - variance) / configured;
        sums.bias += difference / triangulated_m;
    }

    /// Adds the comparisons of another.
    pub fn add(&mut self, other: &Self) {
        for (sums, other) in self.ranges.iter_mut().zip(&other.ranges) {
            sums.count += other.count;
            sums.variance += other.variance;
            sums.bias += other.bias;
            if sums.count > MEMORY {
                let fade = MEMORY / sums.count;
                *sums = RangeSums { count: MEMORY, variance: sums.variance * fade, bias: sums.bias * fade };
            }
        }
    }

    /// Adds the comparisons of one keyframe. Returns what is known now and was not told before, for the user.
    pub fn learn(&mut self, found: &DepthFound) -> Vec<String> {
        self.add(&found.model);
        self.fit.add(&found.normal);
        let known = self.miscalibration();
        let mut news = Vec::new();
        for (number, text) in known.iter().flat_map(Miscalibration::told) {
            if self.told & 1 << number == 0 {
                self.told |= 1 << number;
                news.push(text);
            }
        }
        news
    }

    /// What is wrong with depth in the same way everywhere; none while too little is known.
    #[must_use]
    pub fn miscalibration(&self) -> Option<Miscalibration> {
        self.fit.solve()
    }

    /// Whether nothing was compared.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ranges.iter().all(|sums| sums.count == 0.0)
    }

    /// Factor on the configured standard deviation at a depth in metres.
    #[must_use]
    pub fn factor(&self, depth_m: f64) -> f64 {
        let range = MIDDLES_M.iter().position(|middle| depth_m < *middle).unwrap_or(RANGES);
        let at = |range: usize| {
            let sums = &self.ranges[range];
            let variance = float::max(0.0, PRIOR + sums.variance) / (PRIOR + sums.count);
            float::min(float::max(variance.sqrt(), FACTORS[0]), FACTORS[1])
        };
        match range {
            0 => at(0),
            RANGES => at(RANGES - 1),
            _ => {
                let share = (depth_m - MIDDLES_M[range - 1]) / (MIDDLES_M[range] - MIDDLES_M[range - 1]);
                at(range - 1) * (1.0 - share) + at(range) * share
            }
        }
    }

    /// The ranges: middle in metres, and what was compared there.
    pub fn ranges(&self) -> impl Iterator<Item = (f64, RangeSums)> {
        MIDDLES_M.into_iter().zip(self.ranges)
    }
}

fn nearest_range(depth_m: f64) -> usize {
    let between = |range: &usize| depth_m < (MIDDLES_M[*range] + MIDDLES_M[*range + 1]) / 2.0;
    (0..RANGES - 1).find(between).unwrap_or(RANGES - 1)
}
