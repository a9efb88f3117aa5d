//! First guess of a frame's pose: constant velocity, or the reference keyframe.

use slam_math::{Buffer, MapPointId, Se3};
use slam_vision::nearest_two;

use super::{TrackedFrame, refine_pose};
use crate::context::Context;
use crate::map::{KeyFrame, Map};
use crate::matching::{Limits, Match, Query, claimed, consistent_rotation, project, search};

/// Whether a keypoint of the frame may be matched with a point.
pub type Admits<'a> = &'a dyn Fn(usize, MapPointId) -> bool;

/// Matches the last frame's points around the predicted pose and optimises it. Returns matches and inliers.
pub fn track_motion_model(
    ctx: &Context,
    map: &Map,
    last: &TrackedFrame,
    predicted: &Se3,
    frame: &mut TrackedFrame,
    admits: Admits<'_>,
) -> (u32, u32) {
    let t = &ctx.config.tracking;
    for factor in [1.0, 2.0] {
        let mut matches = match_last_frame(ctx, map, last, predicted, frame, t.motion_radius_px * factor);
        matches.retain(|m| last.points[m.key as usize].is_some_and(|point| admits(m.index as usize, point)));
        if matches.len() < t.min_motion_matches as usize {
            continue;
        }
        frame.camera_from_world = *predicted;
        frame.points.fill(None);
        for m in &matches {
            frame.points[m.index as usize] = last.points[m.key as usize];
        }
        return (matches.len() as u32, refine_pose(ctx, map, frame).inliers);
    }
    (0, 0)
}

fn match_last_frame(
    ctx: &Context,
    map: &Map,
    last: &TrackedFrame,
    predicted: &Se3,
    frame: &TrackedFrame,
    radius: f64,
) -> Buffer<Match<u32>> {
    let mut queries = ctx.buffers.empty();
    for (i, id) in last.matches() {
        let Some(point) = map.point(id) else { continue };
        let Some((pixel, z)) = project(&ctx.camera, predicted, &point.position) else { continue };
        let octave = last.obs.octave[i];
        let radius = radius * ctx.scales[usize::from(octave)];
        queries.push(Query {
            key: i as u32,
            pixel,
            radius,
            octaves: [octave.saturating_sub(1), octave + 1],
            depth_m: Some((z, depth_tolerance(ctx, z, radius))),
            descriptor: point.descriptor,
        });
    }
    let limits = Limits { hamming: ctx.config.tracking.hamming_high, ratio: 1.0 };
    let matches = search(&frame.obs, &queries, limits, &ctx.buffers, |i| frame.usable[i]);
    consistent_rotation(matches, |m| frame.obs.angle[m.index as usize] - last.obs.angle[m.key as usize])
}

/// How far the measured depth may lie from the expected one when the pixel may be off by `radius`: the field's test on
/// the right image coordinate, written for depth.
pub(crate) fn depth_tolerance(ctx: &Context, z: f64, radius: f64) -> f64 {
    z * z / ctx.bf * radius
}

/// Matches against the reference keyframe by descriptor alone and optimises from the last pose. Returns matches and
/// inliers.
pub fn track_reference(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    frame: &mut TrackedFrame,
    admits: Admits<'_>,
) -> (u32, u32) {
    let mut matches = match_descriptors(ctx, keyframe, frame, 0.7);
    matches.retain(|m| keyframe.points[m.key as usize].is_some_and(|point| admits(m.index as usize, point)));
    if matches.len() < ctx.config.relocalization.min_matches {
        return (matches.len() as u32, 0);
    }
    frame.points.fill(None);
    for m in &matches {
        frame.points[m.index as usize] = keyframe.points[m.key as usize];
    }
    (matches.len() as u32, refine_pose(ctx, map, frame).inliers)
}

/// Best frame keypoint for each keyframe keypoint that has a map point, over the whole picture, with ratio test, mutual
/// choice and rotation check. The key is the keyframe's keypoint.
pub(super) fn match_descriptors(
    ctx: &Context,
    keyframe: &KeyFrame,
    frame: &TrackedFrame,
    ratio: f64,
) -> Buffer<Match<u32>> {
    let candidates = ctx.buffers.collect((0..frame.obs.len() as u32).filter(|i| frame.usable[*i as usize]));
    let mut owner: Buffer<Option<(u32, u32)>> = ctx.buffers.filled(frame.obs.len(), None);
    for (key, _) in keyframe.points.iter().enumerate().filter(|(_, p)| p.is_some()) {
        let [first, second] = nearest_two(&keyframe.obs.descriptor[key], &frame.obs.descriptor, &candidates);
        let sure = first.distance <= ctx.config.tracking.hamming_low
            && f64::from(first.distance) <= ratio * f64::from(second.distance);
        let claim = (first.distance, key as u32);
        if sure && owner[first.index as usize].is_none_or(|holder| claim < holder) {
            owner[first.index as usize] = Some(claim);
        }
    }
    let matches = claimed(&owner, &ctx.buffers);
    consistent_rotation(matches, |m| frame.obs.angle[m.index as usize] - keyframe.obs.angle[m.key as usize])
}
