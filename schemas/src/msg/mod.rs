//! Message types, each a plain struct with the fields of its ROS 2 interface in order.

mod camera_info;
mod geometry;
mod image;
mod mocap;
mod recording;
mod segmentation;
mod standard;

pub use camera_info::{CameraInfo, RegionOfInterest};
pub use geometry::{Imu, Point, Pose, PoseStamped, Quaternion, TFMessage, Transform, TransformStamped, Vector3};
pub use image::{CompressedImage, Image, ImageError, encoding, format};
pub use mocap::{MocapBody, MocapFrame, MocapLatency, MocapMarker, MocapTimecode, NOT_TOLD};
pub use recording::{
    ClockPair, DropRecord, Extrinsics, FrameMetadata, LabelRecord, LogEntry, MotionIntrinsics, device_clock, domain,
    level,
};
pub use segmentation::{Category, CategoryTable, LabelInfo, SCORE_UNKNOWN, Segment, SegmentTable, VisionClass};
pub use standard::{Header, Time};
