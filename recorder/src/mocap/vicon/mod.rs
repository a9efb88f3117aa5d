//! Vicon DataStream ("CGStream", TCP port 801).
//!
//! The server offers object ids, the client answers with those that it wants, then frames flow: pushed, or asked for one
//! by one. Facts about the protocol come from Vicon's DataStream SDK 1.11 and 1.12 (MIT), whose own client reads our
//! simulated server (`tests/mocap/`).

mod body;
mod client;
pub mod object;
pub mod packet;
mod scene;
mod server;

pub use body::{HARDWARE_FRAMES_BEFORE, HEALTH, MARKER_ERROR_MM, QUALITY};
pub use client::{Segments, ViconMode, ViconOptions, ViconSource};
pub use scene::Scene;
pub(super) use server::serve;

/// Where a DataStream server listens.
pub const DEFAULT_PORT: u16 = 801;
