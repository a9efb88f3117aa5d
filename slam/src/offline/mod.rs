//! The best path, once nothing is urgent any more: every part of the atlas is adjusted as a whole, and every frame's pose
//! is found again in the map that comes of it.
//!
//! 1. [`Sights`] remember what each tracked frame saw, while frames come in;
//! 2. [`depth_weight`] finds out what the measured depth is worth;
//! 3. [`adjust`] minimises over all keyframes and points of each part;
//! 4. [`refine_frames`] fits each frame to the points that it saw.

mod adjust;
mod depth;
mod frames;
mod sights;

pub use adjust::adjust;
pub use depth::depth_weight;
pub use frames::{Refined, Start, refine_frames};
pub use sights::Sights;

use crate::map::MapPoint;

/// Says which points of the map are to take part.
pub type Trusted<'a> = &'a (dyn Fn(&MapPoint) -> bool + Sync);

/// Points that two keyframes see: one that a single one sees can be wherever that says, and ties nothing to anything.
#[must_use]
pub fn seen_twice(point: &MapPoint) -> bool {
    point.seen_in.len() >= 2
}
