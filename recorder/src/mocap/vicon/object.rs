//! The objects of the protocol, as far as a recorder needs them.
//!
//! Lengths are millimetres here, as on the wire; matrices stand row by row.

use crate::mocap::wire::wire_struct;
use std::collections::{BTreeMap, BTreeSet};

/// Object ids.
pub mod id {
    #![allow(missing_docs, reason = "the names are the protocol's")]
    pub const STREAM_INFO: u32 = 1;
    pub const SUBJECT_INFO: u32 = 2;
    pub const FRAME_INFO: u32 = 5;
    pub const LABELED_RECONS: u32 = 6;
    pub const UNLABELED_RECONS: u32 = 7;
    pub const LOCAL_SEGMENTS: u32 = 8;
    pub const GLOBAL_SEGMENTS: u32 = 9;
    pub const TIMECODE: u32 = 23;
    pub const LATENCY_INFO: u32 = 26;
    pub const SUBJECT_TOPOLOGY: u32 = 28;
    pub const SUBJECT_HEALTH: u32 = 29;
    pub const HARDWARE_FRAME_INFO: u32 = 36;
    pub const APPLICATION_INFO: u32 = 37;
    pub const FRAME_RATE_INFO: u32 = 39;
    pub const OBJECT_QUALITY: u32 = 40;
    pub const PING: u32 = 42;
    pub const LIGHTWEIGHT_SEGMENTS: u32 = 901;
    pub const SUBJECT_SCALE: u32 = 28001;
    pub const OBJECT_ENUMS: u32 = 100_001;
    pub const REQUEST_FRAME: u32 = 100_002;
    pub const KEEP_ALIVE: u32 = 100_003;
    pub const CONTENTS: u32 = 100_004;
    pub const FILTER: u32 = 100_007;
    pub const REQUEST_NEXT_FRAME: u32 = 100_008;
}

/// Objects that describe the scene rather than the frame, and that we keep.
pub const STATIC: [u32; 7] = [
    id::STREAM_INFO,
    id::SUBJECT_INFO,
    id::SUBJECT_TOPOLOGY,
    id::SUBJECT_SCALE,
    id::SUBJECT_HEALTH,
    id::OBJECT_QUALITY,
    id::APPLICATION_INFO,
];

/// Objects of the frame, and that we keep.
pub const DYNAMIC: [u32; 10] = [
    id::FRAME_INFO,
    id::HARDWARE_FRAME_INFO,
    id::FRAME_RATE_INFO,
    id::LATENCY_INFO,
    id::TIMECODE,
    id::LABELED_RECONS,
    id::UNLABELED_RECONS,
    id::LOCAL_SEGMENTS,
    id::GLOBAL_SEGMENTS,
    id::LIGHTWEIGHT_SEGMENTS,
];

/// Ticks a second of the clock in [`StreamInfo`].
pub const TICKS_PER_SECOND: f64 = 135e6;

wire_struct! {
    /// What one side can send, or wants to get.
    pub struct ObjectEnums {
        /// Object ids.
        pub ids: BTreeSet<u32>,
    }
}

wire_struct! {
    /// Client: a frame please.
    pub struct RequestFrame {
        /// True: every frame from now on. False: one frame, now, and no stream.
        pub streaming: bool,
    }
}

wire_struct! {
    /// Client: the next frames that come to be.
    pub struct RequestNextFrame {
        /// How many.
        pub count: u32,
    }
}

wire_struct! {
    /// Goes to the server and comes back.
    pub struct Ping {
        /// The client's choice.
        pub id: u64,
    }
}

wire_struct! {
    /// Client: only these subjects or cameras.
    pub struct Filter {
        /// By object id: the subjects (or cameras) to be sent.
        pub by_object: BTreeMap<u32, BTreeSet<u32>>,
    }
}

wire_struct! {
    /// What is in a packet.
    pub struct Contents {
        /// By object id: how many blocks.
        pub counts: BTreeMap<u32, u32>,
        /// Objects that are as in the packet before, and therefore not in this one.
        pub unchanged: BTreeSet<u32>,
    }
}

wire_struct! {
    /// Speed of the stream.
    pub struct StreamInfo {
        /// Length of a frame in ticks of [`TICKS_PER_SECOND`].
        pub frame_period_ticks: i64,
    }
}

wire_struct! {
    /// Number of the frame.
    pub struct FrameInfo {
        /// One less than the number that Vicon's programs show.
        pub frame_id: u32,
    }
}

wire_struct! {
    /// The cameras' own number of the frame.
    pub struct HardwareFrameInfo {
        /// Number.
        pub frame_id: u32,
    }
}

wire_struct! {
    /// Rates by name.
    pub struct FrameRateInfo {
        /// Hertz.
        pub rates_hz: BTreeMap<String, f64>,
    }
}

wire_struct! {
    /// One step of processing.
    pub struct Latency {
        /// Name.
        pub name: String,
        /// Seconds since the step before.
        pub seconds: f64,
    }
}

wire_struct! {
    /// Steps of processing; their sum is the age of the picture.
    pub struct LatencyInfo {
        /// In order.
        pub samples: Vec<Latency>,
    }
}

wire_struct! {
    /// SMPTE timecode, fields as in [`schemas::msg::MocapTimecode`].
    pub struct Timecode {
        /// Hours, minutes, seconds, frames.
        pub hmsf: [u8; 4],
        /// Subframe.
        pub subframes: u16,
        /// Subframes a frame.
        pub subframes_per_frame: u16,
        /// Standard.
        pub standard: u32,
        /// User bits.
        pub user_bits: u32,
        /// Field flag.
        pub field_flag: u8,
    }
}

wire_struct! {
    /// The sending program.
    pub struct ApplicationInfo {
        /// 0: z is up, 1: y is up. Old servers do not send the object; with them z is up.
        pub axis_orientation: u8,
    }
}

wire_struct! {
    /// A segment of a subject.
    pub struct SegmentInfo {
        /// 0 for the root.
        pub parent: u32,
        /// Id, from 1.
        pub segment: u32,
        /// Bounds of its motion.
        pub bounds: [f32; 6],
        /// Name.
        pub name: String,
    }
}

wire_struct! {
    /// A marker of a subject.
    pub struct MarkerInfo {
        /// Id.
        pub marker: u32,
        /// Name.
        pub name: String,
    }
}

wire_struct! {
    /// Which segment a marker sits on.
    pub struct Attachment {
        /// Marker id.
        pub marker: u32,
        /// Segment id.
        pub segment: u32,
    }
}

wire_struct! {
    /// One subject.
    pub struct SubjectInfo {
        /// Id.
        pub subject: u32,
        /// Name.
        pub name: String,
        /// Its segments.
        pub segments: Vec<SegmentInfo>,
        /// Its markers.
        pub markers: Vec<MarkerInfo>,
        /// Which marker sits where.
        pub attachments: Vec<Attachment>,
    }
}

wire_struct! {
    /// Pose of a segment.
    pub struct SegmentPose {
        /// Segment id.
        pub segment: u32,
        /// Millimetres.
        pub translation_mm: [f64; 3],
        /// Row by row.
        pub rotation: [f64; 9],
    }
}

wire_struct! {
    /// Poses of a subject's segments: in the world, in the parent segment, or (topology) in the parent at rest.
    pub struct Segments {
        /// Subject id.
        pub subject: u32,
        /// Those that are seen.
        pub poses: Vec<SegmentPose>,
    }
}

wire_struct! {
    /// Pose of a segment in few bytes.
    pub struct LightweightPose {
        /// Segment id.
        pub segment: u32,
        /// Millimetres.
        pub translation_mm: [f32; 3],
        /// Rotation vector, radians.
        pub rotation_vector: [f32; 3],
    }
}

wire_struct! {
    /// Poses of a subject's segments in their parents.
    pub struct LightweightSegments {
        /// Subject id.
        pub subject: u32,
        /// Those that are seen.
        pub poses: Vec<LightweightPose>,
    }
}

wire_struct! {
    /// Scale of a segment.
    pub struct SegmentScale {
        /// Segment id.
        pub segment: u32,
        /// Along its axes.
        pub scale: [f64; 3],
    }
}

wire_struct! {
    /// Scales of a subject's segments.
    pub struct SubjectScale {
        /// Subject id.
        pub subject: u32,
        /// Those that differ from their parent's.
        pub scales: Vec<SegmentScale>,
    }
}

wire_struct! {
    /// How a subject fares.
    pub struct SubjectHealth {
        /// Subject id.
        pub subject: u32,
        /// Millimetres.
        pub marker_error_mm: f64,
        /// 0..=1.
        pub health: f64,
    }
}

wire_struct! {
    /// How well a subject is tracked.
    pub struct ObjectQuality {
        /// Subject id.
        pub subject: u32,
        /// 0..=1.
        pub quality: f64,
    }
}

wire_struct! {
    /// A marker that belongs to a subject.
    pub struct LabeledRecon {
        /// Subject id.
        pub subject: u32,
        /// Marker id.
        pub marker: u32,
        /// Where it is.
        pub recon: UnlabeledRecon,
    }
}

wire_struct! {
    /// Where a marker is.
    pub struct UnlabeledRecon {
        /// Millimetres.
        pub radius_mm: f64,
        /// Millimetres.
        pub position_mm: [f64; 3],
        /// Row by row, square millimetres.
        pub covariance: [f64; 9],
        /// The same as long as the marker is followed.
        pub trajectory: u32,
    }
}

wire_struct! {
    /// Markers of subjects.
    pub struct LabeledRecons {
        /// Those that are seen.
        pub recons: Vec<LabeledRecon>,
    }
}

wire_struct! {
    /// Markers of nobody.
    pub struct UnlabeledRecons {
        /// Those that are seen.
        pub recons: Vec<UnlabeledRecon>,
    }
}
