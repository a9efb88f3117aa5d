//! A frame as it stands in a log.

use super::MocapFrame;
use schemas::msg::{
    self, Header, MocapLatency, NOT_TOLD, Point, Pose, PoseStamped, Quaternion, TFMessage, Time, Transform,
    TransformStamped, Vector3,
};
use schemas::topics::{self, frame};
use schemas::{Stamp, StampError};
use slam_math::Se3;

/// What one frame puts into a log.
#[derive(Debug, Clone, PartialEq)]
pub struct MocapMessages {
    /// On [`topics::MOCAP`].
    pub frame: msg::MocapFrame,
    /// On [`topics::TF`]; absent if no body is seen.
    pub tf: Option<TFMessage>,
    /// Topic and pose of every body that is seen.
    pub poses: Vec<(String, PoseStamped)>,
}

/// A frame's messages with `stamp`, the frame's time on the log's timeline, in their headers. `source` is
/// [`MocapSource::describe`](super::MocapSource::describe).
///
/// # Errors
/// A stamp that a ROS time cannot hold.
pub fn messages(captured: &MocapFrame, source: &str, stamp: Stamp) -> Result<MocapMessages, StampError> {
    let header = Header { stamp: Time::try_from(stamp)?, frame_id: frame::WORLD.to_owned() };
    let (mut poses, mut transforms) = (Vec::new(), Vec::new());
    for body in &captured.bodies {
        let Some(pose) = &body.world_from_segment else { continue };
        let topic = topics::mocap_body(&body.subject, &body.segment);
        let (pose, transform) = (to_pose(pose), to_transform(pose));
        let child_frame_id = topic.trim_start_matches('/').to_owned();
        transforms.push(TransformStamped { header: header.clone(), child_frame_id, transform });
        poses.push((topic, PoseStamped { header: header.clone(), pose }));
    }
    let tf = (!transforms.is_empty()).then_some(TFMessage { transforms });
    Ok(MocapMessages { frame: to_frame(captured, source, header), tf, poses })
}

fn to_frame(captured: &MocapFrame, source: &str, header: Header) -> msg::MocapFrame {
    let told = |number: Option<f64>| number.unwrap_or(NOT_TOLD as f64);
    let bodies = captured.bodies.iter().map(|body| msg::MocapBody {
        subject: body.subject.clone(),
        segment: body.segment.clone(),
        parent: body.parent.clone(),
        occluded: body.world_from_segment.is_none(),
        suspect: body.suspect,
        pose: body.world_from_segment.as_ref().map_or(UNSEEN, to_pose),
        quality: told(body.quality),
        health: told(body.health),
        marker_error: told(body.marker_error_m),
    });
    let markers = captured.markers.iter().map(|marker| msg::MocapMarker {
        subject: marker.subject.clone(),
        name: marker.name.clone(),
        position: to_point(marker.position_m),
        radius: marker.radius_m,
        trajectory_id: marker.trajectory_id,
    });
    let latency = captured.latency.iter().map(|s| MocapLatency { name: s.name.clone(), seconds: s.seconds });
    msg::MocapFrame {
        header,
        source: source.to_owned(),
        frame_number: captured.number.and_then(|number| number.try_into().ok()).unwrap_or(NOT_TOLD),
        hardware_frame: captured.hardware_frame.map_or(NOT_TOLD, i64::from),
        rate: told(captured.rate_hz),
        arrival_monotonic_ns: captured.arrival.monotonic_ns,
        arrival_realtime_ns: captured.arrival.realtime_ns,
        source_stamp_ns: captured.source_stamp_ns.unwrap_or(NOT_TOLD),
        latency: latency.collect(),
        ping_round_trip: told(captured.ping_round_trip_s),
        discarded: captured.discarded,
        timecode: captured.timecode.into_iter().collect(),
        bodies: bodies.collect(),
        markers: markers.collect(),
    }
}

/// Nobody can take this for a pose.
const UNSEEN: Pose = Pose {
    position: Point { x: f64::NAN, y: f64::NAN, z: f64::NAN },
    orientation: Quaternion { x: f64::NAN, y: f64::NAN, z: f64::NAN, w: f64::NAN },
};

fn to_point([x, y, z]: [f64; 3]) -> Point {
    Point { x, y, z }
}

fn to_quaternion(pose: &Se3) -> Quaternion {
    let [x, y, z, w] = pose.quaternion_xyzw();
    Quaternion { x, y, z, w }
}

fn to_pose(pose: &Se3) -> Pose {
    Pose { position: to_point(pose.translation.into()), orientation: to_quaternion(pose) }
}

fn to_transform(pose: &Se3) -> Transform {
    let [x, y, z]: [f64; 3] = pose.translation.into();
    Transform { translation: Vector3 { x, y, z }, rotation: to_quaternion(pose) }
}
