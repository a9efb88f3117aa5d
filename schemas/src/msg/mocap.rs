//! Motion capture: what the system said about one of its frames, with every clock that was there.

use super::{Header, Point, Pose};
use crate::message::cdr_struct;

/// A number that the source does not tell: frame numbers, stamps, rates, qualities are never negative.
pub const NOT_TOLD: i64 = -1;

cdr_struct! {
    /// `panoptic_slam_msgs/MocapLatency`: one step of the system's own processing.
    #[derive(Default)]
    pub struct MocapLatency: "panoptic_slam_msgs/msg/MocapLatency" {
        /// Name of the step, as the system gives it.
        pub name: String,
        /// Seconds since the step before; the sum over a frame is the time since the picture was taken.
        pub seconds: f64,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/MocapTimecode`: SMPTE timecode of a frame.
    #[derive(Copy, Eq, Default)]
    pub struct MocapTimecode: "panoptic_slam_msgs/msg/MocapTimecode" {
        /// Hours.
        pub hours: u8,
        /// Minutes.
        pub minutes: u8,
        /// Seconds.
        pub seconds: u8,
        /// Film or video frames within the second.
        pub frames: u8,
        /// Motion capture frames within that frame.
        pub subframes: u16,
        /// How many of those there are.
        pub subframes_per_frame: u16,
        /// 0 PAL, 1 NTSC, 2 NTSC drop, 3 film 24, 4 NTSC film 23.98, 5 ATSC 30, 2^32 - 1 none.
        pub standard: u32,
        /// User bits.
        pub user_bits: u32,
        /// Which field of an interlaced picture.
        pub field_flag: u8,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/MocapBody`: one segment of one subject.
    #[derive(Default)]
    pub struct MocapBody: "panoptic_slam_msgs/msg/MocapBody" {
        /// Subject, as the system names it.
        pub subject: String,
        /// Segment of the subject; a rigid body has one, usually of the same name.
        pub segment: String,
        /// Parent segment; empty for the root.
        pub parent: String,
        /// The system knows it but does not see it: the pose is NaN.
        pub occluded: bool,
        /// The pose is there, but exactly zero or exactly the one before: systems without an occlusion flag send this
        /// for what they do not see.
        pub suspect: bool,
        /// `world_from_segment`, metres.
        pub pose: Pose,
        /// How well the markers fit, 0..=1; [`NOT_TOLD`] if unknown.
        pub quality: f64,
        /// The subject's health, 0..=1; [`NOT_TOLD`] if unknown.
        pub health: f64,
        /// Marker error, metres; [`NOT_TOLD`] if unknown.
        pub marker_error: f64,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/MocapMarker`: one reconstructed marker.
    #[derive(Default)]
    pub struct MocapMarker: "panoptic_slam_msgs/msg/MocapMarker" {
        /// Subject that it belongs to; empty for an unlabelled marker.
        pub subject: String,
        /// Its name; empty for an unlabelled marker.
        pub name: String,
        /// In the world, metres.
        pub position: Point,
        /// Metres.
        pub radius: f64,
        /// The same number as long as the system follows the marker.
        pub trajectory_id: u32,
    }
}

cdr_struct! {
    /// `panoptic_slam_msgs/MocapFrame`: everything about one frame.
    #[derive(Default)]
    pub struct MocapFrame: "panoptic_slam_msgs/msg/MocapFrame" {
        /// Stamp on the log's timeline and the fixed frame of all poses.
        pub header: Header,
        /// Kind and address, as `vicon 10.0.0.2:801`.
        pub source: String,
        /// The system's own number; gaps are lost frames. [`NOT_TOLD`] if it has none.
        pub frame_number: i64,
        /// The cameras' own number; [`NOT_TOLD`] if unknown.
        pub hardware_frame: i64,
        /// Frames a second by the system's clock; [`NOT_TOLD`] if unknown.
        pub rate: f64,
        /// This computer's monotonic clock when the last byte of the frame was read, nanoseconds.
        pub arrival_monotonic_ns: i64,
        /// This computer's realtime clock at the same moment, nanoseconds since 1970.
        pub arrival_realtime_ns: i64,
        /// The sending computer's realtime clock, nanoseconds since 1970; [`NOT_TOLD`] if the protocol has none.
        pub source_stamp_ns: i64,
        /// Steps of processing since the picture was taken, in order.
        pub latency: Vec<MocapLatency>,
        /// Round trip of the last ping, seconds, with the wait for the server's next packet in it; [`NOT_TOLD`] if there
        /// was none.
        pub ping_round_trip: f64,
        /// Datagrams since the last frame that were not the protocol.
        pub discarded: u32,
        /// None or one.
        pub timecode: Vec<MocapTimecode>,
        /// Every known segment, in the system's order, occluded ones too.
        pub bodies: Vec<MocapBody>,
        /// Labelled markers, then unlabelled ones; empty unless asked for.
        pub markers: Vec<MocapMarker>,
    }
}
