//! Poses and points together.

mod scene;

use nalgebra::Vector3;
use proptest::prelude::*;
use scene::{SIGMA_PX, bundle_scene};
use slam_math::{Buffers, Rng, par::Pool};
use slam_optimize::{BaObservation, BaOptions, BaProblem, Measurement, bundle_adjust};

fn bits(problem: &BaProblem) -> Vec<u64> {
    let poses = problem.poses.iter().flat_map(|p| p.camera_from_world.rows());
    let points = problem.points.iter().flat_map(|p| [p[0], p[1], p[2]]);
    poses.chain(points).map(f64::to_bits).collect()
}

/// Largest distance between camera centres, metres.
fn camera_error(a: &BaProblem, b: &BaProblem) -> f64 {
    let centres = |p: &BaProblem| -> Vec<Vector3<f64>> {
        p.poses.iter().map(|p| p.camera_from_world.inverse().translation).collect()
    };
    centres(a).iter().zip(centres(b)).map(|(a, b)| (a - b).norm()).fold(0.0, slam_math::float::max)
}

#[test]
fn the_scene_is_recovered_to_its_noise() {
    let (truth, mut problem) = bundle_scene(12, 600, 5, 0.0);
    let options = BaOptions { robust_rounds: 0, rounds: 1, chi2_mono: 1e9, chi2_stereo: 1e9, ..BaOptions::default() };
    let before = camera_error(&truth, &problem);
    let report = bundle_adjust(&mut problem, &options, &Buffers::default());
    assert!(report.final_cost < 0.1 * report.initial_cost);
    // At the minimum the cost is chi-square distributed with (residuals - parameters) degrees of freedom.
    let residuals: usize =
        problem.observations.iter().map(|o| 2 + usize::from(o.measurement.disparity.is_some())).sum();
    let dof = (residuals - 6 * 10 - 3 * 600) as f64;
    assert!((report.final_cost - dof).abs() < 5.0 * (2.0 * dof).sqrt(), "{} of {dof}", report.final_cost);
    // Neighbours share some 200 points 3.5 m away: sigma / f * z / sqrt(200) = 0.37 mm a link and axis if only the
    // translation were unknown; rotation takes its share, told apart only by the spread of 1/z (30 %): 1.2 mm. Ten links
    // drift like a random walk; three axes; two and a half standard deviations for the worst camera.
    let after = camera_error(&truth, &problem);
    let link = SIGMA_PX / 535.0 * 3.5 / 200f64.sqrt() / 0.3;
    let bound = 2.5 * link * (10.0f64 * 3.0).sqrt();
    assert!(after < bound && after < 0.3 * before, "{before} -> {after}, bound {bound}");
    assert_eq!(problem.poses[0], truth.poses[0]);
    assert_eq!(problem.poses[1], truth.poses[1]);
}

#[test]
fn outliers_are_named_and_do_not_pull() {
    let (truth, mut problem) = bundle_scene(10, 400, 6, 0.1);
    let report = bundle_adjust(&mut problem, &BaOptions::default(), &Buffers::default());
    assert!(report.final_cost < report.initial_cost && report.accepted > 2);
    assert!(camera_error(&truth, &problem) < 0.01, "{}", camera_error(&truth, &problem));
    // Truth of an observation: its distance from the true projection.
    let (mut missed, mut wrong, mut lost, mut right) = (0, 0, 0, 0);
    for (o, outlier) in problem.observations.iter().zip(&report.outlier) {
        let x = truth.poses[o.pose as usize].camera_from_world.transform(&truth.points[o.point as usize]);
        let [u, v] = truth.camera.project(&x).unwrap();
        let distance = ((u - o.measurement.pixel[0]).abs() + (v - o.measurement.pixel[1]).abs()) / SIGMA_PX;
        if distance > 8.0 {
            wrong += 1;
            missed += usize::from(!outlier);
        } else {
            right += 1;
            lost += usize::from(*outlier);
        }
    }
    assert!(wrong > 150 && missed * 50 < wrong, "{missed} of {wrong} outliers missed");
    assert!(lost * 12 < right, "{lost} of {right} inliers lost");
}

#[test]
fn without_a_fixed_pose_the_first_is_held() {
    let (truth, mut problem) = bundle_scene(6, 200, 4, 0.0);
    problem.poses.iter_mut().for_each(|p| p.fixed = false);
    problem.poses[0].camera_from_world = truth.poses[0].camera_from_world;
    let report = bundle_adjust(&mut problem, &BaOptions::default(), &Buffers::default());
    assert_eq!(problem.poses[0].camera_from_world, truth.poses[0].camera_from_world);
    // Scale rests on the disparities alone: 1.2 px are 0.27 m at 3 m, averaged over some 500 measurements.
    let error = camera_error(&truth, &problem);
    assert!(report.final_cost < report.initial_cost && error < 0.05, "{error} m");
}

#[test]
fn bits_do_not_depend_on_threads_nor_on_the_order_of_observations() {
    let (_, mut start) = bundle_scene(8, 700, 5, 0.05);
    // The same camera sees a point twice, differently.
    let mut twice = start.observations[3];
    twice.measurement.pixel[0] += 0.5;
    start.observations.push(twice);
    let solve = |observations: &[usize], threads: usize| {
        let mut problem = start.clone();
        problem.observations = observations.iter().map(|&i| start.observations[i]).collect();
        let report =
            Pool::new(threads).unwrap().run(|| bundle_adjust(&mut problem, &BaOptions::default(), &Buffers::default()));
        let mut outlier = vec![false; observations.len()];
        for (&i, flag) in observations.iter().zip(&report.outlier) {
            outlier[i] = *flag;
        }
        (bits(&problem), report.final_cost.to_bits(), report.iterations, outlier)
    };
    let mut order: Vec<usize> = (0..start.observations.len()).collect();
    let expected = solve(&order, 1);
    let mut rng = Rng::at(3, 0, 0, 0);
    for threads in [1, 2, 4] {
        for i in (1..order.len()).rev() {
            order.swap(i, rng.below(i + 1));
        }
        assert!(solve(&order, threads) == expected, "{threads} threads");
    }
}

#[test]
fn broken_input_is_an_outlier_and_changes_nothing() {
    let (_, clean) = bundle_scene(5, 100, 4, 0.0);
    let mut expected = clean.clone();
    bundle_adjust(&mut expected, &BaOptions::default(), &Buffers::default());
    let mut dirty = clean.clone();
    let n = clean.observations.len();
    let mut add = |change: &dyn Fn(&mut BaObservation)| {
        let mut o = clean.observations[0];
        change(&mut o);
        dirty.observations.push(o);
    };
    add(&|o| o.pose = 5);
    add(&|o| o.point = u32::MAX);
    add(&|o| o.measurement.pixel[0] = f64::NAN);
    add(&|o| o.measurement.disparity = Some(f64::INFINITY));
    add(&|o| o.measurement.weight = 0.0);
    // A point that is not a number, seen well.
    add(&|o| o.point = 100);
    dirty.points.push(Vector3::repeat(f64::NAN));
    let report = bundle_adjust(&mut dirty, &BaOptions::default(), &Buffers::default());
    assert!(report.outlier[n..].iter().all(|o| *o));
    dirty.points.pop();
    assert_eq!(bits(&dirty), bits(&expected));
}

#[test]
fn empty_and_unobserved_problems_stay_as_they_are() {
    let (_, full) = bundle_scene(4, 20, 3, 0.0);
    for (poses, points) in [(0, 0), (4, 0), (0, 20), (4, 20)] {
        let mut problem = full.clone();
        problem.poses.truncate(poses);
        problem.points.truncate(points);
        problem.observations.clear();
        let before = problem.points.clone();
        let report = bundle_adjust(&mut problem, &BaOptions::default(), &Buffers::default());
        assert_eq!((report.initial_cost, report.final_cost), (0.0, 0.0));
        assert_eq!(problem.points, before);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_numbers_are_survived(
        values in proptest::collection::vec((any::<[f64; 4]>(), 0..5u32, 0..25u32), 0..30),
        points in proptest::collection::vec(any::<[f64; 3]>(), 0..5),
    ) {
        let (_, mut problem) = bundle_scene(4, 20, 3, 0.0);
        problem.points.extend(points.into_iter().map(Vector3::from));
        problem.observations.extend(values.into_iter().map(|(v, pose, point)| BaObservation {
            pose,
            point,
            measurement: Measurement { pixel: [v[0], v[1]], disparity: Some(v[2]), weight: v[3].abs(), weight_disparity: 1.0 },
        }));
        let report = bundle_adjust(&mut problem, &BaOptions::default(), &Buffers::default());
        prop_assert!(problem.poses.iter().all(|p| p.camera_from_world.is_finite()));
        prop_assert_eq!(report.outlier.len(), problem.observations.len());
    }
}
