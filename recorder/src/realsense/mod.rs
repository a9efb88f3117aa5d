//! RealSense cameras through librealsense 2.54 - 2.59, found at run time.
mod clock;
mod types;

pub use clock::DeviceClock;
pub use types::*;
