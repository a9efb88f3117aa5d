//! Which message stands on which topic, and the names of frames and units.
//!
//! Stamps: a message's log time is its header stamp. Masks carry the stamp of the colour picture they were made from.
//! In an imported or rendered log the publish time is the same and messages stand in the file in order of log time; equal
//! times in the order of this page.
//!
//! In a live recording (one with [`crate::metadata::RECORDING`]) a stamp is the *device's* time put on the host's timeline
//! by one constant a device and connection, so that spacing is the device's own; the host's timeline is its monotonic
//! clock plus one constant, chosen so that it is the realtime clock at the start. No later step of the realtime clock
//! moves a stamp. The publish time is the host's realtime clock at arrival. Messages stand in the file in order of
//! arrival, so log times are only nearly sorted: a reader sorts. The raw clocks stand in [`crate::msg::FrameMetadata`] and
//! [`crate::msg::MocapFrame`] and are never rewritten; what a later fit makes of them is a record of its own.

use crate::Message;

/// Ground truth, [`crate::msg::PoseStamped`]: `world_from_camera`, every row of the source.
pub const GROUND_TRUTH: &str = "/ground_truth/pose";
/// The same poses as [`crate::msg::TFMessage`] edges [`frame::WORLD`] -> [`frame::CAMERA`].
pub const TF: &str = "/tf";
/// Calibration of the colour camera, [`crate::msg::CameraInfo`], one a picture.
pub const COLOR_INFO: &str = "/camera/color/camera_info";
/// Colour, [`crate::msg::CompressedImage`] with PNG or JPEG bytes.
pub const COLOR: &str = "/camera/color/image/compressed";
/// Calibration of the right camera of a stereo camera, [`crate::msg::CameraInfo`], one a picture: with that of the left one
/// on [`COLOR_INFO`] it tells a [`crate::stereo::StereoModel`].
pub const RIGHT_INFO: &str = "/camera/right/camera_info";
/// The right picture as recorded (not rectified), [`crate::msg::CompressedImage`]; the left one is on [`COLOR`].
pub const RIGHT: &str = "/camera/right/image/compressed";
/// Calibration of the depth image, [`crate::msg::CameraInfo`], one a picture. Registered depth: equal to the colour one.
pub const DEPTH_INFO: &str = "/camera/depth/camera_info";
/// Depth, [`crate::msg::Image`] `16UC1`, 0 = none; units per metre in [`crate::metadata::DEPTH`].
pub const DEPTH: &str = "/camera/depth/image";
/// Inertial measurements, [`crate::msg::Imu`].
pub const IMU: &str = "/camera/imu";
/// Colour that no encoder could keep up with, [`crate::msg::Image`] `rgb8`; calibration on [`COLOR_INFO`]. A recording has
/// either this or [`COLOR`].
pub const COLOR_RAW: &str = "/camera/color/image";
/// Depth as the camera measures it, in [`frame::DEPTH`] and not registered: [`crate::msg::Image`] `16UC1`, 0 = none. A
/// reader registers it to colour with [`COLOR_INFO`], [`DEPTH_NATIVE_INFO`] and [`EXTRINSICS`].
pub const DEPTH_NATIVE: &str = "/camera/depth/native/image";
/// Calibration of the native depth image, [`crate::msg::CameraInfo`], one a picture.
pub const DEPTH_NATIVE_INFO: &str = "/camera/depth/native/camera_info";
/// Gyroscope alone, [`crate::msg::Imu`] without acceleration (first element of its covariance -1).
pub const GYRO: &str = "/camera/gyro/sample";
/// Calibration of the gyroscope, [`crate::msg::MotionIntrinsics`].
pub const GYRO_INFO: &str = "/camera/gyro/imu_info";
/// Accelerometer alone, [`crate::msg::Imu`] without angular velocity (first element of its covariance -1).
pub const ACCEL: &str = "/camera/accel/sample";
/// Calibration of the accelerometer, [`crate::msg::MotionIntrinsics`].
pub const ACCEL_INFO: &str = "/camera/accel/imu_info";
/// Clocks and metadata of each colour picture, [`crate::msg::FrameMetadata`] with the picture's stamp.
pub const COLOR_METADATA: &str = "/camera/color/metadata";
/// The same for native depth.
pub const DEPTH_NATIVE_METADATA: &str = "/camera/depth/native/metadata";
/// The same for the gyroscope.
pub const GYRO_METADATA: &str = "/camera/gyro/metadata";
/// The same for the accelerometer.
pub const ACCEL_METADATA: &str = "/camera/accel/metadata";
/// Where the camera's sensors are, [`crate::msg::Extrinsics`] in [`frame::CAMERA`], one a sensor, at the start and the end.
pub const EXTRINSICS: &str = "/camera/extrinsics";
/// The same as [`crate::msg::TFMessage`] edges, for viewers.
pub const TF_STATIC: &str = "/tf_static";
/// What became of each picture that a network should label live, [`crate::msg::LabelRecord`].
pub const LABELS: &str = "/recording/labels";
/// Every loss, [`crate::msg::DropRecord`].
pub const DROPS: &str = "/recording/drops";
/// The host's clocks once a second, [`crate::msg::ClockPair`].
pub const CLOCK: &str = "/recording/clock";
/// What happened, [`crate::msg::LogEntry`].
pub const EVENTS: &str = "/recording/events";

/// What a motion capture system said, [`crate::msg::MocapFrame`], one a frame, also when every body is occluded.
pub const MOCAP: &str = "/mocap/frames";
const MOCAP_BODY: &str = "/vicon/";

/// The topic of one segment's poses, [`crate::msg::PoseStamped`] in [`frame::WORLD`], whichever system sees it; frames in
/// which it is occluded have no message. Characters that no ROS name has become `_`; [`MOCAP`] has the names as they are.
#[must_use]
pub fn mocap_body(subject: &str, segment: &str) -> String {
    format!("{MOCAP_BODY}{}/{}", ros_token(subject), ros_token(segment))
}

/// Subject and segment, as ROS names, of a topic that [`mocap_body`] made.
#[must_use]
pub fn mocap_body_of(topic: &str) -> Option<(&str, &str)> {
    topic.strip_prefix(MOCAP_BODY)?.split_once('/').filter(|(_, segment)| !segment.contains('/'))
}

/// The nearest ROS name token (letter first, then letters, digits, `_`).
fn ros_token(text: &str) -> String {
    let known = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let token: String = text.chars().map(known).collect();
    if token.starts_with(|c: char| c.is_ascii_alphabetic()) { token } else { format!("m{token}") }
}

/// Names in `frame_id`.
pub mod frame {
    /// The ground truth's fixed frame.
    pub const WORLD: &str = "world";
    /// The colour camera: x right, y down, z forward. Registered depth and masks stand in it too.
    pub const CAMERA: &str = "camera_color_optical_frame";
    /// The left imager of the depth camera, in which native depth stands; axes as those of [`CAMERA`].
    pub const DEPTH: &str = "camera_depth_optical_frame";
    /// The gyroscope, axes as those of [`CAMERA`].
    pub const GYRO: &str = "camera_gyro_optical_frame";
    /// The accelerometer, axes as those of [`CAMERA`].
    pub const ACCEL: &str = "camera_accel_optical_frame";
    /// The right camera of a stereo camera.
    pub const RIGHT_CAMERA: &str = "camera_right_optical_frame";
    /// The inertial sensor of a data set that has its own frame for it.
    pub const IMU: &str = "imu";
}

/// The layer that the SLAM reads unless told otherwise.
pub const DEFAULT_LAYER: &str = "panoptic";
const SEGMENTATION: &str = "/segmentation/";

/// The topics of one named segmentation layer. A log may hold several (two networks, exact labels).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LayerTopics {
    /// [`crate::msg::CategoryTable`], once, before the first mask.
    pub categories: String,
    /// [`crate::msg::LabelInfo`], once: the same names for other tools.
    pub label_info: String,
    /// [`crate::msg::Image`] `mono8` or `mono16`: category id a pixel, 0 = void (unknown).
    pub class: String,
    /// [`crate::msg::Image`] `mono16`: segment id a pixel, 0 = void (unknown).
    pub instance: String,
    /// [`crate::msg::SegmentTable`], one a mask.
    pub segments: String,
}

impl LayerTopics {
    /// The topics of the layer with this name.
    #[must_use]
    pub fn new(layer: &str) -> Self {
        let topic = |leaf: &str| format!("{SEGMENTATION}{layer}/{leaf}");
        Self {
            categories: topic("categories"),
            label_info: topic("label_info"),
            class: topic("class"),
            instance: topic("instance"),
            segments: topic("segments"),
        }
    }
}

/// Whether a text can name a segmentation layer: a ROS name token (letter first, then letters, digits, `_`).
#[must_use]
pub fn is_layer_name(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic()) && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// The layer that a topic belongs to, if it is a segmentation topic.
#[must_use]
pub fn layer_of(topic: &str) -> Option<&str> {
    let (layer, leaf) = topic.strip_prefix(SEGMENTATION)?.split_once('/')?;
    matches!(leaf, "categories" | "label_info" | "class" | "instance" | "segments").then_some(layer)
}

/// The message type that this project writes on a topic.
#[must_use]
pub fn schema_name(topic: &str) -> Option<&'static str> {
    use crate::msg::{
        CameraInfo, CategoryTable, ClockPair, CompressedImage, DropRecord, Extrinsics, FrameMetadata, Image, Imu,
        LabelInfo, LabelRecord, LogEntry, MocapFrame, MotionIntrinsics, PoseStamped, SegmentTable, TFMessage,
    };
    match topic {
        GROUND_TRUTH => Some(PoseStamped::SCHEMA_NAME),
        TF | TF_STATIC => Some(TFMessage::SCHEMA_NAME),
        COLOR_INFO | DEPTH_INFO | RIGHT_INFO | DEPTH_NATIVE_INFO => Some(CameraInfo::SCHEMA_NAME),
        COLOR | RIGHT => Some(CompressedImage::SCHEMA_NAME),
        DEPTH | DEPTH_NATIVE | COLOR_RAW => Some(Image::SCHEMA_NAME),
        IMU | GYRO | ACCEL => Some(Imu::SCHEMA_NAME),
        GYRO_INFO | ACCEL_INFO => Some(MotionIntrinsics::SCHEMA_NAME),
        COLOR_METADATA | DEPTH_NATIVE_METADATA | GYRO_METADATA | ACCEL_METADATA => Some(FrameMetadata::SCHEMA_NAME),
        EXTRINSICS => Some(Extrinsics::SCHEMA_NAME),
        DROPS => Some(DropRecord::SCHEMA_NAME),
        LABELS => Some(LabelRecord::SCHEMA_NAME),
        CLOCK => Some(ClockPair::SCHEMA_NAME),
        EVENTS => Some(LogEntry::SCHEMA_NAME),
        MOCAP => Some(MocapFrame::SCHEMA_NAME),
        _ if mocap_body_of(topic).is_some() => Some(PoseStamped::SCHEMA_NAME),
        _ => {
            let leaf = layer_of(topic).and_then(|_| topic.rsplit('/').next())?;
            Some(match leaf {
                "categories" => CategoryTable::SCHEMA_NAME,
                "label_info" => LabelInfo::SCHEMA_NAME,
                "segments" => SegmentTable::SCHEMA_NAME,
                _ => Image::SCHEMA_NAME,
            })
        }
    }
}

/// Whether a message type begins with a `std_msgs/Header`, whose stamp is then the message's; the others' is the log time.
#[must_use]
pub fn has_header(schema_name: &str) -> bool {
    crate::definition(schema_name).is_some_and(|text| text.starts_with("std_msgs/Header "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_are_found_in_their_own_topics() {
        let topics = LayerTopics::new("exact");
        for topic in [&topics.categories, &topics.label_info, &topics.class, &topics.instance, &topics.segments] {
            assert_eq!(layer_of(topic), Some("exact"));
            assert!(schema_name(topic).is_some());
        }
        assert_eq!(layer_of(COLOR), None);
        assert_eq!(layer_of("/segmentation/exact/other"), None);
        assert!(has_header(crate::msg::FrameMetadata::SCHEMA_NAME));
        assert!(!has_header(crate::msg::LogEntry::SCHEMA_NAME) && !has_header(crate::msg::TFMessage::SCHEMA_NAME));
        assert!(is_layer_name("panoptic_2") && !is_layer_name("a/b") && !is_layer_name("") && !is_layer_name("2a"));
    }

    #[test]
    fn bodies_have_topics_with_ros_names() {
        let topic = mocap_body("Quad 4-b", "1é");
        assert_eq!(topic, "/vicon/Quad_4_b/m1_");
        assert_eq!(mocap_body_of(&topic), Some(("Quad_4_b", "m1_")));
        assert_eq!(schema_name(&topic), Some("geometry_msgs/msg/PoseStamped"));
        assert_eq!(mocap_body_of("/vicon/a/b/c"), None);
        assert_eq!(mocap_body_of(MOCAP), None);
    }
}
