//! Local bundle adjustment: the newest keyframe, its neighbours and their points.

use slam_math::{Buffer, KeyFrameId, MapPointId};
use slam_optimize::{BaObservation, BaOptions, BaPose, BaProblem, bundle_adjust};

use super::Editor;
use crate::context::Context;
use crate::map::{Map, MapEdit};

pub(super) struct Window {
    /// Keyframes that move, sorted, then those held fixed, sorted.
    pub keyframes: Buffer<KeyFrameId>,
    pub points: Buffer<MapPointId>,
    pub problem: BaProblem,
}

/// Whether a keyframe is one whose neighbourhood is adjusted: while the map fits into one window each, then every
/// `mapping.ba_every`th, since windows overlap nearly wholly.
pub(super) fn is_due(ctx: &Context, map: &Map, id: KeyFrameId) -> bool {
    let m = &ctx.config.mapping;
    let Some(keyframe) = map.keyframe(id) else { return false };
    id.0.is_multiple_of(m.ba_every) || map.keyframe_count_of(keyframe.map) <= m.ba_keyframes
}

/// Adjusts the neighbourhood of a keyframe. Observations that do not fit are removed; returns how many.
pub(super) fn local_bundle_adjustment(ctx: &Context, editor: &mut Editor<'_>, id: KeyFrameId) -> u32 {
    let Some(mut window) = collect(ctx, editor.map(), id) else { return 0 };
    // One round, not to the last digit: what it shows to be an outlier leaves the map, and the next window, a few frames
    // later, starts from there.
    let iterations = ctx.config.mapping.ba_iterations as u32;
    let options = BaOptions { rounds: 1, iterations, relative_decrease: 1e-3, ..BaOptions::default() };
    let report = bundle_adjust(&mut window.problem, &options, &ctx.buffers);
    for (id, pose) in window.keyframes.iter().zip(&window.problem.poses).filter(|(_, pose)| !pose.fixed) {
        if pose.camera_from_world.is_finite() {
            editor.apply(MapEdit::SetPose(*id, pose.camera_from_world.normalized()));
        }
    }
    for (id, position) in window.points.iter().zip(&window.problem.points) {
        if position.iter().all(|v| v.is_finite()) {
            editor.apply(MapEdit::SetPosition(*id, *position));
        }
    }
    let mut dropped = 0;
    for (observation, _) in window.problem.observations.iter().zip(&report.outlier).filter(|(_, outlier)| **outlier) {
        let point = window.points[observation.point as usize];
        dropped += u32::from(editor.apply(MapEdit::Unobserve(point, window.keyframes[observation.pose as usize])));
    }
    for &point in &window.points {
        match editor.map().point(point).map(|p| p.weight()) {
            // One view without depth fixes nothing.
            Some(0 | 1) => {
                editor.apply(MapEdit::CullPoint(point));
            }
            _ => editor.refresh(ctx, point),
        }
    }
    dropped
}

pub(super) fn collect(ctx: &Context, map: &Map, id: KeyFrameId) -> Option<Window> {
    let keyframe = map.keyframe(id)?;
    let mut moving = ctx.buffers.collect(keyframe.best_covisible(ctx.config.mapping.ba_keyframes - 1));
    moving.push(id);
    moving.sort_unstable();
    let points = map.points_seen_by(&moving, &ctx.buffers);
    let observers = points.iter().filter_map(|id| map.point(*id)).flat_map(|p| p.seen_in.iter().map(|s| s.keyframe));
    let mut fixed = ctx.buffers.collect(observers.filter(|k| moving.binary_search(k).is_err()));
    fixed.sort_unstable();
    fixed.dedup();
    let moving_count = moving.len();
    let keyframes = ctx.buffers.collect(moving.iter().chain(&fixed).copied());
    // The root of a map is its gauge; without any other fixed keyframe it alone is held.
    let poses = keyframes.iter().enumerate().filter_map(|(n, id)| {
        let keyframe = map.keyframe(*id)?;
        let fixed = n >= moving_count || keyframe.parent.is_none();
        Some(BaPose { camera_from_world: keyframe.camera_from_world, fixed })
    });
    let problem = BaProblem {
        camera: ctx.pinhole,
        bf: ctx.bf,
        poses: ctx.buffers.collect(poses),
        points: ctx.buffers.collect(points.iter().filter_map(|id| map.point(*id).map(|p| p.position))),
        observations: observations(ctx, map, &keyframes, moving_count, &points),
    };
    Some(Window { keyframes, points, problem })
}

fn observations(
    ctx: &Context,
    map: &Map,
    keyframes: &[KeyFrameId],
    moving: usize,
    points: &[MapPointId],
) -> Buffer<BaObservation> {
    let position = |id: &KeyFrameId| {
        let in_fixed = || keyframes[moving..].binary_search(id).map(|n| n + moving);
        keyframes[..moving].binary_search(id).or_else(|_| in_fixed()).ok()
    };
    let known = points.iter().filter_map(|id| map.point(*id));
    let mut out = ctx.buffers.empty();
    for (n, point) in known.enumerate() {
        for sighting in &point.seen_in {
            let keyframe = map.keyframe(sighting.keyframe);
            if let (Some(pose), Some(keyframe)) = (position(&sighting.keyframe), keyframe) {
                let measurement = ctx.measurement(&keyframe.obs, sighting.index as usize);
                out.push(BaObservation { pose: pose as u32, point: n as u32, measurement });
            }
        }
    }
    out
}
