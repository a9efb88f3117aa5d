//! Pose of one camera from known points.

mod scene;

use nalgebra::Vector3;
use proptest::prelude::*;
use scene::{BF, CAMERA, pose_scene, twist};
use slam_math::{Buffers, Rng, Se3};
use slam_optimize::{PoseOptions, optimize_pose};

/// Error as a twist of the estimate against the truth.
fn error(estimate: &Se3, truth: &Se3) -> nalgebra::Vector6<f64> {
    (*estimate * truth.inverse()).log()
}

#[test]
fn exact_data_give_the_exact_pose() {
    let mut rng = Rng::at(1, 0, 0, 0);
    let (truth, observations) = pose_scene(&mut rng, 60, 0, 0.0);
    let result =
        optimize_pose(&CAMERA, BF, &observations, &Se3::identity(), &PoseOptions::default(), &Buffers::default());
    assert!(error(&result.camera_from_world, &truth).norm() < 1e-7, "{}", error(&result.camera_from_world, &truth));
    assert!(result.converged && result.inliers == 60);
}

#[test]
fn the_error_with_40_percent_outliers_is_what_the_information_promises() {
    let mut mahalanobis = Vec::new();
    for seed in 0..40 {
        let mut rng = Rng::at(2, seed, 0, 0);
        let (truth, observations) = pose_scene(&mut rng, 500, 200, 1.0);
        let start = Se3::exp(&twist(&mut rng, 0.05, 0.03)) * truth;
        let result = optimize_pose(&CAMERA, BF, &observations, &start, &PoseOptions::default(), &Buffers::default());
        assert!(result.converged);
        // 95 % of 300 true inliers, give or take five standard deviations (3.8); a few of the wrong ones look right.
        let right = result.inlier[200..].iter().filter(|i| **i).count();
        let wrong = result.inlier[..200].iter().filter(|i| **i).count();
        assert!(right >= 266 && wrong <= 4, "seed {seed}: {right} right, {wrong} wrong");
        assert_eq!(result.inliers, right + wrong);
        let delta = error(&result.camera_from_world, &truth);
        mahalanobis.push((delta.transpose() * result.information * delta)[0]);
    }
    // Chi-square with six degrees of freedom: mean 6, 99.99 % below 27.9. Cutting the tails of the noise at 95 % and a
    // few accepted outliers make it a little larger.
    let mean = mahalanobis.iter().sum::<f64>() / 40.0;
    assert!((4.0..9.0).contains(&mean), "mean {mean}");
    assert!(mahalanobis.iter().all(|m| *m < 35.0), "{mahalanobis:?}");
}

#[test]
fn a_far_start_still_converges() {
    for seed in 0..20 {
        let mut rng = Rng::at(3, seed, 0, 0);
        let (truth, observations) = pose_scene(&mut rng, 200, 40, 1.0);
        let start = Se3::exp(&twist(&mut rng, 0.3, 0.15)) * truth;
        let result = optimize_pose(&CAMERA, BF, &observations, &start, &PoseOptions::default(), &Buffers::default());
        assert!(error(&result.camera_from_world, &truth).norm() < 0.02, "seed {seed}");
    }
}

#[test]
fn broken_observations_are_outliers_and_change_nothing() {
    let mut rng = Rng::at(4, 0, 0, 0);
    let (truth, clean) = pose_scene(&mut rng, 100, 0, 1.0);
    let options = PoseOptions::default();
    let expected = optimize_pose(&CAMERA, BF, &clean, &truth, &options, &Buffers::default());
    let mut dirty = clean.clone();
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut o = clean[0];
        o.point_in_world[2] = value;
        dirty.push(o);
    }
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300] {
        let mut o = clean[0];
        o.measurement.pixel[1] = value;
        dirty.push(o);
        let mut o = clean[0];
        o.measurement.disparity = Some(value);
        dirty.push(o);
    }
    for weight in [f64::NAN, 0.0, -1.0, f64::INFINITY] {
        let mut o = clean[0];
        o.measurement.weight = weight;
        dirty.push(o);
    }
    let mut behind = clean[0];
    behind.point_in_world = truth.inverse().transform(&Vector3::new(0.1, 0.1, -2.0));
    dirty.push(behind);
    let result = optimize_pose(&CAMERA, BF, &dirty, &truth, &options, &Buffers::default());
    assert_eq!(result.camera_from_world, expected.camera_from_world);
    assert_eq!(result.inlier[..100], expected.inlier[..]);
    assert!(result.inlier[100..].iter().all(|i| !i));
}

#[test]
fn too_few_observations_or_a_broken_start_leave_the_pose() {
    let mut rng = Rng::at(5, 0, 0, 0);
    let (truth, observations) = pose_scene(&mut rng, 30, 0, 1.0);
    let options = PoseOptions::default();
    for few in 0..3 {
        let result = optimize_pose(&CAMERA, BF, &observations[..few], &truth, &options, &Buffers::default());
        assert!(!result.converged);
        assert!(error(&result.camera_from_world, &truth).norm() < 1e-9);
    }
    let broken = Se3 { translation: Vector3::repeat(f64::NAN), ..truth };
    let result = optimize_pose(&CAMERA, BF, &observations, &broken, &options, &Buffers::default());
    assert!(!result.converged && result.inliers == 0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_numbers_are_survived(values in proptest::collection::vec(any::<[f64; 7]>(), 0..12), start: [f64; 6]) {
        let observations: Vec<_> = values.iter().map(|v| slam_optimize::PoseObservation {
            point_in_world: Vector3::new(v[0], v[1], v[2]),
            measurement: slam_optimize::Measurement {
                pixel: [v[3], v[4]], disparity: Some(v[5]), weight: v[6], weight_disparity: v[6],
            },
        }).collect();
        let start = Se3::exp(&nalgebra::Vector6::from(start.map(|v| v % 2.0)));
        let result = optimize_pose(&CAMERA, BF, &observations, &start, &PoseOptions::default(), &Buffers::default());
        prop_assert!(!start.is_finite() || result.camera_from_world.is_finite());
        prop_assert_eq!(result.inlier.len(), observations.len());
    }
}
