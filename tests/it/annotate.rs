//! `pslam annotate` as a process: killed and started again, and with a bad log among good ones.

use crate::support::{pslam, pslam_exits, root, small_world, text, write_log, write_masks};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const FRAMES: u32 = 60;

/// Ready labels stand for a network: the journal and the rewriting are the same.
fn command<'a>(logs: &[&'a str], out: &'a str, masks: &'a str) -> Vec<&'a str> {
    let rest = ["-o", out, "--masks", masks, "--threads", "1", "--json", "--no-progress"];
    [&["annotate"], logs, &rest].concat()
}

fn annotated(code: i32, arguments: &[&str]) -> Value {
    serde_json::from_str(&pslam_exits(code, arguments)).unwrap()
}

/// Starts the program and kills it once `file` holds so many bytes; false if it was done before.
fn killed_at(arguments: &[&str], file: &Path, bytes: u64) -> bool {
    let mut child = Command::new(env!("CARGO_BIN_EXE_pslam"))
        .args(arguments)
        .env("SOURCE_DATE_EPOCH", "0")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut looks = 0;
    while child.try_wait().unwrap().is_none() {
        if fs::metadata(file).is_ok_and(|about| about.len() >= bytes) {
            // SIGKILL: nothing of the program runs after it.
            child.kill().unwrap();
            return !child.wait().unwrap().success();
        }
        looks += 1;
        assert!(looks < 500_000, "it neither labels nor ends");
        std::thread::sleep(Duration::from_micros(200));
    }
    false
}

#[test]
fn a_killed_run_is_taken_up_and_gives_the_same_log() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (log, masks, whole, out) = (at("a.mcap"), at("masks"), at("whole.mcap"), at("out.mcap"));
    write_log(&small_world(FRAMES), &log, &mut |_| {});
    write_masks(&masks, (320, 240), FRAMES);
    let ended = Command::new(env!("CARGO_BIN_EXE_pslam"))
        .args(command(&[text(&log)], text(&whole), text(&masks)))
        .env("SOURCE_DATE_EPOCH", "0")
        .output()
        .unwrap();
    assert!(ended.status.success(), "{ended:?}");
    let asked = command(&[text(&log)], text(&out), text(&masks));
    let journal = at("out.mcap.labels");
    // In the middle of the labels; then in the middle of writing the new log.
    let mut kills = u32::from(killed_at(&asked, &journal, 3_000));
    assert!(!out.exists());
    let left = fs::metadata(&journal).map_or(0, |about| about.len());
    kills += u32::from(killed_at(&asked, &at("out.mcap.partial"), 1));
    assert!(!out.exists() && kills == 2, "killed {kills} times, journal of {left} bytes");
    let output = Command::new(env!("CARGO_BIN_EXE_pslam")).args(&asked).env("SOURCE_DATE_EPOCH", "0").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let done = &report["logs"][0]["annotated"];
    assert_eq!((&done["pictures"], &done["resumed"]), (&FRAMES.into(), &FRAMES.into()), "all labels were there");
    assert!(fs::read(&out).unwrap() == fs::read(&whole).unwrap(), "the same bytes as without a kill");
    let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.mcap", "masks", "out.mcap", "whole.mcap"], "nothing unfinished is left");
    pslam_exits(0, &["check", text(&out)]);
}

#[test]
fn a_bad_log_among_good_ones_is_told_and_the_others_are_done() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let logs = ["a.mcap", "bad.mcap", "missing.mcap", "b.mcap"].map(at);
    let masks = at("masks");
    write_log(&small_world(4), &logs[0], &mut |_| {});
    let mut bytes = fs::read(&logs[0]).unwrap();
    fs::copy(&logs[0], &logs[3]).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    fs::write(&logs[1], bytes).unwrap();
    write_masks(&masks, (320, 240), 4);
    let (logs, out) = (logs.each_ref().map(|log| text(log)), at("out"));
    let asked = command(&logs, text(&out), text(&masks));
    let output = pslam(&asked);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("2 of 4 logs were not annotated") && said.contains("bad.mcap"), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let errors: Vec<&Value> = report["logs"].as_array().unwrap().iter().map(|done| &done["error"]).collect();
    assert!(errors[0].is_null() && errors[3].is_null(), "{report}");
    assert!(errors[1].as_str().is_some_and(|e| e.contains("bad.mcap")), "{report}");
    assert!(errors[2].as_str().is_some_and(|e| e.contains("missing.mcap")), "{report}");
    for good in ["a.mcap", "b.mcap"] {
        pslam_exits(0, &["check", text(&out.join(good))]);
    }
    assert!(!out.join("bad.mcap").exists() && !out.join("bad.mcap.partial").exists());
    // Again with the bad ones mended: what is done is left alone.
    fs::copy(logs[0], logs[1]).unwrap();
    fs::copy(logs[0], logs[2]).unwrap();
    let report = annotated(0, &asked);
    let done: Vec<bool> = report["logs"].as_array().unwrap().iter().map(|d| !d["annotated"].is_null()).collect();
    assert_eq!(done, [false, true, true, false], "{report}");
}

#[test]
fn requests_that_make_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (log, masks, out) = (at("a.mcap"), at("masks"), at("out.mcap"));
    write_log(&small_world(2), &log, &mut |_| {});
    write_masks(&masks, (320, 240), 2);
    pslam_exits(2, &["annotate", text(&log), "-o", text(&out)]);
    pslam_exits(3, &command(&[text(&log)], text(&out), "/nowhere"));
    pslam_exits(3, &command(&[text(&root().join("Cargo.toml"))], text(&out), text(&masks)));
    pslam_exits(2, &command(&[text(&log)], text(&log), text(&masks)));
    assert!(!out.exists());
    // What others began is theirs: a recording that a crash cut off, and a file where labels are kept.
    for (name, code) in [("out.mcap.partial", 2), ("out.mcap.labels", 3)] {
        fs::write(at(name), b"precious").unwrap();
        pslam_exits(code, &command(&[text(&log)], text(&out), text(&masks)));
        assert_eq!(fs::read(at(name)).unwrap(), b"precious", "{name}");
        fs::remove_file(at(name)).unwrap();
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2, "nothing is left behind");
    // Labels of another size.
    write_masks(&masks, (160, 120), 2);
    let said = String::from_utf8_lossy(&pslam(&command(&[text(&log)], text(&out), text(&masks))).stderr).into_owned();
    assert!(said.contains("320x240") && said.contains("160x120"), "{said}");
    assert!(!out.exists());
}
