//! A covered sensor: frames are lost and said to be lost; what is before and after stays right.

use crate::support::{SMALL_CAMERA, write_log};
use fixtures::WorldConfig;
use replayer::eval::{Coverage, EvalOptions, Trajectory, evaluate};
use replayer::log::Log;
use replayer::run::{ReplayOptions, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT, replay};

const BEFORE: u32 = 50;
const DARK: u32 = 200;
const AFTER: u32 = 50;
/// Sensor noise and a small picture: far above what a right track shows, far below a guessed pose.
const MAX_ATE_M: f64 = 0.03;

#[test]
fn two_hundred_dark_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (log_path, run) = (folder.path().join("dark.mcap"), folder.path().join("run"));
    let world = WorldConfig {
        camera: SMALL_CAMERA,
        texels_per_metre: 160.0,
        frame_count: BEFORE + DARK + AFTER,
        dark_frames: Some(BEFORE..BEFORE + DARK),
        ..fixtures::scenario::static_room()
    };
    write_log(&world, &log_path, &mut |_| {});
    let options = ReplayOptions { threads: 2, ..ReplayOptions::default() };
    let result = replay(&log_path, &run, &options, &mut |_, _| {}).unwrap().result;
    assert_eq!(result.frames, (BEFORE + DARK + AFTER) as usize);
    let dark = BEFORE..BEFORE + DARK;
    let lost = |frame: u32| result.lost_frames.iter().any(|range| range.contains(&frame));
    assert!(dark.clone().all(lost), "dark frames with a pose; lost are {:?}", result.lost_frames);
    assert!(!(0..BEFORE).any(lost), "lost before the dark: {:?}", result.lost_frames);
    assert!(result.tracked as u32 >= BEFORE + AFTER / 2, "{} tracked, lost {:?}", result.tracked, result.lost_frames);

    let log = Log::open(&log_path).unwrap();
    let stamps = fixtures::World::new(&world).unwrap();
    let covered = stamps.stamp_ns(dark.start)..stamps.stamp_ns(dark.end);
    for name in [TRAJECTORY_TXT, TRAJECTORY_ONLINE_TXT] {
        let path = Trajectory::read_tum(&run.join(name)).unwrap();
        assert!(!path.poses.iter().any(|pose| covered.contains(&pose.stamp.0)), "{name} has poses of dark frames");
        let coverage = Coverage { tracked: path.poses.len(), frames: result.frames };
        let error = evaluate(log.ground_truth(), &path, Some(coverage), &EvalOptions::default()).unwrap();
        assert!(error.ate_m.rmse < MAX_ATE_M, "{name}: {:.4} m", error.ate_m.rmse);
    }
}
