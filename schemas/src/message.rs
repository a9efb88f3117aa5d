//! The trait of all messages, and the `ros2msg` texts that make a log self-describing.

use crate::cdr::{Cdr, CdrError, Reader, Writer};
use std::collections::BTreeSet;

/// One message type: a name, its definition text, and CDR bytes.
///
/// `'a` is the life of the bytes that a decoded message borrows its pixel data from.
pub trait Message<'a>: Cdr<'a> {
    /// ROS 2 name, `package/msg/Type`.
    const SCHEMA_NAME: &'static str;

    /// The `ros2msg` text: the type's own fields, then each type it uses under a line of 80 `=` and `MSG: package/Type`.
    #[must_use]
    fn schema_text() -> String {
        schema_text(Self::SCHEMA_NAME)
    }

    /// Bytes beyond the fixed fields, so that the buffer is allocated once.
    fn payload_bytes(&self) -> usize {
        0
    }

    /// The message as CDR, little endian.
    fn encode(&self) -> Vec<u8> {
        let mut writer = Writer::with_capacity(self.payload_bytes() + 512);
        self.write(&mut writer);
        writer.into_bytes()
    }

    /// Reads a message of either endianness. Bytes after the last field are allowed: writers may pad.
    ///
    /// # Errors
    /// The bytes are no such message.
    fn decode(bytes: &'a [u8]) -> Result<Self, CdrError> {
        Self::read(&mut Reader::new(bytes)?)
    }
}

/// Declares a message as a struct whose fields are written in order; `Name<'a>` if it borrows its `data`.
macro_rules! cdr_struct {
    ($(#[$meta:meta])* pub struct $name:ident: $schema:literal { $($fields:tt)* }) => {
        cdr_struct!(@struct [$(#[$meta])*] $name [] $($fields)*);
        cdr_struct!(@codec 'a [$name] $($fields)*);
        impl<'a> $crate::Message<'a> for $name {
            const SCHEMA_NAME: &'static str = $schema;
        }
    };
    ($(#[$meta:meta])* pub struct $name:ident<$life:lifetime>: $schema:literal { $($fields:tt)* }) => {
        cdr_struct!(@struct [$(#[$meta])*] $name [<$life>] $($fields)*);
        cdr_struct!(@codec $life [$name<$life>] $($fields)*);
        impl<$life> $crate::Message<$life> for $name<$life> {
            const SCHEMA_NAME: &'static str = $schema;
            fn payload_bytes(&self) -> usize {
                self.data.len()
            }
        }
    };
    (@struct [$(#[$meta:meta])*] $name:ident [$($life:tt)*] $($(#[$doc:meta])* pub $field:ident: $kind:ty,)*) => {
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name $($life)* { $($(#[$doc])* pub $field: $kind,)* }
    };
    (@codec $life:lifetime [$target:ty] $($(#[$doc:meta])* pub $field:ident: $kind:ty,)*) => {
        impl<$life> $crate::cdr::Cdr<$life> for $target {
            const MIN_BYTES: usize = 0 $(+ <$kind as $crate::cdr::Cdr<'_>>::MIN_BYTES)*;
            fn write(&self, writer: &mut $crate::cdr::Writer) {
                $($crate::cdr::Cdr::write(&self.$field, writer);)*
            }
            fn read(reader: &mut $crate::cdr::Reader<$life>) -> Result<Self, $crate::cdr::CdrError> {
                Ok(Self { $($field: $crate::cdr::Cdr::read(reader)?,)* })
            }
        }
    };
}
pub(crate) use cdr_struct;

/// Every type's own fields, in the ROS interface language. The standard ones are the published ROS 2 interfaces.
const DEFINITIONS: &[(&str, &str)] = &[
    ("builtin_interfaces/msg/Time", "int32 sec\nuint32 nanosec\n"),
    ("std_msgs/msg/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
    (
        "sensor_msgs/msg/Image",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\nuint8 is_bigendian\nuint32 step\nuint8[] data\n",
    ),
    ("sensor_msgs/msg/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"),
    (
        "sensor_msgs/msg/RegionOfInterest",
        "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
    ),
    (
        "sensor_msgs/msg/CameraInfo",
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
         float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
    ),
    (
        "sensor_msgs/msg/Imu",
        "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
         geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
         geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    ),
    ("geometry_msgs/msg/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/msg/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
    ("geometry_msgs/msg/Quaternion", "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"),
    ("geometry_msgs/msg/Pose", "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"),
    ("geometry_msgs/msg/PoseStamped", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"),
    ("geometry_msgs/msg/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
    (
        "geometry_msgs/msg/TransformStamped",
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    ),
    ("tf2_msgs/msg/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"),
    ("vision_msgs/msg/VisionClass", "uint16 class_id\nstring class_name\n"),
    ("vision_msgs/msg/LabelInfo", "std_msgs/Header header\nvision_msgs/VisionClass[] class_map\nfloat32 threshold\n"),
    ("panoptic_slam_msgs/msg/Category", "uint16 id\nstring name\nbool is_thing\n"),
    (
        "panoptic_slam_msgs/msg/CategoryTable",
        "std_msgs/Header header\nstring layer\npanoptic_slam_msgs/Category[] categories\n",
    ),
    (
        "panoptic_slam_msgs/msg/Segment",
        "uint16 id\nuint16 category_id\nfloat32 score\nuint32 x\nuint32 y\nuint32 width\nuint32 height\nuint32 area\n\
         bool is_crowd\n",
    ),
    (
        "panoptic_slam_msgs/msg/SegmentTable",
        "std_msgs/Header header\nstring layer\npanoptic_slam_msgs/Segment[] segments\n",
    ),
    ("panoptic_slam_msgs/msg/MocapLatency", "string name\nfloat64 seconds\n"),
    (
        "panoptic_slam_msgs/msg/MocapTimecode",
        "uint8 hours\nuint8 minutes\nuint8 seconds\nuint8 frames\nuint16 subframes\nuint16 subframes_per_frame\n\
         uint32 standard\nuint32 user_bits\nuint8 field_flag\n",
    ),
    (
        "panoptic_slam_msgs/msg/MocapBody",
        "string subject\nstring segment\nstring parent\nbool occluded\nbool suspect\ngeometry_msgs/Pose pose\n\
         float64 quality\nfloat64 health\nfloat64 marker_error\n",
    ),
    (
        "panoptic_slam_msgs/msg/MocapMarker",
        "string subject\nstring name\ngeometry_msgs/Point position\nfloat64 radius\nuint32 trajectory_id\n",
    ),
    (
        "panoptic_slam_msgs/msg/MocapFrame",
        "std_msgs/Header header\nstring source\nint64 frame_number\nint64 hardware_frame\nfloat64 rate\n\
         int64 arrival_monotonic_ns\nint64 arrival_realtime_ns\nint64 source_stamp_ns\n\
         panoptic_slam_msgs/MocapLatency[] latency\nfloat64 ping_round_trip\nuint32 discarded\npanoptic_slam_msgs/MocapTimecode[] timecode\n\
         panoptic_slam_msgs/MocapBody[] bodies\npanoptic_slam_msgs/MocapMarker[] markers\n",
    ),
    (
        "panoptic_slam_msgs/msg/FrameMetadata",
        "std_msgs/Header header\nuint64 counter\nuint64 frame_number\nfloat64 timestamp_ms\nuint8 domain\n\
         uint8 device_clock\nint64 device_time_us\nint64 device_time_ns\nint64 arrival_monotonic_ns\n\
         int64 arrival_realtime_ns\nuint64 payload_bytes\nuint16[] attribute_ids\nint64[] attribute_values\n",
    ),
    (
        "panoptic_slam_msgs/msg/Extrinsics",
        "std_msgs/Header header\nstring child_frame_id\nfloat64[9] rotation\nfloat64[3] translation\n",
    ),
    (
        "panoptic_slam_msgs/msg/MotionIntrinsics",
        "std_msgs/Header header\nfloat64[12] data\nfloat64[3] noise_variances\nfloat64[3] bias_variances\n",
    ),
    (
        "panoptic_slam_msgs/msg/DropRecord",
        "std_msgs/Header header\nstring stream\nstring cause\nuint64 first_counter\nuint64 last_counter\nuint64 count\n",
    ),
    (
        "panoptic_slam_msgs/msg/LabelRecord",
        "std_msgs/Header header\nstring layer\nuint64 picture\nuint64 counter\nstring outcome\nint64 decided_ns\nint64 duration_ns\n",
    ),
    (
        "panoptic_slam_msgs/msg/ClockPair",
        "std_msgs/Header header\nint64 monotonic_ns\nint64 realtime_ns\nint64 step_ns\nint64 uncertainty_ns\n",
    ),
    (
        "rcl_interfaces/msg/Log",
        "builtin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n",
    ),
];

/// A type's own fields as ROS text, by its name `package/msg/Type`.
#[must_use]
pub fn definition(name: &str) -> Option<&'static str> {
    DEFINITIONS.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

fn schema_text(name: &str) -> String {
    let mut text = definition(name).unwrap_or_default().to_owned();
    let mut queue = used_types(&text);
    let mut done = BTreeSet::new();
    // Breadth first in the order of use: each used type once.
    let mut next = 0;
    while next < queue.len() {
        let short = queue[next].clone();
        next += 1;
        if !done.insert(short.clone()) {
            continue;
        }
        let own = definition(&short.replacen('/', "/msg/", 1)).unwrap_or_default();
        text.push_str(&format!("{}\nMSG: {short}\n{own}", "=".repeat(80)));
        queue.extend(used_types(own));
    }
    text
}

/// The `package/Type` names that a definition's fields have.
fn used_types(definition: &str) -> Vec<String> {
    let kinds = definition.lines().filter_map(|line| line.split_whitespace().next());
    kinds.filter(|kind| kind.contains('/')).map(|kind| kind.trim_end_matches("[]").to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_used_type_is_defined() {
        for (name, text) in DEFINITIONS {
            for used in used_types(text) {
                assert!(definition(&used.replacen('/', "/msg/", 1)).is_some(), "{name} uses {used}");
            }
        }
    }

    #[test]
    fn schema_text_holds_each_dependency_once() {
        let text = schema_text("geometry_msgs/msg/PoseStamped");
        let heads: Vec<&str> = text.lines().filter(|line| line.starts_with("MSG: ")).collect();
        assert_eq!(
            heads,
            [
                "MSG: std_msgs/Header",
                "MSG: geometry_msgs/Pose",
                "MSG: builtin_interfaces/Time",
                "MSG: geometry_msgs/Point",
                "MSG: geometry_msgs/Quaternion"
            ]
        );
        assert!(text.starts_with("std_msgs/Header header\n"));
        assert_eq!(text.matches(&"=".repeat(80)).count(), heads.len());
    }
}
