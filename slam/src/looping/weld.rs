//! Two parts of the atlas become one (ORB-SLAM3, section VI-B).

use slam_math::{KeyFrameId, MapPointId};
use slam_optimize::BaOptions;

use super::detect::LoopFound;
use super::global::Adjustment;
use super::graph::Graph;
use super::seam::{Seam, correction};
use crate::context::Context;
use crate::map::{Join, Map, MapEdit};

/// The part that found the place moves into the other's frame; bundle adjustment fits its window to the place, which is
/// held; the rest of the part follows over the essential graph.
pub(super) fn join(ctx: &Context, before: &Map, found: &LoopFound, mut seam: Seam) -> Option<MapEdit> {
    let (ends, into) = (before.keyframe(found.keyframe)?.map, before.keyframe(found.matched)?.map);
    let mut window: Vec<KeyFrameId> =
        before.keyframe(found.keyframe)?.best_covisible(ctx.config.looping.weld_keyframes - 1).collect();
    window.push(found.keyframe);
    window.sort_unstable();
    let positions = adjust_window(ctx, &mut seam, &window)?;

    let part: Vec<KeyFrameId> = before.keyframes().filter(|k| k.map == ends).map(|k| k.id).collect();
    let poses = Graph::new(ctx, before, &seam, &part, |id| window.binary_search(&id).is_ok()).solve(ctx)?;
    let mut correction = correction(before, &poses, &positions);
    correction.join = Some(Join { map: ends, into, at: (found.keyframe, found.matched) });
    correction.then = seam.journal;
    Some(MapEdit::Correct(Box::new(correction)))
}

type Positions = std::collections::BTreeMap<MapPointId, nalgebra::Vector3<f64>>;

/// Fits the window to the place in the seam's map. Returns where the points went.
fn adjust_window(ctx: &Context, seam: &mut Seam, window: &[KeyFrameId]) -> Option<Positions> {
    let mut keyframes: Vec<KeyFrameId> = window.iter().chain(&seam.place.keyframes).copied().collect();
    keyframes.sort_unstable();
    keyframes.dedup();
    let points = seam.map.points_seen_by(window, &ctx.buffers).to_vec();
    let fixed = |id: KeyFrameId| window.binary_search(&id).is_err();
    let iterations = ctx.config.looping.global_iterations.max(1);
    let options = BaOptions { iterations, ..BaOptions::default() };
    let (poses, positions, _) = Adjustment::new(ctx, &seam.map, keyframes, fixed, points).solve(&options)?;
    for (id, pose) in poses {
        seam.map.apply(&MapEdit::SetPose(id, pose.to_se3()));
    }
    for (id, position) in &positions {
        seam.map.apply(&MapEdit::SetPosition(*id, *position));
    }
    Some(positions)
}
