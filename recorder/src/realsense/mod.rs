//! RealSense cameras through librealsense 2.54 - 2.59, found at run time.
//!
//! [`Library`] finds and checks it, [`Context`] lists cameras and opens one, [`Camera`] tells about itself, takes options
//! and streams: each sensor on its own, neither the vendor's pipeline nor its syncer. A recording of the vendor's
//! (`.bag`, `.db3`) is opened in the same way as a camera.

mod camera;
mod clock;
mod context;
mod finding;
mod frame;
mod library;
mod raw;
mod select;
mod software;
mod types;
mod vendor_align;

pub use camera::{Camera, Sink, State, Streaming};
pub use clock::DeviceClock;
pub use context::{CameraError, Context};
pub use finding::Finding;
pub use library::{LIBRARY_VARIABLE, Library, LoadError};
pub use raw::CallError;
pub use select::{Selection, VideoMode, Wish};
pub use software::{SoftwareCamera, SoftwareSpec, VendorRecording};
pub use types::*;
pub use vendor_align::vendor_align;

// Numbers of librealsense, checked by name when it is loaded.

const EXTENSION_PLAYBACK: i32 = 16;
const OPTION_DEPTH_UNITS: i32 = 28;
const OPTION_EMITTER_ENABLED: i32 = 18;
const OPTION_EXPOSURE: i32 = 3;
const PLAYBACK_STOPPED: i32 = 3;

/// Texts of a device about itself.
mod info {
    pub const NAME: i32 = 0;
    pub const SERIAL: i32 = 1;
    pub const FIRMWARE: i32 = 2;
    pub const PRODUCT_ID: i32 = 7;
    pub const USB: i32 = 9;
}
