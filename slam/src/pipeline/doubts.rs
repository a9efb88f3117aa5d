//! Points that are no longer where the map has them: what was carried away, and what starts to move.

use crate::context::Context;
use crate::input::FrameInput;
use crate::map::MapEdit;
use crate::mapping::Editor;
use crate::observation::round_to_pixel;
use crate::panoptic::FrameFilter;
use crate::report::RegionState;
use crate::tracking::{LocalMap, TrackedFrame};

/// Half side of the window in which the measured depth is looked up, pixels.
const WINDOW: i64 = 2;

/// Gives a doubt to each visible point that is seen through or lies on a mover, takes them from those found again, and
/// removes points with `mapping.max_doubts`. Returns the number removed.
pub(super) fn doubt_points(
    ctx: &Context,
    editor: &mut Editor<'_>,
    input: &FrameInput,
    filter: &FrameFilter,
    frame: &TrackedFrame,
    local: &LocalMap,
) -> u32 {
    let found = frame.matched_points(&ctx.buffers);
    let mut removed = 0;
    for (id, pixel, z) in &local.in_view {
        let Some(doubts) = editor.map().point(*id).map(|p| p.doubts) else { continue };
        let is_found = found.binary_search(id).is_ok();
        let doubtful = !is_found && is_gone(ctx, input, filter, *pixel, *z);
        let now = match (is_found, doubtful) {
            (true, _) => 0,
            (_, true) => doubts + 1,
            _ => doubts,
        };
        if now >= ctx.config.mapping.max_doubts {
            editor.apply(MapEdit::CullPoint(*id));
            removed += 1;
        } else if now != doubts {
            editor.apply(MapEdit::SetDoubts(*id, now));
        }
    }
    removed
}

/// The sensor sees farther than the point all around it, or a mover is at the point's place.
fn is_gone(ctx: &Context, input: &FrameInput, filter: &FrameFilter, pixel: [f64; 2], z: f64) -> bool {
    let Some(depth) = input.depth.as_deref() else { return false };
    let raw = ctx.camera.distort(pixel);
    let (cx, cy) = (round_to_pixel(raw[0]), round_to_pixel(raw[1]));
    let margin = ctx.free_space_margin(z);
    let (mut measured, mut farther, mut same) = (0, 0, 0);
    for y in cy - WINDOW..=cy + WINDOW {
        for x in cx - WINDOW..=cx + WINDOW {
            let Some(d) = depth.metres(x, y) else { continue };
            measured += 1;
            farther += i64::from(d > z + margin);
            same += i64::from((d - z).abs() <= margin);
        }
    }
    let window = (2 * WINDOW + 1) * (2 * WINDOW + 1);
    let seen_through = measured * 2 > window && farther == measured;
    let state = filter.state_at(raw);
    let on_mover = same * 2 > window && matches!(state, Some(RegionState::Dynamic | RegionState::Person));
    seen_through || on_mover
}
