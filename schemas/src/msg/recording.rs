//! What a live recording keeps besides the measurements: raw clocks, metadata, losses, events.

use super::{Header, Time};
use crate::message::cdr_struct;

/// Values of [`FrameMetadata::domain`]: what the camera's library says its timestamp is.
pub mod domain {
    /// The device's own counter.
    pub const HARDWARE_CLOCK: u8 = 0;
    /// The host's clock at arrival: the device's stamp did not come through.
    pub const SYSTEM_TIME: u8 = 1;
    /// The device's counter, mapped to the host's realtime clock by the library.
    pub const GLOBAL_TIME: u8 = 2;
}

/// Values of [`FrameMetadata::device_clock`]: where the raw device time comes from.
pub mod device_clock {
    /// There is none; the header's stamp is the arrival.
    pub const NONE: u8 = 0;
    /// The metadata value `Sensor Timestamp`: middle of the exposure.
    pub const SENSOR_TIMESTAMP: u8 = 1;
    /// The metadata value `Frame Timestamp`: readout of the frame.
    pub const FRAME_TIMESTAMP: u8 = 2;
    /// The library's timestamp in the domain [`super::domain::HARDWARE_CLOCK`].
    pub const TIMESTAMP: u8 = 3;
}

/// Values of [`LogEntry::level`], as in ROS.
pub mod level {
    /// As planned.
    pub const INFO: u8 = 20;
    /// Odd, nothing is lost.
    pub const WARN: u8 = 30;
    /// Something is lost or missing.
    pub const ERROR: u8 = 40;
}

cdr_struct! {
    /// `panoptic_slam_msgs/FrameMetadata`: everything a camera tells about one picture or inertial sample besides its
    /// contents. Raw clocks stand here as they came; the header has the stamp of the measurement.
    #[derive(Default)]
    pub struct FrameMetadata: "panoptic_slam_msgs/msg/FrameMetadata" {
        /// Stamp and frame of the measurement that this belongs to.
        pub header: Header,
        /// Counter that tells lost frames: the metadata value `Frame Counter` where there is one, else the library's.
        pub counter: u64,
        /// The library's frame number.
        pub frame_number: u64,
        /// The library's timestamp, milliseconds, see [`mod@domain`].
        pub timestamp_ms: f64,
        /// See [`mod@domain`].
        pub domain: u8,
        /// Where `device_time_us` comes from, see [`mod@device_clock`].
        pub device_clock: u8,
        /// Device time as it came, microseconds; the counter may have 32 bits and wrap. [`NOT_TOLD`](super::NOT_TOLD) without.
        pub device_time_us: i64,
        /// The same without wraps, nanoseconds; [`NOT_TOLD`](super::NOT_TOLD) without.
        pub device_time_ns: i64,
        /// Host `CLOCK_MONOTONIC` at arrival, nanoseconds.
        pub arrival_monotonic_ns: i64,
        /// Host `CLOCK_REALTIME` at arrival, nanoseconds since 1970.
        pub arrival_realtime_ns: i64,
        /// Bytes of the measurement as the camera gave it.
        pub payload_bytes: u64,
        /// Numbers of the metadata values that the camera supports; names stand in [`crate::metadata::DEVICE`].
        pub attribute_ids: Vec<u16>,
        /// Their values, in the same order.
        pub attribute_values: Vec<i64>,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/Extrinsics`: `header_frame_from_child`, exactly as the device tells it.
    #[derive(Default)]
    pub struct Extrinsics: "panoptic_slam_msgs/msg/Extrinsics" {
        /// Stamp and frame that points are taken to.
        pub header: Header,
        /// Frame that points are taken from.
        pub child_frame_id: String,
        /// Rows of 3.
        pub rotation: [f64; 9],
        /// Metres.
        pub translation: [f64; 3],
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/MotionIntrinsics`: calibration of a gyroscope or accelerometer, as the device tells it.
    #[derive(Default)]
    pub struct MotionIntrinsics: "panoptic_slam_msgs/msg/MotionIntrinsics" {
        /// Stamp and frame of the sensor.
        pub header: Header,
        /// Rows of 4: scale and cross-axis sensitivity, then the bias.
        pub data: [f64; 12],
        /// Variance of the noise, an axis each.
        pub noise_variances: [f64; 3],
        /// Variance of the bias, an axis each.
        pub bias_variances: [f64; 3],
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/DropRecord`: measurements that are not in the log. Every loss has one.
    #[derive(Eq, Default)]
    pub struct DropRecord: "panoptic_slam_msgs/msg/DropRecord" {
        /// When it was noticed; the frame is that of the stream.
        pub header: Header,
        /// Stream, as `color`.
        pub stream: String,
        /// Who lost it: `device` (before it reached this program), `queue`, `disk` (by this program).
        pub cause: String,
        /// Counter of the first lost measurement, see [`FrameMetadata::counter`].
        pub first_counter: u64,
        /// Counter of the last one.
        pub last_counter: u64,
        /// How many.
        pub count: u64,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/LabelRecord`: what became of one colour picture of a recording that was labelled live. Each picture
    /// that came in has one; those that are not `labelled` never got labels.
    #[derive(Eq, Default)]
    pub struct LabelRecord: "panoptic_slam_msgs/msg/LabelRecord" {
        /// Stamp and frame of the picture.
        pub header: Header,
        /// Name of the segmentation layer.
        pub layer: String,
        /// The picture's number among all that came in, from 0; the lag counts these.
        pub picture: u64,
        /// Counter of the picture, see [`FrameMetadata::counter`].
        pub counter: u64,
        /// `labelled`; `busy` (the network worked at others until a newer picture came), `late` (its labels were not ready when
        /// they were due), `unlabelled` (there are none for it), `failed`, `ended` (the recording ended before).
        pub outcome: String,
        /// When that was decided, on the log's timeline, nanoseconds: for `labelled` the moment of delivery.
        pub decided_ns: i64,
        /// How long the network worked at it, nanoseconds; [`NOT_TOLD`](super::NOT_TOLD) where it did not, or not to the end.
        pub duration_ns: i64,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/ClockPair`: the host's two clocks at one moment.
    #[derive(Eq, Default)]
    pub struct ClockPair: "panoptic_slam_msgs/msg/ClockPair" {
        /// The moment on the log's timeline.
        pub header: Header,
        /// `CLOCK_MONOTONIC`, nanoseconds.
        pub monotonic_ns: i64,
        /// `CLOCK_REALTIME`, nanoseconds since 1970.
        pub realtime_ns: i64,
        /// How much realtime was set forward against monotonic since the last pair, nanoseconds; 0 unless it is a step.
        pub step_ns: i64,
        /// How far the two readings may lie apart, nanoseconds.
        pub uncertainty_ns: i64,
    }
}

cdr_struct! {
    /// `rcl_interfaces/Log`: something happened.
    #[derive(Eq, Default)]
    pub struct LogEntry: "rcl_interfaces/msg/Log" {
        /// When, on the log's timeline.
        pub stamp: Time,
        /// How bad, see [`mod@level`].
        pub level: u8,
        /// Stable name of what happened, as `camera.lost`.
        pub name: String,
        /// The same in words.
        pub msg: String,
        /// Unused.
        pub file: String,
        /// Unused.
        pub function: String,
        /// Unused.
        pub line: u32,
    }
}
