//! Finding the camera again among the keyframes, without a prior pose.

use nalgebra::Vector3;
use slam_math::{KeyFrameId, MapId, Rng};
use slam_optimize::{AbsoluteOptions, absolute_orientation_ransac};
use slam_vision::PlaceIndex;

use super::predict::match_descriptors;
use super::{LocalMap, TrackedFrame, refine_pose, track_local_map};
use crate::context::{CHI2_3, Context};
use crate::map::{KeyFrame, Map};

/// Random stream of this stage, see [`Rng::at`].
const STAGE: u32 = 2;

/// A place found again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Relocalized {
    /// Keyframe of that place.
    pub keyframe: KeyFrameId,
    /// Part of the atlas.
    pub map: MapId,
    /// Inliers of the pose.
    pub inliers: u32,
}

/// Looks for the frame's place among the keyframes that `eligible` admits. On success the frame has pose, matches and
/// reference; otherwise it has no matches.
pub fn relocalize(
    ctx: &Context,
    map: &Map,
    places: &PlaceIndex,
    frame: &mut TrackedFrame,
    eligible: impl Fn(&KeyFrame) -> bool,
) -> Option<Relocalized> {
    let r = &ctx.config.relocalization;
    let usable = (0..frame.obs.len()).filter(|i| frame.usable[*i]);
    let descriptors: Vec<_> = usable.map(|i| frame.obs.descriptor[i]).collect();
    if descriptors.len() < r.min_keypoints as usize {
        return None;
    }
    // More are asked for than tried: some are of other parts of the atlas.
    let found = places.query(&descriptors, r.candidates * 4);
    let candidates = found.iter().filter_map(|(id, _)| map.keyframe(KeyFrameId(*id))).filter(|k| eligible(k));
    for keyframe in candidates.take(r.candidates) {
        if let Some(inliers) = try_keyframe(ctx, map, keyframe, frame) {
            frame.refer_to(keyframe.id, map);
            return Some(Relocalized { keyframe: keyframe.id, map: keyframe.map, inliers });
        }
    }
    frame.points.fill(None);
    None
}

fn try_keyframe(ctx: &Context, map: &Map, keyframe: &KeyFrame, frame: &mut TrackedFrame) -> Option<u32> {
    let r = &ctx.config.relocalization;
    let matches = match_descriptors(ctx, keyframe, frame, 0.8);
    let (mut in_world, mut in_camera, mut sigma, mut pairs) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for m in &matches {
        let i = m.index as usize;
        let point = keyframe.points[m.key as usize].and_then(|id| map.point(id));
        if let (Some(point), Some(z)) = (point, frame.obs.depth(i)) {
            in_world.push(point.position);
            in_camera.push(ctx.camera.unproject(frame.obs.pixel[i], z));
            sigma.push(point_sigma(ctx, z, frame.obs.octave[i]));
            pairs.push((i, point.id));
        }
    }
    if pairs.len() < r.min_matches {
        return None;
    }
    let mut rng = Rng::at(ctx.config.seed, frame.id.0, STAGE, keyframe.id.0);
    let options = AbsoluteOptions { max_iterations: r.iterations as u32, min_inliers: 10, ..Default::default() };
    let agrees = |i: usize, moved: &Vector3<f64>| (moved - in_camera[i]).norm_squared() <= CHI2_3 * sigma[i] * sigma[i];
    let (pose, inlier) = absolute_orientation_ransac(&mut rng, &in_world, &in_camera, agrees, &options)?;
    frame.camera_from_world = pose;
    frame.points.fill(None);
    for ((i, id), _) in pairs.iter().zip(&inlier).filter(|(_, inlier)| **inlier) {
        frame.points[*i] = Some(*id);
    }
    frame.reference = keyframe.id;
    // Two rounds: the first pose is rough, so the neighbourhood is searched again around the better one.
    let mut inliers = refine_pose(ctx, map, frame);
    for _ in 0..2 {
        if inliers < 10 {
            return None;
        }
        let mut local = LocalMap::around(ctx, map, frame);
        (_, inliers) = track_local_map(ctx, map, &mut local, frame);
    }
    (inliers >= r.min_inliers).then_some(inliers)
}

/// Spread of a point measured at depth `z`: the sensor's noise along the ray and the pixel's across it; twice, since
/// the map point has its own.
fn point_sigma(ctx: &Context, z: f64, octave: u8) -> f64 {
    let across = z / ctx.pinhole.fx * ctx.scales[usize::from(octave)];
    let along = ctx.depth_sigma(z);
    2.0 * (across * across + along * along).sqrt()
}
