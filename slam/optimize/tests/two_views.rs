//! Epipolar geometry, triangulation and rigid motion between point clouds.

mod scene;

use nalgebra::{Matrix3, Vector3, Vector6};
use proptest::prelude::*;
use scene::{CAMERA, normal3, point, twist, two_views};
use slam_math::{Rng, Se3, se3::skew};
use slam_optimize::{
    AbsoluteOptions, FundamentalOptions, absolute_orientation_ransac, epipolar_distance, fundamental_ransac,
    sampson_distance, triangulate,
};

fn motion() -> Se3 {
    Se3::exp(&Vector6::new(0.2, 0.05, -0.1, 0.02, -0.05, 0.03))
}

/// `K^-T [t] R K^-1` for the second view from the first.
fn true_fundamental(second_from_first: &Se3) -> Matrix3<f64> {
    let k = Matrix3::new(CAMERA.fx, 0.0, CAMERA.cx, 0.0, CAMERA.fy, CAMERA.cy, 0.0, 0.0, 1.0);
    let inverse = k.try_inverse().expect("focal lengths are not zero");
    inverse.transpose() * skew(&second_from_first.translation) * second_from_first.rotation * inverse
}

#[test]
fn half_of_the_matches_may_be_wrong() {
    let truth = true_fundamental(&motion());
    for seed in 0..10 {
        let mut rng = Rng::at(1, seed, 0, 0);
        let (last, current) = two_views(&mut rng, &motion(), 300, 150, 0.4);
        let found = fundamental_ransac(&mut rng, &last, &current, &FundamentalOptions::default()).unwrap();
        assert!(!found.degenerate, "seed {seed}");
        assert!(found.matrix.determinant().abs() < 1e-12);
        assert!((found.matrix.norm() - 1.0).abs() < 1e-12);
        // 1 px is 2.5 sigma: 98.8 % of 150, less five standard deviations (1.3 each).
        let right = found.inlier[..150].iter().filter(|i| **i).count();
        assert!(right >= 138, "seed {seed}: {right}");
        // Wrong matches within 1 px of their line by chance: about 2 of 480 px.
        assert!(found.inliers - right <= 8, "seed {seed}: {}", found.inliers - right);
        // Fresh, exact matches lie near the estimated lines: the mean distance is below the noise of one keypoint.
        let (last, current) = two_views(&mut rng, &motion(), 200, 200, 0.0);
        let distance = |f: &Matrix3<f64>| {
            last.iter().zip(&current).map(|(a, b)| epipolar_distance(f, *a, *b)).sum::<f64>() / 200.0
        };
        assert!(distance(&truth) < 1e-6);
        assert!(distance(&found.matrix) < 0.4, "seed {seed}: {}", distance(&found.matrix));
    }
}

#[test]
fn exact_matches_give_the_exact_matrix() {
    let mut rng = Rng::at(2, 0, 0, 0);
    let (last, current) = two_views(&mut rng, &motion(), 50, 50, 0.0);
    let found = fundamental_ransac(&mut rng, &last, &current, &FundamentalOptions::default()).unwrap();
    let truth = true_fundamental(&motion()).normalize();
    let difference = slam_math::float::min((found.matrix - truth).norm(), (found.matrix + truth).norm());
    assert!(difference < 1e-6, "{difference}");
}

#[test]
fn still_turning_and_planar_views_are_flagged() {
    let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.02, -0.05, 0.03));
    let crawl = Se3::exp(&Vector6::new(0.001, 0.0, 0.0, 0.0, 0.0, 0.0));
    for (name, second_from_first) in [("still", Se3::identity()), ("turn", turn), ("crawl", crawl)] {
        for seed in 0..5 {
            let mut rng = Rng::at(3, seed, 0, 0);
            let (last, current) = two_views(&mut rng, &second_from_first, 200, 160, 0.4);
            let found = fundamental_ransac(&mut rng, &last, &current, &FundamentalOptions::default()).unwrap();
            assert!(found.degenerate, "{name} {seed}");
        }
    }
    let mut rng = Rng::at(4, 0, 0, 0);
    let wall = (0..100).map(|_| Vector3::new(rng.normal(), rng.normal(), 3.0));
    let (last, current): (Vec<_>, Vec<_>) =
        wall.map(|x| (CAMERA.project(&x).unwrap(), CAMERA.project(&motion().transform(&x)).unwrap())).unzip();
    if let Some(found) = fundamental_ransac(&mut rng, &last, &current, &FundamentalOptions::default()) {
        assert!(found.degenerate);
    }
}

#[test]
fn broken_matches_are_outliers() {
    let mut rng = Rng::at(5, 0, 0, 0);
    let (mut last, mut current) = two_views(&mut rng, &motion(), 100, 90, 0.3);
    let options = FundamentalOptions::default();
    let expected = fundamental_ransac(&mut Rng::at(6, 0, 0, 0), &last, &current, &options).unwrap();
    last.extend([[f64::NAN, 0.0], [1.0, 2.0]]);
    current.extend([[0.0, 0.0], [f64::INFINITY, 2.0]]);
    let found = fundamental_ransac(&mut Rng::at(6, 0, 0, 0), &last, &current, &options).unwrap();
    assert_eq!(found.matrix, expected.matrix);
    assert_eq!(found.inlier[100..], [false, false]);
    assert!(fundamental_ransac(&mut rng, &last[..7], &current[..7], &options).is_none());
    assert!(fundamental_ransac(&mut rng, &last[..9], &current[..8], &options).is_none());
    assert!(fundamental_ransac(&mut rng, &[[5.0; 2]; 20], &[[5.0; 2]; 20], &options).is_none());
}

#[test]
fn distances_are_pixels() {
    // A camera that moves along x: epipolar lines are rows.
    let rows = true_fundamental(&Se3 { translation: Vector3::new(0.1, 0.0, 0.0), ..Se3::identity() });
    assert!((epipolar_distance(&rows, [100.0, 50.0], [130.0, 52.5]) - 2.5).abs() < 1e-9);
    // Both keypoints may give way: the first-order distance is smaller by the square root of two.
    assert!((sampson_distance(&rows, [100.0, 50.0], [130.0, 52.5]) - 2.5 / 2f64.sqrt()).abs() < 1e-9);
    assert_eq!(epipolar_distance(&rows, [f64::NAN, 0.0], [0.0, 0.0]), f64::INFINITY);
    assert_eq!(sampson_distance(&Matrix3::zeros(), [1.0, 0.0], [0.0, 0.0]), 0.0);
}

#[test]
fn clouds_align_with_half_of_the_pairs_wrong() {
    for seed in 0..20 {
        let mut rng = Rng::at(7, seed, 0, 0);
        let truth = Se3::exp(&twist(&mut rng, 1.0, 0.8));
        let sigma = 0.01;
        let source: Vec<_> = (0..120).map(|_| point(&mut rng)).collect();
        let mut target: Vec<_> = source.iter().map(|p| truth.transform(p) + normal3(&mut rng, sigma)).collect();
        for wrong in &mut target[60..] {
            *wrong += normal3(&mut rng, 1.0);
        }
        target[119] = Vector3::repeat(f64::NAN);
        // 99.9 % of chi-square with three degrees of freedom: 16.27.
        let agrees = |i: usize, moved: &Vector3<f64>| (target[i] - moved).norm_squared() < 16.27 * sigma * sigma;
        let options = AbsoluteOptions::default();
        let (found, inlier) = absolute_orientation_ransac(&mut rng, &source, &target, agrees, &options).unwrap();
        assert!(inlier[..60].iter().filter(|i| **i).count() >= 56, "seed {seed}");
        assert!(inlier[60..].iter().filter(|i| **i).count() <= 2, "seed {seed}");
        // sigma / sqrt(60) = 1.3 mm; the points lie some 3 m from the origin and spread by about 1 m.
        assert!((found * truth.inverse()).log().norm() < 5.0 * 0.0013 * 3.0, "seed {seed}");
    }
}

#[test]
fn clouds_without_a_common_motion_give_nothing() {
    let mut rng = Rng::at(8, 0, 0, 0);
    let source: Vec<_> = (0..50).map(|_| point(&mut rng)).collect();
    let target: Vec<_> = (0..50).map(|_| point(&mut rng)).collect();
    let agrees = |i: usize, moved: &Vector3<f64>| (target[i] - moved).norm() < 0.03;
    let options = AbsoluteOptions::default();
    assert!(absolute_orientation_ransac(&mut rng, &source, &target, agrees, &options).is_none());
    assert!(absolute_orientation_ransac(&mut rng, &source[..2], &target[..2], agrees, &options).is_none());
    assert!(absolute_orientation_ransac(&mut rng, &source, &target[..9], agrees, &options).is_none());
}

#[test]
fn rays_that_do_not_meet_in_front_give_nothing() {
    let second = Se3 { translation: Vector3::new(-0.2, 0.0, 0.0), ..Se3::identity() };
    let first = Se3::identity();
    assert!(triangulate(&first, &second, [0.0, 0.0], [0.0, 0.0], 0.001).is_none(), "parallel");
    assert!(triangulate(&first, &second, [0.0, 0.0], [0.1, 0.0], 0.001).is_none(), "behind");
    assert!(triangulate(&first, &second, [0.0, 0.0], [f64::NAN, 0.0], 0.001).is_none());
    assert!(triangulate(&first, &second, [0.0, 0.0], [-0.1, 0.0], 0.2).is_none(), "small angle");
    let found = triangulate(&first, &second, [0.0, 0.0], [-0.1, 0.0], 0.05).unwrap();
    assert!((found - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-12);
}

proptest! {
    #[test]
    fn exact_rays_give_the_point(
        x in [-1.0..1.0f64, -1.0..1.0, 1.5..6.0],
        first in proptest::array::uniform6(-0.3..0.3f64),
        second in proptest::array::uniform6(-0.3..0.3f64),
    ) {
        let x = Vector3::from(x);
        let [first, second] = [first, second].map(|t| Se3::exp(&Vector6::from(t)));
        let ray = |pose: &Se3| { let p = pose.transform(&x); [p[0] / p[2], p[1] / p[2]] };
        prop_assume!(first.transform(&x)[2] > 0.2 && second.transform(&x)[2] > 0.2);
        if let Some(found) = triangulate(&first, &second, ray(&first), ray(&second), 0.01) {
            prop_assert!((found - x).norm() < 1e-6, "{found} {x}");
        } else {
            let to = |pose: &Se3| (x - pose.inverse().translation).normalize();
            prop_assert!(to(&first).cross(&to(&second)).norm() < 0.0101);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_matches_are_survived(
        matches in proptest::collection::vec(any::<([f64; 2], [f64; 2])>(), 0..20),
        grid in proptest::collection::vec(([0..4i32, 0..4], [0..4i32, 0..4]), 0..20),
    ) {
        // Arbitrary numbers, and coarse ones that coincide and line up.
        let whole = |p: [i32; 2]| p.map(f64::from);
        let all = matches.into_iter().chain(grid.into_iter().map(|(a, b)| (whole(a), whole(b))));
        let (last, current): (Vec<_>, Vec<_>) = all.unzip();
        let options = FundamentalOptions { max_iterations: 50, ..FundamentalOptions::default() };
        if let Some(found) = fundamental_ransac(&mut Rng::at(9, 0, 0, 0), &last, &current, &options) {
            prop_assert!(found.matrix.iter().all(|v| v.is_finite()));
            prop_assert_eq!(found.inlier.iter().filter(|i| **i).count(), found.inliers);
        }
    }
}
