//! Finding a place again: similarities between two cameras, poses from points and pixels.

mod scene;

use nalgebra::{SVector, Vector3};
use proptest::prelude::*;
use scene::{BF, CAMERA, measure, normal3, point, pose_scene, twist};
use slam_math::{Rng, Se3, Sim3};
use slam_optimize::{
    AbsoluteOptions, DepthCamera, Measurement, PointPair, PoseObservation, PoseOptions, SimilarityOptions,
    absolute_pose_ransac, find_similarity, refine_similarity,
};

const DEPTH_CAMERA: DepthCamera = DepthCamera { pinhole: CAMERA, bf: BF };

/// Pairs of points, 1 mm of noise on each side; the first `wrong` are of different points.
fn pairs(rng: &mut Rng, motion: &Sim3, n: usize, wrong: usize) -> Vec<PointPair> {
    let pair = |i: usize| {
        // Seen by both: in front of the second camera as well, in its own unit.
        let (in_first, in_second) = loop {
            let x = point(rng);
            let moved = motion.transform(&x);
            if CAMERA.project(&moved).is_some_and(|[u, v]| (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v)) {
                break (x, moved);
            }
        };
        let seen_by_first = measure(rng, &in_first, false, 1.0).expect("in front");
        let seen_by_second = measure(rng, &in_second, false, 1.0).expect("in front");
        let in_first = if i < wrong { point(rng) } else { in_first + normal3(rng, 0.001) };
        PointPair { in_first, in_second: in_second + normal3(rng, 0.001), seen_by_first, seen_by_second }
    };
    (0..n).map(pair).collect()
}

fn close(a: &Sim3, b: &Sim3) -> f64 {
    (a.se3.rotation - b.se3.rotation).norm()
        + (a.se3.translation - b.se3.translation).norm()
        + (a.scale - b.scale).abs()
}

#[test]
fn a_place_is_recognised_with_half_of_the_pairs_wrong() {
    for (seed, fix_scale) in (0..10).flat_map(|seed| [(seed, false), (seed, true)]) {
        let mut rng = Rng::at(seed, 1, 0, 0);
        let tangent = SVector::from_fn(|i, _| 0.2 * rng.normal() * if i == 6 && fix_scale { 0.0 } else { 1.0 });
        let truth = Sim3::exp(&tangent);
        let pairs = pairs(&mut rng, &truth, 120, 60);
        let options = SimilarityOptions { fix_scale, ..SimilarityOptions::default() };
        let found = find_similarity(&mut rng, &DEPTH_CAMERA, &pairs, &options).unwrap();
        assert!(close(&found.second_from_first, &truth) < 0.03, "{seed}: {}", close(&found.second_from_first, &truth));
        assert!(!fix_scale || (found.second_from_first.scale - 1.0).abs() < 1e-12);
        assert!(found.inliers > 50 && found.inlier[..60].iter().filter(|i| **i).count() <= 2, "{}", found.inliers);
        // From a rough start without RANSAC, a seventh of the pairs wrong.
        let rough = Sim3::from(Se3::exp(&twist(&mut rng, 0.02, 0.01))) * truth;
        let refined = refine_similarity(&DEPTH_CAMERA, &pairs[50..], &rough, &options);
        assert!(close(&refined.second_from_first, &found.second_from_first) < 0.02 && refined.inliers > 50);
    }
}

#[test]
fn cameras_at_the_same_place_get_their_scale_from_depths() {
    let truth = Sim3 { scale: 2.0, se3: Se3::identity() };
    for seed in 0..5 {
        let mut rng = Rng::at(seed, 4, 0, 0);
        let mut pairs = pairs(&mut rng, &truth, 120, 0);
        // Depths that each map knows to 8 %; a tenth are of something else.
        for (i, pair) in pairs.iter_mut().enumerate() {
            pair.in_first *= 1.0 + 0.08 * rng.normal();
            pair.in_second *= if i % 10 == 0 { 1.7 } else { 1.0 + 0.08 * rng.normal() };
        }
        let options = SimilarityOptions::default();
        let off = Sim3 { scale: 0.25, ..truth };
        let refined = refine_similarity(&DEPTH_CAMERA, &pairs, &off, &options).second_from_first;
        let found = find_similarity(&mut rng, &DEPTH_CAMERA, &pairs, &options).unwrap().second_from_first;
        for scale in [refined.scale, found.scale] {
            // The strangers pull at it by up to a tenth of two sigmas of 11 %, noise adds its own.
            assert!((scale / truth.scale - 1.0).abs() < 0.07, "{seed}: {scale}");
        }
    }
}

#[test]
fn different_places_have_no_similarity() {
    let mut rng = Rng::at(3, 0, 0, 0);
    let wrong = pairs(&mut rng, &Sim3::identity(), 100, 100);
    assert_eq!(find_similarity(&mut rng, &DEPTH_CAMERA, &wrong, &SimilarityOptions::default()), None);
    assert_eq!(find_similarity(&mut rng, &DEPTH_CAMERA, &wrong[..2], &SimilarityOptions::default()), None);
}

/// The same scene without any depth.
fn without_depth(observations: Vec<PoseObservation>) -> Vec<PoseObservation> {
    let flat =
        |o: PoseObservation| PoseObservation { measurement: Measurement { disparity: None, ..o.measurement }, ..o };
    observations.into_iter().map(flat).collect()
}

#[test]
fn a_camera_is_found_from_pixels_with_half_of_them_wrong() {
    for seed in 0..20 {
        let mut rng = Rng::at(seed, 2, 0, 0);
        let (truth, observations) = pose_scene(&mut rng, 120, 60, 1.0);
        let observations = without_depth(observations);
        let options = AbsoluteOptions::default();
        let found =
            absolute_pose_ransac(&mut rng, &CAMERA, BF, &observations, &options, &PoseOptions::default()).unwrap();
        let error = (found.camera_from_world * truth.inverse()).log();
        // Four standard deviations of what the information promises, in its own metric.
        let squared = error.dot(&(found.information * error));
        assert!(
            squared < 6.0 + 4.0 * 12.0f64.sqrt() + 6.0 && found.inliers > 50,
            "{seed}: {squared} {}",
            found.inliers
        );
        assert!(found.inlier[..60].iter().filter(|i| **i).count() <= 2);
    }
}

#[test]
fn pixels_of_other_points_give_no_pose() {
    let mut rng = Rng::at(5, 0, 0, 0);
    let (_, observations) = pose_scene(&mut rng, 60, 60, 1.0);
    let options = AbsoluteOptions { min_inliers: 12, ..AbsoluteOptions::default() };
    let find = |observations: &[PoseObservation]| {
        absolute_pose_ransac(&mut Rng::at(1, 0, 0, 0), &CAMERA, BF, observations, &options, &PoseOptions::default())
    };
    assert_eq!(find(&without_depth(observations.clone())), None);
    assert_eq!(find(&observations[..2]), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_numbers_are_survived(values in proptest::collection::vec(any::<[f64; 10]>(), 0..40)) {
        let observation = |v: &[f64; 10]| PoseObservation {
            point_in_world: Vector3::new(v[0], v[1], v[2]),
            measurement: Measurement { pixel: [v[3], v[4]], disparity: None, weight: v[5], weight_disparity: 0.0 },
        };
        let observations: Vec<_> = values.iter().map(observation).collect();
        let options = AbsoluteOptions { min_inliers: 3, max_iterations: 20, ..AbsoluteOptions::default() };
        let pose_options = PoseOptions::default();
        let found = absolute_pose_ransac(&mut Rng::at(1, 0, 0, 0), &CAMERA, BF, &observations, &options, &pose_options);
        prop_assert!(found.is_none_or(|f| f.camera_from_world.is_finite()));
        let pairs: Vec<_> = values.iter().zip(&observations).map(|(v, o)| PointPair {
            in_first: o.point_in_world,
            in_second: Vector3::new(v[6], v[7], v[8]),
            seen_by_first: o.measurement,
            seen_by_second: Measurement { weight: v[9], ..o.measurement },
        }).collect();
        let found = find_similarity(&mut Rng::at(1, 0, 0, 0), &DEPTH_CAMERA, &pairs, &SimilarityOptions { min_inliers: 3, ..SimilarityOptions::default() });
        prop_assert!(found.is_none_or(|f| f.second_from_first.is_finite()));
    }
}
