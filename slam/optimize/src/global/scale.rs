//! The gauge: which parts hang together, where each is held, and whether anything fixes its scale.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::{LoosePose, Model, State};
use crate::bundle::BaProblem;
use crate::gauge::representatives;

/// Fixed centres nearer than this to each other fix no scale; metres, or whatever the map's unit is.
const SAME_CENTRE: f64 = 1e-9;

/// Poses and points that hang together.
pub(super) struct Part {
    poses: Vec<usize>,
    points: Vec<usize>,
    /// Centre of the first fixed pose.
    centre: Option<Vector3<f64>>,
    /// A disparity was measured, or two fixed poses stand apart.
    scale_is_fixed: bool,
}

/// The connected parts, each with a fixed pose.
pub(super) fn parts(problem: &BaProblem, model: &Model<'_>) -> Result<Vec<Part>, LoosePose> {
    let poses = problem.poses.len();
    let seen = || model.layout.order.iter().zip(&model.active).filter(|(_, active)| **active);
    let ties = seen().map(|(&at, _)| {
        let o = &problem.observations[at as usize];
        (o.pose as usize, poses + o.point as usize)
    });
    let part_of = representatives(poses + problem.points.len(), ties);
    let mut parts: BTreeMap<usize, Part> = BTreeMap::new();
    for (pose, p) in problem.poses.iter().enumerate() {
        let new = || Part { poses: Vec::new(), points: Vec::new(), centre: None, scale_is_fixed: false };
        let part = parts.entry(part_of[pose]).or_insert_with(new);
        part.poses.push(pose);
        if p.fixed {
            let centre = p.camera_from_world.inverse().translation;
            let first = *part.centre.get_or_insert(centre);
            part.scale_is_fixed |= (centre - first).norm() > SAME_CENTRE;
        }
    }
    if let Some(loose) = parts.values().find(|part| part.centre.is_none()) {
        return Err(LoosePose { pose: loose.poses[0] });
    }
    for (point, root) in part_of[poses..].iter().enumerate() {
        // A point that nobody sees hangs together with nothing.
        if let Some(part) = parts.get_mut(root) {
            part.points.push(point);
        }
    }
    for (&at, _) in seen() {
        let o = &problem.observations[at as usize];
        if let Some(part) = parts.get_mut(&part_of[o.pose as usize]) {
            part.scale_is_fixed |= o.measurement.disparity.is_some() && o.measurement.weight_disparity > 0.0;
        }
    }
    Ok(parts.into_values().collect())
}

/// Scales every part whose scale nothing fixes about its fixed centre, so that the pose that was farthest from it has its
/// old distance again: no residual changes. Returns those poses.
pub(super) fn restore(parts: &[Part], before: &BaProblem, state: &mut State) -> Vec<usize> {
    let mut kept = Vec::new();
    for part in parts.iter().filter(|part| !part.scale_is_fixed) {
        let Some(centre) = part.centre else { continue };
        let was = |pose: usize| (before.poses[pose].camera_from_world.inverse().translation - centre).norm();
        let farthest = part.poses.iter().copied().fold(part.poses[0], |a, b| if was(b) > was(a) { b } else { a });
        let is = (state.poses[farthest].inverse().translation - centre).norm();
        let factor = was(farthest) / is;
        if !(factor.is_finite() && factor > 0.0) {
            continue;
        }
        for &pose in part.poses.iter().filter(|pose| !before.poses[**pose].fixed) {
            let p = &mut state.poses[pose];
            let moved = centre + (p.inverse().translation - centre) * factor;
            p.translation = -(p.rotation * moved);
        }
        for &point in &part.points {
            state.points[point] = centre + (state.points[point] - centre) * factor;
        }
        kept.push(farthest);
    }
    kept.sort_unstable();
    kept
}
