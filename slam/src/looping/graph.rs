//! The essential graph: the spanning tree, loops and strong covisibility (ORB-SLAM, T-RO 2015, section VII-B). Its edges
//! hold keyframes relative to each other as they were, new ones as the closed loop says.

use std::collections::BTreeMap;

use nalgebra::{Const, DimMin, SMatrix};
use slam_math::{KeyFrameId, LieGroup, Sim3};
use slam_optimize::pose_graph::{Edge, PoseGraph, PoseGraphError, PoseGraphOptions, Vertex, optimize_pose_graph};
use slam_optimize::robust::Kernel;

use super::seam::Seam;
use crate::context::Context;
use crate::map::{KeyFrame, Map};

/// Keyframes, where they are by the seam, and what ties them.
pub(super) struct Graph {
    keyframes: Vec<KeyFrameId>,
    poses: Vec<Sim3>,
    fixed: Vec<bool>,
    /// `(from, to, to_from_from)`, indices into `keyframes`.
    edges: Vec<(u32, u32, Sim3)>,
}

impl Graph {
    /// The graph over sorted keyframes.
    pub fn new(
        ctx: &Context,
        before: &Map,
        seam: &Seam,
        keyframes: &[KeyFrameId],
        fixed: impl Fn(KeyFrameId) -> bool,
    ) -> Self {
        let found = keyframes.iter().filter_map(|id| seam.pose(before, *id).map(|pose| (*id, pose)));
        let (keyframes, poses): (Vec<KeyFrameId>, Vec<Sim3>) = found.unzip();
        let fixed = keyframes.iter().map(|id| fixed(*id)).collect();
        let mut graph = Self { keyframes, poses, fixed, edges: Vec::new() };
        let was = |id: KeyFrameId| before.keyframe(id).map(|k| Sim3::from(k.camera_from_world));
        for id in graph.keyframes.clone() {
            let older = before.keyframe(id).map(|k| old_edges(k, ctx.config.looping.essential_weight));
            for other in older.unwrap_or_default() {
                graph.tie(other, id, was);
            }
        }
        for (a, b) in seam.new_edges(before) {
            graph.tie(a, b, |id| seam.pose(before, id));
        }
        graph
    }

    /// An edge that holds two keyframes as `pose` has them; nothing when one is not of the graph.
    fn tie(&mut self, from: KeyFrameId, to: KeyFrameId, pose: impl Fn(KeyFrameId) -> Option<Sim3>) {
        let index = |id: KeyFrameId| self.keyframes.binary_search(&id).ok().map(|i| i as u32);
        let ends = index(from).zip(index(to)).zip(pose(from).zip(pose(to)));
        if let Some(((i, j), (a, b))) = ends {
            self.edges.push((i, j, b * a.inverse()));
        }
    }

    /// `camera_from_world` of every keyframe when all edges are as content as they can be together. `None` when numbers
    /// are not finite.
    pub fn solve(self, ctx: &Context) -> Option<BTreeMap<KeyFrameId, Sim3>> {
        let poses: Vec<Sim3> = if ctx.is_monocular() {
            self.optimized(ctx, |pose| pose)?
        } else {
            // Depth fixes the scale.
            self.optimized(ctx, |pose| pose.se3)?.into_iter().map(Sim3::from).collect()
        };
        Some(self.keyframes.into_iter().zip(poses).collect())
    }

    /// The poses as elements of a group, optimised.
    fn optimized<G: LieGroup<N>, const N: usize>(&self, ctx: &Context, element: impl Fn(Sim3) -> G) -> Option<Vec<G>>
    where
        Const<N>: DimMin<Const<N>, Output = Const<N>>,
    {
        let vertex = |(pose, fixed): (&Sim3, &bool)| Vertex { pose: element(*pose), fixed: *fixed };
        let edge = |(from, to, to_from_from): &(u32, u32, Sim3)| Edge {
            from: *from,
            to: *to,
            to_from_from: element(*to_from_from),
            information: SMatrix::identity(),
            kernel: Kernel::Square,
        };
        let mut graph = PoseGraph {
            vertices: self.poses.iter().zip(&self.fixed).map(vertex).collect(),
            edges: self.edges.iter().map(edge).collect(),
        };
        let iterations = ctx.config.looping.graph_iterations;
        let options = PoseGraphOptions { iterations, ..PoseGraphOptions::default() };
        loop {
            match optimize_pose_graph(&mut graph, &options) {
                Ok(_) => return Some(graph.vertices.into_iter().map(|v| v.pose).collect()),
                // A keyframe that nothing ties to the others stays where it is.
                Err(PoseGraphError::Loose { vertex, .. }) => graph.vertices[vertex].fixed = true,
                Err(_) => return None,
            }
        }
    }
}

/// Parent, loops and neighbours with many shared points, each edge from its younger end.
fn old_edges(keyframe: &KeyFrame, weight: u32) -> Vec<KeyFrameId> {
    let strong = keyframe.covisible.iter().filter(|(_, shared)| *shared >= weight).map(|(id, _)| *id);
    let mut others: Vec<KeyFrameId> =
        strong.chain(keyframe.loops.iter().copied()).filter(|o| *o < keyframe.id).collect();
    others.extend(keyframe.parent);
    others.sort_unstable();
    others.dedup();
    others
}
