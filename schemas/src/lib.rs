//! What stands on disk: stamps, message types with their CDR bytes and `ros2msg` texts, topic names, metadata records,
//! calibration and label conventions. Pure values: no file, no clock, no network.
//!
//! A log is an MCAP file with profile `ros2`; every channel carries CDR messages with a `ros2msg` schema, so that any
//! ROS 2 tool opens it. This crate is the only place that defines those bytes:
//!
//! - [`Stamp`]: nanoseconds, read from and written to decimal text exactly.
//! - [`Message`]: the trait of all message types in [`msg`], over the CDR codec in [`cdr`].
//! - [`topics`]: which message stands on which topic, in which frame.
//! - [`metadata`]: the records that tell units, provenance and repairs, each with a checksum.
//! - [`sync`]: clocks and frames of a recording: the signals that tell them, the record that keeps them.
//! - [`alignment`], [`calibration`], [`panoptic`], [`pairing`]: what several rooms must read in the same way.

pub mod alignment;
pub mod calibration;
pub mod cdr;
mod message;
pub mod metadata;
pub mod msg;
pub mod pairing;
pub mod panoptic;
mod stamp;
pub mod stereo;
pub mod sync;
pub mod topics;

pub use message::{Message, definition};
pub use stamp::{Stamp, StampError};
