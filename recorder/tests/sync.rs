//! Clock offset, drift and hand-eye transform on simulated recordings with known truth.
//!
//! Noise: mocap 100 Hz with 0.05 degrees and 0.3 mm, gyroscope 200 Hz with 0.004 rad/s and a bias, camera poses 10 Hz with
//! 0.3 degrees and 4 mm; offset 37.3 ms, drift 20 ppm. The limits are those that a user is promised.

use nalgebra::{Vector3, Vector6};
use recorder::sync::{
    HandEyeOptions, OffsetOptions, SyncError, SyncOptions, estimate_offset, from_gyro, from_poses, hand_eye, solve,
};
use schemas::sync::{HandEye, Offset, PoseSample, Signals};
use slam_math::float::sin;
use slam_math::{Rng, Se3, StampedPose, Track};
use std::f64::consts::TAU;

const OFFSET_NS: i64 = 37_300_000;
const DRIFT: f64 = 20e-6;
/// Both clocks count from a large number, as real ones do.
const START_NS: i64 = 1_700_000_000_000_000_000;

/// How the marker body moves: amplitudes in radians and metres.
#[derive(Clone, Copy)]
struct Motion {
    turn: [f64; 3],
    sway_m: f64,
    seed: u64,
}

const HAND_HELD: Motion = Motion { turn: [0.35, 0.3, 0.5], sway_m: 0.4, seed: 1 };
const WALKING: Motion = Motion { turn: [0.04, 0.05, 0.15], sway_m: 0.6, seed: 2 };
const YAW_ONLY: Motion = Motion { turn: [0.0, 0.0, 0.6], sway_m: 0.6, seed: 3 };
const STILL: Motion = Motion { turn: [0.0; 3], sway_m: 0.0, seed: 4 };

impl Motion {
    /// `world_from_marker` at a mocap time in seconds.
    fn pose(&self, t: f64) -> Se3 {
        let wave = |axis: u32| {
            let mut rng = Rng::at(self.seed, axis, 0, 0);
            (0..4).fold(0.0, |sum, _| {
                let (hz, phase) = (0.15 + 0.8 * rng.uniform(), TAU * rng.uniform());
                sum + 0.5 * sin(TAU * hz * t + phase)
            })
        };
        let [roll, pitch, yaw] = [0, 1, 2].map(|axis| wave(axis) * self.turn[axis as usize]);
        let about = |axis: usize, angle: f64| {
            let mut twist = Vector6::zeros();
            twist[3 + axis] = angle;
            Se3::exp(&twist)
        };
        let mut pose = about(2, yaw) * about(1, pitch) * about(0, roll);
        pose.translation = Vector3::new(wave(3), wave(4), wave(5)) * self.sway_m;
        pose
    }

    /// Angular velocity in the marker's frame.
    fn rate(&self, t: f64) -> Vector3<f64> {
        let step = 1e-4;
        let turn = self.pose(t - step).inverse() * self.pose(t + step);
        turn.log().fixed_rows::<3>(3) / (2.0 * step)
    }
}

fn marker_from_camera() -> Se3 {
    Se3::from_quaternion([0.06, -0.03, 0.11], [0.5, -0.5, 0.5, -0.5])
        * Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.05, -0.1, 0.07))
}

fn noisy(pose: Se3, rng: &mut Rng, degrees: f64, metres: f64) -> Se3 {
    let turn = degrees.to_radians();
    let mut normal = || rng.normal();
    let twist = Vector6::new(0.0, 0.0, 0.0, normal() * turn, normal() * turn, normal() * turn);
    let shift = Vector3::new(normal(), normal(), normal()) * metres;
    Se3 { translation: pose.translation + shift, ..pose * Se3::exp(&twist) }
}

struct Recording {
    gyro: Vec<(i64, [f64; 3])>,
    mocap: Vec<StampedPose>,
    camera: Vec<StampedPose>,
}

/// Camera clock at a mocap time.
fn camera_ns(mocap_s: f64) -> i64 {
    drifted_ns(mocap_s, DRIFT)
}

fn drifted_ns(mocap_s: f64, drift: f64) -> i64 {
    START_NS + (mocap_s * 1e9) as i64 + OFFSET_NS + (mocap_s * drift * 1e9) as i64
}

fn record(motion: Motion, seconds: f64, seed: u64) -> Recording {
    record_with(motion, seconds, seed, DRIFT)
}

fn record_with(motion: Motion, seconds: f64, seed: u64, drift: f64) -> Recording {
    let camera_ns = |mocap_s: f64| drifted_ns(mocap_s, drift);
    let mut rng = Rng::at(seed, 0, 0, 0);
    let every = |hz: f64| (0..(seconds * hz) as usize).map(move |i| i as f64 / hz);
    let camera_from_marker = marker_from_camera().inverse();
    let gyro = every(200.0).map(|t| {
        let rate = camera_from_marker.rotation * motion.rate(t);
        let noise = Vector3::from_fn(|_, _| rng.normal()) * 0.004;
        (camera_ns(t), (rate + noise + Vector3::new(0.01, -0.02, 0.005)).into())
    });
    let gyro = gyro.collect();
    let mut rng = Rng::at(seed, 1, 0, 0);
    let mocap = every(100.0).map(|t| {
        let world_from_body = noisy(motion.pose(t), &mut rng, 0.05, 0.0003);
        StampedPose { stamp_ns: START_NS + (t * 1e9) as i64, world_from_body }
    });
    let mocap = mocap.collect();
    let mut rng = Rng::at(seed, 2, 0, 0);
    // The camera's world is another one.
    let other = Se3::exp(&Vector6::new(1.0, 2.0, -0.5, 0.3, 1.2, -0.4));
    let camera = every(10.0).map(|t| {
        let world_from_body = noisy(other * motion.pose(t) * marker_from_camera(), &mut rng, 0.3, 0.004);
        StampedPose { stamp_ns: camera_ns(t), world_from_body }
    });
    Recording { gyro, mocap, camera: camera.collect() }
}

fn offset_of(recording: &Recording) -> Result<Offset, SyncError> {
    let mocap = from_poses(&Track::new(recording.mocap.clone()));
    estimate_offset(&from_gyro(&recording.gyro), &mocap, &OffsetOptions::default())
}

/// Error of the offset at its own reference time, seconds.
fn offset_error_s(offset: &Offset) -> f64 {
    let mocap_s = (offset.reference_ns - START_NS) as f64 * 1e-9;
    (camera_ns(mocap_s) - offset.camera_ns(offset.reference_ns)) as f64 * 1e-9
}

fn hand_eye_of(recording: &Recording, offset: &Offset) -> Result<HandEye, SyncError> {
    let (camera, marker) = (Track::new(recording.camera.clone()), Track::new(recording.mocap.clone()));
    hand_eye(&camera, &marker, offset, &HandEyeOptions::default())
}

/// Degrees and metres.
fn hand_eye_error(found: &HandEye) -> (f64, f64) {
    let found = Se3::from_quaternion(found.translation_m, found.rotation_xyzw);
    let turn = found.inverse() * marker_from_camera();
    (turn.angle().to_degrees(), (found.translation - marker_from_camera().translation).norm())
}

#[test]
fn a_minute_of_hand_held_motion_gives_everything() {
    for seed in 0..3 {
        let recording = record(Motion { seed: 10 + seed, ..HAND_HELD }, 60.0, seed);
        let offset = offset_of(&recording).unwrap();
        let error_s = offset_error_s(&offset);
        eprintln!("seed {seed}: offset {:.3} ms wrong, drift {:.2} ppm", error_s * 1e3, offset.drift_ppm);
        assert!(error_s.abs() < 1e-3 && error_s.abs() < 5e-9 * offset.offset_sigma_ns + 1e-4, "{offset:?}");
        assert!((offset.drift_ppm - 20.0).abs() < 2.0, "{offset:?}");
        assert!((offset.bias_rad_s[1] + 0.02).abs() < 2e-3, "{offset:?}");
        // One line is enough, so no window leaves it.
        assert_eq!(offset.windows.len(), 3);
        assert!(offset.windows.iter().all(|w| w.deviation_ns.abs() < 1e6), "{:?}", offset.windows);
        let found = hand_eye_of(&recording, &offset).unwrap();
        let (degrees, metres) = hand_eye_error(&found);
        eprintln!("seed {seed}: hand-eye {degrees:.3} deg, {:.2} mm wrong; {found:?}", metres * 1e3);
        assert!(degrees < 0.2 && metres < 0.003, "{degrees} deg, {metres} m");
        assert!(found.condition < 3.0 && found.translation_sigma_m > metres / 4.0, "{found:?}");
    }
}

/// As far apart as two clocks of 100 ppm are after two hours: 720 ms, so that no one lag fits the whole.
#[test]
fn a_long_recording_is_followed_from_where_it_shows() {
    let drift = 4e-4;
    let recording = record_with(HAND_HELD, 1800.0, 12, drift);
    let offset = offset_of(&recording).unwrap();
    let mocap_s = (offset.reference_ns - START_NS) as f64 * 1e-9;
    let error_s = (drifted_ns(mocap_s, drift) - offset.camera_ns(offset.reference_ns)) as f64 * 1e-9;
    eprintln!("half an hour: offset {:.4} ms wrong, drift {:.3} ppm", error_s * 1e3, offset.drift_ppm);
    assert!(error_s.abs() < 1e-4 && (offset.drift_ppm - 400.0).abs() < 0.1, "{offset:?}");
    assert_eq!(offset.windows.len(), 90);
    assert!(offset.windows.iter().all(|w| w.deviation_ns.abs() < 1e6), "{:?}", offset.windows);
}

/// Arrivals with a jitter of 0.3 ms and stalls of 20 ms: with them the drift is known far better than by turning.
#[test]
fn arrivals_tell_the_drift() {
    for seed in 0..3 {
        let recording = record(Motion { seed: 10 + seed, ..HAND_HELD }, 60.0, seed);
        let mut rng = Rng::at(seed, 7, 0, 0);
        let mut late_ns = || {
            let jitter = 3e5 * rng.uniform();
            2_000_000 + jitter as i64 + if rng.uniform() < 0.02 { 20_000_000 } else { 0 }
        };
        let mut signals = Signals::default();
        for (i, (stamp_ns, _)) in recording.gyro.iter().enumerate() {
            let arrival_ns = START_NS + i as i64 * 5_000_000 + late_ns();
            signals.arrivals.entry("gyro".to_owned()).or_default().push(*stamp_ns, arrival_ns);
        }
        let sample = |pose: &StampedPose| {
            let system_ns = pose.stamp_ns - START_NS;
            let (stamp_ns, world) = (pose.stamp_ns + late_ns(), &pose.world_from_body);
            signals.arrivals.entry("mocap".to_owned()).or_default().push(system_ns, stamp_ns);
            let (translation_m, rotation_xyzw) = (world.translation.into(), world.quaternion_xyzw());
            PoseSample { stamp_ns, system_ns: Some(system_ns), translation_m, rotation_xyzw }
        };
        let samples = recording.mocap.iter().map(sample).collect();
        signals.bodies.insert("quad/quad".to_owned(), samples);
        signals.gyro = recording.gyro;
        let record = solve(&signals, &SyncOptions::default());
        let offset = record.camera_body().unwrap().offset.found().unwrap();
        eprintln!("seed {seed}: drift {:.2} +- {:.2} ppm", offset.drift_ppm, offset.drift_sigma_ppm.unwrap());
        assert!((offset.drift_ppm - 20.0).abs() < 0.5 && offset.drift_sigma_ppm.unwrap() < 1.5, "{offset:?}");
        // The mocap's frames are placed behind their shortest transport of 2 ms.
        let mocap_s = (offset.reference_ns - START_NS) as f64 * 1e-9 - 0.002;
        let error_ns = camera_ns(mocap_s) - offset.camera_ns(offset.reference_ns);
        assert!(error_ns.abs() < 200_000, "{error_ns} ns");
    }
}

#[test]
fn walking_is_enough_for_the_clocks() {
    let recording = record(WALKING, 60.0, 5);
    let offset = offset_of(&recording).unwrap();
    eprintln!("walking: offset {:.3} ms wrong, drift {:.2} ppm", offset_error_s(&offset) * 1e3, offset.drift_ppm);
    assert!(offset_error_s(&offset).abs() < 1e-3, "{offset:?}");
}

#[test]
fn an_occlusion_is_no_motion() {
    let mut recording = record(HAND_HELD, 60.0, 6);
    recording.mocap.retain(|pose| {
        let t = (pose.stamp_ns - START_NS) as f64 * 1e-9;
        !(10.0..14.0).contains(&t) && !(30.0..30.4).contains(&t)
    });
    let offset = offset_of(&recording).unwrap();
    assert!(offset_error_s(&offset).abs() < 1e-3, "{offset:?}");
    let (degrees, metres) = hand_eye_error(&hand_eye_of(&recording, &offset).unwrap());
    assert!(degrees < 0.2 && metres < 0.004, "{degrees} deg, {metres} m");
}

/// Eight seconds, half of them hidden, and an offset that is looked for over 20 s either way: little in common, but all there.
#[test]
fn a_short_recording_is_found_in_a_wide_search() {
    let mut recording = record(HAND_HELD, 8.0, 13);
    recording.mocap.retain(|pose| (pose.stamp_ns - START_NS) % 1_000_000_000 < 520_000_000);
    recording.gyro.iter_mut().for_each(|(stamp_ns, _)| *stamp_ns += 3_000_000_000);
    let mocap = from_poses(&Track::new(recording.mocap));
    let options = OffsetOptions { max_offset_s: 20.0, ..OffsetOptions::default() };
    let offset = estimate_offset(&from_gyro(&recording.gyro), &mocap, &options).unwrap();
    assert!((offset.offset_ns - OFFSET_NS - 3_000_000_000).abs() < 1_000_000, "{offset:?}");
}

#[test]
fn turning_about_one_axis_hides_the_hand_eye_transform() {
    let recording = record(YAW_ONLY, 60.0, 7);
    let offset = offset_of(&recording).unwrap();
    assert!(offset_error_s(&offset).abs() < 1e-3, "the clocks are still seen: {offset:?}");
    let error = hand_eye_of(&recording, &offset).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("cannot be observed") && text.contains("tilts"), "{text}");
    assert!(text.contains("[0.00, 0.00, 1.00]") || text.contains("[-0.00, -0.00, -1.00]") || text.contains("1.00]"));
}

#[test]
fn little_motion_and_strangers_are_refused() {
    let still = offset_of(&record(STILL, 60.0, 8)).unwrap_err();
    assert!(matches!(still, SyncError::Unobservable { .. }), "{still}");
    let (mut mixed, other) = (record(HAND_HELD, 60.0, 9), record(Motion { seed: 99, ..HAND_HELD }, 60.0, 9));
    mixed.mocap = other.mocap;
    let stranger = offset_of(&mixed).unwrap_err();
    assert!(matches!(stranger, SyncError::NoAgreement { .. }), "{stranger}");
    let empty = estimate_offset(&from_gyro(&[]), &from_poses(&Track::default()), &OffsetOptions::default());
    assert!(empty.is_err());
    let short = offset_of(&record(HAND_HELD, 2.0, 9)).unwrap_err();
    assert!(matches!(short, SyncError::TooFew { .. } | SyncError::NoAgreement { .. }), "{short}");
}

#[test]
fn a_camera_without_gyroscope_uses_its_own_turning() {
    // Poses of a visual odometry at 30 Hz.
    let mut rng = Rng::at(11, 3, 0, 0);
    let poses = (0..1800).map(|i| f64::from(i) / 30.0).map(|t| StampedPose {
        stamp_ns: camera_ns(t),
        world_from_body: noisy(HAND_HELD.pose(t) * marker_from_camera(), &mut rng, 0.05, 0.002),
    });
    let recording = record(HAND_HELD, 60.0, 11);
    let visual = from_poses(&Track::new(poses.collect()));
    let mocap = from_poses(&Track::new(recording.mocap));
    let offset = estimate_offset(&visual, &mocap, &OffsetOptions::default()).unwrap();
    eprintln!("visual: offset {:.3} ms wrong, drift {:.2} ppm", offset_error_s(&offset) * 1e3, offset.drift_ppm);
    assert!(offset_error_s(&offset).abs() < 1e-3, "{offset:?}");
}
