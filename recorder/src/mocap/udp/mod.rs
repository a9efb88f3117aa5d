//! Vicon Tracker's UDP object stream (port 51001): one datagram a frame.
//!
//! The layout is agreed upon by three independent public parsers. It has no time and no occlusion flag: an exactly zero
//! pose counts as occluded, an exactly repeated one is marked as suspect.

mod client;
pub mod datagram;
mod server;

pub use client::{UdpOptions, UdpSource};
pub(super) use server::send_to;

/// Where Tracker sends to unless told otherwise.
pub const DEFAULT_PORT: u16 = 51001;
