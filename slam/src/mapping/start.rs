//! Two views without depth become a map.

use slam_math::{KeyFrameId, MapId};

use super::{Editor, insert_keyframe};
use crate::context::Context;
use crate::map::{MapEdit, NewPoint};
use crate::tracking::{TrackedFrame, TwoViews};

/// Adds both views as keyframes of a new part of the atlas, and their points. `second` gets its pose.
pub fn insert_two_views(
    ctx: &Context,
    editor: &mut Editor<'_>,
    views: &TwoViews,
    second: &mut TrackedFrame,
    map: MapId,
) -> [KeyFrameId; 2] {
    second.camera_from_world = views.second_from_world;
    second.points.fill(None);
    let ids = [insert_keyframe(editor, &views.first, map), insert_keyframe(editor, second, map)];
    for (in_first, in_second, position) in &views.points {
        let point = editor.map().next_point();
        let class = views.first.class[*in_first as usize].joined(second.class[*in_second as usize]);
        let new = NewPoint { position: *position, keyframe: ids[0], index: *in_first, frame: views.first.id, class };
        if editor.apply(MapEdit::AddPoint(new)) {
            editor.apply(MapEdit::Observe(point, ids[1], *in_second));
            editor.refresh(ctx, point);
        }
    }
    for id in ids {
        editor.apply(MapEdit::Connect(id));
    }
    ids
}
