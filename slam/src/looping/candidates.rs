//! Which keyframes may show the place that a new keyframe sees?

use std::cmp::Ordering;
use std::collections::BTreeMap;

use slam_math::KeyFrameId;

use crate::context::Context;
use crate::map::{KeyFrame, Map};

/// Keyframes to be verified, best first.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Candidates {
    /// Of the keyframe's own part of the atlas: a loop.
    pub own: Vec<KeyFrameId>,
    /// Of other parts: two maps meet.
    pub others: Vec<KeyFrameId>,
}

/// What the index of places says about a keyframe.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Votes {
    /// Keyframes and their scores.
    pub scores: Vec<(u32, f64)>,
    /// Whether the scores are likenesses of bags of words. Those depend on the vocabulary and on the picture, so they are
    /// measured by what the keyframe has in common with its own neighbours; otherwise they count descriptors.
    pub by_words: bool,
}

/// Chooses among the keyframes that the place index voted for: never one that shares points with `keyframe`; those with
/// about as many votes as the best; judged again by the votes of their whole neighbourhood, in which the best one stands
/// for all.
#[must_use]
pub fn find_candidates(ctx: &Context, map: &Map, keyframe: &KeyFrame, votes: &Votes) -> Candidates {
    let l = &ctx.config.looping;
    let mut connected: Vec<KeyFrameId> = keyframe.covisible.iter().map(|(id, _)| *id).collect();
    connected.push(keyframe.id);
    connected.sort_unstable();
    let is_connected = |id: u32| connected.binary_search(&KeyFrameId(id)).is_ok();
    let least = if votes.by_words {
        let neighbours = votes.scores.iter().filter(|(id, _)| *id != keyframe.id.0 && is_connected(*id));
        l.min_word_share * most(neighbours.map(|(_, score)| *score))
    } else {
        l.min_matches as f64
    };
    let eligible = |(id, score): &(u32, f64)| {
        let other = map.keyframe(KeyFrameId(*id)).filter(|_| !is_connected(*id))?;
        Some((other.id, *score, other.map == keyframe.map))
    };
    let eligible: Vec<(KeyFrameId, f64, bool)> = votes.scores.iter().filter_map(eligible).collect();
    let mut found = Candidates::default();
    let large_enough = l.enabled && map.keyframe_count_of(keyframe.map) >= l.min_keyframes;
    for (own, list) in [(true, &mut found.own), (false, &mut found.others)] {
        if own && !large_enough {
            continue;
        }
        let side = eligible.iter().filter(|(_, _, is_own)| *is_own == own).map(|(id, n, _)| (*id, *n)).collect();
        *list = best_groups(ctx, map, &side, least);
    }
    found
}

/// The largest of some scores, 0 without any.
fn most(scores: impl Iterator<Item = f64>) -> f64 {
    scores.fold(0.0, slam_math::float::max)
}

/// Best scores first, then oldest first.
fn by_score(a: &(f64, KeyFrameId), b: &(f64, KeyFrameId)) -> Ordering {
    b.0.total_cmp(&a.0).then(a.1.cmp(&b.1))
}

/// The best keyframe of each of the best neighbourhoods, none with a score below `least`.
fn best_groups(ctx: &Context, map: &Map, votes: &BTreeMap<KeyFrameId, f64>, least: f64) -> Vec<KeyFrameId> {
    let l = &ctx.config.looping;
    let least = slam_math::float::max(least, l.min_vote_share * most(votes.values().copied()));
    let mut groups: Vec<(f64, KeyFrameId)> = Vec::new();
    for (id, own) in votes.iter().filter(|(_, score)| **score >= least) {
        let (mut sum, mut best) = (*own, (*own, *id));
        let neighbours = map.keyframe(*id).into_iter().flat_map(|k| k.best_covisible(l.place_keyframes));
        for (neighbour, score) in neighbours.filter_map(|id| votes.get(&id).map(|score| (id, *score))) {
            sum += score;
            best = std::cmp::min_by(best, (score, neighbour), by_score);
        }
        groups.push((sum, best.1));
    }
    groups.sort_unstable_by(by_score);
    let most = groups.first().map_or(0.0, |(sum, _)| *sum);
    let mut chosen = Vec::new();
    for (sum, id) in groups {
        let strong = sum >= l.min_accumulated_share * most;
        if strong && chosen.len() < l.candidates && !chosen.contains(&id) {
            chosen.push(id);
        }
    }
    chosen
}
