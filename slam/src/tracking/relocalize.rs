//! Finding the camera again among the keyframes, without a prior pose.

use nalgebra::Vector3;
use slam_math::{KeyFrameId, MapId, MapPointId, Rng, Se3};
use slam_optimize::{AbsoluteOptions, PoseObservation, PoseOptions, absolute_orientation_ransac, absolute_pose_ransac};
use slam_vision::Places;

use super::predict::match_descriptors;
use super::{LocalMap, TrackedFrame, refine_pose, track_local_map};
use crate::context::{CHI2_3, Context};
use crate::input::Sensor;
use crate::map::{KeyFrame, Map};
use crate::matching::Match;

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

/// Looks for the frame's place among the keyframes that `eligible` admits; `expected` tells how many points of a place
/// should be found from the pose there. On success the frame has pose, matches and
/// reference; otherwise it has no matches.
pub fn relocalize(
    ctx: &Context,
    map: &Map,
    places: &Places,
    frame: &mut TrackedFrame,
    eligible: impl Fn(&KeyFrame) -> bool,
    expected: impl Fn(&LocalMap) -> usize,
) -> Option<Relocalized> {
    let r = &ctx.config.relocalization;
    let usable = (0..frame.obs.len()).filter(|i| frame.usable[*i]);
    let descriptors: Vec<_> = usable.map(|i| frame.obs.descriptor[i]).collect();
    if descriptors.len() < r.min_keypoints as usize {
        return None;
    }
    // More are asked for than tried: some are of other parts of the atlas.
    let found = places.query(&descriptors, r.candidates * 4, |id, keypoint| map.has_point(KeyFrameId(id), keypoint));
    let candidates = found.iter().filter_map(|(id, _)| map.keyframe(KeyFrameId(*id))).filter(|k| eligible(k));
    for keyframe in candidates.take(r.candidates) {
        if let Some(inliers) = try_keyframe(ctx, map, keyframe, frame, &expected) {
            frame.refer_to(keyframe.id, map);
            return Some(Relocalized { keyframe: keyframe.id, map: keyframe.map, inliers });
        }
    }
    frame.points.fill(None);
    None
}

fn try_keyframe(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    frame: &mut TrackedFrame,
    expected: impl Fn(&LocalMap) -> usize,
) -> Option<u32> {
    let r = &ctx.config.relocalization;
    let matches = match_descriptors(ctx, keyframe, frame, 0.8);
    let mut rng = Rng::at(ctx.config.seed, frame.id.0, STAGE, keyframe.id.0);
    let (pose, inliers) = match ctx.sensor {
        Sensor::Rgbd => pose_from_depth(ctx, map, keyframe, frame, &matches, &mut rng)?,
        Sensor::Stereo { .. } | Sensor::Monocular => pose_from_pixels(ctx, map, keyframe, frame, &matches, &mut rng)?,
    };
    frame.camera_from_world = pose;
    frame.points.fill(None);
    for (i, id) in inliers {
        frame.points[i] = Some(id);
    }
    frame.reference = keyframe.id;
    // Two rounds: the first pose is rough, so the neighbourhood is searched again around the better one.
    let mut inliers = refine_pose(ctx, map, frame).inliers;
    let mut local = LocalMap::default();
    for _ in 0..2 {
        if inliers < 10 {
            return None;
        }
        local = LocalMap::around(ctx, map, frame);
        inliers = track_local_map(ctx, map, &mut local, frame).inliers;
    }
    let is_found = inliers >= r.min_inliers && f64::from(inliers) >= r.min_found_share * expected(&local) as f64;
    is_found.then_some(inliers)
}

/// A pose, and keypoints with the points that agree with it.
type Found = (Se3, Vec<(usize, MapPointId)>);

fn options(ctx: &Context) -> AbsoluteOptions {
    let max_iterations = ctx.config.relocalization.iterations as u32;
    AbsoluteOptions { max_iterations, min_inliers: 10, ..Default::default() }
}

/// From points in the world and in the camera: where depth is dense and good.
fn pose_from_depth(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    frame: &TrackedFrame,
    matches: &[Match<u32>],
    rng: &mut Rng,
) -> Option<Found> {
    let (mut in_world, mut in_camera, mut sigma, mut pairs) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for m in matches {
        let i = m.index as usize;
        let point = keyframe.points[m.key as usize].and_then(|id| map.point(id));
        if let (Some(point), Some(z)) = (point, frame.obs.depth(i)) {
            in_world.push(point.position);
            in_camera.push(ctx.camera.unproject(frame.obs.pixel[i], z));
            sigma.push(point_sigma(ctx, z, frame.obs.octave[i]));
            pairs.push((i, point.id));
        }
    }
    if pairs.len() < ctx.config.relocalization.min_matches {
        return None;
    }
    let agrees = |i: usize, moved: &Vector3<f64>| (moved - in_camera[i]).norm_squared() <= CHI2_3 * sigma[i] * sigma[i];
    let (pose, inlier) = absolute_orientation_ransac(rng, &in_world, &in_camera, agrees, &options(ctx))?;
    let inliers = pairs.into_iter().zip(inlier).filter_map(|(pair, inlier)| inlier.then_some(pair));
    Some((pose, inliers.collect()))
}

/// From points in the world and their pixels.
fn pose_from_pixels(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    frame: &TrackedFrame,
    matches: &[Match<u32>],
    rng: &mut Rng,
) -> Option<Found> {
    let (mut pairs, mut observations) = (Vec::new(), Vec::new());
    for m in matches {
        let i = m.index as usize;
        if let Some(point) = keyframe.points[m.key as usize].and_then(|id| map.point(id)) {
            pairs.push((i, point.id));
            let measurement = ctx.measurement(&frame.obs, i);
            observations.push(PoseObservation { point_in_world: point.position, measurement });
        }
    }
    if pairs.len() < ctx.config.relocalization.min_matches {
        return None;
    }
    let refinement = PoseOptions::default();
    let found = absolute_pose_ransac(rng, &ctx.pinhole, ctx.bf, &observations, &options(ctx), &refinement)?;
    let inliers = pairs.into_iter().zip(&found.inlier).filter_map(|(pair, inlier)| inlier.then_some(pair));
    Some((found.camera_from_world, inliers.collect()))
}

/// Spread of a point measured at depth `z`: the sensor's noise along the ray and the pixel's across it; twice, since
/// the map point has its own.
fn point_sigma(ctx: &Context, z: f64, octave: u8) -> f64 {
    let across = z / ctx.pinhole.fx * ctx.scales[usize::from(octave)];
    let along = ctx.depth_sigma(z);
    2.0 * (across * across + along * along).sqrt()
}
