//! All poses and points of a map.

mod scene;

use nalgebra::Vector3;
use scene::{BF, CAMERA, bundle_scene, chain};
use slam_math::par::Pool;
use slam_math::{Buffer, Buffers, Se3, float};
use slam_optimize::{BaObservation, BaOptions, BaProblem, LoosePose, bundle_adjust, global_bundle_adjust};

fn bits(problem: &BaProblem) -> Vec<u64> {
    let poses = problem.poses.iter().flat_map(|p| p.camera_from_world.rows());
    let points = problem.points.iter().flat_map(|p| [p[0], p[1], p[2]]);
    poses.chain(points).map(f64::to_bits).collect()
}

fn centre(pose: &Se3) -> Vector3<f64> {
    pose.inverse().translation
}

/// Largest distance between camera centres.
fn camera_error(a: &BaProblem, b: &BaProblem) -> f64 {
    let distance = |(a, b): (&_, &_)| -> f64 { (centre(a) - centre(b)).norm() };
    let poses = |p: &BaProblem| p.poses.iter().map(|p| p.camera_from_world).collect::<Vec<_>>();
    poses(a).iter().zip(&poses(b)).map(distance).fold(0.0, float::max)
}

#[test]
fn it_finds_the_same_minimum_as_the_local_one() {
    for outlier_share in [0.0, 0.1] {
        let (truth, start) = bundle_scene(12, 600, 5, outlier_share);
        let options = BaOptions { iterations: 30, relative_decrease: 1e-9, ..BaOptions::default() };
        let (mut local, mut global) = (start.clone(), start);
        let expected = bundle_adjust(&mut local, &options, &Buffers::default());
        let report = global_bundle_adjust(&mut global, &options).unwrap();
        assert!(camera_error(&local, &global) < 1e-4, "{}", camera_error(&local, &global));
        assert!(camera_error(&truth, &global) < 0.02);
        assert!(
            (report.ba.final_cost - expected.final_cost).abs() < 1e-3 * expected.final_cost,
            "{} {}",
            report.ba.final_cost,
            expected.final_cost
        );
        let differ = report.ba.outlier.iter().zip(&expected.outlier).filter(|(a, b)| a != b).count();
        assert!(differ * 500 < expected.outlier.len(), "{differ} of {}", expected.outlier.len());
        assert!(report.scale_kept_at.is_empty() && report.ba.initial_cost == expected.initial_cost);
    }
}

#[test]
fn a_long_loop_comes_back_to_its_start() {
    let (truth, mut problem) = chain(300, 0.005, true);
    let before = camera_error(&truth, &problem);
    let report = global_bundle_adjust(&mut problem, &BaOptions { iterations: 30, ..BaOptions::default() }).unwrap();
    let after = camera_error(&truth, &problem);
    // 75 m of nothing but pixels 0.8 px off: what is left is their noise, not the drift.
    assert!(after < 0.1 && after < 0.2 * before, "{before} m -> {after} m, {report:?}", report = report.ba.iterations);
    // Closed, but still a chain: the factor stays narrow.
    assert!(report.factor_blocks < 300 * 40, "{} blocks", report.factor_blocks);
}

#[test]
fn without_depth_the_scale_is_kept_where_it_was() {
    let (truth, mut problem) = bundle_scene(10, 500, 5, 0.0);
    for (i, pose) in problem.poses.iter_mut().enumerate() {
        pose.fixed = i == 0;
    }
    problem.observations.iter_mut().for_each(|o| o.measurement.disparity = None);
    let start = problem.clone();
    let options = BaOptions { iterations: 40, ..BaOptions::default() };
    let report = global_bundle_adjust(&mut problem, &options).unwrap();
    let [kept] = report.scale_kept_at[..] else { panic!("{:?}", report.scale_kept_at) };
    let distance =
        |p: &BaProblem| (centre(&p.poses[kept].camera_from_world) - centre(&p.poses[0].camera_from_world)).norm();
    assert!((distance(&problem) - distance(&start)).abs() < 1e-9);
    assert!(report.ba.final_cost < 0.2 * report.ba.initial_cost);
    // The shape is right once the scale is divided out.
    let unit = distance(&truth) / distance(&problem);
    for (found, truth) in problem.poses.iter().zip(&truth.poses) {
        assert!((centre(&found.camera_from_world) * unit - centre(&truth.camera_from_world)).norm() < 0.02);
    }
    // Two fixed poses that stand apart fix the scale as well.
    let mut two = start;
    two.poses[9].fixed = true;
    assert!(global_bundle_adjust(&mut two, &options).unwrap().scale_kept_at.is_empty());
}

#[test]
fn parts_without_a_fixed_pose_are_refused() {
    let (_, start) = bundle_scene(6, 100, 3, 0.0);
    let mut loose = start.clone();
    loose.poses.iter_mut().for_each(|p| p.fixed = false);
    let untouched = loose.clone();
    assert_eq!(global_bundle_adjust(&mut loose, &BaOptions::default()), Err(LoosePose { pose: 0 }));
    assert_eq!(loose, untouched);
    let mut blind = start;
    blind.observations.retain(|o| o.pose != 4);
    assert_eq!(global_bundle_adjust(&mut blind, &BaOptions::default()), Err(LoosePose { pose: 4 }));
    let mut empty = BaProblem {
        camera: CAMERA,
        bf: BF,
        poses: Buffer::default(),
        points: Buffer::default(),
        observations: Buffer::default(),
    };
    assert_eq!(global_bundle_adjust(&mut empty, &BaOptions::default()).unwrap().ba.final_cost, 0.0);
}

#[test]
fn bits_do_not_depend_on_threads() {
    let (_, start) = chain(60, 0.005, true);
    let solve = |threads| {
        let mut problem = start.clone();
        let solved = || global_bundle_adjust(&mut problem, &BaOptions::default()).map(|r| r.ba.final_cost.to_bits());
        let cost = Pool::new(threads).unwrap().run(solved).unwrap();
        (bits(&problem), cost)
    };
    let expected = solve(1);
    assert!(solve(2) == expected && solve(4) == expected);
}

#[test]
fn broken_input_is_an_outlier_and_changes_nothing() {
    let (_, clean) = bundle_scene(5, 100, 4, 0.0);
    let mut expected = clean.clone();
    global_bundle_adjust(&mut expected, &BaOptions::default()).unwrap();
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
    add(&|o| o.measurement.weight = 0.0);
    add(&|o| o.point = 100);
    dirty.points.push(Vector3::repeat(f64::NAN));
    let report = global_bundle_adjust(&mut dirty, &BaOptions::default()).unwrap();
    assert!(report.ba.outlier[n..].iter().all(|o| *o));
    dirty.points.pop();
    assert_eq!(bits(&dirty), bits(&expected));
}
