//! Poses, transforms and inertial measurements. Metres, radians, unit quaternions (x, y, z, w).

use super::Header;
use crate::message::cdr_struct;

cdr_struct! {
    /// `geometry_msgs/Vector3`.
    #[derive(Copy, Default)]
    pub struct Vector3: "geometry_msgs/msg/Vector3" {
        /// Along x.
        pub x: f64,
        /// Along y.
        pub y: f64,
        /// Along z.
        pub z: f64,
    }
}

cdr_struct! {
    /// `geometry_msgs/Point`, metres.
    #[derive(Copy, Default)]
    pub struct Point: "geometry_msgs/msg/Point" {
        /// Along x.
        pub x: f64,
        /// Along y.
        pub y: f64,
        /// Along z.
        pub z: f64,
    }
}

cdr_struct! {
    /// `geometry_msgs/Quaternion`. Values are the source's own digits: they may be off unit length by their rounding.
    #[derive(Copy)]
    pub struct Quaternion: "geometry_msgs/msg/Quaternion" {
        /// First imaginary part.
        pub x: f64,
        /// Second imaginary part.
        pub y: f64,
        /// Third imaginary part.
        pub z: f64,
        /// Real part.
        pub w: f64,
    }
}

impl Default for Quaternion {
    fn default() -> Self {
        Self { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }
    }
}

cdr_struct! {
    /// `geometry_msgs/Pose`: where a frame's origin and axes are, in the frame of the header.
    #[derive(Copy, Default)]
    pub struct Pose: "geometry_msgs/msg/Pose" {
        /// Origin.
        pub position: Point,
        /// Axes.
        pub orientation: Quaternion,
    }
}

cdr_struct! {
    /// `geometry_msgs/PoseStamped`: `header_frame_from_body`.
    #[derive(Default)]
    pub struct PoseStamped: "geometry_msgs/msg/PoseStamped" {
        /// Stamp and reference frame.
        pub header: Header,
        /// The body's pose in it.
        pub pose: Pose,
    }
}

cdr_struct! {
    /// `geometry_msgs/Transform`.
    #[derive(Copy, Default)]
    pub struct Transform: "geometry_msgs/msg/Transform" {
        /// Metres.
        pub translation: Vector3,
        /// Unit quaternion.
        pub rotation: Quaternion,
    }
}

cdr_struct! {
    /// `geometry_msgs/TransformStamped`: `header_frame_from_child`.
    #[derive(Default)]
    pub struct TransformStamped: "geometry_msgs/msg/TransformStamped" {
        /// Stamp and parent frame.
        pub header: Header,
        /// Child frame.
        pub child_frame_id: String,
        /// The child's pose in the parent.
        pub transform: Transform,
    }
}

cdr_struct! {
    /// `tf2_msgs/TFMessage`: edges of the frame tree.
    #[derive(Default)]
    pub struct TFMessage: "tf2_msgs/msg/TFMessage" {
        /// Any number of edges.
        pub transforms: Vec<TransformStamped>,
    }
}

cdr_struct! {
    /// `sensor_msgs/Imu`.
    #[derive(Default)]
    pub struct Imu: "sensor_msgs/msg/Imu" {
        /// Stamp and sensor frame.
        pub header: Header,
        /// Orientation, if the sensor estimates one.
        pub orientation: Quaternion,
        /// Rows of 3; first element -1 = no orientation.
        pub orientation_covariance: [f64; 9],
        /// rad/s.
        pub angular_velocity: Vector3,
        /// Rows of 3, (rad/s)^2; all zero = unknown.
        pub angular_velocity_covariance: [f64; 9],
        /// m/s^2, gravity included.
        pub linear_acceleration: Vector3,
        /// Rows of 3, (m/s^2)^2; all zero = unknown.
        pub linear_acceleration_covariance: [f64; 9],
    }
}
