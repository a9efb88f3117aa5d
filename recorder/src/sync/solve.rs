//! Everything that a log's signals tell, as one record.

use super::clock::drift_sigma;
use super::{
    AngularVelocity, DriftPrior, HandEyeOptions, OffsetOptions, SyncError, estimate_offset, fit_clock, from_gyro,
    from_poses, hand_eye,
};
use schemas::sync::{BodySync, ClockFit, Estimate, PoseSample, Signals, SyncRecord};
use slam_math::{Se3, StampedPose, Track};
use std::collections::BTreeMap;

/// How to solve.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SyncOptions {
    /// Clock offset.
    pub offset: OffsetOptions,
    /// Hand-eye transform.
    pub hand_eye: HandEyeOptions,
    /// The body (`subject/segment`, or the subject alone) that carries the camera; default: the one that agrees best.
    pub body: Option<String>,
}

/// The methods, as a log tells them.
const METHOD: &str = "device clocks: line through the earliest arrival of each second (Theil-Sen); \
    mocap frames: at their number times the period, put on the host's clock by the same line; \
    offset: correlation of angular speeds, then robust least squares over rotation, bias, offset and drift, \
    the drift with what the device clocks tell of it; \
    while recording, of more than five minutes every second, fourth, ... piece of 20 s; \
    hand-eye: AX = XB on motions of 0.1 to 3.2 s, each length by its residuals, rotation by singular values, translation \
    by robust least squares";

/// Solves for clocks, offset and hand-eye transform. The gyroscope tells the offset if there is one, else the camera
/// poses do; the hand-eye transform needs camera poses.
#[must_use]
pub fn solve(signals: &Signals, options: &SyncOptions) -> SyncRecord {
    let clocks: BTreeMap<String, Estimate<ClockFit>> =
        signals.arrivals.iter().map(|(stream, pairs)| (stream.clone(), estimate(fit_clock(pairs)))).collect();
    let mocap_clock = clocks.get("mocap").and_then(Estimate::found);
    let camera = track(&signals.camera, None);
    let (camera_side, stream, turning) = match signals.gyro.len() {
        0 => ("camera poses", "color", from_poses(&camera)),
        _ => ("gyroscope", "gyro", from_gyro(&signals.gyro)),
    };
    let mut options = options.clone();
    options.offset.drift = drift_told(clocks.get(stream).and_then(Estimate::found), mocap_clock, &turning);
    let options = &options;
    let wanted = |name: &&String| options.body.as_ref().is_none_or(|body| is_of(name, body));
    let names = signals.bodies.keys().filter(wanted);
    let solved = |name: &String| {
        let marker = track(&signals.bodies[name], mocap_clock);
        let mut body = solve_body(name, &marker, camera_side, &turning, &camera, options);
        if let Some(seen) = signals.seen.get(name) {
            let moments =
                |(from, to): &(PoseSample, PoseSample)| [from, to].map(|end| end.moment_ns(mocap_clock)).into();
            body.windows = seen.iter().map(moments).collect();
        }
        body
    };
    let bodies = names.map(solved).collect::<Vec<_>>();
    let agreement = |body: &BodySync| body.offset.found().map(|offset| offset.correlation);
    // The first of equals, so that the order of names decides.
    let best =
        bodies.iter().filter_map(|b| Some((agreement(b)?, b))).fold(None, |best: Option<(f64, _)>, one| match best {
            Some(best) if best.0 >= one.0 => Some(best),
            _ => Some(one),
        });
    let camera_body = best.map(|(_, body)| body.body.clone());
    let program = concat!("pslam ", env!("CARGO_PKG_VERSION")).to_owned();
    SyncRecord { program, method: METHOD.to_owned(), clocks, bodies, camera_body }
}

/// Whether a body (`subject/segment`) is the one that a user names, whole or by its subject.
#[must_use]
pub fn is_of(body: &str, named: &str) -> bool {
    body == named || body.split_once('/').is_some_and(|(subject, _)| subject == named)
}

/// The drift that the arrivals tell: the mocap's moments are on the host's clock already, the camera's stamps are its
/// device's time plus a constant. Not where that clock began anew, for then there are several constants.
fn drift_told(camera: Option<&ClockFit>, mocap: Option<&ClockFit>, turning: &AngularVelocity) -> Option<DriftPrior> {
    let (camera, mocap) = camera.zip(mocap)?;
    let span_s = turning.end_s() - turning.time_s.first().copied().unwrap_or(0.0);
    let [a, b] = [camera, mocap].map(drift_sigma);
    (camera.span_s >= 0.95 * span_s)
        .then(|| DriftPrior { drift: -camera.drift_ppm * 1e-6, sigma: (a * a + b * b).sqrt() })
}

fn solve_body(
    name: &str,
    marker: &Track,
    camera_side: &str,
    turning: &AngularVelocity,
    camera: &Track,
    options: &SyncOptions,
) -> BodySync {
    let offset = if turning.time_s.is_empty() {
        Err(SyncError::TooFew { what: "samples of a gyroscope, or camera poses", found: 0, needed: 1 })
    } else {
        estimate_offset(turning, &from_poses(marker), &options.offset)
    };
    let hand_eye = match &offset {
        Ok(offset) if !camera.poses().is_empty() => estimate(hand_eye(camera, marker, offset, &options.hand_eye)),
        Ok(_) => Estimate::Missing("it needs camera poses: `pslam sync LOG` estimates them".to_owned()),
        Err(_) => Estimate::Missing("it needs the clock offset".to_owned()),
    };
    BodySync {
        body: name.to_owned(),
        windows: marker.windows(),
        camera_side: camera_side.to_owned(),
        offset: estimate(offset),
        hand_eye,
    }
}

fn estimate<T>(result: Result<T, SyncError>) -> Estimate<T> {
    result.map_or_else(|error| Estimate::Missing(error.to_string()), Estimate::Found)
}

/// Samples so far apart have a gap between them, as their own usual interval tells; nanoseconds.
pub(super) fn usual_gap_ns<'a>(bodies: impl Iterator<Item = &'a Vec<PoseSample>>) -> i64 {
    let longest = bodies.max_by_key(|samples| samples.len()).map_or(&[][..], Vec::as_slice);
    let interval_s = track(longest, None).interval_s();
    // Of a body that is not known yet nothing can be told: that of a system of 50 Hz.
    if interval_s > 0.0 { (2.5e9 * interval_s) as i64 } else { 50_000_000 }
}

fn track(samples: &[PoseSample], clock: Option<&ClockFit>) -> Track {
    let pose = |sample: &PoseSample| StampedPose {
        stamp_ns: sample.moment_ns(clock),
        world_from_body: Se3::from_quaternion(sample.translation_m, sample.rotation_xyzw),
    };
    Track::new(samples.iter().map(pose).collect())
}
