//! Ground truth of a recording: the camera's pose at each picture, from the motion capture system.
//!
//! The stamp of a picture is taken to mocap time by the sync record, the marker body's pose is interpolated there if it
//! was seen without a gap, and the hand-eye transform leads to the camera. A picture in an occlusion has no truth.

use schemas::Stamp;
use schemas::sync::{ClockFit, PoseSample, Signals, SyncRecord};
use slam_math::{Se3, Track};

use crate::eval::{StampedPose, Trajectory};

/// Ground truth and where it comes from, in words.
pub(crate) struct MocapTruth {
    pub trajectory: Trajectory,
    pub origin: String,
}

/// The truth at the pictures' stamps; `None` without mocap, or with several bodies and no word about which carries the
/// camera.
pub(crate) fn mocap_truth(signals: &Signals, record: Option<&SyncRecord>, pictures: &[Stamp]) -> Option<MocapTruth> {
    let synced = record.and_then(SyncRecord::camera_body);
    let name = match synced {
        Some(body) => &body.body,
        None if signals.bodies.len() == 1 => signals.bodies.keys().next()?,
        None => return None,
    };
    let offset = synced.and_then(|body| body.offset.found());
    let hand_eye = synced.and_then(|body| body.hand_eye.found());
    let marker_from_camera =
        hand_eye.map_or_else(Se3::identity, |found| Se3::from_quaternion(found.translation_m, found.rotation_xyzw));
    let clock = record.and_then(|record| record.clocks.get("mocap")?.found());
    let marker = track(signals.bodies.get(name)?, clock);
    let pose = |stamp: &Stamp| {
        let mocap_ns = offset.map_or(stamp.0, |offset| offset.mocap_ns(stamp.0));
        Some(StampedPose { stamp: *stamp, world_from_camera: marker.at(mocap_ns)? * marker_from_camera })
    };
    let poses = pictures.iter().filter_map(pose).collect();
    let clock = match offset {
        Some(offset) => {
            format!("clock offset {:.3} ms, drift {:.2} ppm", offset.offset_ns as f64 * 1e-6, offset.drift_ppm)
        }
        None => "clock offset not known (`pslam sync` finds it)".to_owned(),
    };
    let frame = match hand_eye {
        Some(found) => format!("hand-eye transform to {:.1} mm", found.translation_sigma_m * 1e3),
        None => "marker body instead of camera (`pslam sync` finds the transform)".to_owned(),
    };
    Some(MocapTruth { trajectory: Trajectory { poses }, origin: format!("mocap body {name}, {clock}, {frame}") })
}

fn track(samples: &[PoseSample], clock: Option<&ClockFit>) -> Track {
    let pose = |sample: &PoseSample| slam_math::StampedPose {
        stamp_ns: sample.moment_ns(clock),
        world_from_body: Se3::from_quaternion(sample.translation_m, sample.rotation_xyzw),
    };
    Track::new(samples.iter().map(pose).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use schemas::sync::{BodySync, Estimate, HandEye, Offset};
    use std::collections::BTreeMap;

    /// A body that moves along x at 1 m/s, seen at 100 Hz but for half a second.
    fn signals() -> Signals {
        let sample = |i: i64| PoseSample {
            stamp_ns: i * 10_000_000,
            system_ns: None,
            translation_m: [i as f64 * 0.01, 0.0, 0.0],
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
        };
        let samples = (0..200).filter(|i| !(100..150).contains(i)).map(sample).collect();
        Signals { bodies: BTreeMap::from([("quad/quad".to_owned(), samples)]), ..Signals::default() }
    }

    fn record() -> SyncRecord {
        let offset = Offset {
            reference_ns: 0,
            offset_ns: 37_000_000,
            offset_sigma_ns: 1e4,
            drift_ppm: 0.0,
            drift_sigma_ppm: None,
            correlation: 1.0,
            rival_correlation: 0.0,
            residual_rad_s: 0.0,
            motion_rad_s: 1.0,
            marker_from_sensor: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            bias_rad_s: [0.0; 3],
            samples: 1000,
            windows: Vec::new(),
        };
        let hand_eye = HandEye {
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
            translation_m: [0.0, 0.5, 0.0],
            rotation_sigma_deg: 0.1,
            translation_sigma_m: 0.001,
            rotation_residual_deg: 0.1,
            translation_residual_m: 0.001,
            condition: 1.2,
            motions: 100,
        };
        let body = BodySync {
            body: "quad/quad".to_owned(),
            windows: Vec::new(),
            camera_side: "gyroscope".to_owned(),
            offset: Estimate::Found(offset),
            hand_eye: Estimate::Found(hand_eye),
        };
        SyncRecord {
            program: String::new(),
            method: String::new(),
            clocks: BTreeMap::new(),
            bodies: vec![body],
            camera_body: Some("quad/quad".to_owned()),
        }
    }

    #[test]
    fn the_camera_at_its_pictures_and_nowhere_else() {
        // 30 Hz; the third picture is inside the occlusion, the last one behind the end.
        let pictures = [100_000_000, 533_333_333, 1_300_000_000, 1_700_000_000, 2_500_000_000].map(Stamp);
        let truth = mocap_truth(&signals(), Some(&record()), &pictures).unwrap();
        let stamps: Vec<i64> = truth.trajectory.poses.iter().map(|pose| pose.stamp.0).collect();
        assert_eq!(stamps, [100_000_000, 533_333_333, 1_700_000_000]);
        let centre = truth.trajectory.poses[1].world_from_camera.translation;
        // 37 ms before the picture's stamp, half a metre beside the marker.
        assert!((centre.x - 0.496_333).abs() < 1e-6 && centre.y == 0.5, "{centre}");
        assert!(truth.origin.contains("37.000 ms"), "{}", truth.origin);
    }

    #[test]
    fn what_is_not_known_is_said() {
        let raw = mocap_truth(&signals(), None, &[Stamp(100_000_000)]).unwrap();
        assert_eq!(raw.trajectory.poses[0].world_from_camera.translation.x, 0.1);
        assert!(raw.origin.contains("not known") && raw.origin.contains("instead of camera"), "{}", raw.origin);
        let mut two = signals();
        two.bodies.insert("box/box".to_owned(), two.bodies["quad/quad"].clone());
        assert!(mocap_truth(&two, None, &[Stamp(0)]).is_none(), "which one carries the camera?");
        assert!(mocap_truth(&two, Some(&record()), &[Stamp(100_000_000)]).is_some());
        assert!(mocap_truth(&Signals::default(), None, &[Stamp(0)]).is_none());
    }
}
