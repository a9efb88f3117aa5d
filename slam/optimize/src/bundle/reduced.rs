//! The system over the free poses after the points are eliminated, and the step it gives.

use nalgebra::{Cholesky, Matrix3, Matrix6, Vector3, Vector6};
use slam_math::{Buffer, par};

use super::cholesky::{BlockCholesky, subtract_product};
use super::linear::{Linearization, Model, PointBlock};
use crate::camera::{pose_gradient, pose_information};
use crate::levenberg::Damping;

/// A change of all free poses and all points.
pub(super) struct Step {
    /// Per free pose, `[translation, rotation]`.
    pub poses: Buffer<Vector6<f64>>,
    /// Per point, metres in the world.
    pub points: Buffer<Vector3<f64>>,
    /// Decrease of the cost that the linear model promises.
    pub predicted: f64,
}

/// A column of the lower triangle of the reduced system, with the right side.
struct Column {
    /// Blocks (k, i) for k = i.. .
    blocks: Buffer<Matrix6<f64>>,
    reduced_gradient: Vector6<f64>,
    gradient: Vector6<f64>,
    damping: Vector6<f64>,
}

/// Solves the damped normal equations; `None` when they are not positive definite.
pub(super) fn solve(model: &Model, linear: &Linearization, damping: &Damping) -> Option<Step> {
    let Model { layout, buffers, .. } = model;
    let points = 0..layout.edges_of_point.len();
    let inverses = buffers.collect(points.map(|point| damped_inverse(linear.point(layout, point), damping)));
    let mut columns =
        par::ordered_map(&layout.edges_of_free, |free, edges| column(model, linear, damping, &inverses, free, edges));
    let factor = BlockCholesky::new(buffers.collect(columns.iter_mut().map(|c| std::mem::take(&mut c.blocks))))?;
    let poses = factor.solve(buffers.collect(columns.iter().map(|c| -c.reduced_gradient)));
    let mut predicted = 0.0;
    for (step, c) in poses.iter().zip(&columns) {
        predicted += step.dot(&(c.damping.component_mul(step) - c.gradient));
    }
    let mut points = buffers.with_room(inverses.len());
    for (point, inverse) in inverses.iter().enumerate() {
        let block = linear.point(layout, point);
        let mut gradient = block.gradient;
        for edge in layout.edges_of_point[point].clone() {
            if let Some(free) = layout.edges[edge].free {
                gradient += linear.edge(layout, point, edge).pose_point.tr_mul(&poses[free]);
            }
        }
        let step = -(inverse * gradient);
        let scale = block.information.diagonal().map(|d| damping.of(d));
        predicted += step.dot(&(scale.component_mul(&step) - block.gradient));
        points.push(step);
    }
    Some(Step { poses, points, predicted })
}

/// Inverse of a point's damped block; zero, which holds the point, when that can't be formed.
fn damped_inverse(point: &PointBlock, damping: &Damping) -> Matrix3<f64> {
    let mut damped = point.information;
    for i in 0..3 {
        damped[(i, i)] += damping.of(damped[(i, i)]);
    }
    Cholesky::new(damped).map_or_else(Matrix3::zeros, |c| c.inverse())
}

/// Adds up, in the points' order, what belongs to one free pose and the free poses after it.
fn column(
    model: &Model,
    linear: &Linearization,
    damping: &Damping,
    inverses: &[Matrix3<f64>],
    free: usize,
    edges: &[usize],
) -> Column {
    let layout = &model.layout;
    let mut blocks = model.buffers.filled(layout.free_poses.len() - free, Matrix6::zeros());
    let (mut information, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    let mut reduced_gradient = Vector6::zeros();
    for &edge in edges {
        let point = layout.edges[edge].point;
        let block = linear.edge(layout, point, edge);
        information += pose_information(&block.information, &block.point_in_camera);
        gradient += pose_gradient(&block.gradient, &block.point_in_camera);
        let eliminated = block.pose_point * inverses[point];
        reduced_gradient -= eliminated * linear.point(layout, point).gradient;
        for other in edge..layout.edges_of_point[point].end {
            if let Some(row) = layout.edges[other].free {
                subtract_product(&mut blocks[row - free], &linear.edge(layout, point, other).pose_point, &eliminated);
            }
        }
    }
    let damping = information.diagonal().map(|d| damping.of(d));
    blocks[0] += information + Matrix6::from_diagonal(&damping);
    Column { blocks, reduced_gradient: reduced_gradient + gradient, gradient, damping }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::layout::Layout;
    use crate::bundle::linear::State;
    use crate::bundle::{BaObservation, BaPose, BaProblem};
    use crate::camera::{DepthCamera, Measurement, Pinhole};
    use crate::robust::Gates;
    use nalgebra::{DMatrix, DVector};
    use slam_math::{Buffers, Rng, Se3};

    fn small_problem() -> BaProblem {
        let mut rng = Rng::at(5, 0, 0, 0);
        let camera = Pinhole { fx: 500.0, fy: 510.0, cx: 320.0, cy: 240.0 };
        let mut pose = |fixed| {
            let twist = Vector6::from_fn(|_, _| 0.1 * rng.normal());
            BaPose { camera_from_world: Se3::exp(&twist), fixed }
        };
        let poses = vec![pose(false), pose(true), pose(false), pose(false)];
        let points: Vec<_> = (0..7).map(|_| Vector3::new(rng.normal(), rng.normal(), 4.0 + rng.uniform())).collect();
        let mut observations = Vec::new();
        for (point, position) in points.iter().enumerate() {
            for (pose, p) in poses.iter().enumerate().filter(|(pose, _)| (pose + point) % 4 != 0) {
                let x = p.camera_from_world.transform(position);
                let pixel = camera.project(&x).unwrap().map(|v| v + 2.0 * rng.normal());
                let disparity = (point % 2 == 0).then_some(40.0 / x[2] + rng.normal());
                let measurement = Measurement { pixel, disparity, weight: 1.0 + rng.uniform(), weight_disparity: 0.5 };
                observations.push(BaObservation { pose: pose as u32, point: point as u32, measurement });
            }
        }
        // The same camera sees a point twice: one edge, two observations.
        observations.push(BaObservation {
            measurement: Measurement { disparity: None, ..observations[0].measurement },
            ..observations[0]
        });
        BaProblem { camera, bf: 40.0, poses: poses.into(), points: points.into(), observations: observations.into() }
    }

    /// All weighted residuals after a change of the free poses and the points, in one vector.
    fn residuals(model: &Model, state: &State, delta: &DVector<f64>) -> Vec<f64> {
        let mut state = state.clone();
        let free = &model.layout.free_poses;
        for (i, &pose) in free.iter().enumerate() {
            state.poses[pose] = Se3::exp(&Vector6::from_fn(|r, _| delta[6 * i + r])) * state.poses[pose];
        }
        for (i, point) in state.points.iter_mut().enumerate() {
            *point += Vector3::from_fn(|r, _| delta[6 * free.len() + 3 * i + r]);
        }
        let mut out = Vec::new();
        for edge in &model.layout.edges {
            let x = state.poses[edge.pose].transform(&state.points[edge.point]);
            for (_, m) in &model.layout.observations[edge.observations.clone()] {
                let [u, v, right] = model.camera.residual(&x, m).unwrap();
                out.extend([u * m.weight.sqrt(), v * m.weight.sqrt(), right * m.weight_disparity.sqrt()]);
            }
        }
        out
    }

    #[test]
    fn the_reduced_step_equals_the_full_dense_one() {
        let problem = small_problem();
        let model = Model {
            camera: DepthCamera { pinhole: problem.camera, bf: problem.bf },
            gates: Gates { mono: 5.991, stereo: 7.815 },
            layout: Layout::new(&problem, &Buffers::default()),
            buffers: Buffers::default(),
        };
        let poses: Vec<Se3> = problem.poses.iter().map(|p| p.camera_from_world).collect();
        let state = State { poses: poses.into(), points: problem.points.clone() };
        let n = 6 * 3 + 3 * problem.points.len();
        let at = |delta: &DVector<f64>| DVector::from_vec(residuals(&model, &state, delta));
        let e = at(&DVector::zeros(n));
        let mut jacobian = DMatrix::zeros(e.len(), n);
        for c in 0..n {
            let mut delta = DVector::zeros(n);
            delta[c] = 1e-6;
            jacobian.set_column(c, &((at(&delta) - at(&-delta)) / 2e-6));
        }
        let damping = Damping::new(1e-2);
        let normal = jacobian.transpose() * &jacobian;
        let scale = normal.diagonal().map(|d| damping.of(d));
        let gradient = jacobian.transpose() * &e;
        let dense = -(normal + DMatrix::from_diagonal(&scale)).lu().solve(&gradient).unwrap();

        let active = vec![true; model.layout.observations.len()];
        let step = solve(&model, &model.linearize(&state, false, &active), &damping).unwrap();
        let parts = step.poses.iter().flat_map(|p| p.iter()).chain(step.points.iter().flat_map(|p| p.iter()));
        let reduced = DVector::from_iterator(n, parts.copied());
        assert!((&reduced - &dense).norm() < 1e-6 * dense.norm(), "{reduced} {dense}");
        let predicted = dense.dot(&(scale.component_mul(&dense) - gradient));
        assert!((step.predicted - predicted).abs() < 1e-6 * predicted);
    }
}
