//! The problem's structure: observations by point, free poses, and which of them share points.

use std::ops::Range;

use crate::bundle::BaProblem;
use crate::sparse::BlockPattern;

/// Points a work item; constant, so that no sum depends on the number of threads.
const CHUNK: usize = 64;
/// Points after which repeated pairs of poses are dropped: bounds the memory while they are collected.
const PAIR_WINDOW: usize = 4096;

pub(super) struct Layout {
    /// Usable observations by (point, pose, index in the input): their index in the input.
    pub order: Vec<u32>,
    /// First place in `order` of every point, and the end.
    starts: Vec<u32>,
    /// Index of each free pose, ascending.
    pub free_poses: Vec<u32>,
    /// Per pose: its number among the free ones.
    pub free_of: Vec<Option<u32>>,
    /// Which free poses see a common point.
    pub pattern: BlockPattern,
    /// Work items: consecutive points.
    pub chunks: Vec<Range<usize>>,
}

impl Layout {
    pub fn new(problem: &BaProblem) -> Self {
        let free_poses: Vec<u32> =
            (0..problem.poses.len() as u32).filter(|i| !problem.poses[*i as usize].fixed).collect();
        let mut free_of = vec![None; problem.poses.len()];
        for (free, &pose) in free_poses.iter().enumerate() {
            free_of[pose as usize] = Some(free as u32);
        }
        let (order, starts) = by_point(problem);
        let n = problem.points.len();
        let chunks = (0..n).step_by(CHUNK).map(|start| start..usize::min(start + CHUNK, n)).collect();
        let size = free_poses.len();
        let mut layout = Self { order, starts, free_poses, free_of, pattern: BlockPattern::new(size, []), chunks };
        layout.pattern = BlockPattern::new(size, layout.pairs(problem));
        layout
    }

    /// Places in `order` of a point's observations.
    pub fn of_point(&self, point: usize) -> Range<usize> {
        self.starts[point] as usize..self.starts[point + 1] as usize
    }

    fn pairs(&self, problem: &BaProblem) -> Vec<(u32, u32)> {
        let (mut all, mut window) = (Vec::new(), Vec::new());
        for point in 0..problem.points.len() {
            let seen = self.order[self.of_point(point)].iter().map(|&at| problem.observations[at as usize].pose);
            let free: Vec<u32> = seen.filter_map(|pose| self.free_of[pose as usize]).collect();
            for (at, &a) in free.iter().enumerate() {
                window.extend(free[at + 1..].iter().filter(|b| **b != a).map(|b| (a, *b)));
            }
            if point % PAIR_WINDOW == PAIR_WINDOW - 1 || point + 1 == problem.points.len() {
                window.sort_unstable();
                window.dedup();
                all.append(&mut window);
            }
        }
        all
    }
}

fn by_point(problem: &BaProblem) -> (Vec<u32>, Vec<u32>) {
    let usable = |at: &u32| {
        let o = &problem.observations[*at as usize];
        let exists = (o.pose as usize) < problem.poses.len() && (o.point as usize) < problem.points.len();
        exists && o.measurement.is_usable()
    };
    let mut order: Vec<u32> = (0..problem.observations.len() as u32).filter(usable).collect();
    let key = |at: &u32| {
        let o = &problem.observations[*at as usize];
        (o.point, o.pose, *at)
    };
    order.sort_unstable_by_key(key);
    let mut starts = vec![0; problem.points.len() + 1];
    for &at in &order {
        starts[problem.observations[at as usize].point as usize + 1] += 1;
    }
    for point in 0..problem.points.len() {
        starts[point + 1] += starts[point];
    }
    (order, starts)
}
