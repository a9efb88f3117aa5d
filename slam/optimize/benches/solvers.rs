//! `cargo bench -p slam-optimize`: what a frame, a keyframe and a relocalisation pay.

#[path = "../tests/scene/mod.rs"]
mod scene;

use divan::{Bencher, black_box};
use nalgebra::Vector6;
use scene::{BF, CAMERA, bundle_scene, normal3, point, pose_scene, twist, two_views};
use slam_math::{Buffers, Rng, Se3, par::Pool};
use slam_optimize::{
    AbsoluteOptions, BaOptions, FundamentalOptions, PoseOptions, absolute_orientation_ransac, bundle_adjust,
    fundamental_ransac, optimize_pose,
};

fn main() {
    divan::main();
}

/// 500 points, a share of them wrong (percent), from a motion model's error.
#[divan::bench(args = [0, 20, 40])]
fn pose_500(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let mut rng = Rng::at(1, 0, 0, 0);
    let (truth, observations) = pose_scene(&mut rng, 500, 5 * wrong_percent, 1.0);
    let start = Se3::exp(&twist(&mut rng, 0.02, 0.01)) * truth;
    let (options, buffers) = (PoseOptions::default(), Buffers::default());
    bencher.bench_local(|| optimize_pose(&CAMERA, BF, black_box(&observations), &start, &options, &buffers));
}

/// 20 keyframes, 2000 points, 10000 observations, by number of threads.
#[divan::bench(args = [1, 2])]
fn local_bundle_20(bencher: Bencher<'_, '_>, threads: usize) {
    let (_, start) = bundle_scene(20, 2000, 5, 0.03);
    let pool = Pool::new(threads).expect("threads");
    // As in a slam: the memory of one adjustment serves the next.
    let buffers = Buffers::default();
    bencher.with_inputs(|| start.clone()).bench_local_values(|mut problem| {
        let report = pool.run(|| bundle_adjust(&mut problem, &BaOptions::default(), &buffers));
        (problem, report)
    });
}

/// 300 matches, a share of them wrong (percent).
#[divan::bench(args = [10, 30, 50])]
fn fundamental_300(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let motion = Se3::exp(&Vector6::new(0.2, 0.05, -0.1, 0.02, -0.05, 0.03));
    let (last, current) = two_views(&mut Rng::at(2, 0, 0, 0), &motion, 300, 300 - 3 * wrong_percent, 0.4);
    bencher.bench_local(|| {
        fundamental_ransac(&mut Rng::at(3, 0, 0, 0), black_box(&last), &current, &FundamentalOptions::default())
    });
}

/// 200 pairs, a share of them wrong (percent).
#[divan::bench(args = [10, 50, 80])]
fn absolute_200(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let mut rng = Rng::at(4, 0, 0, 0);
    let truth = Se3::exp(&twist(&mut rng, 1.0, 0.8));
    let source: Vec<_> = (0..200).map(|_| point(&mut rng)).collect();
    let mut target: Vec<_> = source.iter().map(|p| truth.transform(p) + normal3(&mut rng, 0.01)).collect();
    for wrong in &mut target[..2 * wrong_percent] {
        *wrong += normal3(&mut rng, 1.0);
    }
    bencher.bench_local(|| {
        let agrees = |i: usize, moved: &nalgebra::Vector3<f64>| (target[i] - moved).norm_squared() < 11.3e-4;
        absolute_orientation_ransac(&mut Rng::at(5, 0, 0, 0), &source, &target, agrees, &AbsoluteOptions::default())
    });
}
