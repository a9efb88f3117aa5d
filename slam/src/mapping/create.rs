//! A frame becomes a keyframe, and its depth becomes points.

use std::sync::Arc;

use slam_math::{Buffer, KeyFrameId, MapId};
use smallvec::SmallVec;

use super::{Editor, YoungPoints};
use crate::context::Context;
use crate::map::{KeyFrame, MapEdit, NewPoint};
use crate::report::KeypointClass;
use crate::tracking::TrackedFrame;

/// Adds a keyframe made from a tracked frame. The first one of a map has no parent.
pub fn insert_keyframe(editor: &mut Editor<'_>, frame: &TrackedFrame, map: MapId) -> KeyFrameId {
    let id = editor.map().next_keyframe();
    let keyframe = KeyFrame {
        id,
        frame: frame.id,
        stamp: frame.stamp,
        map,
        obs: frame.obs.clone(),
        usable: Arc::new(frame.usable.to_vec()),
        points: frame.points.clone(),
        camera_from_world: frame.camera_from_world,
        covisible: Buffer::default(),
        parent: None,
        children: SmallVec::new(),
        loops: SmallVec::new(),
    };
    editor.apply(MapEdit::AddKeyFrame(Box::new(keyframe)));
    id
}

/// Makes points from the depth of a keyframe's free keypoints, nearest first: all close ones, and at least
/// `keyframes.min_points`. Returns how many.
pub fn create_points_from_depth(
    ctx: &Context,
    editor: &mut Editor<'_>,
    young: &mut YoungPoints,
    id: KeyFrameId,
    classes: &[KeypointClass],
) -> u32 {
    let Some(keyframe) = editor.map().keyframe(id).cloned() else { return 0 };
    let obs = &keyframe.obs;
    let usable = (0..obs.len()).filter(|i| keyframe.usable[*i]);
    let mut by_depth = ctx.buffers.collect(usable.filter_map(|i| obs.depth(i).map(|z| (z, i))));
    by_depth.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let world_from_camera = keyframe.camera_from_world.inverse();
    let mut created = 0;
    for (rank, &(z, i)) in by_depth.iter().enumerate() {
        if z > ctx.close_m && rank >= ctx.config.keyframes.min_points as usize {
            break;
        }
        if keyframe.points[i].is_some() {
            continue;
        }
        let position = world_from_camera.transform(&ctx.camera.unproject(obs.pixel[i], z));
        add_point(
            ctx,
            editor,
            young,
            NewPoint { position, keyframe: id, index: i as u32, frame: keyframe.frame, class: classes[i] },
        );
        created += 1;
    }
    created
}

/// Adds a young point with its range.
pub(super) fn add_point(ctx: &Context, editor: &mut Editor<'_>, young: &mut YoungPoints, new: NewPoint) {
    let id = editor.map().next_point();
    if editor.apply(MapEdit::AddPoint(new)) {
        editor.refresh(ctx, id);
        young.push(id);
    }
}
