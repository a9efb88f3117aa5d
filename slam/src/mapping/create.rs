//! A frame becomes a keyframe, and its depth becomes points.

use std::sync::Arc;

use slam_math::{Buffer, KeyFrameId, MapId};
use smallvec::SmallVec;

use super::{Editor, YoungPoints};
use crate::context::Context;
use crate::map::{KeyFrame, MapEdit, NewPoint};
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
        class: Arc::new(frame.class.to_vec()),
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

/// Noise of a depth, as a share of it, up to which it makes a point. Far points fix the camera's rotation, whose error would
/// else pass for a translation: a room of 3 to 8 m seen from a still camera jitters by 10 mm without them and by 1.4 mm with
/// them. What they lack in depth their noise says, to bundle adjustment as to tracking.
const MAX_SIGMA_SHARE: f64 = 0.2;

/// Makes points from the depth of a keyframe's free keypoints. Returns how many.
pub fn create_points_from_depth(
    ctx: &Context,
    editor: &mut Editor<'_>,
    young: &mut YoungPoints,
    id: KeyFrameId,
) -> u32 {
    let Some(keyframe) = editor.map().keyframe(id).cloned() else { return 0 };
    let obs = &keyframe.obs;
    let world_from_camera = keyframe.camera_from_world.inverse();
    let mut created = 0;
    for i in (0..obs.len()).filter(|i| keyframe.usable[*i] && keyframe.points[*i].is_none()) {
        let Some(z) = obs.depth(i).filter(|z| ctx.depth_sigma(*z) <= MAX_SIGMA_SHARE * z) else { continue };
        let position = world_from_camera.transform(&ctx.camera.unproject(obs.pixel[i], z));
        let new = NewPoint { position, keyframe: id, index: i as u32, frame: keyframe.frame, class: keyframe.class[i] };
        add_point(ctx, editor, young, new);
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
