//! Poses tied by relative poses.

use nalgebra::{Const, DimMin, SMatrix, SVector, Vector3, Vector6};
use proptest::prelude::*;
use slam_math::par::Pool;
use slam_math::{LieGroup, Rng, Se3, Sim3};
use slam_optimize::{Edge, Kernel, PoseGraph, PoseGraphError, PoseGraphOptions, Vertex, optimize_pose_graph};

/// Keyframes on a circle of 60 m, looking ahead, `camera_from_world`.
fn circle(n: usize) -> Vec<Se3> {
    let radius = 60.0 / (2.0 * std::f64::consts::PI);
    let at = |i: usize| {
        let angle = 2.0 * std::f64::consts::PI * i as f64 / n as f64;
        let turn = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, angle, 0.0));
        (turn * Se3 { translation: Vector3::new(radius, 0.0, 0.0), ..Se3::identity() }).inverse()
    };
    (0..n).map(at).collect()
}

fn edge<G: LieGroup<N>, const N: usize>(truth: &[G], from: usize, to: usize, error: &SVector<f64, N>) -> Edge<G, N> {
    Edge {
        from: from as u32,
        to: to as u32,
        to_from_from: G::exp(error) * truth[to] * truth[from].inverse(),
        information: SMatrix::identity(),
        kernel: Kernel::Square,
    }
}

/// Odometry with the same error every step, chained from the first vertex, and one edge that closes the circle.
fn drifting<G: LieGroup<N>, const N: usize>(truth: &[G], error: &SVector<f64, N>) -> PoseGraph<G, N> {
    let mut graph = PoseGraph { vertices: vec![Vertex { pose: truth[0], fixed: true }], edges: Vec::new() };
    for i in 1..truth.len() {
        let step = edge(truth, i - 1, i, error);
        let pose = step.to_from_from * graph.vertices[i - 1].pose;
        graph.vertices.push(Vertex { pose, fixed: false });
        graph.edges.push(step);
    }
    graph.edges.push(edge(truth, truth.len() - 1, 0, &SVector::zeros()));
    graph
}

/// Root mean square distance of the camera centres.
fn error_m(poses: impl Iterator<Item = Se3>, truth: &[Se3]) -> f64 {
    let centre = |pose: &Se3| pose.inverse().translation;
    let squares: f64 = poses.zip(truth).map(|(p, t)| (centre(&p) - centre(t)).norm_squared()).sum();
    (squares / truth.len() as f64).sqrt()
}

#[test]
fn a_drifting_loop_of_60_m_closes_to_under_a_tenth() {
    let truth = circle(120);
    // Yaw and height add up around the circle; what turns with the camera mostly cancels, and no closing edge sees it.
    let drift = Vector6::new(0.0005, 0.004, -0.0005, 0.0001, 0.003, 0.0001);
    let mut graph = drifting(&truth, &drift);
    let open = error_m(graph.vertices.iter().map(|v| v.pose), &truth);
    let report = optimize_pose_graph(&mut graph, &PoseGraphOptions::default()).unwrap();
    let closed = error_m(graph.vertices.iter().map(|v| v.pose), &truth);
    assert!(report.converged && report.final_cost < report.initial_cost);
    assert!(open > 1.0 && closed < 0.1 * open, "{open} m -> {closed} m, {report:?}");
    assert_eq!(graph.vertices[0].pose, truth[0]);
}

#[test]
fn scale_drift_is_taken_back() {
    let truth: Vec<Sim3> = circle(120).into_iter().map(Sim3::from).collect();
    // 0.3 % of scale a keyframe: 40 % around the circle.
    let drift = SVector::from([0.002, 0.0, 0.001, 0.0, 0.001, 0.0, 0.003]);
    let mut graph = drifting(&truth, &drift);
    let rigid: Vec<Se3> = truth.iter().map(|t| t.se3).collect();
    let error = |graph: &PoseGraph<Sim3, 7>| error_m(graph.vertices.iter().map(|v| v.pose.to_se3()), &rigid);
    let open = error(&graph);
    let report = optimize_pose_graph(&mut graph, &PoseGraphOptions::default()).unwrap();
    assert!(error(&graph) < 0.1 * open, "{open} m -> {} m, {report:?}", error(&graph));
    let worst = graph.vertices.iter().map(|v| (v.pose.scale - 1.0).abs()).fold(0.0, slam_math::float::max);
    assert!(worst < 0.03, "scale off by {worst}");
}

fn consistent_edges_give_the_truth<G: LieGroup<N>, const N: usize>(seed: u64)
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    let mut rng = Rng::at(seed, N as u32, 0, 0);
    let mut random = |spread: f64| SVector::<f64, N>::from_fn(|_, _| spread * rng.normal());
    let truth: Vec<G> = (0..15).map(|_| G::exp(&random(0.6))).collect();
    let vertices = truth.iter().enumerate().map(|(i, t)| {
        let fixed = i == 7;
        Vertex { pose: if fixed { *t } else { G::exp(&random(0.05)) * *t }, fixed }
    });
    let mut graph = PoseGraph { vertices: vertices.collect(), edges: Vec::new() };
    for i in 1..15 {
        graph.edges.push(edge(&truth, i, i - 1, &SVector::zeros()));
        graph.edges.push(edge(&truth, i * 5 % 15, (i * 5 + i) % 15, &SVector::zeros()));
    }
    optimize_pose_graph(&mut graph, &PoseGraphOptions::default()).expect("every vertex is tied to the fixed one");
    for (vertex, truth) in graph.vertices.iter().zip(&truth) {
        assert!((vertex.pose * truth.inverse()).log().norm() < 1e-6);
    }
}

#[test]
fn exact_edges_give_the_exact_poses() {
    for seed in 0..5 {
        consistent_edges_give_the_truth::<Se3, 6>(seed);
        consistent_edges_give_the_truth::<Sim3, 7>(seed);
    }
}

#[test]
fn a_robust_edge_does_not_pull() {
    let truth = circle(60);
    let drift = Vector6::new(0.001, 0.0, 0.0, 0.0, 0.0005, 0.0);
    let wrong = Vector6::new(5.0, 0.0, -4.0, 0.0, 0.8, 0.0);
    let solve = |kernel| {
        let mut graph = drifting(&truth, &drift);
        // Precise odometry, 1 mm and 1 mrad; one place taken for another.
        graph.edges.push(Edge { kernel, ..edge(&truth, 10, 40, &wrong) });
        graph.edges.iter_mut().for_each(|e| e.information *= 1e6);
        optimize_pose_graph(&mut graph, &PoseGraphOptions { iterations: 100, ..Default::default() }).unwrap();
        error_m(graph.vertices.iter().map(|v| v.pose), &truth)
    };
    let (robust, plain) = (solve(Kernel::Huber { gate: 12.6 }), solve(Kernel::Square));
    assert!(plain > 2.0 && robust < 0.1 * plain, "{robust} m, without a kernel {plain} m");
}

#[test]
fn bits_do_not_depend_on_threads() {
    let start = drifting(&circle(2500), &Vector6::new(1e-4, 0.0, 1e-4, 0.0, 1e-4, 0.0));
    let solve = |threads| {
        let mut graph = start.clone();
        Pool::new(threads).unwrap().run(|| optimize_pose_graph(&mut graph, &PoseGraphOptions::default())).unwrap();
        graph.vertices.iter().flat_map(|v| v.pose.rows()).map(f64::to_bits).collect::<Vec<_>>()
    };
    let expected = solve(1);
    assert!(solve(2) == expected && solve(4) == expected);
}

#[test]
fn graphs_that_can_not_be_solved_are_refused_and_left_alone() {
    let graph = drifting(&circle(6), &Vector6::zeros());
    let refused = |change: &dyn Fn(&mut PoseGraph<Se3, 6>)| {
        let mut changed = graph.clone();
        change(&mut changed);
        optimize_pose_graph(&mut changed, &PoseGraphOptions::default()).unwrap_err()
    };
    assert_eq!(refused(&|g| g.vertices[0].fixed = false), PoseGraphError::Loose { vertex: 0, size: 6 });
    assert_eq!(refused(&|g| drop(g.edges.drain(2..=3))), PoseGraphError::Loose { vertex: 3, size: 1 });
    let bad = refused(&|g| g.edges[1].to = 6);
    assert_eq!(bad, PoseGraphError::BadEdge { edge: 1, from: 1, to: 6, vertices: 6 });
    assert!(matches!(refused(&|g| g.edges[1].to = 1), PoseGraphError::BadEdge { .. }));
    let nan = refused(&|g| g.vertices[3].pose.translation[0] = f64::NAN);
    assert_eq!(nan, PoseGraphError::NotFinite { what: "vertex", index: 3 });
    assert!(matches!(refused(&|g| g.edges[4].information[(2, 2)] = f64::INFINITY), PoseGraphError::NotFinite { .. }));
    let mut empty = PoseGraph::<Se3, 6> { vertices: Vec::new(), edges: Vec::new() };
    assert_eq!(optimize_pose_graph(&mut empty, &PoseGraphOptions::default()).unwrap().final_cost, 0.0);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn any_edges_are_survived(
        ends in proptest::collection::vec((0..8u32, 0..8u32, proptest::array::uniform6(-1e3..1e3f64), 0.0..1e6f64), 0..20),
    ) {
        let mut graph = drifting(&circle(8), &Vector6::zeros());
        graph.edges.extend(ends.into_iter().filter(|(a, b, ..)| a != b).map(|(from, to, twist, weight)| Edge {
            from,
            to,
            to_from_from: Se3::exp(&Vector6::from(twist)),
            information: SMatrix::identity() * weight,
            kernel: Kernel::Huber { gate: 12.6 },
        }));
        let report = optimize_pose_graph(&mut graph, &PoseGraphOptions::default()).unwrap();
        prop_assert!(report.final_cost <= report.initial_cost);
        prop_assert!(graph.vertices.iter().all(|v| v.pose.is_finite()));
    }
}
