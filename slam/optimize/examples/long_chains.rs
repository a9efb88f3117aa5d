//! `cargo run --release -p slam-optimize --example long_chains [KEYFRAMES...]`: what the solvers of a whole map cost on
//! chains of 100, 1,000 and 10,000 keyframes that close a large loop and, every now and then, a small one. One row a
//! length and solver: CPU seconds of all threads, solves, CPU seconds a solve, blocks of the factor and how many of them are
//! fill-in, cost a residual before and after, peak memory of the process so far (Linux).

#[path = "../tests/scene/mod.rs"]
mod scene;

use nalgebra::{SMatrix, Vector6};
use scene::{carry_points, chain, twist};
use slam_math::{Rng, Se3};
use slam_optimize::{
    BaOptions, BaProblem, Edge, Kernel, PoseGraph, PoseGraphOptions, Vertex, global_bundle_adjust, optimize_pose_graph,
};

/// A place is seen again this many keyframes later, and how often that happens.
const REVISIT: usize = 40;
const REVISIT_EVERY: usize = 100;
/// Drift a keyframe, metres: about one percent of the way.
const DRIFT_M: f64 = 0.002;

fn main() {
    let given: Vec<usize> = std::env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let lengths = if given.is_empty() { vec![100, 1000, 10_000] } else { given };
    println!("solver       keyframes    cpu s  solves  s/solve  blocks  fill-in  cost before  cost after  peak MB");
    for keyframes in lengths {
        let (truth, start) = chain(keyframes, DRIFT_M, true);
        let mut graph = pose_graph(&truth, &start);
        let (report, seconds) = timed(|| optimize_pose_graph(&mut graph, &PoseGraphOptions::default()));
        let report = report.expect("the first vertex is fixed");
        let cost = [report.initial_cost, report.final_cost].map(|cost| cost / (6 * graph.edges.len()) as f64);
        let blocks = keyframes - 1 + graph.edges.len() + report.fill_in;
        print_row("pose graph", keyframes, seconds, report.iterations, [blocks, report.fill_in], cost);

        // As after a loop: the points follow their keyframes, then all is adjusted.
        let mut problem = start;
        for (pose, vertex) in problem.poses.iter_mut().zip(&graph.vertices) {
            pose.camera_from_world = vertex.pose;
        }
        carry_points(&truth, &mut problem);
        let (report, seconds) = timed(|| global_bundle_adjust(&mut problem, &BaOptions::default()));
        let report = report.expect("the first pose is fixed");
        let cost = [report.ba.initial_cost, report.ba.final_cost].map(|cost| cost / residuals(&problem));
        let blocks = [report.factor_blocks, report.fill_in];
        print_row("global BA", keyframes, seconds, report.ba.iterations, blocks, cost);
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
        to_from_from: Se3::exp(&twist(&mut rng, noise * DRIFT_M, 0.1 * noise * DRIFT_M))
            * pose(source, to)
            * pose(source, from).inverse(),
        information: SMatrix::from_diagonal(&Vector6::from_fn(
            |i, _| if i < 3 { 1.0 } else { 100.0 } / (DRIFT_M * DRIFT_M),
        )),
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

fn residuals(problem: &BaProblem) -> f64 {
    problem.observations.iter().map(|o| if o.measurement.disparity.is_some() { 3.0 } else { 2.0 }).sum()
}

fn timed<R>(work: impl FnOnce() -> R) -> (R, f64) {
    let start = cpu_seconds();
    let result = work();
    (result, cpu_seconds() - start)
}

/// User and system time of all threads, in steps of 10 ms: what else runs on the machine does not count. Zero where the
/// system does not tell.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // After the name, which ends the only parenthesis: fields 14 and 15 of proc(5), in ticks of 1/100 s.
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn print_row(solver: &str, keyframes: usize, seconds: f64, solves: u32, blocks: [usize; 2], cost: [f64; 2]) {
    let ([blocks, fill_in], [before, after]) = (blocks, cost);
    println!(
        "{solver:<12} {keyframes:>9} {seconds:>8.3} {solves:>7} {:>8.4} {blocks:>7} {fill_in:>8} {before:>12.3} {after:>11.3} {:>8.0}",
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
