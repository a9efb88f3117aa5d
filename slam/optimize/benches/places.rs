//! `cargo bench -p slam-optimize --bench places`: what a loop, a lost track and the start of a monocular map pay.

#[path = "../tests/scene/mod.rs"]
mod scene;

use divan::{Bencher, black_box};
use nalgebra::{SMatrix, Vector6};
use scene::{BF, CAMERA, chain, measure, normal3, point, pose_scene, twist, two_views};
use slam_math::{Rng, Se3};
use slam_optimize::{
    AbsoluteOptions, BaOptions, DepthCamera, Edge, Kernel, PointPair, PoseGraph, PoseGraphOptions, PoseOptions,
    SimilarityOptions, TwoViewOptions, Vertex, absolute_pose_ransac, find_similarity, global_bundle_adjust,
    optimize_pose_graph, two_view_reconstruction,
};

fn main() {
    divan::main();
}

/// 200 points without depth, a share of them wrong (percent).
#[divan::bench(args = [10, 50])]
fn camera_from_pixels_200(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let (_, mut observations) = pose_scene(&mut Rng::at(1, 0, 0, 0), 200, 2 * wrong_percent, 1.0);
    observations.iter_mut().for_each(|o| o.measurement.disparity = None);
    let (options, refinement) = (AbsoluteOptions::default(), PoseOptions::default());
    bencher.bench_local(|| {
        absolute_pose_ransac(&mut Rng::at(2, 0, 0, 0), &CAMERA, BF, black_box(&observations), &options, &refinement)
    });
}

/// 100 pairs of points, a share of them wrong (percent), rigid.
#[divan::bench(args = [10, 50])]
fn similarity_100(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let mut rng = Rng::at(3, 0, 0, 0);
    let motion = Se3::exp(&twist(&mut rng, 0.1, 0.1));
    let pair = |i: usize| {
        let x = point(&mut rng);
        let in_second = motion.transform(&x);
        let seen_by_first = measure(&mut rng, &x, true, 1.0).expect("in front");
        let seen_by_second = measure(&mut rng, &in_second, true, 1.0).expect("in front");
        let in_first = if i < wrong_percent { point(&mut rng) } else { x + normal3(&mut rng, 0.001) };
        PointPair { in_first, in_second, seen_by_first, seen_by_second }
    };
    let pairs: Vec<_> = (0..100).map(pair).collect();
    let camera = DepthCamera { pinhole: CAMERA, bf: BF };
    let options = SimilarityOptions { fix_scale: true, ..SimilarityOptions::default() };
    bencher.bench_local(|| find_similarity(&mut Rng::at(4, 0, 0, 0), &camera, black_box(&pairs), &options));
}

/// 300 matches, a share of them wrong (percent).
#[divan::bench(args = [10, 40])]
fn two_views_300(bencher: Bencher<'_, '_>, wrong_percent: usize) {
    let motion = Se3::exp(&Vector6::new(0.4, 0.05, -0.1, 0.02, -0.05, 0.03));
    let (first, second) = two_views(&mut Rng::at(5, 0, 0, 0), &motion, 300, 300 - 3 * wrong_percent, 0.5);
    let options = TwoViewOptions::default();
    bencher.bench_local(|| {
        two_view_reconstruction(&mut Rng::at(6, 0, 0, 0), &CAMERA, black_box(&first), &second, &options)
    });
}

/// A chain of that many keyframes that closes.
#[divan::bench(args = [100, 1000])]
fn pose_graph(bencher: Bencher<'_, '_>, keyframes: usize) {
    let (truth, start) = chain(keyframes, 0.002, true);
    let edge = |from: usize, to: usize, source: &slam_optimize::BaProblem| Edge {
        from: from as u32,
        to: to as u32,
        to_from_from: source.poses[to].camera_from_world * source.poses[from].camera_from_world.inverse(),
        information: SMatrix::<f64, 6, 6>::identity(),
        kernel: Kernel::Square,
    };
    let mut edges: Vec<_> = (1..keyframes).map(|i| edge(i - 1, i, &start)).collect();
    edges.push(edge(keyframes - 1, 0, &truth));
    let vertices = start.poses.iter().map(|p| Vertex { pose: p.camera_from_world, fixed: p.fixed }).collect();
    let graph = PoseGraph { vertices, edges };
    bencher.with_inputs(|| graph.clone()).bench_local_values(|mut graph| {
        let report = optimize_pose_graph(&mut graph, &PoseGraphOptions::default());
        (graph, report)
    });
}

/// A chain of that many keyframes that closes, 160 observations a keyframe.
#[divan::bench(args = [100], sample_count = 10)]
fn global_bundle(bencher: Bencher<'_, '_>, keyframes: usize) {
    let (_, start) = chain(keyframes, 0.002, true);
    bencher.with_inputs(|| start.clone()).bench_local_values(|mut problem| {
        let report = global_bundle_adjust(&mut problem, &BaOptions::default());
        (problem, report)
    });
}
