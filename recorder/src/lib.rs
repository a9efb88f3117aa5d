//! Everything that writes a log.
//!
//! - [`LogWriter`]: one MCAP file, crash-safe and byte for byte reproducible.
//! - [`RgbdLog`]: the same with the project's topics and metadata for a colour-depth camera: what importers, renderers
//!   and sensors write through.
//! - [`capture`]: live recording from sensors into a log that loses nothing silently.
//! - [`mocap`]: motion capture systems as sources of frames, and simulated ones.
//! - [`import`]: data set folders to logs.
//! - [`edit`]: a log to another one: cut, merged, filtered, redacted, with more in it.
//! - [`annotate`]: a log to the same log with one more segmentation layer.
//! - [`recover`]: a damaged log to a valid one, with a list of what is lost.
//! - [`realsense`]: RealSense cameras through the vendor's library.
//! - [`board`]: the calibration board to print; with the feature `opencv`, `calibrate` looks for it in pictures.
//! - [`sync`]: clocks and hand-eye transform from what was recorded.
//! - [`Arrival`]: the host's clocks at the moment when something came in.
//! - [`picture`]: PNG and JPEG files at the border of a log.

pub mod annotate;
mod arrival;
pub mod board;
#[cfg(feature = "opencv")]
pub mod calibrate;
pub mod capture;
pub mod edit;
pub mod import;
mod layer;
mod log_writer;
pub mod mocap;
pub mod picture;
pub mod realsense;
pub mod recover;
mod rgbd;
pub mod sync;

pub use arrival::Arrival;
pub use layer::LayerSpec;
pub use log_writer::{ChannelId, LogOptions, LogWriter, WriteError};
pub use rgbd::{Beside, RgbdLog, RgbdSpec};
pub use segment::Mask;
