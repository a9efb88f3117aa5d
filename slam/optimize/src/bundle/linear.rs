//! The problem linearised around the current estimate, a chunk of points at a time.

use nalgebra::{Matrix3, Matrix6x3, Vector3};
use slam_math::{Buffer, Buffers, Se3, par};

use super::layout::{CHUNK_EDGES, Layout};
use crate::camera::{DepthCamera, Linearized, pose_point};
use crate::robust::Gates;

/// Estimate of all poses and points.
#[derive(Clone)]
pub(super) struct State {
    pub poses: Buffer<Se3>,
    pub points: Buffer<Vector3<f64>>,
}

/// A point's own part of the normal equations.
#[derive(Clone, Copy)]
pub(super) struct PointBlock {
    pub information: Matrix3<f64>,
    pub gradient: Vector3<f64>,
}

/// What one edge adds, in the point's coordinates in the camera's frame (see [`Linearized`]), and the block between pose
/// and point.
#[derive(Clone, Copy)]
pub(super) struct EdgeBlock {
    pub point_in_camera: Vector3<f64>,
    pub information: Matrix3<f64>,
    pub gradient: Vector3<f64>,
    pub pose_point: Matrix6x3<f64>,
}

struct Chunk {
    first_point: usize,
    first_edge: usize,
    points: Buffer<PointBlock>,
    edges: Buffer<EdgeBlock>,
}

/// What the cost is made of, besides the estimate.
pub(super) struct Model {
    pub camera: DepthCamera,
    pub gates: Gates,
    pub layout: Layout,
    pub buffers: Buffers,
}

/// All blocks but those of the poses, which [`super::reduced`] adds up.
pub(super) struct Linearization(Vec<Chunk>);

impl Linearization {
    pub fn point(&self, layout: &Layout, point: usize) -> &PointBlock {
        let chunk = &self.0[layout.chunk_of_point[point]];
        &chunk.points[point - chunk.first_point]
    }

    /// Block of an edge of a point.
    pub fn edge(&self, layout: &Layout, point: usize, edge: usize) -> &EdgeBlock {
        let chunk = &self.0[layout.chunk_of_point[point]];
        &chunk.edges[edge - chunk.first_edge]
    }
}

impl Model {
    /// Linearises the active observations around `state`; hidden points add nothing.
    pub fn linearize(&self, state: &State, robust: bool, active: &[bool]) -> Linearization {
        let chunk = |_: usize, points: &std::ops::Range<usize>| {
            let edges = self.layout.edges_of_chunk(points);
            let mut chunk = Chunk {
                first_point: points.start,
                first_edge: edges.start,
                points: self.buffers.with_room(points.len()),
                edges: self.buffers.with_room(usize::max(edges.len(), CHUNK_EDGES)),
            };
            for point in points.clone() {
                self.linearize_point(point, state, robust, active, &mut chunk);
            }
            chunk
        };
        Linearization(par::ordered_map(&self.layout.chunks, chunk))
    }

    fn linearize_point(&self, point: usize, state: &State, robust: bool, active: &[bool], chunk: &mut Chunk) {
        let mut block = PointBlock { information: Matrix3::zeros(), gradient: Vector3::zeros() };
        for edge in &self.layout.edges[self.layout.edges_of_point[point].clone()] {
            let pose = &state.poses[edge.pose];
            let x = pose.transform(&state.points[point]);
            let (mut information, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            for at in edge.observations.clone().filter(|at| active[*at]) {
                let measurement = &self.layout.observations[at].1;
                let Some(Linearized { chi2, information: m, gradient: g }) = self.camera.linearize(&x, measurement)
                else {
                    continue;
                };
                let weight = self.gates.kernel(robust, measurement.disparity.is_some()).weight(chi2);
                information += m * weight;
                gradient += g * weight;
            }
            let turned = information * pose.rotation;
            block.information += pose.rotation.tr_mul(&turned);
            block.gradient += pose.rotation.tr_mul(&gradient);
            let pose_point = if edge.free.is_some() { pose_point(&turned, &x) } else { Matrix6x3::zeros() };
            chunk.edges.push(EdgeBlock { point_in_camera: x, information, gradient, pose_point });
        }
        chunk.points.push(block);
    }

    /// Squared normalised residuals at `state` in sorted order, `None` where a point can't be seen.
    pub fn chi2(&self, state: &State) -> Buffer<Option<f64>> {
        let chunk = |_: usize, points: &std::ops::Range<usize>| {
            let edges = self.layout.edges_of_chunk(points);
            let mut out = self.buffers.with_room(edges.len());
            for edge in &self.layout.edges[edges] {
                let x = state.poses[edge.pose].transform(&state.points[edge.point]);
                let seen = &self.layout.observations[edge.observations.clone()];
                out.extend(seen.iter().map(|(_, measurement)| self.camera.chi2(&x, measurement)));
            }
            out
        };
        let chunks = par::ordered_map(&self.layout.chunks, chunk);
        let mut all = self.buffers.with_room(self.layout.observations.len());
        all.extend(chunks.iter().flatten().copied());
        all
    }

    /// Sum of the kernel over the active observations, in sorted order.
    pub fn cost(&self, robust: bool, active: &[bool], chi2: impl Iterator<Item = f64>) -> f64 {
        let mut cost = 0.0;
        for (((_, measurement), active), chi2) in self.layout.observations.iter().zip(active).zip(chi2) {
            if *active {
                cost += self.gates.kernel(robust, measurement.disparity.is_some()).cost(chi2);
            }
        }
        cost
    }
}
