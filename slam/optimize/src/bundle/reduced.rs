//! The system over the free poses after the points are eliminated, and the step it gives.

use nalgebra::{Cholesky, Matrix3, Matrix6, Vector3, Vector6};
use slam_math::par;

use super::cholesky::{BlockCholesky, times_transposed};
use super::layout::Layout;
use super::linear::Linearization;
use crate::camera::{pose_gradient, pose_information};
use crate::levenberg::Damping;

/// A change of all free poses and all points.
pub(super) struct Step {
    /// Per free pose, `[translation, rotation]`.
    pub poses: Vec<Vector6<f64>>,
    /// Per point, metres in the world.
    pub points: Vec<Vector3<f64>>,
    /// Decrease of the cost that the linear model promises.
    pub predicted: f64,
}

/// A column of the lower triangle of the reduced system, with the right side.
struct Column {
    /// Blocks (k, i) for k = i.. .
    blocks: Vec<Matrix6<f64>>,
    reduced_gradient: Vector6<f64>,
    gradient: Vector6<f64>,
    damping: Vector6<f64>,
}

/// Solves the damped normal equations; `None` when they are not positive definite.
pub(super) fn solve(layout: &Layout, linear: &Linearization, damping: &Damping) -> Option<Step> {
    let inverses: Vec<_> = (0..layout.edges_of_point.len()).map(|p| damped_inverse(linear, p, damping)).collect();
    let mut columns =
        par::ordered_map(&layout.edges_of_free, |free, edges| column(layout, linear, damping, &inverses, free, edges));
    let factor = BlockCholesky::new(columns.iter_mut().map(|c| std::mem::take(&mut c.blocks)).collect())?;
    let poses = factor.solve(columns.iter().map(|c| -c.reduced_gradient).collect());
    let mut predicted = 0.0;
    for (step, c) in poses.iter().zip(&columns) {
        predicted += step.dot(&(c.damping.component_mul(step) - c.gradient));
    }
    let mut points = Vec::with_capacity(inverses.len());
    for (point, inverse) in inverses.iter().enumerate() {
        let block = linear.point(point);
        let mut gradient = block.gradient;
        for edge in layout.edges_of_point[point].clone() {
            if let Some(free) = layout.edges[edge].free {
                gradient += linear.edge(point, edge).pose_point.tr_mul(&poses[free]);
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
fn damped_inverse(linear: &Linearization, point: usize, damping: &Damping) -> Matrix3<f64> {
    let mut damped = linear.point(point).information;
    for i in 0..3 {
        damped[(i, i)] += damping.of(damped[(i, i)]);
    }
    Cholesky::new(damped).map_or_else(Matrix3::zeros, |c| c.inverse())
}

/// Adds up, in the points' order, what belongs to one free pose and the free poses after it.
fn column(
    layout: &Layout,
    linear: &Linearization,
    damping: &Damping,
    inverses: &[Matrix3<f64>],
    free: usize,
    edges: &[usize],
) -> Column {
    let mut blocks = vec![Matrix6::zeros(); layout.free_poses.len() - free];
    let (mut information, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    let mut reduced_gradient = Vector6::zeros();
    for &edge in edges {
        let point = layout.edges[edge].point;
        let block = linear.edge(point, edge);
        information += pose_information(&block.information, &block.point_in_camera);
        gradient += pose_gradient(&block.gradient, &block.point_in_camera);
        let eliminated = block.pose_point * inverses[point];
        reduced_gradient -= eliminated * linear.point(point).gradient;
        for other in edge..layout.edges_of_point[point].end {
            if let Some(row) = layout.edges[other].free {
                blocks[row - free] -= times_transposed(&linear.edge(point, other).pose_point, &eliminated);
            }
        }
    }
    let damping = information.diagonal().map(|d| damping.of(d));
    blocks[0] += information + Matrix6::from_diagonal(&damping);
    Column { blocks, reduced_gradient: reduced_gradient + gradient, gradient, damping }
}
