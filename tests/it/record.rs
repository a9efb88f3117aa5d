//! `pslam record` as a process: told to stop, killed, refused.

use crate::support::{pslam_exits, text};
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

const SMALL: [&str; 9] =
    ["record", "--source", "synthetic", "--color", "160x120@30", "--depth", "160x120@30", "--imu", "--json"];

/// Starts a recording and waits until it says how it goes.
fn start(out: &Path, more: &[&str]) -> (Child, BufReader<ChildStdout>, serde_json::Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
    command.args(SMALL).args(["--reserve", "1M", "-o", text(out)]).args(more);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let first = next(&mut lines);
    (child, lines, first)
}

fn next(lines: &mut BufReader<ChildStdout>) -> serde_json::Value {
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("`{line}`: {error}"))
}

/// The last line.
fn verdict(mut lines: BufReader<ChildStdout>) -> serde_json::Value {
    loop {
        let line = next(&mut lines);
        if line["kind"] == "verdict" {
            return line;
        }
    }
}

fn counts(log: &Path) -> impl Fn(&str) -> u64 {
    let info: serde_json::Value = serde_json::from_str(&pslam_exits(0, &["info", text(log), "--json"])).unwrap();
    move |topic: &str| {
        let topics = info["topics"].as_array().unwrap();
        topics.iter().find(|known| known["topic"] == topic).map_or(0, |known| known["count"].as_u64().unwrap())
    }
}

const TOPICS: [(&str, &str); 4] = [
    ("color", "/camera/color/image/compressed"),
    ("depth", "/camera/depth/native/image"),
    ("gyro", "/camera/gyro/sample"),
    ("accel", "/camera/accel/sample"),
];

#[test]
fn a_stopped_recording_is_whole_and_replays() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let (mut child, lines, _) = start(&log, &[]);
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let verdict = verdict(lines);
    let code = child.wait().unwrap().code();
    // A loaded machine may lose pictures; then it must say so.
    assert_eq!(code, Some(if verdict["complete"] == true { 0 } else { 1 }), "{verdict}");
    let count = counts(&log);
    for stream in verdict["streams"].as_array().unwrap() {
        let topic = TOPICS.iter().find(|(name, _)| stream["stream"] == *name).unwrap().1;
        assert_eq!(count(topic), stream["written"].as_u64().unwrap(), "{verdict}");
        assert_eq!(stream["received"], stream["written"].as_u64().unwrap() + stream["dropped_host"].as_u64().unwrap());
    }
    let checked = pslam_exits(0, &["check", text(&log)]);
    assert!(checked.contains("sound"), "{checked}");
    let run = folder.path().join("run");
    pslam_exits(0, &["replay", text(&log), "-o", text(&run)]);
    pslam_exits(0, &["verify", text(&run)]);
}

#[test]
fn a_killed_recording_keeps_what_was_flushed() {
    let folder = tempfile::tempdir().unwrap();
    for (number, delay_ms) in [0, 370, 810].into_iter().enumerate() {
        let log = folder.path().join(format!("{number}.mcap"));
        let (mut child, mut lines, first) = start(&log, &[]);
        std::thread::sleep(Duration::from_millis(delay_ms));
        child.kill().unwrap();
        child.wait().unwrap();
        let mut status = first;
        let mut line = String::new();
        while lines.read_line(&mut line).unwrap() > 0 {
            // The last line may be cut.
            status = serde_json::from_str(&line).unwrap_or(status);
            line.clear();
        }
        assert!(!log.exists());
        let (partial, saved) = (format!("{}.partial", text(&log)), folder.path().join(format!("{number}.saved.mcap")));
        let recovered = crate::support::pslam(&["recover", &partial, "-o", text(&saved)]);
        assert!(recovered.status.code().is_some_and(|code| code <= 1), "{recovered:?}");
        let count = counts(&saved);
        for stream in status["streams"].as_array().unwrap() {
            let topic = TOPICS.iter().find(|(name, _)| stream["stream"] == *name).unwrap().1;
            assert!(count(topic) >= stream["flushed"].as_u64().unwrap(), "{topic}: {} of {status}", count(topic));
        }
        let checked = pslam_exits(0, &["check", text(&saved)]);
        assert!(checked.contains("interrupted"), "{checked}");
    }
}

#[test]
fn a_file_that_may_not_grow_ends_the_recording_cleanly() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    // 2000 blocks of 1024 bytes; the reserve of 1 MB is reached after a second or two.
    let pslam = [&[env!("CARGO_BIN_EXE_pslam")], &SMALL[..], &["--reserve", "1M", "-o", text(&log)]].concat().join(" ");
    let output = Command::new("bash").args(["-c", &format!("ulimit -f 2000; exec {pslam}")]).output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap().to_owned();
    let verdict: serde_json::Value = serde_json::from_str(&last).unwrap();
    assert!(["reserve", "disk_full"].contains(&verdict["ended_by"]["kind"].as_str().unwrap()), "{last}");
    assert!(pslam_exits(0, &["check", text(&log)]).contains("sound"));
}

#[test]
fn requests_that_make_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let out = text(&log);
    pslam_exits(2, &["record", "--source", "none", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--color", "big", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--flush-interval", "1ms", "-o", out]);
    pslam_exits(3, &["record", "--librealsense", "/nowhere.so", "-o", out]);
    pslam_exits(3, &[&SMALL[..], &["--duration", "1", "-o", "/nowhere/a.mcap"]].concat());
    fs::write(&log, b"something").unwrap();
    pslam_exits(2, &[&SMALL[..], &["--duration", "1", "-o", out]].concat());
    assert_eq!(fs::read(&log).unwrap(), b"something");
}
