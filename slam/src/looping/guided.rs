//! A place: what a keyframe and its neighbours know about it, and finding that in another keyframe.

use nalgebra::Vector3;
use slam_math::{Buffers, KeyFrameId, MapPointId, Se3, Sim3};
use slam_optimize::{
    DepthCamera, Measurement, PointPair, PoseObservation, PoseOptions, SimilarityOptions, optimize_pose,
    refine_similarity,
};
use slam_vision::{Descriptor, hamming_many};

use crate::context::Context;
use crate::map::{KeyFrame, Map};
use crate::matching::{Limits, Match, Query, project, search};
use crate::tracking::{appearance, depth_tolerance};

/// A keyframe's keypoint and the point of the place that it shows.
pub type Pairing = Vec<(u32, MapPointId)>;

/// A keyframe, its best neighbours and all their points.
#[derive(Debug, Clone)]
pub struct Place {
    /// In the middle.
    pub middle: KeyFrameId,
    /// With its neighbours, sorted.
    pub keyframes: Vec<KeyFrameId>,
    /// Their points, sorted.
    pub points: Vec<MapPointId>,
}

impl Place {
    /// The place around a keyframe.
    #[must_use]
    pub fn around(map: &Map, middle: &KeyFrame, neighbours: usize) -> Self {
        let mut keyframes: Vec<KeyFrameId> = middle.best_covisible(neighbours).collect();
        keyframes.push(middle.id);
        keyframes.sort_unstable();
        let points = map.points_seen_by(&keyframes, &Buffers::default()).to_vec();
        Self { middle: middle.id, keyframes, points }
    }

    /// Pairs a keyframe's map points with the place's by descriptor alone: mutually best, clearly better than the second
    /// best.
    #[must_use]
    pub fn match_descriptors(&self, ctx: &Context, map: &Map, keyframe: &KeyFrame) -> Pairing {
        let points: Vec<(MapPointId, Descriptor)> =
            self.points.iter().filter_map(|id| map.point(*id)).map(|p| (p.id, p.descriptor)).collect();
        let descriptors: Vec<Descriptor> = points.iter().map(|(_, d)| *d).collect();
        let mut owner: Vec<Option<(u32, u32)>> = vec![None; points.len()];
        let mut distances = vec![0; descriptors.len()];
        for i in (0..keyframe.points.len()).filter(|i| keyframe.points[*i].is_some()) {
            hamming_many(&keyframe.obs.descriptor[i], &descriptors, &mut distances);
            let Some((best, distance)) = clear_winner(&distances, RATIO) else { continue };
            let claim = (distance, i as u32);
            if distance <= ctx.config.tracking.hamming_low && owner[best].is_none_or(|holder| claim < holder) {
                owner[best] = Some(claim);
            }
        }
        let mut pairs: Pairing =
            owner.iter().zip(&points).filter_map(|(o, (id, _))| o.map(|(_, i)| (i, *id))).collect();
        pairs.sort_unstable();
        pairs
    }

    /// Looks for the place's points in a keyframe that is at `camera_from_world` in the place's world. Also returns how
    /// many of them should be visible there.
    #[must_use]
    pub fn search(
        &self,
        ctx: &Context,
        map: &Map,
        keyframe: &KeyFrame,
        camera_from_world: &Se3,
        radius: f64,
    ) -> (Pairing, usize) {
        let center = camera_from_world.inverse().translation;
        let mut queries = Vec::new();
        for point in self.points.iter().filter_map(|id| map.point(*id)) {
            let Some((pixel, z)) = project(&ctx.camera, camera_from_world, &point.position) else { continue };
            let Some((octave, _)) = appearance(ctx, point, &center) else { continue };
            let radius = radius * ctx.scales[usize::from(octave)];
            queries.push(Query {
                key: point.id,
                pixel,
                radius,
                octaves: [octave.saturating_sub(1), octave + 1],
                depth_m: Some((z, depth_tolerance(ctx, z, radius))),
                descriptor: point.descriptor,
            });
        }
        let limits = Limits { hamming: ctx.config.looping.hamming, ratio: 1.0 };
        let found = search(&keyframe.obs, &queries, limits, &ctx.buffers, |i| keyframe.usable[i]);
        (found.iter().map(|m: &Match<MapPointId>| (m.index, m.key)).collect(), queries.len())
    }
}

/// Best over second best distance when nothing else than the descriptor is known (ORB-SLAM's matcher for loops).
const RATIO: f64 = 0.9;

/// Index and distance of the smallest, if the second smallest is far enough.
fn clear_winner(distances: &[u32], ratio: f64) -> Option<(usize, u32)> {
    let (mut first, mut second) = ((u32::MAX, 0), u32::MAX);
    for (i, distance) in distances.iter().enumerate() {
        if *distance < first.0 {
            (first, second) = ((*distance, i), first.0);
        } else if *distance < second {
            second = *distance;
        }
    }
    (first.0 != u32::MAX && f64::from(first.0) <= ratio * f64::from(second)).then_some((first.1, first.0))
}

/// The keyframe's pose among the paired points, and the pairs that fit it. With depth the points themselves say how large
/// everything is; without it the points that the keyframe knows on its side do.
pub(super) fn refine(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    place: &Place,
    pairs: &Pairing,
    start: &Sim3,
) -> Option<(Sim3, Pairing)> {
    if ctx.is_monocular() {
        let (used, points) = point_pairs(ctx, map, keyframe, place, pairs);
        let middle = Sim3::from(map.keyframe(place.middle)?.camera_from_world);
        let camera = DepthCamera { pinhole: ctx.pinhole, bf: ctx.bf };
        let options = similarity_options(ctx);
        let found = refine_similarity(&camera, &points, &(*start * middle.inverse()), &options);
        let fitting = chosen(&used, &found.inlier);
        return (found.second_from_first.is_finite()).then_some((found.second_from_first * middle, fitting));
    }
    let known: Vec<_> = pairs.iter().filter_map(|(i, id)| map.point(*id).map(|p| ((*i, *id), p.position))).collect();
    let observe = |((i, _), point): &((u32, MapPointId), Vector3<f64>)| {
        let measurement = ctx.measurement(&keyframe.obs, *i as usize);
        PoseObservation { point_in_world: *point, measurement }
    };
    let observations: Vec<PoseObservation> = known.iter().map(observe).collect();
    let (start, options) = (start.to_se3(), PoseOptions::default());
    let result = optimize_pose(&ctx.pinhole, ctx.bf, &observations, &start, &options, &ctx.buffers);
    let used: Pairing = known.into_iter().map(|(pair, _)| pair).collect();
    let fitting = chosen(&used, &result.inlier);
    result.camera_from_world.is_finite().then_some((result.camera_from_world.into(), fitting))
}

fn chosen(pairs: &Pairing, inlier: &[bool]) -> Pairing {
    pairs.iter().zip(inlier).filter(|(_, inlier)| **inlier).map(|(pair, _)| *pair).collect()
}

/// Pairs of which the keyframe knows a point of its own, as both cameras see them: the place through its middle keyframe,
/// which need not have seen every point of it itself.
pub(super) fn point_pairs(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    place: &Place,
    pairs: &Pairing,
) -> (Pairing, Vec<PointPair>) {
    let Some(middle) = map.keyframe(place.middle) else { return Default::default() };
    let both = |(i, id): &(u32, MapPointId)| {
        let own = keyframe.points[*i as usize].and_then(|own| map.point(own))?;
        let point = map.point(*id)?;
        let in_first = middle.camera_from_world.transform(&point.position);
        let seen_by_first = match point.sighting(middle.id) {
            Some(sighting) => ctx.measurement(&middle.obs, sighting.index as usize),
            None => {
                let pixel = ctx.pinhole.project(&in_first)?;
                Measurement { pixel, disparity: None, weight: 1.0, weight_disparity: 0.0 }
            }
        };
        let in_second = keyframe.camera_from_world.transform(&own.position);
        let seen_by_second = ctx.measurement(&keyframe.obs, *i as usize);
        Some(((*i, *id), PointPair { in_first, in_second, seen_by_first, seen_by_second }))
    };
    pairs.iter().filter_map(both).unzip()
}

/// Depth fixes the scale.
pub(super) fn similarity_options(ctx: &Context) -> SimilarityOptions {
    let l = &ctx.config.looping;
    SimilarityOptions {
        fix_scale: !ctx.is_monocular(),
        max_iterations: l.iterations,
        min_inliers: l.min_inliers,
        ..SimilarityOptions::default()
    }
}
