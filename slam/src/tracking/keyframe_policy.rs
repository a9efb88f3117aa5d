//! When a frame is worth keeping. Every number here is a count: nothing asks a clock or another thread.

use slam_math::FrameId;

use super::TrackedFrame;
use crate::context::Context;
use crate::map::Map;

/// A frame tracked by no more than this is no ground to build on (ORB-SLAM2).
const MIN_INLIERS: u32 = 15;

/// Why a keyframe is due.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyframeNeed {
    /// The view changed: many of the reference's points are out of sight.
    View,
    /// Too few close points are tracked although more could be made.
    Close,
}

/// Decides after tracking. `last_keyframe` is the frame of the newest keyframe.
#[must_use]
pub fn keyframe_needed(
    ctx: &Context,
    map: &Map,
    frame: &TrackedFrame,
    inliers: u32,
    last_keyframe: FrameId,
) -> Option<KeyframeNeed> {
    let k = &ctx.config.keyframes;
    let reference = map.keyframe(frame.reference)?;
    let keyframes = map.keyframe_count_of(reference.map);
    let min_weight = if keyframes <= 2 { 2 } else { 3 };
    let reference_points = reference.points.iter().flatten();
    let well_seen = |weight: u32| weight >= min_weight;
    let in_reference = reference_points.filter(|p| map.point(**p).is_some_and(|p| well_seen(p.weight()))).count();

    let is_close = |i: &usize| frame.usable[*i] && frame.obs.depth(*i).is_some_and(|z| z < ctx.close_m);
    let close = || (0..frame.obs.len()).filter(is_close);
    let (close, tracked) = (close().count(), close().filter(|i| frame.points[*i].is_some()).count());
    let few_tracked = tracked < k.min_close_tracked as usize || (tracked as f64) < k.min_close_share * close as f64;
    let need_close = few_tracked && close - tracked > k.min_close_untracked as usize;

    let since = frame.id.0.saturating_sub(last_keyframe.0);
    let usual = if ctx.is_monocular() { ctx.config.monocular.tracked_share } else { k.tracked_share };
    let share = if keyframes < 2 { k.tracked_share_start } else { usual };
    let changed = f64::from(inliers) < share * in_reference as f64;
    if since < k.min_interval || inliers <= MIN_INLIERS {
        return None;
    }
    match (need_close, changed) {
        (true, _) => Some(KeyframeNeed::Close),
        (_, true) => Some(KeyframeNeed::View),
        _ => None,
    }
}
