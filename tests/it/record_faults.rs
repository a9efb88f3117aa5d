//! `pslam record` as a process whose clock is set, whose disk turns read-only, whose folder goes away.

use crate::record::{SMALL, counts, next, start, verdict};
use crate::support::{pslam, pslam_exits, text};
use serde_json::Value;
use std::fs;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Stdio};

fn says(verdict: &Value, words: &str) -> bool {
    verdict["reasons"].as_array().unwrap().iter().any(|reason| reason.as_str().unwrap().contains(words))
}

/// Recovers `partial`; at least what `status` says was flushed must be there.
fn recovers(partial: &Path, status: &Value) {
    let saved = partial.with_file_name("saved.mcap");
    let recovered = pslam(&["recover", text(partial), "-o", text(&saved)]);
    assert!(recovered.status.code().is_some_and(|code| code <= 1), "{recovered:?}");
    let color = status["streams"].as_array().unwrap().iter().find(|stream| stream["stream"] == "color").unwrap();
    let (kept, flushed) = (counts(&saved)("/camera/color/image/compressed"), color["flushed"].as_u64().unwrap());
    assert!(flushed > 0 && kept >= flushed, "{kept} of {status}");
    pslam_exits(0, &["check", text(&saved)]);
}

#[test]
fn a_clock_that_is_set_moves_no_stamp() {
    let folder = tempfile::tempdir().unwrap();
    let shim = folder.path().join("clock_step.so");
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/record/clock_step.c");
    let Ok(built) = Command::new("cc").args(["-O2", "-shared", "-fPIC", "-o", text(&shim), source]).output() else {
        return eprintln!("SKIPPED: there is no C compiler `cc` here");
    };
    assert!(built.status.success(), "{built:?}");
    for step_ms in [-7_500_i64, 3_600_000] {
        let log = folder.path().join(format!("{step_ms}.mcap"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
        command.args(SMALL).args(["--reserve", "1M", "--duration", "4", "-o", text(&log)]);
        command.env("LD_PRELOAD", &shim).env("CLOCK_STEP_MS", step_ms.to_string()).env("CLOCK_STEP_AFTER_MS", "2500");
        let output = command.output().unwrap();
        let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap().to_owned();
        let verdict: Value = serde_json::from_str(&last).unwrap();
        assert_eq!(verdict["clock"]["steps"], 1, "{verdict}");
        let off_ns = verdict["clock"]["last_step_ns"].as_i64().unwrap() - step_ms * 1_000_000;
        assert!(off_ns.abs() < 50_000_000, "{off_ns} ns beside the step");
        let told = format!("clock.step: the host's realtime clock was set by {:.1}", step_ms as f64 / 1e3);
        let screen = String::from_utf8_lossy(&output.stderr);
        // 3600.000 may be told as 3600.001, -7.500 as -7.499.
        let told = &told[..told.len() - 2];
        assert!(screen.contains(told), "{screen}");
        // A step is no loss, and the duration is counted by the clock that does not step.
        let seconds = verdict["duration_s"].as_f64().unwrap();
        assert!((3.9..10.0).contains(&seconds), "{verdict}");
        let checked = pslam_exits(0, &["check", text(&log)]);
        assert!(checked.contains("Note: clock step (1 x)"), "{checked}");
        assert!(!checked.contains("goes back"), "{checked}");
    }
}

/// A disk of our own, mounted from a file; the file system gives up in mid-recording, as after an error of the disk.
#[test]
fn a_disk_that_turns_read_only_keeps_what_was_flushed() {
    let folder = tempfile::tempdir().unwrap();
    let place = text(folder.path());
    let pslam =
        [&[env!("CARGO_BIN_EXE_pslam")], &SMALL[..], &["--reserve", "1M", "-o", "disk/a.mcap"]].concat().join(" ");
    let script = format!(
        "cd {place}; PATH=$PATH:/usr/sbin:/sbin; mkdir disk; truncate -s 100M disk.img
         mkfs.ext4 -q disk.img >why.txt 2>&1 && mount -o loop disk.img disk 2>why.txt || exit 77
         {pslam} >out.txt 2>err.txt & recording=$!
         until [ $(wc -l <out.txt) -ge 3 ]; do kill -0 $recording || break; sleep 0.1; done
         mount -o remount,abort disk
         wait $recording; code=$?
         umount disk; mount -o loop disk.img disk && cp disk/a.mcap* .; umount disk
         exit $code"
    );
    let output = Command::new("unshare").args(["-m", "bash", "-c", &script]).output();
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap_or_default();
    let output = match output {
        Ok(output) if output.status.code() != Some(77) && folder.path().join("out.txt").exists() => output,
        _ => return eprintln!("SKIPPED: no ext4 can be mounted here: {}", read("why.txt").trim()),
    };
    assert_eq!(output.status.code(), Some(1), "{output:?} {}", read("err.txt"));
    let told: Vec<Value> = read("out.txt").lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let verdict = told.last().unwrap();
    assert_eq!(verdict["ended_by"]["kind"], "write_failed", "{verdict}");
    assert!(says(verdict, "Read-only file system") && says(verdict, "a.mcap.partial: recover it"), "{verdict}");
    recovers(&folder.path().join("a.mcap.partial"), &told[2]);
}

#[test]
fn a_folder_that_goes_away_ends_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let [here, there] = ["here", "there"].map(|name| folder.path().join(name));
    for removed in [false, true] {
        fs::create_dir(&here).unwrap();
        let (mut child, mut lines, _) = start(&here.join("a.mcap"), &[]);
        let before = next(&mut lines);
        if removed {
            fs::remove_dir_all(&here).unwrap();
        } else {
            fs::rename(&here, &there).unwrap();
        }
        let verdict = verdict(lines);
        assert_eq!(child.wait().unwrap().code(), Some(1), "{verdict}");
        assert_eq!(verdict["ended_by"]["kind"], "write_failed", "{verdict}");
        assert!(says(&verdict, "a.mcap or its folder was moved or removed"), "{verdict}");
        if removed {
            assert!(says(&verdict, "nothing of it is left"), "{verdict}");
        } else {
            assert_eq!(Path::new(verdict["file"].as_str().unwrap()).file_name().unwrap(), "a.mcap.partial");
            recovers(Path::new(verdict["file"].as_str().unwrap()), &before);
        }
    }
}

#[test]
fn times_at_the_edges_and_flags_that_do_not_go_together() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    for wrong in ["-1", "0", "0s", "1e300", "nan", "1d", "", "5 m"] {
        pslam_exits(2, &[&SMALL[..], &[&format!("--duration={wrong}"), "-o", text(&log)]].concat());
    }
    pslam_exits(2, &[&SMALL[..], &["--raw", "--encoding", "png", "-o", text(&log)]].concat());
    for together in [
        "--play x.bag",
        "--serial 12",
        "--emitter on",
        "--subject quad",
        "--color 640x480@0",
        "--color 0x480@30",
        "--unpaced",
        "--markers",
    ] {
        let words: Vec<&str> = together.split(' ').collect();
        pslam_exits(2, &[&["record", "--source", "synthetic", "-o", text(&log)], &words[..]].concat());
    }
    pslam_exits(2, &["record", "--source", "synthetic", "--color", "off", "--depth", "off", "-o", text(&log)]);
    pslam_exits(2, &["record", "--source", "none", "--librealsense", "x.so", "--udp", "127.0.0.1:0", "-o", text(&log)]);
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none(), "nothing was begun");
    pslam_exits(0, &[&SMALL[..], &["--reserve", "1M", "--duration", "700ms", "-o", text(&log)]].concat());
    let mut huge = Command::new(env!("CARGO_BIN_EXE_pslam"));
    huge.args(SMALL).args(["--reserve", "1M", "--duration", "27000h", "--force", "-o", text(&log)]);
    let mut huge = huge.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(huge.stdout.take().unwrap());
    next(&mut lines);
    assert!(Command::new("kill").args(["-INT", &huge.id().to_string()]).status().unwrap().success());
    assert_eq!(verdict(lines)["ended_by"]["kind"], "request");
    assert!(huge.wait().unwrap().code().is_some());
}

/// Nothing listens at the address: the length that was asked for holds all the same.
#[test]
fn a_motion_capture_system_that_never_answers() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let asked =
        ["record", "--source", "none", "--vicon", "127.0.0.1:1", "--duration", "1s", "--reserve", "1M", "--json"];
    let told = pslam_exits(1, &[&asked[..], &["-o", text(&log)]].concat());
    let verdict: Value = told.lines().filter_map(|line| serde_json::from_str(line).ok()).next_back().unwrap();
    assert_eq!(verdict["ended_by"]["kind"], "duration");
    assert!(says(&verdict, "mocap: nothing came"), "{verdict}");
}
