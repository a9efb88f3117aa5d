//! The same log gives the same bits, and the check of that can fail.

use crate::support::{SMALL_CAMERA, pslam_exits, small_world, text, write_log};
use replayer::run::{
    DiffReport, RECORDS_BIN, ReplayOptions, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT, Unrest, diff, replay,
    verify,
};
use slam::Config;
use slam::panoptic::CELL_PX;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const FRAMES: u32 = 30;
/// Where the changed log differs.
const CHANGED: u32 = 17;
const WIDTH: usize = SMALL_CAMERA.width as usize;

fn run(log: &Path, out: &Path, threads: usize, config: Config) -> RunSummary {
    let rrd = cfg!(feature = "rerun");
    let options = ReplayOptions { threads, config, rrd, ..ReplayOptions::default() };
    replay(log, out, &options, &mut |_, _| {}).unwrap()
}

/// A log and a run of it with one thread.
fn first_run(folder: &Path) -> (PathBuf, PathBuf, RunSummary) {
    let (log, out) = (folder.join("a.mcap"), folder.join("run-1"));
    write_log(&small_world(FRAMES), &log, &mut |_| {});
    let summary = run(&log, &out, 1, Config::default());
    (log, out, summary)
}

#[test]
fn threads_do_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let (log, first, summary) = first_run(folder.path());
    assert_eq!((summary.result.frames, summary.result.tracked), (FRAMES as usize, FRAMES as usize));
    for threads in [1, 2, 4, 8] {
        let out = folder.path().join(format!("again-{threads}"));
        assert_eq!(run(&log, &out, threads, Config::default()).fingerprint, summary.fingerprint, "{threads} threads");
        let rrd = cfg!(feature = "rerun").then_some("replay.rrd");
        for name in [RECORDS_BIN, TRAJECTORY_TXT, TRAJECTORY_ONLINE_TXT].into_iter().chain(rrd) {
            let same = fs::read(first.join(name)).unwrap() == fs::read(out.join(name)).unwrap();
            assert!(same, "{name} differs between 1 and {threads} threads");
        }
        assert!(diff(&first, &out).unwrap().same());
        assert!(verify(&out, None, threads, &mut |_, _| {}).unwrap().passed());
    }
}

/// A log with a keyframe, and so a background job, every few frames.
fn busy_log(folder: &Path) -> PathBuf {
    let log = folder.join("busy.mcap");
    let mut world = small_world(FRAMES);
    world.camera_path.look_amplitude_m = [1.8, 0.0, 0.0];
    write_log(&world, &log, &mut |_| {});
    log
}

/// Sleeps that come out differently every time: whoever comes first takes the next.
fn unrest(seed: u64, hurry: bool) -> Unrest {
    let state = AtomicU64::new(seed);
    let pause = move || {
        let turn = state.fetch_add(1, Ordering::Relaxed);
        let micros = turn.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 52;
        std::thread::sleep(Duration::from_micros(micros));
    };
    Unrest { pause: Arc::new(pause), hurry }
}

#[test]
fn slow_and_uneven_workers_do_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let log = busy_log(folder.path());
    let summary = run(&log, &folder.path().join("calm"), 1, Config::default());
    assert!(summary.result.keyframes >= 5, "{} keyframes are too few to test jobs", summary.result.keyframes);
    for (threads, seed) in [(1, 1), (2, 2), (3, 3), (4, 4), (8, 5), (2, 6)] {
        let options = ReplayOptions { threads, unrest: Some(unrest(seed, false)), ..ReplayOptions::default() };
        let again = replay(&log, &folder.path().join(seed.to_string()), &options, &mut |_, _| {}).unwrap();
        assert_eq!(again.fingerprint, summary.fingerprint, "{threads} threads, seed {seed}");
    }
}

#[test]
fn results_applied_when_they_are_ready_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let log = busy_log(folder.path());
    let config = Config::from_toml("[jobs]\nmapping_lag_frames = 6").unwrap();
    let (calm, hurried) = (folder.path().join("calm"), folder.path().join("hurried"));
    let summary = run(&log, &calm, 2, config.clone());
    let options = ReplayOptions { threads: 2, config, unrest: Some(unrest(1, true)), ..ReplayOptions::default() };
    let other = replay(&log, &hurried, &options, &mut |_, _| {}).unwrap();
    assert_ne!(other.fingerprint, summary.fingerprint);
    assert!(!diff(&calm, &hurried).unwrap().same());
}

#[test]
fn rendering_and_writing_a_log_twice_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let logs = ["a.mcap", "b.mcap"].map(|name| folder.path().join(name));
    logs.iter().for_each(|log| write_log(&small_world(5), log, &mut |_| {}));
    assert!(fs::read(&logs[0]).unwrap() == fs::read(&logs[1]).unwrap());
}

#[test]
fn one_changed_mask_pixel_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (_, first, summary) = first_run(folder.path());
    let (log, out) = (folder.path().join("b.mcap"), folder.path().join("run-2"));
    write_log(&small_world(FRAMES), &log, &mut |frame| {
        if frame.index == CHANGED {
            // A pixel of a Thing (numbered from 256) becomes unknown: one that the filter's grid of cells reads.
            let half = CELL_PX / 2;
            let read = |at: &usize| at % WIDTH % CELL_PX == half && at / WIDTH % CELL_PX == half;
            let at = (0..frame.panoptic.ids.len()).filter(read).find(|at| frame.panoptic.ids[*at] >= 256).unwrap();
            frame.panoptic.ids[at] = 0;
        }
    });
    assert_ne!(run(&log, &out, 1, Config::default()).fingerprint, summary.fingerprint);
    let report: DiffReport = diff(&first, &out).unwrap();
    assert!(!report.same() && report.header.iter().any(|difference| difference.field.starts_with("log")));
    let difference = report.first.expect("the changed frame has another digest");
    assert_eq!((difference.frame, report.equal_frames), (Some(CHANGED), CHANGED as usize));
    assert!(difference.stage.is_some() && !difference.field.is_empty() && difference.values[0] != difference.values[1]);
}

#[test]
fn another_configuration_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (log, first, summary) = first_run(folder.path());
    let out = folder.path().join("run-2");
    let config = Config::from_toml("[orb]\nfeatures = 500\n").unwrap();
    assert_ne!(run(&log, &out, 1, config).fingerprint, summary.fingerprint);
    let report = pslam_exits(1, &["diff", text(&first), text(&out)]);
    let default = Config::default().orb.features.to_string();
    for word in ["orb.features", "500", &default, "frame 0", "stage"] {
        assert!(report.contains(word), "{word}: {report}");
    }
}

#[test]
fn a_forged_record_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (_, first, _) = first_run(folder.path());
    let path = first.join(TRAJECTORY_TXT);
    let forged = fs::read_to_string(&path).unwrap().replacen("0.0", "0.1", 1);
    fs::write(&path, forged).unwrap();
    pslam_exits(1, &["verify", text(&first)]);
    let path = first.join(RECORDS_BIN);
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).unwrap();
    pslam_exits(3, &["verify", text(&first)]);
}
