//! The objects that a simulated server says about a frame.

use super::object::{self as o, id};
use crate::mocap::convert::{Axis, MM_PER_M};
use crate::mocap::sim::{Fault, Script, SimBody, SimFrame};
use crate::mocap::wire::Wire;
use nalgebra::Vector3;
use slam_math::Se3;
use std::collections::BTreeSet;

/// Markers in the body, metres; no two distances are the same, as a real rigid body should have it.
const MARKERS_M: [[f64; 3]; 4] = [[0.05, 0.0, 0.02], [-0.04, 0.03, 0.0], [-0.03, -0.05, 0.01], [0.0, 0.02, 0.06]];
const MARKER_RADIUS_MM: f64 = 7.0;
/// A reflection that nobody removed.
const STRAY_MARKER_M: [f64; 3] = [1.0, 2.0, 0.25];
/// A rigid body has one segment.
const SEGMENT: u32 = 1;
/// What the cameras had counted before the stream's first frame.
pub const HARDWARE_FRAMES_BEFORE: u32 = 1000;
/// What every subject's quality is said to be.
pub const QUALITY: f64 = 0.95;
/// What every subject's health is said to be.
pub const HEALTH: f64 = 0.9;
/// What every subject's marker error is said to be, millimetres.
pub const MARKER_ERROR_MM: f64 = 0.4;
/// Frames a second of the timecode (PAL).
const TIMECODE_HZ: i64 = 25;

/// All that the simulated server offers.
pub fn offered() -> BTreeSet<u32> {
    let messages = [id::PING, id::CONTENTS, id::FILTER];
    o::STATIC.into_iter().chain(o::DYNAMIC).chain(messages).collect()
}

/// The blocks of one object type, a body each; none if the type has nothing to say or is not known.
pub fn blocks(object: u32, script: &Script, frame: &SimFrame) -> Vec<Vec<u8>> {
    match object {
        id::STREAM_INFO => one(&o::StreamInfo { frame_period_ticks: (o::TICKS_PER_SECOND / script.rate_hz) as i64 }),
        id::APPLICATION_INFO => one(&o::ApplicationInfo { axis_orientation: u8::from(script.has(Fault::YUp)) }),
        id::FRAME_INFO => one(&o::FrameInfo { frame_id: frame.index }),
        id::HARDWARE_FRAME_INFO => one(&o::HardwareFrameInfo { frame_id: frame.index + HARDWARE_FRAMES_BEFORE }),
        id::FRAME_RATE_INFO => one(&o::FrameRateInfo { rates_hz: [("System".to_owned(), script.rate_hz)].into() }),
        id::LATENCY_INFO => one(&latency(script)),
        id::TIMECODE => one(&timecode(frame.system_ns)),
        id::UNLABELED_RECONS => one(&o::UnlabeledRecons { recons: vec![recon(axis(script), STRAY_MARKER_M, 1)] }),
        id::LABELED_RECONS => one(&labeled(script, frame)),
        _ => frame.bodies.iter().flat_map(|body| of_subject(object, script, body)).collect(),
    }
}

/// Id of a subject of the script.
pub fn subject_id(subject: usize) -> u32 {
    u32::try_from(subject).map_or(u32::MAX, |subject| subject + 1)
}

fn one(object: &impl Wire) -> Vec<Vec<u8>> {
    let mut body = Vec::new();
    object.write(&mut body);
    vec![body]
}

fn axis(script: &Script) -> Axis {
    if script.has(Fault::YUp) { Axis::YUp } else { Axis::ZUp }
}

fn of_subject(object: u32, script: &Script, body: &SimBody) -> Vec<Vec<u8>> {
    let subject = subject_id(body.subject);
    let name = &script.subjects[body.subject].name;
    let seen = body.world_from_marker.map(|pose| axis(script).pose_from_z_up(&pose));
    match object {
        id::SUBJECT_INFO => one(&subject_info(subject, name)),
        id::SUBJECT_TOPOLOGY => one(&o::Segments { subject, poses: vec![segment_pose(&Se3::identity())] }),
        id::SUBJECT_SCALE => one(&o::SubjectScale { subject, scales: Vec::new() }),
        id::SUBJECT_HEALTH => one(&o::SubjectHealth { subject, marker_error_mm: MARKER_ERROR_MM, health: HEALTH }),
        id::OBJECT_QUALITY => one(&o::ObjectQuality { subject, quality: QUALITY }),
        // The one segment is the root: its parent is the world.
        id::GLOBAL_SEGMENTS | id::LOCAL_SEGMENTS => {
            one(&o::Segments { subject, poses: seen.iter().map(segment_pose).collect() })
        }
        id::LIGHTWEIGHT_SEGMENTS => {
            one(&o::LightweightSegments { subject, poses: seen.iter().map(lightweight).collect() })
        }
        _ => Vec::new(),
    }
}

fn subject_info(subject: u32, name: &str) -> o::SubjectInfo {
    let segment = o::SegmentInfo { parent: 0, segment: SEGMENT, bounds: [0.0; 6], name: name.to_owned() };
    let ids = 1..=MARKERS_M.len() as u32;
    o::SubjectInfo {
        subject,
        name: name.to_owned(),
        segments: vec![segment],
        markers: ids.clone().map(|marker| o::MarkerInfo { marker, name: format!("{name}{marker}") }).collect(),
        attachments: ids.map(|marker| o::Attachment { marker, segment: SEGMENT }).collect(),
    }
}

fn segment_pose(pose: &Se3) -> o::SegmentPose {
    o::SegmentPose {
        segment: SEGMENT,
        translation_mm: (pose.translation * MM_PER_M).into(),
        rotation: std::array::from_fn(|i| pose.rotation[(i / 3, i % 3)]),
    }
}

fn lightweight(pose: &Se3) -> o::LightweightPose {
    let turn = Se3 { rotation: pose.rotation, ..Se3::identity() }.log();
    o::LightweightPose {
        segment: SEGMENT,
        translation_mm: std::array::from_fn(|i| (pose.translation[i] * MM_PER_M) as f32),
        rotation_vector: std::array::from_fn(|i| turn[i + 3] as f32),
    }
}

fn recon(axis: Axis, position_m: [f64; 3], trajectory: u32) -> o::UnlabeledRecon {
    let position_mm = axis.point_from_z_up(position_m).map(|m| m * MM_PER_M);
    o::UnlabeledRecon { radius_mm: MARKER_RADIUS_MM, position_mm, covariance: [0.0; 9], trajectory }
}

fn labeled(script: &Script, frame: &SimFrame) -> o::LabeledRecons {
    let mut recons = Vec::new();
    for body in &frame.bodies {
        let Some(pose) = body.world_from_marker else { continue };
        let subject = subject_id(body.subject);
        for (marker, position_m) in (1..).zip(MARKERS_M) {
            let position_m = pose.transform(&Vector3::from(position_m)).into();
            recons.push(o::LabeledRecon {
                subject,
                marker,
                recon: recon(axis(script), position_m, 10 * subject + marker),
            });
        }
    }
    o::LabeledRecons { recons }
}

fn latency(script: &Script) -> o::LatencyInfo {
    // In two unequal parts, so that a reader has something to add.
    let share = |name: &str, share: f64| o::Latency { name: name.to_owned(), seconds: script.latency_s * share };
    o::LatencyInfo { samples: vec![share("Camera Capture", 0.75), share("Data Processing", 0.25)] }
}

fn timecode(system_ns: i64) -> o::Timecode {
    let frames = system_ns * TIMECODE_HZ / 1_000_000_000;
    let seconds = frames / TIMECODE_HZ;
    let parts = [seconds / 3600 % 24, seconds / 60 % 60, seconds % 60, frames % TIMECODE_HZ];
    let hmsf = parts.map(|part| u8::try_from(part).unwrap_or(0));
    o::Timecode { hmsf, subframes: 0, subframes_per_frame: 1, standard: 0, user_bits: 0, field_flag: 0 }
}
