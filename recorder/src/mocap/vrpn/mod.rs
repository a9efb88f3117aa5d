//! VRPN (Tracker's built-in server and many others, port 3883).
//!
//! Facts about the protocol come from VRPN 07.x (BSL-1.0). A tracker is a subject, its sensor 0 the segment of the same
//! name. VRPN has no frame numbers and no occlusion flag; its stamps are the server's time of day.

mod client;
pub mod message;
mod server;

pub use client::{VrpnOptions, VrpnSource};
pub(super) use server::listen;

/// Where a VRPN server listens.
pub const DEFAULT_PORT: u16 = 3883;
