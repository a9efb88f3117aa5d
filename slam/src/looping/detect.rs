//! Is a candidate the same place? Geometry decides, and other keyframes must agree.

use serde::{Deserialize, Serialize};
use slam_math::{KeyFrameId, MapId, MapPointId, Rng, Se3, Sim3};
use slam_optimize::{DepthCamera, find_similarity};

use super::candidates::Candidates;
use super::guided::{Pairing, Place, point_pairs, refine, similarity_options};
use crate::context::Context;
use crate::map::{KeyFrame, Map, moved_pose};

/// Random stream of this stage, see [`Rng::at`].
const STAGE: u32 = 5;
/// Keyframes around the current one that are asked whether they agree.
const WITNESSES: usize = 5;

/// A place that was seen before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopFound {
    /// The keyframe that sees it again.
    pub keyframe: KeyFrameId,
    /// The middle of the place as it was known.
    pub matched: KeyFrameId,
    /// How the neighbourhood of `keyframe` must move so that both agree.
    pub corrected_from_world: Sim3,
    /// Keypoints of `keyframe` and the points of the place that they show.
    pub pairs: Vec<(u32, MapPointId)>,
    /// Part of the atlas that `keyframe` is of.
    pub part: MapId,
    /// True when the place is of another part.
    pub joins: bool,
    /// Distance between where the keyframe was and where the place puts it, metres.
    pub moved_m: f64,
}

/// What detection carries from keyframe to keyframe: a place that was found, but not by enough keyframes yet.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LoopState {
    pending: Option<Pending>,
}

impl LoopState {
    /// Whether no place is pending.
    #[must_use]
    pub fn is_idle(&self) -> bool {
        self.pending.is_none()
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Pending {
    matched: KeyFrameId,
    /// The same for all keyframes of one neighbourhood: a move of the world, not of a camera.
    corrected_from_world: Sim3,
    /// [`Map::corrections`] when it was found.
    corrections: u32,
    coincidences: u32,
    misses: u32,
}

/// A place that one keyframe has verified.
struct Verified {
    /// In the place's world, with the unit of the keyframe's own.
    camera_from_world: Sim3,
    pairs: Pairing,
}

/// Verifies a place found by earlier keyframes, or else the candidates of this one. A place is accepted when
/// `looping.coincidences` keyframes agree with it: neighbours of `keyframe` at once, or the keyframes that follow.
#[must_use]
pub fn detect(
    ctx: &Context,
    map: &Map,
    candidates: &Candidates,
    keyframe: KeyFrameId,
    state: &mut LoopState,
) -> Option<LoopFound> {
    let keyframe = map.keyframe(keyframe)?;
    state.pending = state.pending.take().filter(|p| p.corrections == map.corrections());
    if let Some(mut pending) = state.pending.take() {
        if let Some((place, verified)) = confirm(ctx, map, keyframe, &pending) {
            pending.corrected_from_world = correction_by(keyframe, &verified.camera_from_world);
            (pending.coincidences, pending.misses) = (pending.coincidences + 1, 0);
            if pending.coincidences >= ctx.config.looping.coincidences {
                return Some(found(map, keyframe, &place, verified));
            }
            state.pending = Some(pending);
            return None;
        }
        pending.misses += 1;
        if pending.misses < ctx.config.looping.max_misses {
            state.pending = Some(pending);
        }
    }
    for id in candidates.own.iter().chain(&candidates.others) {
        let Some(middle) = map.keyframe(*id) else { continue };
        let place = Place::around(map, middle, ctx.config.looping.place_keyframes);
        let Some(verified) = verify(ctx, map, keyframe, &place) else { continue };
        let corrected_from_world = correction_by(keyframe, &verified.camera_from_world);
        let coincidences = agreeing_neighbours(ctx, map, keyframe, &place, &corrected_from_world);
        if coincidences >= ctx.config.looping.coincidences {
            state.pending = None;
            return Some(found(map, keyframe, &place, verified));
        }
        let (matched, corrections) = (place.middle, map.corrections());
        // An older pending place has priority: more keyframes speak for it.
        let pending =
            Pending { matched, corrected_from_world, corrections, coincidences: coincidences.max(1), misses: 0 };
        state.pending.get_or_insert(pending);
    }
    None
}

fn correction_by(keyframe: &KeyFrame, camera_from_world: &Sim3) -> Sim3 {
    camera_from_world.inverse() * Sim3::from(keyframe.camera_from_world)
}

fn found(map: &Map, keyframe: &KeyFrame, place: &Place, verified: Verified) -> LoopFound {
    let joins = map.keyframe(place.middle).is_some_and(|k| k.map != keyframe.map);
    let corrected_from_world = correction_by(keyframe, &verified.camera_from_world);
    let moved_m = (corrected_from_world.transform(&keyframe.center()) - keyframe.center()).norm();
    let (part, pairs) = (keyframe.map, verified.pairs);
    LoopFound { keyframe: keyframe.id, matched: place.middle, corrected_from_world, pairs, part, joins, moved_m }
}

/// From descriptors alone to a refined pose among the place's points.
fn verify(ctx: &Context, map: &Map, keyframe: &KeyFrame, place: &Place) -> Option<Verified> {
    let l = &ctx.config.looping;
    let pairs = place.match_descriptors(ctx, map, keyframe);
    if pairs.len() < l.min_matches {
        return None;
    }
    let (_, points) = point_pairs(ctx, map, keyframe, place, &pairs);
    let camera = DepthCamera { pinhole: ctx.pinhole, bf: ctx.bf };
    let mut rng = Rng::at(ctx.config.seed, keyframe.frame.0, STAGE, place.middle.0);
    let found = find_similarity(&mut rng, &camera, &points, &similarity_options(ctx))?;
    let middle = Sim3::from(map.keyframe(place.middle)?.camera_from_world);
    let start = found.second_from_first * middle;
    search_and_refine(ctx, map, keyframe, place, &start)
}

/// Two guided searches, each refined: the first around a rough pose, the second must find enough.
fn search_and_refine(ctx: &Context, map: &Map, keyframe: &KeyFrame, place: &Place, start: &Sim3) -> Option<Verified> {
    let l = &ctx.config.looping;
    let (pairs, _) = place.search(ctx, map, keyframe, &start.to_se3(), l.radius_px);
    if pairs.len() < l.min_projected {
        return None;
    }
    let (pose, fitting) = refine(ctx, map, keyframe, place, &pairs, start)?;
    if fitting.len() < l.min_refined {
        return None;
    }
    let (pairs, visible) = place.search(ctx, map, keyframe, &pose.to_se3(), l.radius_refined_px);
    let (camera_from_world, fitting) = refine(ctx, map, keyframe, place, &pairs, &pose)?;
    // Not only those that fit: without depth they are few, since the keyframe must know a point of its own there.
    let seen = count_seen(ctx, map, keyframe, &pairs, &camera_from_world.to_se3());
    let share = seen as f64 / visible.max(1) as f64;
    let is_found = fitting.len() >= l.min_final && share >= l.min_found_share;
    is_found.then_some(Verified { camera_from_world, pairs: fitting })
}

/// Pairs whose points lie where the keyframe shows them.
fn count_seen(ctx: &Context, map: &Map, keyframe: &KeyFrame, pairs: &Pairing, camera_from_world: &Se3) -> usize {
    let is_there = |(index, id): &&(u32, MapPointId)| {
        let in_camera = map.point(*id).map(|point| camera_from_world.transform(&point.position));
        in_camera.is_some_and(|x| ctx.fits(&keyframe.obs, *index as usize, &x))
    };
    pairs.iter().filter(is_there).count()
}

/// A later keyframe looks for the pending place where the earlier ones found it.
fn confirm(ctx: &Context, map: &Map, keyframe: &KeyFrame, pending: &Pending) -> Option<(Place, Verified)> {
    let place = Place::around(map, map.keyframe(pending.matched)?, ctx.config.looping.place_keyframes);
    // By now the two ends may be neighbours: nothing is left to close.
    if keyframe.covisible.iter().any(|(id, _)| *id == pending.matched) {
        return None;
    }
    let start = Sim3::from(keyframe.camera_from_world) * pending.corrected_from_world.inverse();
    let verified = search_and_refine(ctx, map, keyframe, &place, &start)?;
    Some((place, verified))
}

/// How many neighbours of the keyframe see the place where the correction puts it.
fn agreeing_neighbours(
    ctx: &Context,
    map: &Map,
    keyframe: &KeyFrame,
    place: &Place,
    corrected_from_world: &Sim3,
) -> u32 {
    let l = &ctx.config.looping;
    let witnesses = keyframe.best_covisible(WITNESSES).filter(|id| place.keyframes.binary_search(id).is_err());
    let agrees = |witness: &KeyFrame| {
        let pose = moved_pose(&witness.camera_from_world, corrected_from_world);
        let (pairs, _) = place.search(ctx, map, witness, &pose, l.radius_refined_px);
        pairs.len() >= l.min_agreeing
    };
    witnesses.filter_map(|id| map.keyframe(id)).filter(|k| agrees(k)).count() as u32
}
