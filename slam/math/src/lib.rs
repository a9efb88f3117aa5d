//! Lowest room: numbers that come out the same on every x86-64 CPU.
//!
//! * [`float`]: the only way to transcendental functions (crate `libm`), and min/max with a fixed answer for signed zeros.
//! * [`se3`], [`sim3`]: rigid transforms and similarities `target_from_source`, [`lie`]: what both have in common for
//!   solvers, [`align`]: best fit of point sets.
//! * [`id`]: stamps and identifiers in creation order, and the append-only [`IdVec`].
//! * [`Buffers`]: vectors whose memory is used again.
//! * [`rng`]: random numbers by coordinates (seed, frame, stage, item), never a shared stream.
//! * [`digest`]: canonical bytes and their xxh3-128.
//! * [`par`]: the only parallel construct, an ordered map over fixed work items.

pub mod align;
mod buffer;
pub mod digest;
pub mod float;
pub mod id;
mod id_vec;
pub mod lie;
pub mod par;
pub mod rng;
pub mod se3;
pub mod sim3;
pub mod track;
pub mod vector;

pub use buffer::{Buffer, Buffers};
pub use digest::{Digest, DigestWriter};
pub use id::{FrameId, KeyFrameId, MapId, MapPointId, Stamp};
pub use id_vec::IdVec;
pub use lie::LieGroup;
pub use rng::Rng;
pub use se3::Se3;
pub use sim3::Sim3;
pub use track::{StampedPose, Track};
