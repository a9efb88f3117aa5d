//! Which keyframes may show the place that a new keyframe sees?

use std::cmp::Reverse;
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

/// Chooses among the keyframes that the place index voted for (`(id, votes)`): never one that shares points with
/// `keyframe`; those with about as many votes as the best; judged again by the votes of their whole neighbourhood, in
/// which the best one stands for all.
#[must_use]
pub fn find_candidates(ctx: &Context, map: &Map, keyframe: &KeyFrame, votes: &[(u32, u32)]) -> Candidates {
    let l = &ctx.config.looping;
    let mut connected: Vec<KeyFrameId> = keyframe.covisible.iter().map(|(id, _)| *id).collect();
    connected.push(keyframe.id);
    connected.sort_unstable();
    let eligible = |(id, n): &(u32, u32)| {
        let other = map.keyframe(KeyFrameId(*id)).filter(|k| connected.binary_search(&k.id).is_err())?;
        Some((other.id, *n, other.map == keyframe.map))
    };
    let eligible: Vec<(KeyFrameId, u32, bool)> = votes.iter().filter_map(eligible).collect();
    let mut found = Candidates::default();
    let large_enough = l.enabled && map.keyframe_count_of(keyframe.map) >= l.min_keyframes;
    for (own, list) in [(true, &mut found.own), (false, &mut found.others)] {
        if own && !large_enough {
            continue;
        }
        let side = eligible.iter().filter(|(_, _, is_own)| *is_own == own).map(|(id, n, _)| (*id, *n)).collect();
        *list = best_groups(ctx, map, &side);
    }
    found
}

/// The best keyframe of each of the best neighbourhoods.
fn best_groups(ctx: &Context, map: &Map, votes: &BTreeMap<KeyFrameId, u32>) -> Vec<KeyFrameId> {
    let l = &ctx.config.looping;
    let most = votes.values().copied().max().unwrap_or(0);
    let enough = |n: u32| n as usize >= l.min_matches && f64::from(n) >= l.min_vote_share * f64::from(most);
    let mut groups: Vec<(u32, KeyFrameId)> = Vec::new();
    for (id, own) in votes.iter().filter(|(_, n)| enough(**n)) {
        let (mut sum, mut best) = (*own, (Reverse(*own), *id));
        let neighbours = map.keyframe(*id).into_iter().flat_map(|k| k.best_covisible(l.place_keyframes));
        for (neighbour, n) in neighbours.filter_map(|id| votes.get(&id).map(|n| (id, *n))) {
            sum += n;
            best = best.min((Reverse(n), neighbour));
        }
        groups.push((sum, best.1));
    }
    groups.sort_unstable_by_key(|(sum, id)| (Reverse(*sum), *id));
    let most = groups.first().map_or(0, |(sum, _)| *sum);
    let mut chosen = Vec::new();
    for (sum, id) in groups {
        let strong = f64::from(sum) >= l.min_accumulated_share * f64::from(most);
        if strong && chosen.len() < l.candidates && !chosen.contains(&id) {
            chosen.push(id);
        }
    }
    chosen
}
