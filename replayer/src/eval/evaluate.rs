use nalgebra::Vector3;
use schemas::Stamp;
use serde::{Deserialize, Serialize};
use slam_math::align::umeyama;
use slam_math::{Se3, Sim3};

use super::relative::relative_error;
use super::{DeltaUnit, EvalError, RpeOptions, RpeResult, StampedPose, Statistics, Trajectory, associate};

/// How the estimate is moved onto the truth before they are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Alignment {
    /// Best rotation and translation: the usual choice when depth gives the scale.
    #[default]
    Se3,
    /// Best rotation, translation and scale: for monocular estimates.
    Sim3,
    /// Not at all: both are in the same frame already.
    None,
}

impl Alignment {
    /// The usual choice for what a run saw with, as its summary names it: scale is free where only pictures of one camera
    /// were used.
    #[must_use]
    pub fn for_sensor(sensor: &str) -> Self {
        if sensor == slam::Sensor::Monocular.name() { Self::Sim3 } else { Self::Se3 }
    }
}

/// How to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct EvalOptions {
    /// Largest difference of the stamps of a pair, seconds.
    pub max_difference_s: f64,
    /// Alignment over all pairs.
    pub alignment: Alignment,
    /// Relative errors to compute.
    pub rpe: Vec<RpeOptions>,
}

impl EvalOptions {
    /// The default with the usual alignment for what a run saw with, see [`Alignment::for_sensor`].
    #[must_use]
    pub fn for_sensor(sensor: &str) -> Self {
        Self { alignment: Alignment::for_sensor(sensor), ..Self::default() }
    }
}

impl Default for EvalOptions {
    /// 10 ms as in evo, SE3, relative errors over 1 frame, 1 s and 1 m.
    fn default() -> Self {
        let units = [DeltaUnit::Frames, DeltaUnit::Seconds, DeltaUnit::Metres];
        let rpe = units.map(|unit| RpeOptions::new(1.0, unit)).to_vec();
        Self { max_difference_s: 0.01, alignment: Alignment::Se3, rpe }
    }
}

/// How much of the log was tracked. An error without it can be bought by giving up early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Coverage {
    /// Frames with a pose.
    pub tracked: usize,
    /// Frames in the log.
    pub frames: usize,
}

impl Coverage {
    /// 0 to 1; 0 without frames.
    #[must_use]
    pub fn share(&self) -> f64 {
        if self.frames == 0 { 0.0 } else { self.tracked as f64 / self.frames as f64 }
    }
}

/// Error along one axis of the world of the truth, metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct AxisError {
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean of estimate minus truth: about 0 after an alignment.
    pub mean: f64,
    /// Largest without its sign.
    pub max_abs: f64,
}

/// Error of one pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSample {
    /// Stamp of the estimate.
    pub stamp: Stamp,
    /// Aligned estimate minus truth in the world of the truth, metres.
    pub difference_m: [f64; 3],
    /// Its length, metres.
    pub translation_m: f64,
    /// Angle between the two orientations, degrees.
    pub rotation_deg: f64,
}

/// What [`evaluate`] found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// How the estimate was aligned.
    pub alignment: Alignment,
    /// Scale of the alignment, 1 unless Sim3.
    pub scale: f64,
    /// The alignment as rows of `[R | t]`: `truth = scale * R * estimate + t`.
    pub truth_from_estimate: [f64; 12],
    /// Poses in the estimate.
    pub estimated_poses: usize,
    /// Poses in the truth.
    pub true_poses: usize,
    /// Paired poses: all statistics are over these.
    pub pairs: usize,
    /// Tracked frames, when known.
    pub coverage: Option<Coverage>,
    /// Length of the true path over the pairs, metres.
    pub true_length_m: f64,
    /// Length of the aligned estimated path over the pairs, metres.
    pub estimated_length_m: f64,
    /// Absolute trajectory error: distance between paired positions, metres.
    pub ate_m: Statistics,
    /// Angle between paired orientations, degrees.
    pub ate_rotation_deg: Statistics,
    /// Along x, y, z of the world of the truth.
    pub axes_m: [AxisError; 3],
    /// In the order of the options.
    pub rpe: Vec<RpeResult>,
    /// One entry a pair, in time order; for plots.
    #[serde(skip)]
    pub samples: Vec<ErrorSample>,
    /// The whole estimate (unpaired poses too) in the world of the truth; for plots.
    #[serde(skip)]
    pub aligned: Trajectory,
}

/// Compares an estimate with the truth.
///
/// # Errors
/// [`EvalError`] when stamps do not meet, the alignment is undetermined, or an option is senseless.
pub fn evaluate(
    truth: &Trajectory,
    estimate: &Trajectory,
    coverage: Option<Coverage>,
    options: &EvalOptions,
) -> Result<Evaluation, EvalError> {
    let pairs = associate(truth, estimate, options.max_difference_s)?;
    let true_poses: Vec<StampedPose> = pairs.iter().map(|&(t, _)| truth.poses[t]).collect();
    let raw: Vec<StampedPose> = pairs.iter().map(|&(_, e)| estimate.poses[e]).collect();
    let fit = fit(&true_poses, &raw, options.alignment)?;
    let estimated: Vec<StampedPose> = raw.iter().map(|pose| aligned(pose, &fit)).collect();

    let samples: Vec<ErrorSample> = true_poses.iter().zip(&estimated).map(|(t, e)| sample(t, e)).collect();
    let column = |f: fn(&ErrorSample) -> f64| samples.iter().map(f).collect::<Vec<_>>();
    let none = || EvalError::Degenerate { pairs: pairs.len() };
    Ok(Evaluation {
        alignment: options.alignment,
        scale: fit.scale,
        truth_from_estimate: fit.se3.rows(),
        estimated_poses: estimate.poses.len(),
        true_poses: truth.poses.len(),
        pairs: pairs.len(),
        coverage,
        ate_m: Statistics::of(&column(|s| s.translation_m)).ok_or_else(none)?,
        ate_rotation_deg: Statistics::of(&column(|s| s.rotation_deg)).ok_or_else(none)?,
        axes_m: std::array::from_fn(|axis| axis_error(&samples, axis)),
        rpe: options.rpe.iter().map(|rpe| relative_error(&true_poses, &estimated, rpe)).collect::<Result<_, _>>()?,
        true_length_m: Trajectory { poses: true_poses }.length_m(),
        estimated_length_m: Trajectory { poses: estimated }.length_m(),
        samples,
        aligned: Trajectory { poses: estimate.poses.iter().map(|pose| aligned(pose, &fit)).collect() },
    })
}

fn fit(truth: &[StampedPose], estimate: &[StampedPose], alignment: Alignment) -> Result<Sim3, EvalError> {
    let positions = |poses: &[StampedPose]| poses.iter().map(|p| p.world_from_camera.translation).collect::<Vec<_>>();
    match alignment {
        Alignment::None => Ok(Sim3 { scale: 1.0, se3: Se3::identity() }),
        Alignment::Se3 | Alignment::Sim3 => {
            umeyama(&positions(estimate), &positions(truth), alignment == Alignment::Sim3)
                .ok_or(EvalError::Degenerate { pairs: truth.len() })
        }
    }
}

fn aligned(pose: &StampedPose, fit: &Sim3) -> StampedPose {
    let world_from_camera = Se3 {
        rotation: fit.se3.rotation * pose.world_from_camera.rotation,
        translation: fit.transform(&pose.world_from_camera.translation),
    };
    StampedPose { stamp: pose.stamp, world_from_camera }
}

fn sample(truth: &StampedPose, estimate: &StampedPose) -> ErrorSample {
    let difference: Vector3<f64> = estimate.world_from_camera.translation - truth.world_from_camera.translation;
    let turn = truth.world_from_camera.inverse() * estimate.world_from_camera;
    ErrorSample {
        stamp: estimate.stamp,
        difference_m: difference.into(),
        translation_m: difference.norm(),
        rotation_deg: turn.angle().to_degrees(),
    }
}

fn axis_error(samples: &[ErrorSample], axis: usize) -> AxisError {
    let n = samples.len() as f64;
    let values = || samples.iter().map(|s| s.difference_m[axis]);
    AxisError {
        rmse: (values().fold(0.0, |sum, v| sum + v * v) / n).sqrt(),
        mean: values().fold(0.0, |sum, v| sum + v) / n,
        max_abs: values().fold(0.0, |most, v| slam_math::float::max(most, v.abs())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;
    use slam_math::Rng;

    /// A smooth curve in all three dimensions.
    fn curve(n: i64) -> Trajectory {
        let pose = |i: i64| {
            let t = i as f64 * 0.1;
            let twist = Vector6::new(t, 0.3 * t * t, 0.1 * t * (3.0 - t), 0.2 * t, -0.1 * t, 0.05);
            StampedPose { stamp: Stamp(i * 33_333_333), world_from_camera: Se3::exp(&twist) }
        };
        Trajectory { poses: (0..n).map(pose).collect() }
    }

    fn moved(trajectory: &Trajectory, similarity: &Sim3) -> Trajectory {
        Trajectory { poses: trajectory.poses.iter().map(|p| aligned(p, similarity)).collect() }
    }

    #[test]
    fn alignment_removes_exactly_what_it_may() {
        let truth = curve(40);
        let se3 = Se3::exp(&Vector6::new(3.0, -2.0, 1.0, 0.4, 1.0, -0.3));
        let estimate = moved(&truth, &Sim3 { scale: 0.5, se3 });
        let error = |alignment| {
            evaluate(&truth, &estimate, None, &EvalOptions { alignment, ..EvalOptions::default() }).unwrap()
        };
        let sim3 = error(Alignment::Sim3);
        assert!(sim3.ate_m.max < 1e-12 && (sim3.scale - 2.0).abs() < 1e-12 && sim3.ate_rotation_deg.max < 1e-6);
        assert!(error(Alignment::Se3).ate_m.rmse > 0.1);
        assert!(error(Alignment::None).ate_m.rmse > error(Alignment::Se3).ate_m.rmse);
    }

    #[test]
    fn known_offset_without_alignment() {
        let truth = curve(10);
        let mut estimate = truth.clone();
        for pose in &mut estimate.poses {
            pose.world_from_camera.translation += Vector3::new(0.3, 0.0, -0.4);
        }
        let options = EvalOptions { alignment: Alignment::None, ..EvalOptions::default() };
        let result = evaluate(&truth, &estimate, Some(Coverage { tracked: 10, frames: 20 }), &options).unwrap();
        assert!((result.ate_m.rmse - 0.5).abs() < 1e-12 && result.ate_m.std < 1e-7);
        assert!((result.axes_m[2].mean + 0.4).abs() < 1e-12 && (result.axes_m[0].max_abs - 0.3).abs() < 1e-12);
        assert_eq!(result.coverage.unwrap().share(), 0.5);
        assert_eq!((result.samples.len(), result.aligned.poses.len(), result.rpe.len()), (10, 10, 3));
    }

    #[test]
    fn noise_gives_the_error_it_should() {
        let truth = curve(400);
        let mut rng = Rng::at(5, 0, 0, 0);
        let mut estimate = truth.clone();
        for pose in &mut estimate.poses {
            pose.world_from_camera.translation += Vector3::from_fn(|_, _| rng.normal() * 0.01);
        }
        let rmse = evaluate(&truth, &estimate, None, &EvalOptions::default()).unwrap().ate_m.rmse;
        assert!((rmse - 0.01 * 3f64.sqrt()).abs() < 0.001, "{rmse}");
    }

    #[test]
    fn a_still_camera_cannot_be_aligned() {
        let still = Trajectory {
            poses: curve(5).poses.iter().map(|p| StampedPose { world_from_camera: Se3::identity(), ..*p }).collect(),
        };
        assert!(matches!(
            evaluate(&still, &still, None, &EvalOptions::default()),
            Err(EvalError::Degenerate { pairs: 5 })
        ));
    }
}
