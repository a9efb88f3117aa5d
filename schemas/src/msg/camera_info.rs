//! Camera calibration as ROS tells it. [`crate::calibration::CameraModel`] is what this project computes with.

use super::Header;
use crate::message::cdr_struct;

cdr_struct! {
    /// `sensor_msgs/RegionOfInterest`; all zero = the whole picture.
    #[derive(Eq, Default)]
    pub struct RegionOfInterest: "sensor_msgs/msg/RegionOfInterest" {
        /// Leftmost pixel.
        pub x_offset: u32,
        /// Topmost pixel.
        pub y_offset: u32,
        /// Rows.
        pub height: u32,
        /// Columns.
        pub width: u32,
        /// Whether a rectified region is meant.
        pub do_rectify: bool,
    }
}

cdr_struct! {
    /// `sensor_msgs/CameraInfo`.
    #[derive(Default)]
    pub struct CameraInfo: "sensor_msgs/msg/CameraInfo" {
        /// Stamp of the picture that this belongs to, and its optical frame.
        pub header: Header,
        /// Rows of the picture.
        pub height: u32,
        /// Columns of the picture.
        pub width: u32,
        /// `plumb_bob`, or empty without distortion.
        pub distortion_model: String,
        /// Distortion, for `plumb_bob` k1, k2, p1, p2, k3.
        pub d: Vec<f64>,
        /// Intrinsic matrix, rows of 3: fx 0 cx, 0 fy cy, 0 0 1 (pixels).
        pub k: [f64; 9],
        /// Rectification rotation, rows of 3.
        pub r: [f64; 9],
        /// Projection of rectified points, rows of 4.
        pub p: [f64; 12],
        /// Horizontal binning, 0 = 1 = none.
        pub binning_x: u32,
        /// Vertical binning, 0 = 1 = none.
        pub binning_y: u32,
        /// Part of the sensor that the picture shows.
        pub roi: RegionOfInterest,
    }
}
