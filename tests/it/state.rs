//! A replay that is saved and taken up again ends as if it had never stopped.

use crate::support::{SMALL_CAMERA, pslam, pslam_exits, small_world, text, write_log};
use fixtures::WorldConfig;
use replayer::run::{RECORDS_BIN, ReplayOptions, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT, replay, verify};
use slam::config::SensorChoice;
use std::fs;
use std::path::{Path, PathBuf};

const FRAMES: u32 = 40;

fn run(log: &Path, out: &Path, options: &ReplayOptions) -> RunSummary {
    replay(log, out, options, &mut |_, _| {}).unwrap()
}

/// A gaze that sweeps, for many keyframes, and some dark frames: the track is lost and found again.
fn eventful(folder: &Path) -> PathBuf {
    let log = folder.join("eventful.mcap");
    let mut world = small_world(FRAMES);
    world.camera_path.look_amplitude_m = [1.8, 0.0, 0.0];
    world.dark_frames = Some(22..26);
    write_log(&world, &log, &mut |_| {});
    log
}

/// Saves with one number of threads, goes on with another, and wants the files of the whole run.
fn goes_on_from(log: &Path, folder: &Path, frames: &[usize], options: &ReplayOptions) {
    let whole = folder.join("whole");
    let summary = run(log, &whole, &ReplayOptions { threads: 1, ..options.clone() });
    for (&frame, threads) in frames.iter().zip([1, 2, 4, 8].into_iter().cycle()) {
        let (state, first, second) = (folder.join("state"), folder.join("first"), folder.join("second"));
        let options = |threads, out: &Path| (out.to_owned(), ReplayOptions { threads, force: true, ..options.clone() });
        let (out, saving) = options(threads, &first);
        let saved = run(log, &out, &ReplayOptions { save_state: Some((frame, state.clone())), ..saving });
        assert_eq!(saved.fingerprint, summary.fingerprint, "saving changes nothing");
        let (out, resuming) = options(9 - threads, &second);
        let resumed = run(log, &out, &ReplayOptions { resume: Some(state.clone()), ..resuming });
        assert_eq!(resumed.fingerprint, summary.fingerprint, "frame {frame}, {threads} threads");
        assert_eq!((&resumed.result, &resumed.header), (&summary.result, &summary.header), "frame {frame}");
        assert_eq!(resumed.resumed_at, Some(frame));
        for name in [RECORDS_BIN, TRAJECTORY_TXT, TRAJECTORY_ONLINE_TXT] {
            assert!(fs::read(whole.join(name)).unwrap() == fs::read(out.join(name)).unwrap(), "{name}, frame {frame}");
        }
        assert!(verify(&out, None, 2, &mut |_, _| {}).unwrap().passed());
        // The state itself does not depend on threads either.
        let again = folder.join("again");
        let options = ReplayOptions { threads: 3, force: true, ..options(3, &first).1 };
        run(log, &first, &ReplayOptions { save_state: Some((frame, again.clone())), ..options });
        assert!(fs::read(&state).unwrap() == fs::read(&again).unwrap(), "state before frame {frame}");
    }
}

#[test]
fn at_any_frame() {
    let folder = tempfile::tempdir().unwrap();
    let log = eventful(folder.path());
    // The first and the last, with jobs in flight, in the dark, right after it.
    goes_on_from(&log, folder.path(), &[1, 2, 3, 9, 14, 24, 27, 33, 40], &ReplayOptions::default());
}

#[test]
fn of_a_single_camera_that_has_not_started_yet() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("mono.mcap");
    write_log(&small_world(24), &log, &mut |_| {});
    let mut options = ReplayOptions::default();
    options.config.sensor.kind = SensorChoice::Monocular;
    goes_on_from(&log, folder.path(), &[2, 5, 12, 18], &options);
}

#[test]
fn a_longer_run_goes_on_from_a_shorter_one() {
    let folder = tempfile::tempdir().unwrap();
    let log = eventful(folder.path());
    let path = |name: &str| folder.path().join(name);
    let whole = run(&log, &path("whole"), &ReplayOptions { frames: Some(3..40), ..ReplayOptions::default() });
    let (frames, save_state) = (Some(3..12), Some((12, path("state"))));
    run(&log, &path("short"), &ReplayOptions { frames, save_state, ..ReplayOptions::default() });
    let (frames, resume) = (Some(3..40), Some(path("state")));
    let long = run(&log, &path("long"), &ReplayOptions { frames, resume, ..ReplayOptions::default() });
    assert_eq!((long.fingerprint, long.resumed_at), (whole.fingerprint, Some(12)));
}

/// What `pslam` says when it refuses, with its exit code.
fn refusal(arguments: &[&str]) -> (Option<i32>, String) {
    let output = pslam(arguments);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked"), "{text}");
    (output.status.code(), text)
}

#[test]
fn what_does_not_fit_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (log, other, state, out) = (path("a.mcap"), path("b.mcap"), path("run.state"), path("out"));
    write_log(&small_world(12), Path::new(&log), &mut |_| {});
    let dark = WorldConfig { camera: SMALL_CAMERA, dark_frames: Some(3..4), ..small_world(12) };
    write_log(&dark, Path::new(&other), &mut |_| {});
    pslam_exits(0, &["replay", &log, "-o", &path("run"), "--save-state", &format!("6:{state}")]);
    pslam_exits(0, &["replay", &log, "-o", &out, "--resume", &state, "--json"]);

    let refuse = |code: i32, words: &[&str], arguments: &[&str]| {
        let found = refusal(&[&["replay", "--force", "-o", &out], arguments].concat());
        assert_eq!(found.0, Some(code), "{arguments:?}: {}", found.1);
        assert!(words.iter().all(|word| found.1.contains(word)), "{arguments:?}: {}", found.1);
    };
    refuse(2, &["log (BLAKE3)"], &[&other, "--resume", &state]);
    refuse(2, &["config panoptic.people", "true", "false"], &[&log, "--resume", &state, "--preset", "none"]);
    refuse(2, &["0..12", "2..12"], &[&log, "--resume", &state, "--frames", "2.."]);
    refuse(3, &["after 6 frames", "to have 4"], &[&log, "--resume", &state, "--frames", "..4"]);
    refuse(2, &["before frame 13", "0..12"], &[&log, "--save-state", &format!("13:{state}")]);
    refuse(3, &["record of a run"], &[&log, "--resume", text(&Path::new(&path("run")).join(RECORDS_BIN))]);
    refuse(3, &["no records file"], &[&log, "--resume", &log]);
    let found = refusal(&["replay", &log, "-o", &path("new"), "--save-state", &format!("6:{state}")]);
    assert!(found.0 == Some(2) && found.1.contains("--force"), "{found:?}");

    // Every kind of damage at many places; a whole file is some megabytes.
    let whole = fs::read(&state).unwrap();
    let damaged = path("damaged.state");
    for place in (0..40).map(|i| i * whole.len() / 40) {
        let mut flipped = whole.clone();
        flipped[place] ^= 1 << (place % 8);
        for bytes in [&flipped, &whole[..place]] {
            fs::write(&damaged, bytes).unwrap();
            refuse(3, &["damaged.state"], &[&log, "--resume", &damaged]);
        }
    }
    fs::write(&damaged, [&whole[..], b"more"].concat()).unwrap();
    refuse(3, &["bytes after the end"], &[&log, "--resume", &damaged]);
}
