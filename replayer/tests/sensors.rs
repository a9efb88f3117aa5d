//! Logs of stereo and single cameras: what they are taken for, rectification, the camera that trajectories are of.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use fixtures::{Intrinsics, World, WorldConfig, scenario};
use recorder::import::{EurocOptions, KittiOptions, euroc, kitti};
use recorder::picture::encode_rgb8;
use recorder::{Beside, LogOptions, RgbdLog, RgbdSpec};
use replayer::eval::{Alignment, EvalOptions, Trajectory, evaluate};
use replayer::log::{Log, check};
use replayer::run::{ReplayOptions, RunError, RunSummary, TRAJECTORY_TXT, replay, verify};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::format;
use schemas::stereo::StereoModel;
use slam::Config;
use slam::config::SensorChoice;

const BASELINE_M: f64 = 0.11;
const FRAMES: u32 = 8;

/// Eight pairs of a furnished room, with true poses.
fn write_stereo(path: &Path) {
    let camera = Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 159.5, cy_px: 119.5 };
    let room = scenario::static_room();
    let world = WorldConfig { camera, texels_per_metre: 160.0, right_camera_m: BASELINE_M, ..room };
    let world = World::new(&world).unwrap();
    let Intrinsics { width, height, fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy } = camera;
    let model = CameraModel { width, height, fx, fy, cx, cy, distortion: Distortion::None };
    let beside = Beside::Right(StereoModel::of_rectified(model, BASELINE_M * fx).unwrap());
    let spec = RgbdSpec { beside, ..RgbdSpec::new("synthetic", "stereo", model) };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    for index in 0..FRAMES {
        let frame = world.frame(index);
        let (stamp, pose) = (Stamp(frame.stamp_ns), frame.world_from_camera);
        let png = |rgb: &[u8]| encode_rgb8(width, height, rgb).unwrap();
        log.ground_truth(stamp, pose.translation.into(), pose.quaternion_xyzw()).unwrap();
        log.color(stamp, format::PNG, &png(&frame.rgb)).unwrap();
        // The third pair has lost its right picture.
        if index != 2 {
            log.right(stamp, format::PNG, &png(&frame.right_rgb.unwrap())).unwrap();
        }
    }
    log.finish().unwrap();
}

fn run(log: &Path, out: &Path, kind: SensorChoice) -> Result<RunSummary, RunError> {
    let mut config = Config::default();
    config.sensor.kind = kind;
    replay(log, out, &ReplayOptions { config, ..ReplayOptions::default() }, &mut |_, _| {})
}

#[test]
fn a_log_with_pairs_is_a_stereo_log() {
    let dir = tempfile::tempdir().unwrap();
    let (log, out) = (dir.path().join("stereo.mcap"), dir.path().join("run"));
    write_stereo(&log);
    let report = check(&log).unwrap();
    assert!(report.is_sound(), "{report}");
    assert!(report.findings.iter().any(|f| f.kind == "picture_without_right" && f.count == 1), "{report}");
    let info = Log::open(&log).unwrap().info();
    assert_eq!((info.frames, info.frames_with_right), (8, 7));
    assert!((info.baseline_m.unwrap() - BASELINE_M).abs() < 1e-12 && info.depth_units_per_metre.is_none());

    let summary = run(&log, &out, SensorChoice::Auto).unwrap();
    assert_eq!((summary.result.sensor.as_str(), summary.result.tracked), ("stereo", 8));
    assert!(summary.result.events.iter().any(|e| e.frame == Some(2) && e.text.contains("no right picture")));
    let truth = Log::open(&log).unwrap().ground_truth().clone();
    let estimate = Trajectory::read_tum(&out.join(TRAJECTORY_TXT)).unwrap();
    let result = evaluate(&truth, &estimate, None, &EvalOptions::default()).unwrap();
    assert!(result.ate_m.rmse < 0.01, "{} m, aligned without scale", result.ate_m.rmse);
    assert!(verify(&out, None, 2, &mut |_, _| {}).unwrap().passed());

    let single = run(&log, &dir.path().join("single"), SensorChoice::Monocular).unwrap();
    assert_eq!(single.result.sensor, "monocular");
    let error = run(&log, &dir.path().join("none"), SensorChoice::Rgbd).unwrap_err().to_string();
    assert!(error.contains("depth images"), "{error}");
    assert_eq!(Alignment::for_sensor("monocular"), Alignment::Sim3);
    assert_eq!(Alignment::for_sensor("stereo"), Alignment::Se3);
}

#[test]
fn real_pieces_are_replayed() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    if !data.join("euroc_v101_piece").exists() || !data.join("kitti07_piece").exists() {
        return eprintln!("skipped: no pieces of EuRoC and KITTI in {}", data.display());
    }
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("euroc.mcap");
    euroc(&data.join("euroc_v101_piece"), &log, &EurocOptions::default(), &mut |_, _| {}).unwrap();
    let summary = run(&log, &dir.path().join("euroc"), SensorChoice::Auto).unwrap();
    assert_eq!((summary.result.sensor.as_str(), summary.result.tracked), ("stereo", 30));
    // The first pose is that of the left camera as it records: rectification turned it by half a degree.
    let first = Trajectory::read_tum(&dir.path().join("euroc").join(TRAJECTORY_TXT)).unwrap().poses[0];
    let turn_deg = first.world_from_camera.angle().to_degrees();
    assert!((0.3..1.0).contains(&turn_deg), "{turn_deg} degrees");
    // It hovers: one camera alone has nothing to start from, and says so.
    let single = run(&log, &dir.path().join("single"), SensorChoice::Monocular).unwrap();
    assert_eq!((single.result.tracked, single.result.states["not initialized"]), (0, 30));

    let log = dir.path().join("kitti.mcap");
    kitti(&data.join("kitti07_piece"), &log, &KittiOptions::default(), &mut |_, _| {}).unwrap();
    let out = dir.path().join("kitti");
    let summary = run(&log, &out, SensorChoice::Auto).unwrap();
    assert_eq!(summary.result.sensor, "monocular");
    assert!(summary.result.tracked >= 35, "{} of 45 tracked", summary.result.tracked);
    let truth = Log::open(&log).unwrap().ground_truth().clone();
    let estimate = Trajectory::read_tum(&out.join(TRAJECTORY_TXT)).unwrap();
    let options = EvalOptions { alignment: Alignment::Sim3, ..EvalOptions::default() };
    let result = evaluate(&truth, &estimate, None, &options).unwrap();
    assert!(result.ate_m.rmse < 0.5, "{} m over {} m", result.ate_m.rmse, result.true_length_m);
}
