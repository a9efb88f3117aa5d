//! A place that was seen before: found, verified, and what it corrects.
//!
//! Everything here is a function of a [`Map`](crate::map::Map), the live one or a snapshot:
//! 1. [`detect`] turns votes of the place index into a verified [`LoopFound`], or none;
//! 2. [`correct`] turns that into one [`MapEdit::Correct`](crate::map::MapEdit): the essential graph within one map, a
//!    weld of two;
//! 3. [`global_adjustment`] then adjusts the whole map, again as one correction.

mod candidates;
mod close;
mod detect;
mod global;
mod graph;
mod guided;
mod seam;
mod weld;

pub use candidates::{Candidates, Votes, find_candidates};
pub use close::correct;
pub use detect::{LoopFound, LoopState, detect};
pub use global::{Adjusted, adjust_part, global_adjustment};
