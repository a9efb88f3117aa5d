//! A synthetic scene with known truth, shared by tests and benches.
#![allow(dead_code, missing_docs)]

use nalgebra::{Vector3, Vector6};
use slam_math::{Buffer, Rng, Se3};
use slam_optimize::{BaObservation, BaPose, BaProblem, Measurement, Pinhole, PoseObservation};

pub const CAMERA: Pinhole = Pinhole { fx: 535.4, fy: 539.2, cx: 320.1, cy: 247.6 };
pub const BF: f64 = 40.0;
/// Noise of a pixel.
pub const SIGMA_PX: f64 = 0.8;
/// Noise of `disparity`, px.
pub const SIGMA_DISPARITY_PX: f64 = 1.2;

pub fn normal3(rng: &mut Rng, sigma: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * rng.normal())
}

pub fn twist(rng: &mut Rng, sigma_m: f64, sigma_rad: f64) -> Vector6<f64> {
    Vector6::from_fn(|i, _| rng.normal() * if i < 3 { sigma_m } else { sigma_rad })
}

/// A point in front of a camera near the world's origin that looks along z.
pub fn point(rng: &mut Rng) -> Vector3<f64> {
    let z = 1.0 + 4.0 * rng.uniform();
    Vector3::new((rng.uniform() - 0.5) * z, (rng.uniform() - 0.5) * 0.8 * z, z)
}

/// What a camera measures of a point, with the noise of this scene times `noise`.
pub fn measure(rng: &mut Rng, x: &Vector3<f64>, with_depth: bool, noise: f64) -> Option<Measurement> {
    let [u, v] = CAMERA.project(x)?;
    let pixel = [u + noise * SIGMA_PX * rng.normal(), v + noise * SIGMA_PX * rng.normal()];
    let disparity = with_depth.then(|| BF / x[2] + noise * SIGMA_DISPARITY_PX * rng.normal());
    let (weight, weight_disparity) = (1.0 / (SIGMA_PX * SIGMA_PX), 1.0 / (SIGMA_DISPARITY_PX * SIGMA_DISPARITY_PX));
    Some(Measurement { pixel, disparity, weight, weight_disparity })
}

/// True pose and `n` observations, every third without depth, the first `outliers` of them anywhere in the image.
pub fn pose_scene(rng: &mut Rng, n: usize, outliers: usize, noise: f64) -> (Se3, Vec<PoseObservation>) {
    let truth = Se3::exp(&twist(rng, 0.3, 0.2));
    let observations = (0..n).map(|i| {
        let x = point(rng);
        let mut measurement = measure(rng, &x, i % 3 != 0, noise).expect("in front of the camera");
        if i < outliers {
            let pixel = [640.0 * rng.uniform(), 480.0 * rng.uniform()];
            let disparity = measurement.disparity.map(|_| BF / (0.5 + 5.0 * rng.uniform()));
            measurement = Measurement { pixel, disparity, ..measurement };
        }
        PoseObservation { point_in_world: truth.inverse().transform(&x), measurement }
    });
    (truth, observations.collect())
}

/// True problem and the one to be solved: cameras on an arc, every point seen by `views` of them in a row, a share of
/// wrong observations, the free poses and the points disturbed.
pub fn bundle_scene(poses: usize, points: usize, views: usize, outlier_share: f64) -> (BaProblem, BaProblem) {
    let mut rng = Rng::at(11, poses as u32, points as u32, views as u32);
    let camera_at = |i: usize| {
        let along = i as f64 / poses as f64 - 0.5;
        BaPose {
            camera_from_world: Se3::exp(&Vector6::new(1.5 * along, 0.1 * along, 0.0, 0.0, 0.4 * along, 0.0)),
            fixed: i < 2,
        }
    };
    let mut truth = BaProblem {
        camera: CAMERA,
        bf: BF,
        poses: (0..poses).map(camera_at).collect(),
        points: (0..points).map(|_| point(&mut rng) + Vector3::new(0.0, 0.0, 1.0)).collect(),
        observations: Buffer::default(),
    };
    for p in 0..points {
        let first = rng.below(poses - views + 1);
        for pose in first..first + views {
            let x = truth.poses[pose].camera_from_world.transform(&truth.points[p]);
            let Some(mut measurement) = measure(&mut rng, &x, p % 4 != 0, 1.0) else { continue };
            if rng.uniform() < outlier_share {
                measurement.pixel = [640.0 * rng.uniform(), 480.0 * rng.uniform()];
            }
            truth.observations.push(BaObservation { pose: pose as u32, point: p as u32, measurement });
        }
    }
    let mut start = truth.clone();
    for pose in start.poses.iter_mut().filter(|p| !p.fixed) {
        pose.camera_from_world = Se3::exp(&twist(&mut rng, 0.02, 0.01)) * pose.camera_from_world;
    }
    for point in &mut start.points {
        *point += normal3(&mut rng, 0.03);
    }
    (truth, start)
}

/// Matches of two views: `second_from_first` sees the points again; every pair from index `inliers` on is wrong.
pub fn two_views(
    rng: &mut Rng,
    second_from_first: &Se3,
    n: usize,
    inliers: usize,
    sigma_px: f64,
) -> (Vec<[f64; 2]>, Vec<[f64; 2]>) {
    let noisy = |pixel: [f64; 2], rng: &mut Rng| pixel.map(|v| v + sigma_px * rng.normal());
    (0..n)
        .map(|i| {
            let x = point(rng);
            let last = noisy(CAMERA.project(&x).expect("in front"), rng);
            let current = CAMERA.project(&second_from_first.transform(&x)).expect("in front");
            let wrong = [640.0 * rng.uniform(), 480.0 * rng.uniform()];
            (last, noisy(if i < inliers { current } else { wrong }, rng))
        })
        .unzip()
}

/// Points that a keyframe of [`chain`] brings along.
pub const POINTS_A_KEYFRAME: usize = 20;

/// A corridor as a ring: keyframes 0.25 m apart that look ahead, points on both walls seen from the next eight keyframes.
/// With `closed`, the last keyframes see the points of the first. Truth, and a start whose poses have drifted by
/// `drift_m` a keyframe and a tenth of that in radians, points moved along with the keyframe that saw them first.
pub fn chain(keyframes: usize, drift_m: f64, closed: bool) -> (BaProblem, BaProblem) {
    let mut rng = Rng::at(12, keyframes as u32, 0, 0);
    let radius = 0.25 * keyframes as f64 / (2.0 * std::f64::consts::PI);
    // World to camera: on the ring, looking along its tangent.
    let pose = |i: usize| {
        let angle = 2.0 * std::f64::consts::PI * i as f64 / keyframes as f64;
        let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, -angle, 0.0));
        (turn * Se3 { translation: Vector3::new(radius, 0.0, 0.0), ..Se3::identity() }).inverse()
    };
    let poses = (0..keyframes).map(|i| BaPose { camera_from_world: pose(i), fixed: i == 0 }).collect();
    let mut truth =
        BaProblem { camera: CAMERA, bf: BF, poses, points: Buffer::default(), observations: Buffer::default() };
    for i in 0..keyframes {
        for _ in 0..POINTS_A_KEYFRAME {
            let side = if rng.uniform() < 0.5 { -1.0 } else { 1.0 };
            let x = Vector3::new(
                side * (0.8 + 0.4 * rng.uniform()),
                1.6 * (rng.uniform() - 0.5),
                2.5 + 1.5 * rng.uniform(),
            );
            let point = truth.poses[i].camera_from_world.inverse().transform(&x);
            let index = truth.points.len() as u32;
            for view in i..i + 8 {
                if view >= keyframes && !closed {
                    break;
                }
                let pose = view % keyframes;
                let x = truth.poses[pose].camera_from_world.transform(&point);
                let Some(measurement) = measure(&mut rng, &x, !index.is_multiple_of(4), 1.0) else { continue };
                truth.observations.push(BaObservation { pose: pose as u32, point: index, measurement });
            }
            truth.points.push(point);
        }
    }
    let mut start = truth.clone();
    for i in 1..keyframes {
        let step = truth.poses[i].camera_from_world * truth.poses[i - 1].camera_from_world.inverse();
        let drift = Se3::exp(&twist(&mut rng, drift_m, 0.1 * drift_m));
        start.poses[i].camera_from_world = drift * step * start.poses[i - 1].camera_from_world;
    }
    carry_points(&truth, &mut start);
    (truth, start)
}

/// Puts every point where the keyframe that saw it first, at the pose it has now, would have put it.
pub fn carry_points(truth: &BaProblem, problem: &mut BaProblem) {
    for (at, point) in problem.points.iter_mut().enumerate() {
        let i = at / POINTS_A_KEYFRAME;
        let in_camera = truth.poses[i].camera_from_world.transform(&truth.points[at]);
        *point = problem.poses[i].camera_from_world.inverse().transform(&in_camera);
    }
}
