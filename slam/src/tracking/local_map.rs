//! Matching against the neighbourhood of the camera.

use slam_math::{Buffer, KeyFrameId, MapPointId};

use super::predict::{Admits, depth_tolerance};
use super::{PoseFit, TrackedFrame, refine_pose};
use crate::context::Context;
use crate::map::{Map, MapPoint};
use crate::matching::{Limits, Query, project, search};

/// Cosine of the largest angle between the mean viewing direction and the ray (60 degrees).
const MIN_VIEW_COS: f64 = 0.5;
/// A point's scale range is stretched by a fifth at both ends.
const RANGE_SLACK: f64 = 1.2;

/// Keyframes and points around a frame.
#[derive(Debug, Clone, Default)]
pub struct LocalMap {
    /// Keyframe with the most shared points.
    pub reference: Option<KeyFrameId>,
    /// Points of the neighbourhood, by id.
    pub points: Buffer<MapPointId>,
    /// Points that should be visible in the frame: `(point, pixel, depth in metres)`.
    pub in_view: Buffer<(MapPointId, [f64; 2], f64)>,
}

impl LocalMap {
    /// Keyframes that share points with the frame, their neighbours in graph and tree, and all their points.
    #[must_use]
    pub fn around(ctx: &Context, map: &Map, frame: &TrackedFrame) -> Self {
        let mut votes: Buffer<u32> = ctx.buffers.filled(map.next_keyframe().index(), 0);
        for (_, id) in frame.matches() {
            for sighting in map.point(id).iter().flat_map(|p| &p.seen_in) {
                votes[sighting.keyframe.index()] += 1;
            }
        }
        let voted = votes.iter().enumerate().filter(|(_, n)| **n > 0);
        let mut order = ctx.buffers.collect(voted.map(|(id, n)| (KeyFrameId::from(id), *n)));
        if order.is_empty() {
            order.push((frame.reference, 1));
        }
        order.sort_unstable_by_key(|(id, n)| (std::cmp::Reverse(*n), *id));
        let limit = ctx.config.tracking.local_keyframes;
        order.truncate(limit);
        let mut keyframes = ctx.buffers.collect(order.iter().map(|(id, _)| *id));
        for (id, _) in &order {
            let Some(keyframe) = map.keyframe(*id) else { continue };
            let neighbour = keyframe.best_covisible(10).find(|n| !keyframes.contains(n));
            let child = keyframe.children.iter().copied().find(|c| !keyframes.contains(c));
            for extra in [neighbour, child, keyframe.parent].into_iter().flatten() {
                if keyframes.len() < limit && !keyframes.contains(&extra) {
                    keyframes.push(extra);
                }
            }
        }
        let points = map.points_seen_by(&keyframes, &ctx.buffers);
        Self { reference: order.first().map(|(id, _)| *id), points, in_view: ctx.buffers.empty() }
    }

    fn find_in_view(&mut self, ctx: &Context, map: &Map, frame: &TrackedFrame) -> Buffer<Query<MapPointId>> {
        let center = frame.camera_from_world.inverse().translation;
        let matched = frame.matched_points(&ctx.buffers);
        let mut queries = ctx.buffers.empty();
        self.in_view.clear();
        for point in self.points.iter().filter_map(|id| map.point(*id)) {
            let Some((pixel, z)) = project(&ctx.camera, &frame.camera_from_world, &point.position) else { continue };
            let Some((octave, cos)) = appearance(ctx, point, &center) else { continue };
            self.in_view.push((point.id, pixel, z));
            if matched.binary_search(&point.id).is_ok() {
                continue;
            }
            let width = if cos > 0.998 { 2.5 } else { 4.0 };
            let radius = width * ctx.config.tracking.local_radius * ctx.scales[usize::from(octave)];
            queries.push(Query {
                key: point.id,
                pixel,
                radius,
                octaves: [octave.saturating_sub(1), octave],
                depth_m: Some((z, depth_tolerance(ctx, z, radius))),
                descriptor: point.descriptor,
            });
        }
        queries
    }
}

/// Pyramid level on which a point should appear, and cosine to its mean viewing direction; `None` when it can't be
/// recognised from there.
pub(crate) fn appearance(ctx: &Context, point: &MapPoint, center: &nalgebra::Vector3<f64>) -> Option<(u8, f64)> {
    let ray = point.position - center;
    let distance = ray.norm();
    let [nearest, farthest] = point.range_m;
    if distance < nearest / RANGE_SLACK || distance > farthest * RANGE_SLACK {
        return None;
    }
    let cos = ray.dot(&point.normal) / distance;
    (cos >= MIN_VIEW_COS).then(|| (ctx.predict_octave(farthest, distance), cos))
}

/// Finds local points among the frame's free keypoints and optimises the pose. Returns how the pose fits them.
pub fn track_local_map(ctx: &Context, map: &Map, local: &mut LocalMap, frame: &mut TrackedFrame) -> PoseFit {
    match_local_map(ctx, map, local, frame, &|_, _| true);
    refine_pose(ctx, map, frame)
}

/// Keypoints that are not used but on which a point of the local map lies all the same, by looks and within the noise of the
/// pose that the frame has. `wanted` are the keypoints to try, `admits` the points.
pub fn look_up(
    ctx: &Context,
    map: &Map,
    local: &LocalMap,
    frame: &TrackedFrame,
    wanted: impl Fn(usize) -> bool,
    admits: impl Fn(MapPointId) -> bool,
) -> Buffer<bool> {
    let mut found = ctx.buffers.filled(frame.obs.len(), false);
    if !(0..frame.obs.len()).any(&wanted) {
        return found;
    }
    let mut local = LocalMap { reference: None, points: local.points.clone(), in_view: ctx.buffers.empty() };
    local.points.retain(|id| admits(*id));
    let queries = local.find_in_view(ctx, map, frame);
    let limits = Limits { hamming: ctx.config.tracking.hamming_high, ratio: ctx.config.tracking.ratio };
    for m in &search(&frame.obs, &queries, limits, &ctx.buffers, wanted) {
        let Some(point) = map.point(m.key) else { continue };
        let in_camera = frame.camera_from_world.transform(&point.position);
        found[m.index as usize] = ctx.fits(&frame.obs, m.index as usize, &in_camera);
    }
    found
}

/// Finds local points among the frame's free keypoints; what does not fit the pose is among the matches still. Returns how many
/// there are.
pub fn match_local_map(
    ctx: &Context,
    map: &Map,
    local: &mut LocalMap,
    frame: &mut TrackedFrame,
    admits: Admits<'_>,
) -> u32 {
    let queries = local.find_in_view(ctx, map, frame);
    let t = &ctx.config.tracking;
    let limits = Limits { hamming: t.hamming_high, ratio: t.ratio };
    let free = |i: usize| frame.usable[i] && frame.points[i].is_none();
    for m in &search(&frame.obs, &queries, limits, &ctx.buffers, free) {
        if admits(m.index as usize, m.key) {
            frame.points[m.index as usize] = Some(m.key);
        }
    }
    frame.match_count()
}
