//! `cargo run --release -p slam-optimize --example long_chains [KEYFRAMES...]`: what the solvers of a whole map cost on
//! chains of 100, 1,000 and 10,000 keyframes that close a large loop and, every now and then, a small one. One row a
//! length and solver: seconds, solves, seconds a solve, fill-in, peak memory of the process so far (Linux).

#[path = "../tests/scene/mod.rs"]
mod scene;

use nalgebra::{SMatrix, Vector6};
use scene::{chain, twist};
use slam_math::{LieGroup, Rng, Se3};
use slam_optimize::{
    BaOptions, BaProblem, Edge, Kernel, PoseGraph, PoseGraphOptions, Vertex, global_bundle_adjust, optimize_pose_graph,
};

/// A place is seen again this many keyframes later, and how often that happens.
const REVISIT: usize = 40;
const REVISIT_EVERY: usize = 100;

fn main() {
    let given: Vec<usize> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let lengths = if given.is_empty() { vec![100, 1000, 10_000] } else { given };
    println!("solver       keyframes  seconds  solves  s/solve  blocks  fill-in  error before  after (m)  peak MB");
    for keyframes in lengths {
        let (truth, start) = chain(keyframes, 0.02, true);
        let mut graph = pose_graph(&truth, &start);
        let before = error_m(&truth, graph.vertices.iter().map(|v| v.pose));
        let (report, seconds) = timed(|| optimize_pose_graph(&mut graph, &PoseGraphOptions::default()));
        let report = report.expect("the first vertex is fixed");
        let after = error_m(&truth, graph.vertices.iter().map(|v| v.pose));
        let blocks = keyframes - 1 + graph.edges.len() + report.fill_in;
        print_row("pose graph", keyframes, seconds, report.iterations, [blocks, report.fill_in], [before, after]);

        let mut problem = start;
        let before = error_m(&truth, problem.poses.iter().map(|p| p.camera_from_world));
        let (report, seconds) = timed(|| global_bundle_adjust(&mut problem, &BaOptions::default()));
        let report = report.expect("the first pose is fixed");
        let after = error_m(&truth, problem.poses.iter().map(|p| p.camera_from_world));
        let blocks = [report.factor_blocks, report.fill_in];
        print_row("global BA", keyframes, seconds, report.ba.iterations, blocks, [before, after]);
    }
}

/// Odometry between neighbours, the large loop, and a small one every hundred keyframes; edges with the drift's noise.
fn pose_graph(truth: &BaProblem, start: &BaProblem) -> PoseGraph<Se3, 6> {
    let n = truth.poses.len();
    let pose = |problem: &BaProblem, i: usize| problem.poses[i].camera_from_world;
    let mut rng = Rng::at(1, 0, 0, 0);
    let mut edge = |from: usize, to: usize, source: &BaProblem, noise: f64| Edge {
        from: from as u32,
        to: to as u32,
        to_from_from: Se3::exp(&twist(&mut rng, 0.02 * noise, 0.002 * noise))
            * pose(source, to)
            * pose(source, from).inverse(),
        information: SMatrix::from_diagonal(&Vector6::from_fn(|i, _| if i < 3 { 2.5e3 } else { 2.5e5 })),
        kernel: Kernel::Square,
    };
    // Odometry is what the drifting start says; loops say the truth, as exactly.
    let mut edges: Vec<_> = (1..n).map(|i| edge(i - 1, i, start, 0.0)).collect();
    edges.push(edge(n - 1, 0, truth, 0.1));
    let again = (REVISIT..n).step_by(REVISIT_EVERY).map(|i| edge(i, i - REVISIT, truth, 0.1));
    edges.extend(again.collect::<Vec<_>>());
    let vertices = start.poses.iter().map(|p| Vertex { pose: p.camera_from_world, fixed: p.fixed }).collect();
    PoseGraph { vertices, edges }
}

fn error_m(truth: &BaProblem, poses: impl Iterator<Item = Se3>) -> f64 {
    let squared = |(pose, truth): (Se3, &slam_optimize::BaPose)| {
        (LieGroup::inverse(&pose).translation - truth.camera_from_world.inverse().translation).norm_squared()
    };
    (poses.zip(&truth.poses).map(squared).sum::<f64>() / truth.poses.len() as f64).sqrt()
}

#[expect(clippy::disallowed_methods, reason = "measures; nothing depends on it")]
fn timed<R>(work: impl FnOnce() -> R) -> (R, f64) {
    let start = std::time::Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64())
}

fn print_row(solver: &str, keyframes: usize, seconds: f64, solves: u32, blocks: [usize; 2], error: [f64; 2]) {
    let ([blocks, fill_in], [before, after]) = (blocks, error);
    println!(
        "{solver:<12} {keyframes:>9} {seconds:>8.3} {solves:>7} {:>8.4} {blocks:>7} {fill_in:>8} {before:>13.3} {after:>10.3} {:>8.0}",
        seconds / f64::from(solves),
        peak_memory_mb()
    );
}

/// High-water mark of the resident set; zero where the system does not tell.
fn peak_memory_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()).map_or(0.0, |kb| kb / 1024.0)
}
