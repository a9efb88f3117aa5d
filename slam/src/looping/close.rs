//! What a place seen again corrects.

use std::collections::BTreeMap;

use slam_math::KeyFrameId;

use super::detect::LoopFound;
use super::graph::Graph;
use super::seam::{Seam, correction};
use super::weld;
use crate::context::Context;
use crate::map::{Map, MapEdit};

/// The correction of a map in which `found` holds: one edit, or none when a keyframe is gone or nothing sensible comes
/// out.
#[must_use]
pub fn correct(ctx: &Context, before: &Map, found: &LoopFound) -> Option<MapEdit> {
    let seam = Seam::sew(ctx, before, found)?;
    if found.joins { weld::join(ctx, before, found, seam) } else { close(ctx, before, seam) }
}

/// Spreads the error of a loop over the essential graph; its root and what was fused hold still relative to each other.
fn close(ctx: &Context, before: &Map, seam: Seam) -> Option<MapEdit> {
    let part = before.keyframe(seam.place.middle)?.map;
    let keyframes: Vec<KeyFrameId> = before.keyframes().filter(|k| k.map == part).map(|k| k.id).collect();
    let root = before.keyframes().find(|k| k.map == part && k.parent.is_none())?.id;
    let poses = Graph::new(ctx, before, &seam, &keyframes, |id| id == root).solve(ctx)?;
    let mut correction = correction(before, &poses, &BTreeMap::new());
    correction.then = seam.journal;
    Some(MapEdit::Correct(Box::new(correction)))
}
