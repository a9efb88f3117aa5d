//! Relative pose error: how far the estimated motion between two instants is from the true one. Blind to where the
//! error began, so it measures drift.

use schemas::Stamp;
use serde::{Deserialize, Serialize};

use super::trajectory::step_m;
use super::{EvalError, StampedPose, Statistics};

/// What the distance between the two poses of a pair is counted in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DeltaUnit {
    /// Path length of the estimate, metres.
    Metres,
    /// Paired poses.
    Frames,
    /// Time between the stamps of the estimate.
    Seconds,
}

/// Which pairs of poses are compared.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RpeOptions {
    /// Distance between the two poses of a pair, above 0; whole for frames.
    pub delta: f64,
    /// Its unit.
    pub unit: DeltaUnit,
    /// A pair from every pose on; otherwise each pair starts where the one before ended.
    pub all_pairs: bool,
    /// With `all_pairs` in metres or seconds: how far a pair's distance may be from `delta`, as a share of it.
    pub relative_tolerance: f64,
}

impl RpeOptions {
    /// Consecutive pairs, tolerance 0.1.
    #[must_use]
    pub fn new(delta: f64, unit: DeltaUnit) -> Self {
        Self { delta, unit, all_pairs: false, relative_tolerance: 0.1 }
    }

    fn validate(&self) -> Result<(), EvalError> {
        let whole = self.delta.fract() == 0.0 && self.delta <= f64::from(u32::MAX);
        if self.delta > 0.0 && self.delta.is_finite() && (self.unit != DeltaUnit::Frames || whole) {
            return Ok(());
        }
        Err(EvalError::Option(format!("delta {} {:?}: must be above 0, and whole for frames", self.delta, self.unit)))
    }

    /// Index pairs into the estimate.
    fn pairs(&self, poses: &[StampedPose]) -> Vec<(usize, usize)> {
        let step = |i: usize| match self.unit {
            DeltaUnit::Metres => step_m(&poses[i - 1], &poses[i]),
            DeltaUnit::Frames => 1.0,
            DeltaUnit::Seconds => (poses[i].stamp.0 - poses[i - 1].stamp.0) as f64 * 1e-9,
        };
        let steps = (1..poses.len()).map(step);
        if self.all_pairs { self.all_pairs(steps) } else { self.consecutive_pairs(steps) }
    }

    fn consecutive_pairs(&self, steps: impl Iterator<Item = f64>) -> Vec<(usize, usize)> {
        let (mut pairs, mut start, mut travelled) = (Vec::new(), 0, 0.0);
        for (end, step) in (1..).zip(steps) {
            travelled += step;
            if travelled >= self.delta {
                pairs.push((start, end));
                (start, travelled) = (end, 0.0);
            }
        }
        pairs
    }

    fn all_pairs(&self, steps: impl Iterator<Item = f64>) -> Vec<(usize, usize)> {
        let mut along = vec![0.0];
        along.extend(steps.scan(0.0, |sum, step| {
            *sum += step;
            Some(*sum)
        }));
        let tolerance = if self.unit == DeltaUnit::Frames { 0.0 } else { self.delta * self.relative_tolerance };
        let mut pairs = Vec::new();
        for start in 0..along.len().saturating_sub(1) {
            let off = |end: usize| (along[end] - along[start] - self.delta).abs();
            // `along` never falls: the nearest is at the first entry not short of delta, or just before it.
            let reach = start + 1 + along[start + 1..].partition_point(|a| a - along[start] < self.delta);
            let first_equal = |end: usize| start + 1 + along[start + 1..].partition_point(|a| *a < along[end]);
            let before = (reach > start + 1).then(|| first_equal(reach - 1));
            let after = (reach < along.len()).then_some(reach);
            let nearest = match (before, after) {
                (Some(before), Some(after)) => {
                    if off(before) <= off(after) {
                        before
                    } else {
                        after
                    }
                }
                (Some(only), None) | (None, Some(only)) => only,
                (None, None) => continue,
            };
            if off(nearest) <= tolerance {
                pairs.push((start, nearest));
            }
        }
        pairs
    }
}

/// Relative pose error over one kind of pairs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RpeResult {
    /// Which pairs.
    pub options: RpeOptions,
    /// Translation part of the error, metres; `None` when the trajectory has no such pair.
    pub translation_m: Option<Statistics>,
    /// Rotation angle of the error, degrees.
    pub rotation_deg: Option<Statistics>,
    /// One entry a pair: stamp of its second pose and translation error, metres; for plots.
    #[serde(skip)]
    pub samples: Vec<(Stamp, f64)>,
}

/// Compares motions over pairs of poses; both slices are paired by position.
pub(crate) fn relative_error(
    truth: &[StampedPose],
    estimate: &[StampedPose],
    options: &RpeOptions,
) -> Result<RpeResult, EvalError> {
    options.validate()?;
    let motion = |poses: &[StampedPose], (i, j): (usize, usize)| {
        poses[i].world_from_camera.inverse() * poses[j].world_from_camera
    };
    let (mut translation_m, mut rotation_deg, mut samples) = (Vec::new(), Vec::new(), Vec::new());
    for pair in options.pairs(estimate) {
        let error = motion(truth, pair).inverse() * motion(estimate, pair);
        translation_m.push(error.translation.norm());
        rotation_deg.push(error.angle().to_degrees());
        samples.push((estimate[pair.1].stamp, error.translation.norm()));
    }
    Ok(RpeResult {
        options: *options,
        translation_m: Statistics::of(&translation_m),
        rotation_deg: Statistics::of(&rotation_deg),
        samples,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use slam_math::Se3;

    /// A walk along x with these steps, one pose each 100 ms.
    fn walk(steps: &[f64]) -> Vec<StampedPose> {
        let mut x = 0.0;
        let mut poses = Vec::new();
        for (i, step) in (0i64..).zip(std::iter::once(&0.0).chain(steps)) {
            x += step;
            let world_from_camera = Se3 { translation: Vector3::new(x, 0.0, 0.0), ..Se3::identity() };
            poses.push(StampedPose { stamp: Stamp(i * 100_000_000), world_from_camera });
        }
        poses
    }

    fn pairs(delta: f64, unit: DeltaUnit, all_pairs: bool, steps: &[f64]) -> Vec<(usize, usize)> {
        RpeOptions { all_pairs, ..RpeOptions::new(delta, unit) }.pairs(&walk(steps))
    }

    #[test]
    fn pairs_of_each_kind() {
        use DeltaUnit::{Frames, Metres, Seconds};
        let steps = [0.5, 0.5, 0.25, 0.0, 0.75, 2.0];
        assert_eq!(pairs(2.0, Frames, false, &steps), [(0, 2), (2, 4), (4, 6)]);
        assert_eq!(pairs(4.0, Frames, true, &steps), [(0, 4), (1, 5), (2, 6)]);
        assert_eq!(pairs(1.0, Metres, false, &steps), [(0, 2), (2, 5), (5, 6)]);
        assert_eq!(pairs(1.0, Metres, true, &steps), [(0, 2), (2, 5)]);
        assert_eq!(pairs(0.75, Metres, true, &steps), [(1, 3), (3, 5), (4, 5)]);
        assert_eq!(pairs(0.2, Seconds, false, &steps), [(0, 2), (2, 4), (4, 6)]);
        assert!(pairs(10.0, Metres, true, &steps).is_empty() && pairs(1.0, Metres, true, &[]).is_empty());
    }

    #[test]
    fn a_constant_offset_is_no_relative_error_and_scale_is() {
        let truth = walk(&[1.0; 5]);
        let mut estimate = truth.clone();
        for pose in &mut estimate {
            pose.world_from_camera.translation *= 1.1;
            pose.world_from_camera.translation.y += 7.0;
        }
        let result = relative_error(&truth, &estimate, &RpeOptions::new(1.0, DeltaUnit::Frames)).unwrap();
        assert!((result.translation_m.unwrap().rmse - 0.1).abs() < 1e-12);
        assert_eq!(result.rotation_deg.unwrap().max, 0.0);
    }

    #[test]
    fn senseless_deltas_are_refused() {
        for (delta, unit) in [(0.0, DeltaUnit::Metres), (1.5, DeltaUnit::Frames), (f64::NAN, DeltaUnit::Seconds)] {
            assert!(RpeOptions::new(delta, unit).validate().is_err());
        }
    }
}
