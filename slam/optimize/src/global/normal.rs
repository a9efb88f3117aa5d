//! The damped normal equations of the poses after the points are eliminated.

use nalgebra::{Cholesky, Matrix3, Matrix6, Matrix6x3, Vector3, Vector6};
use slam_math::par;

use super::{Model, State};
use crate::camera::{Linearized, pose_gradient, pose_information, pose_point};
use crate::levenberg::Damping;
use crate::sparse::{BlockMatrix, BlockPattern, subtract_product};

/// Work items that are linearised before they are added up: what lies between the two stays in a cache (some 4 MB).
const WINDOW: usize = 16;

/// What one observation by a free pose adds.
struct EdgeTerm {
    free: u32,
    information: Matrix6<f64>,
    gradient: Vector6<f64>,
    pose_point: Matrix6x3<f64>,
}

/// A point with all that is tied to it.
struct PointTerm {
    /// Inverse of its damped block; zero, which holds the point, when that can't be formed.
    inverse: Matrix3<f64>,
    /// What damping added to its diagonal.
    damping: Vector3<f64>,
    gradient: Vector3<f64>,
    /// By pose.
    edges: Vec<EdgeTerm>,
}

/// The reduced system; storage that is used again.
pub(super) struct Normal {
    pub matrix: BlockMatrix<6>,
    /// Right side of the reduced system.
    pub right: Vec<Vector6<f64>>,
    /// Gradient by the poses and diagonal of their information, before the elimination.
    gradient: Vec<Vector6<f64>>,
    diagonal: Vec<Vector6<f64>>,
}

impl Normal {
    pub fn new(pattern: &BlockPattern) -> Self {
        let zeros = vec![Vector6::zeros(); pattern.size()];
        let matrix = BlockMatrix::zeros(pattern);
        Self { matrix, right: zeros.clone(), gradient: zeros.clone(), diagonal: zeros }
    }

    /// Forms the system at `state`. Points are linearised in parallel and added up in their order.
    pub fn build(&mut self, model: &Model<'_>, state: &State, damping: &Damping) {
        self.matrix.clear();
        for vector in [&mut self.right, &mut self.gradient, &mut self.diagonal] {
            vector.fill(Vector6::zeros());
        }
        for window in model.layout.chunks.chunks(WINDOW) {
            let terms = par::ordered_map(window, |_, points| {
                points.clone().map(|point| point_term(model, state, point, damping)).collect::<Vec<_>>()
            });
            for term in terms.iter().flatten() {
                self.add(&model.layout.pattern, term);
            }
        }
        for (block, diagonal) in self.matrix.diagonal.iter_mut().zip(&self.diagonal) {
            *block += Matrix6::from_diagonal(&diagonal.map(|d| damping.of(d)));
        }
    }

    fn add(&mut self, pattern: &BlockPattern, term: &PointTerm) {
        for (at, edge) in term.edges.iter().enumerate() {
            let free = edge.free as usize;
            self.gradient[free] += edge.gradient;
            self.diagonal[free] += edge.information.diagonal();
            let eliminated = edge.pose_point * term.inverse;
            self.right[free] += eliminated * term.gradient - edge.gradient;
            self.matrix.diagonal[free] += edge.information;
            subtract_product(&mut self.matrix.diagonal[free], &edge.pose_point, &eliminated);
            for other in &term.edges[at + 1..] {
                if other.free == edge.free {
                    // The same camera sees the point twice.
                    let product = other.pose_point * eliminated.transpose();
                    self.matrix.diagonal[free] -= product + product.transpose();
                } else if let Some(slot) = pattern.find(edge.free, other.free) {
                    subtract_product(&mut self.matrix.lower[slot], &other.pose_point, &eliminated);
                }
            }
        }
    }

    /// The poses' share of the decrease that the linear model promises.
    pub fn predicted(&self, steps: &[Vector6<f64>], damping: &Damping) -> f64 {
        let mut predicted = 0.0;
        for ((step, gradient), diagonal) in steps.iter().zip(&self.gradient).zip(&self.diagonal) {
            let scale = diagonal.map(|d| damping.of(d));
            predicted += step.dot(&(scale.component_mul(step) - gradient));
        }
        predicted
    }
}

/// Moves the points by what the poses' steps leave them; returns their share of the promised decrease.
pub(super) fn move_points(
    model: &Model<'_>,
    state: &State,
    steps: &[Vector6<f64>],
    damping: &Damping,
    points: &mut [Vector3<f64>],
) -> f64 {
    let moved = par::ordered_map(&model.layout.chunks, |_, chunk| {
        let step = |point| {
            let term = point_term(model, state, point, damping);
            let mut gradient = term.gradient;
            for edge in &term.edges {
                gradient += edge.pose_point.tr_mul(&steps[edge.free as usize]);
            }
            let step = -(term.inverse * gradient);
            (step, step.dot(&(term.damping.component_mul(&step) - term.gradient)))
        };
        chunk.clone().map(step).collect::<Vec<_>>()
    });
    let mut predicted = 0.0;
    for (point, (step, decrease)) in points.iter_mut().zip(moved.into_iter().flatten()) {
        *point += step;
        predicted += decrease;
    }
    predicted
}

fn point_term(model: &Model<'_>, state: &State, point: usize, damping: &Damping) -> PointTerm {
    let (mut information, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
    let range = model.layout.of_point(point);
    let mut edges = Vec::with_capacity(range.len());
    for at in range.filter(|at| model.active[*at]) {
        let o = &model.problem.observations[model.layout.order[at] as usize];
        let pose = &state.poses[o.pose as usize];
        let x = pose.transform(&state.points[point]);
        let Some(Linearized { chi2, information: m, gradient: g }) = model.camera.linearize(&x, &o.measurement) else {
            continue;
        };
        let weight = model.gates.kernel(model.robust, o.measurement.disparity.is_some()).weight(chi2);
        let (m, g) = (m * weight, g * weight);
        let turned = m * pose.rotation;
        information += pose.rotation.tr_mul(&turned);
        gradient += pose.rotation.tr_mul(&g);
        if let Some(free) = model.layout.free_of[o.pose as usize] {
            edges.push(EdgeTerm {
                free,
                information: pose_information(&m, &x),
                gradient: pose_gradient(&g, &x),
                pose_point: pose_point(&turned, &x),
            });
        }
    }
    let scale = information.diagonal().map(|d| damping.of(d));
    let inverse =
        Cholesky::new(information + Matrix3::from_diagonal(&scale)).map_or_else(Matrix3::zeros, |c| c.inverse());
    PointTerm { inverse, damping: scale, gradient, edges }
}
