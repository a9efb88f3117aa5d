//! Points of neighbours that are one point in the world.

use slam_math::{Buffer, KeyFrameId, MapPointId};

use super::Editor;
use crate::context::Context;
use crate::map::{KeyFrame, Map, MapEdit, MapPoint};
use crate::matching::{Limits, Query, project, search};
use crate::tracking::appearance;

/// Projects a keyframe's points into its neighbours and theirs into it; agreeing points are merged or observed.
/// Returns the number of changes.
pub(super) fn fuse_with_neighbours(ctx: &Context, editor: &mut Editor<'_>, id: KeyFrameId) -> u32 {
    let targets = neighbourhood(ctx, editor.map(), id);
    let mut changes = 0;
    let own = editor.map().points_seen_by(&[id], &ctx.buffers);
    for target in &targets {
        changes += fuse_into(ctx, editor, *target, &own);
    }
    let theirs = editor.map().points_seen_by(&targets, &ctx.buffers);
    changes += fuse_into(ctx, editor, id, &theirs);
    let own = editor.map().points_seen_by(&[id], &ctx.buffers);
    for &point in &own {
        editor.refresh(ctx, point);
    }
    editor.apply(MapEdit::Connect(id));
    changes
}

fn neighbourhood(ctx: &Context, map: &Map, id: KeyFrameId) -> Buffer<KeyFrameId> {
    let m = &ctx.config.mapping;
    let Some(keyframe) = map.keyframe(id) else { return Buffer::default() };
    let mut targets = ctx.buffers.collect(keyframe.best_covisible(m.neighbours));
    for i in 0..targets.len() {
        let second = map.keyframe(targets[i]).into_iter().flat_map(|k| k.best_covisible(m.second_neighbours));
        targets.extend(second.filter(|n| *n != id));
    }
    targets.sort_unstable();
    targets.dedup();
    targets
}

/// Projects points into a keyframe: agreeing ones are merged with what it sees there, or observed. Returns the number of
/// changes.
pub fn fuse_into(ctx: &Context, editor: &mut Editor<'_>, target: KeyFrameId, points: &[MapPointId]) -> u32 {
    let Some(keyframe) = editor.map().keyframe(target) else { return 0 };
    let (obs, usable, camera_from_world) = (keyframe.obs.clone(), keyframe.usable.clone(), keyframe.camera_from_world);
    let center = keyframe.center();
    let candidates = points.iter().filter_map(|id| editor.map().point(*id));
    let queries = ctx.buffers.collect(candidates.filter_map(|point| query(ctx, keyframe, &center, point)));
    let limits = Limits { hamming: ctx.config.tracking.hamming_low, ratio: 1.0 };
    let mut changes = 0;
    for m in &search(&obs, &queries, limits, &ctx.buffers, |i| usable[i]) {
        // Earlier merges of this round may have changed who is where.
        let Some(point) = editor.map().point(m.key) else { continue };
        if !ctx.fits(&obs, m.index as usize, &camera_from_world.transform(&point.position))
            || point.sighting(target).is_some()
        {
            continue;
        }
        let holder = editor.map().keyframe(target).and_then(|k| k.points[m.index as usize]);
        let applied = match holder.and_then(|id| editor.map().point(id)) {
            None => editor.apply(MapEdit::Observe(m.key, target, m.index)),
            Some(holder) if (point.weight(), holder.id) > (holder.weight(), point.id) => {
                let edit = MapEdit::MergePoints { keep: point.id, drop: holder.id };
                editor.apply(edit)
            }
            Some(holder) => {
                let edit = MapEdit::MergePoints { keep: holder.id, drop: point.id };
                editor.apply(edit)
            }
        };
        changes += u32::from(applied);
    }
    changes
}

fn query(
    ctx: &Context,
    keyframe: &KeyFrame,
    center: &nalgebra::Vector3<f64>,
    point: &MapPoint,
) -> Option<Query<MapPointId>> {
    if point.sighting(keyframe.id).is_some() {
        return None;
    }
    let (pixel, _) = project(&ctx.camera, &keyframe.camera_from_world, &point.position)?;
    let (octave, _) = appearance(ctx, point, center)?;
    Some(Query {
        key: point.id,
        pixel,
        radius: ctx.config.mapping.fuse_radius * ctx.scales[usize::from(octave)],
        octaves: [octave.saturating_sub(1), octave],
        depth_m: None,
        descriptor: point.descriptor,
    })
}
