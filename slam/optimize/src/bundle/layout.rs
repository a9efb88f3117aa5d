//! The problem's structure in canonical order: observations by (point, pose), edges between points and poses, free poses.

use std::cmp::Ordering;
use std::ops::Range;

use slam_math::{Buffer, Buffers};

use super::{BaObservation, BaProblem};
use crate::camera::Measurement;

/// Edges of a work item, if it has more than one point; constant, so that nothing depends on the number of threads.
pub(super) const CHUNK_EDGES: usize = 512;

/// A point and a pose that are tied by one observation, or by several.
pub(super) struct Edge {
    pub point: usize,
    pub pose: usize,
    /// Number of the pose among the free ones.
    pub free: Option<usize>,
    pub observations: Range<usize>,
}

pub(super) struct Layout {
    /// Usable observations by (point, pose), and their index in the input.
    pub observations: Buffer<(usize, Measurement)>,
    /// By (point, pose).
    pub edges: Buffer<Edge>,
    /// Edges of each point.
    pub edges_of_point: Buffer<Range<usize>>,
    /// Index of each free pose, ascending.
    pub free_poses: Buffer<usize>,
    /// Edges of each free pose, ascending, that is by point.
    pub edges_of_free: Buffer<Buffer<usize>>,
    /// Work items: consecutive points.
    pub chunks: Buffer<Range<usize>>,
    /// Work item of each point.
    pub chunk_of_point: Buffer<usize>,
}

impl Layout {
    pub fn new(problem: &BaProblem, buffers: &Buffers) -> Self {
        let free_poses = free_poses(problem, buffers);
        let mut free_of = buffers.filled(problem.poses.len(), None);
        for (free, &pose) in free_poses.iter().enumerate() {
            free_of[pose] = Some(free);
        }
        let sorted = sorted_observations(problem, buffers);
        let mut edges: Buffer<Edge> = buffers.with_room(sorted.len());
        for (at, (_, o)) in sorted.iter().enumerate() {
            let (point, pose) = (o.point as usize, o.pose as usize);
            match edges.last_mut() {
                Some(edge) if (edge.point, edge.pose) == (point, pose) => edge.observations.end = at + 1,
                _ => edges.push(Edge { point, pose, free: free_of[pose], observations: at..at + 1 }),
            }
        }
        let mut edges_of_point = buffers.filled(problem.points.len(), 0..0);
        let mut edges_of_free = buffers.collect(free_poses.iter().map(|_| buffers.empty()));
        let mut end = 0;
        for (point, range) in edges_of_point.iter_mut().enumerate() {
            let start = end;
            while end < edges.len() && edges[end].point == point {
                if let Some(free) = edges[end].free {
                    edges_of_free[free].push(end);
                }
                end += 1;
            }
            *range = start..end;
        }
        let (chunks, chunk_of_point) = chunks(&edges_of_point, buffers);
        let observations = buffers.collect(sorted.iter().map(|(index, o)| (*index, o.measurement)));
        Self { observations, edges, edges_of_point, free_poses, edges_of_free, chunks, chunk_of_point }
    }

    /// Edges of the points of a chunk: consecutive.
    pub fn edges_of_chunk(&self, points: &Range<usize>) -> Range<usize> {
        self.edges_of_point[points.start].start..self.edges_of_point[points.end - 1].end
    }
}

/// Work items, and the work item of each point.
fn chunks(edges_of_point: &[Range<usize>], buffers: &Buffers) -> (Buffer<Range<usize>>, Buffer<usize>) {
    let mut chunks: Buffer<Range<usize>> = buffers.empty();
    let mut chunk_of_point = buffers.with_room(edges_of_point.len());
    for (point, edges) in edges_of_point.iter().enumerate() {
        match chunks.last_mut() {
            Some(last) if edges.end - edges_of_point[last.start].start <= CHUNK_EDGES => last.end = point + 1,
            _ => chunks.push(point..point + 1),
        }
        chunk_of_point.push(chunks.len() - 1);
    }
    (chunks, chunk_of_point)
}

fn free_poses(problem: &BaProblem, buffers: &Buffers) -> Buffer<usize> {
    let any_fixed = problem.poses.iter().any(|p| p.fixed);
    buffers.collect((0..problem.poses.len()).filter(|&i| !problem.poses[i].fixed && (any_fixed || i > 0)))
}

fn sorted_observations(problem: &BaProblem, buffers: &Buffers) -> Buffer<(usize, BaObservation)> {
    let exists =
        |o: &BaObservation| (o.pose as usize) < problem.poses.len() && (o.point as usize) < problem.points.len();
    let usable = problem.observations.iter().copied().enumerate();
    let mut sorted = buffers.collect(usable.filter(|(_, o)| exists(o) && o.measurement.is_usable()));
    sorted.sort_unstable_by(|(i, a), (j, b)| {
        let by_numbers = || by_numbers(&a.measurement, &b.measurement);
        (a.point, a.pose).cmp(&(b.point, b.pose)).then_with(by_numbers).then(i.cmp(j))
    });
    sorted
}

/// Orders two observations of the same point by the same camera, so that the input's order never matters.
fn by_numbers(a: &Measurement, b: &Measurement) -> Ordering {
    let key = |m: &Measurement| [m.pixel[0], m.pixel[1], m.disparity.unwrap_or(f64::NAN), m.weight, m.weight_disparity];
    let (a, b) = (key(a), key(b));
    a.iter().zip(&b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
}
