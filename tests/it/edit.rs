//! Edited logs: a piece replays as it did inside the whole, and a redacted log is still a log.

use crate::support::{pslam_exits, small_world, text, write_log};
use replayer::log::{Log, check};
use replayer::run::{ReplayOptions, TRAJECTORY_TXT, diff, replay};
use schemas::metadata;
use std::fs;
use std::path::Path;

const FRAMES: u32 = 24;

fn replayed(log: &Path, run: &Path, frames: Option<std::ops::Range<usize>>) {
    let options = ReplayOptions { frames, threads: 2, ..ReplayOptions::default() };
    replay(log, run, &options, &mut |_, _| {}).unwrap();
}

fn json(output: &str) -> serde_json::Value {
    serde_json::from_str(output).unwrap()
}

#[test]
fn a_piece_replays_as_inside_the_whole() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, piece, a, b] = ["whole.mcap", "piece.mcap", "a", "b"].map(|name| folder.path().join(name));
    write_log(&small_world(FRAMES), &whole, &mut |_| {});
    pslam_exits(0, &["slice", text(&whole), "--frames", "7..19", "-o", text(&piece)]);
    assert!(check(&piece).unwrap().is_sound());
    replayed(&whole, &a, Some(7..19));
    replayed(&piece, &b, None);
    let report = diff(&a, &b).unwrap();
    assert_eq!((report.first, report.equal_frames), (None, 12), "every digest of every stage");
    let differing: Vec<&str> = report.header.iter().map(|difference| difference.field.as_str()).collect();
    assert!(differing.iter().all(|field| ["log (BLAKE3)", "frames"].contains(field)), "{differing:?}");
    assert_eq!(fs::read(a.join(TRAJECTORY_TXT)).unwrap(), fs::read(b.join(TRAJECTORY_TXT)).unwrap());
    // Ground truth reaches beyond every frame.
    let log = Log::open(&piece).unwrap();
    let truth = &log.ground_truth().poses;
    let frames = log.timeline(None).unwrap();
    assert!(truth[0].stamp <= frames.frames()[0].stamp && truth.last().unwrap().stamp >= frames.frames()[11].stamp);
    // Another frame is another replay: the comparison can fail.
    let other = folder.path().join("c");
    replayed(&whole, &other, Some(6..18));
    assert!(diff(&other, &b).unwrap().first.is_some());
}

#[test]
fn a_redacted_log_is_sound_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let [log, out, run] = ["log.mcap", "out.mcap", "run"].map(|name| folder.path().join(name));
    write_log(&small_world(FRAMES), &log, &mut |_| {});
    let report = json(&pslam_exits(0, &["redact", text(&log), "-o", text(&out), "--margin", "4", "--json"]));
    assert_eq!(report["refused"], false);
    assert!(report["redacted"]["pixels"].as_array().unwrap().iter().any(|pixels| pixels.as_u64() > Some(0)));
    let findings = check(&out).unwrap();
    assert!(findings.is_sound(), "{findings}");
    replayed(&out, &run, None);
    let log = Log::open(&out).unwrap();
    assert!(log.metadata().contains_key(metadata::REDACTION));
    assert!(log.metadata().contains_key(&format!("{}1", metadata::PROVENANCE_PREFIX)));
}

#[test]
fn the_command_line_says_no() {
    let folder = tempfile::tempdir().unwrap();
    let [log, out] = ["log.mcap", "out.mcap"].map(|name| folder.path().join(name));
    write_log(&small_world(6), &log, &mut |_| {});
    let (log, out) = (text(&log), text(&out));
    pslam_exits(2, &["slice", log, "--frames", "6..9", "-o", out]);
    pslam_exits(2, &["slice", log, "--from", "yesterday", "-o", out]);
    pslam_exits(2, &["slice", log, "--from", "1h", "-o", out]);
    pslam_exits(2, &["filter", log, "-o", out]);
    pslam_exits(2, &["filter", log, "-y", "(", "-o", out]);
    pslam_exits(2, &["compress", log, "--level", "23", "-o", out]);
    pslam_exits(2, &["compress", log, "--level", "none", "-o", log]);
    pslam_exits(2, &["merge", log, log, "--rename-layer", "3:panoptic=x", "-o", out]);
    pslam_exits(2, &["redact", log, "--layer", "nobody", "-o", out]);
    pslam_exits(3, &["filter", "/no/such/log", "-y", ".*", "-o", out]);
    assert!(!Path::new(out).exists());
    let dry = json(&pslam_exits(0, &["filter", log, "-n", "/camera/.*", "-o", out, "--dry-run", "--json"]));
    assert!(dry["out"].is_null() && !Path::new(out).exists());
    let wet = json(&pslam_exits(0, &["filter", log, "-n", "/camera/.*", "-o", out, "--json"]));
    assert_eq!(dry["topics"], wet["topics"]);
    pslam_exits(2, &["filter", log, "-n", "/camera/.*", "-o", out]);
    let packed = json(&pslam_exits(0, &["compress", log, "--level", "9", "-o", out, "--force", "--json"]));
    assert_eq!(packed["proof"]["messages"], packed["messages"]["kept"]);
    // By time: from 40 ms after the first picture to before 140 ms there are three at 30 Hz.
    let piece =
        json(&pslam_exits(0, &["slice", log, "--from", "40ms", "--to", "0.14s", "-o", out, "--force", "--json"]));
    assert_eq!(piece["topics"]["/camera/color/image/compressed"]["kept"], 3);
}
