//! `pslam record` as a process: told to stop, killed, refused.

use crate::support::{pslam, pslam_exits, text, write_masks};
use recorder::sync::append_record;
use schemas::metadata;
use schemas::sync::{BodySync, Estimate, SyncRecord};
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Duration;

pub const SMALL: [&str; 9] =
    ["record", "--source", "synthetic", "--color", "160x120@30", "--depth", "160x120@30", "--imu", "--json"];

/// Starts a recording and waits until it says how it goes.
pub fn start(out: &Path, more: &[&str]) -> (Child, BufReader<ChildStdout>, serde_json::Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
    command.args(SMALL).args(["--reserve", "1M", "-o", text(out)]).args(more);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap());
    let first = next(&mut lines);
    (child, lines, first)
}

pub fn next(lines: &mut BufReader<ChildStdout>) -> serde_json::Value {
    let mut line = String::new();
    lines.read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|error| panic!("`{line}`: {error}"))
}

/// The last line.
pub fn verdict(mut lines: BufReader<ChildStdout>) -> serde_json::Value {
    loop {
        let line = next(&mut lines);
        if line["kind"] == "verdict" {
            return line;
        }
    }
}

pub fn counts(log: &Path) -> impl Fn(&str) -> u64 {
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
        let recovered = pslam(&["recover", &partial, "-o", text(&saved)]);
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

/// A simulated Vicon on this port (0: any free one), and its address.
pub fn start_sim(port: u16) -> (Child, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
    command.args(["sim", "vicon", "synthetic:tiny", "--subject", "quad", "--loop"]);
    command.args(["--listen", &format!("127.0.0.1:{port}")]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    (child, line.split(' ').nth(1).unwrap().to_owned())
}

#[test]
fn a_motion_capture_server_may_be_started_anew() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let (mut sim, address) = start_sim(0);
    let port = address.rsplit_once(':').unwrap().1.parse().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
    command.args(["record", "--source", "none", "--json", "--reserve", "1M", "--vicon", &address, "-o", text(&log)]);
    let mut recording = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(recording.stdout.take().unwrap());
    let received = |status: &serde_json::Value| status["streams"][0]["received"].as_u64().unwrap();
    let mut wait_for = |wanted: &dyn Fn(&serde_json::Value) -> bool| {
        let lines = std::iter::repeat_with(|| next(&mut lines));
        lines.take(60).find(wanted).expect("it happens within a minute")
    };
    let happened = |status: &serde_json::Value, name: &str| {
        status["happenings"].as_array().unwrap().iter().any(|happening| happening["name"] == name)
    };
    let before = received(&wait_for(&|status| received(status) > 20));
    sim.kill().unwrap();
    sim.wait().unwrap();
    wait_for(&|status| happened(status, "mocap.lost"));
    let (mut sim, _) = start_sim(port);
    wait_for(&|status| happened(status, "mocap.connected"));
    wait_for(&|status| received(status) > before + 20);
    assert!(Command::new("kill").args(["-TERM", &recording.id().to_string()]).status().unwrap().success());
    let verdict = verdict(lines);
    let output = recording.wait_with_output().unwrap();
    sim.kill().unwrap();
    sim.wait().unwrap();
    assert_eq!(output.status.code(), Some(1), "{verdict}");
    assert!(
        verdict["reasons"].as_array().unwrap().iter().any(|r| r.as_str().unwrap().starts_with("mocap was away for"))
    );
    assert!(String::from_utf8_lossy(&output.stderr).contains("mocap.lost"), "{output:?}");
    assert_eq!(counts(&log)("/mocap/frames"), verdict["streams"][0]["written"].as_u64().unwrap());
    // It says that it has no camera, and is judged by what it says it holds.
    let checked = pslam_exits(0, &["check", text(&log)]);
    assert!(checked.contains("Note: no pictures") && checked.contains("mocap.lost"), "{checked}");
    assert!(checked.contains("/mocap/frames") && checked.trim_end().ends_with("sound"), "{checked}");
    // With its motion capture taken out it holds nothing of what it says.
    let rest = folder.path().join("rest.mcap");
    pslam_exits(0, &["filter", text(&log), "-n", "/mocap/.*", "-n", "/tf", "-o", text(&rest)]);
    let checked = pslam_exits(1, &["check", text(&rest)]);
    assert!(checked.contains("Error: nothing recorded"), "{checked}");
}

#[test]
fn a_misspelt_subject_is_no_complete_recording() {
    let folder = tempfile::tempdir().unwrap();
    let (mut sim, address) = start_sim(0);
    let record = |name: &str, subject: &str| -> (Option<i32>, serde_json::Value) {
        let log = folder.path().join(name);
        let mut command = Command::new(env!("CARGO_BIN_EXE_pslam"));
        command.args(["record", "--source", "none", "--json", "--reserve", "1M", "--duration", "1s"]);
        command.args(["--vicon", &address, "--subject", subject, "-o", text(&log)]);
        let output = command.output().unwrap();
        let verdict = String::from_utf8_lossy(&output.stdout).lines().last().map(serde_json::from_str);
        (output.status.code(), verdict.unwrap().unwrap())
    };
    let (code, complete) = record("a.mcap", "quad");
    assert_eq!((code, &complete["reasons"]), (Some(0), &serde_json::json!([])));
    let (code, missing) = record("b.mcap", "qad");
    sim.kill().unwrap();
    sim.wait().unwrap();
    assert!(code == Some(1) && missing["streams"][0]["written"].as_u64().unwrap() > 20, "{missing}");
    let reasons = missing["reasons"].to_string();
    assert!(reasons.contains("nothing was ever seen") && reasons.contains("`qad` was never seen"), "{reasons}");
    let synced = pslam(&["sync", text(&folder.path().join("a.mcap")), "--no-poses", "--subject", "qad"]);
    let told = String::from_utf8_lossy(&synced.stderr);
    assert!(synced.status.code() == Some(2) && told.contains("no body `qad` was seen"), "{told}");
}

/// A second of mocap alone tells no offset: that must not hide the one of an earlier time.
#[test]
fn a_sync_that_finds_nothing_keeps_what_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let (mut sim, address) = start_sim(0);
    let mocap = ["record", "--source", "none", "--reserve", "1M", "--duration", "1s", "--vicon", &address];
    pslam_exits(0, &[&mocap, &["-o", text(&log)][..]].concat());
    sim.kill().unwrap();
    sim.wait().unwrap();
    let told = pslam_exits(1, &["sync", text(&log), "--no-poses"]);
    assert!(told.contains("written to"), "{told}");
    let earlier = SyncRecord {
        program: "earlier".to_owned(),
        method: String::new(),
        clocks: BTreeMap::new(),
        bodies: vec![BodySync {
            body: "quad/quad".to_owned(),
            windows: Vec::new(),
            camera_side: String::new(),
            offset: Estimate::Missing(String::new()),
            hand_eye: Estimate::Missing(String::new()),
        }],
        camera_body: Some("quad/quad".to_owned()),
    };
    append_record(&log, &log, metadata::SYNC, earlier.to_metadata(), false).unwrap();
    let before = fs::read(&log).unwrap();
    let told = pslam_exits(1, &["sync", text(&log), "--no-poses"]);
    assert!(told.contains("nothing is written: the log has an offset from an earlier time"), "{told}");
    assert_eq!(fs::read(&log).unwrap(), before);
}

#[test]
fn the_rendered_camera_has_one_size() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let sizes = ["--color", "64x48@30", "--depth", "32x24@30"];
    let refused = pslam(&[&["record", "--source", "synthetic", "-o", text(&log)], &sizes[..]].concat());
    let told = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(2) && told.contains("one size and rate"), "{told}");
    assert!(fs::read_dir(folder.path()).unwrap().next().is_none());
}

/// What a script with file systems of its own prints; `None` where such are not allowed.
fn mounted(script: &str) -> Option<std::process::Output> {
    let run = |script: &str| Command::new("unshare").args(["-rm", "bash", "-c", script]).output();
    if !run("mount -t tmpfs tmpfs /mnt").is_ok_and(|tried| tried.status.success()) {
        eprintln!("SKIPPED: no file system can be mounted here (unshare -rm)");
        return None;
    }
    Some(run(script).unwrap())
}

#[test]
fn a_full_disk_closes_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let (disk, kept) = (folder.path().join("disk"), folder.path().join("kept.mcap"));
    fs::create_dir(&disk).unwrap();
    let log = disk.join("a.mcap");
    let pslam = [&[env!("CARGO_BIN_EXE_pslam")], &SMALL[..], &["--reserve", "0", "--duration", "60", "-o", text(&log)]];
    let script = format!(
        "mount -t tmpfs -o size=4m tmpfs {disk} && {pslam}; code=$?; cp {log} {kept}; exit $code",
        disk = text(&disk),
        pslam = pslam.concat().join(" "),
        log = text(&log),
        kept = text(&kept),
    );
    let Some(output) = mounted(&script) else { return };
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap().to_owned();
    let verdict: serde_json::Value = serde_json::from_str(&last).unwrap();
    assert!(["reserve", "disk_full"].contains(&verdict["ended_by"]["kind"].as_str().unwrap()), "{last}");
    let checked = pslam_exits(0, &["check", text(&kept)]);
    assert!(checked.contains("sound") && counts(&kept)("/camera/gyro/sample") > 0, "{checked}");
}

#[test]
fn a_read_only_target_is_told_before_anything_else() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let pslam = [&[env!("CARGO_BIN_EXE_pslam")], &SMALL[..], &["--duration", "1", "-o", text(&log)]].concat().join(" ");
    let script = format!("mount -t tmpfs -o ro tmpfs {} && exec {pslam}", text(folder.path()));
    let Some(output) = mounted(&script) else { return };
    let said = String::from_utf8_lossy(&output.stderr).to_lowercase();
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    assert!(said.contains("a.mcap") && said.contains("read-only"), "{said}");
}

#[test]
fn labels_made_while_recording_are_what_a_replay_sees() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (log, masks) = (at("a.mcap"), at("masks"));
    // The masks of some pictures are missing, as those of a network that is too slow.
    write_masks(&masks, (160, 120), 400);
    (0..400)
        .filter(|number| number % 3 == 1)
        .for_each(|n| fs::remove_file(masks.join(format!("class/{n}.png"))).unwrap());
    let asked = ["--segment", "--masks", text(&masks), "--segment-lag", "30", "--duration", "3", "--reserve", "1M"];
    let output = pslam(&[&SMALL[..], &asked, &["-o", text(&log)]].concat());
    let last = String::from_utf8_lossy(&output.stdout).lines().last().unwrap().to_owned();
    let verdict: serde_json::Value = serde_json::from_str(&last).unwrap();
    let told = &verdict["segmentation"];
    let number = |name: &str| told[name].as_u64().unwrap_or_else(|| panic!("no {name} in {last}"));
    let outcomes = ["labelled", "skipped_busy", "skipped_late", "unlabelled", "failed", "ended"].map(number);
    assert_eq!(outcomes.iter().sum::<u64>(), number("pictures"), "{told}");
    assert!(number("labelled") > 0 && number("unlabelled") > 0 && number("failed") == 0, "{told}");
    let count = counts(&log);
    assert_eq!(count("/segmentation/network/class"), number("labelled"));
    assert_eq!(count("/recording/labels"), number("pictures"));
    let checked = pslam_exits(0, &["check", text(&log)]);
    assert!(checked.contains("sound") && !checked.contains("stamp_goes_back"), "{checked}");
    // A frame without labels is replayed as unknown, with a word in its report, and the same bits come again.
    let run = |name: &str, threads: &str| {
        pslam_exits(
            0,
            &["replay", text(&log), "-o", text(&at(name)), "--segmentation", "network", "--threads", threads],
        );
        let summary: serde_json::Value = serde_json::from_slice(&fs::read(at(name).join("run.json")).unwrap()).unwrap();
        summary["fingerprint"].as_str().unwrap().to_owned()
    };
    assert_eq!(run("one", "1"), run("two", "2"));
    pslam_exits(0, &["verify", text(&at("two"))]);
    // The labels count: without them it is another run.
    let none = at("none");
    pslam_exits(0, &["filter", text(&log), "-n", "/segmentation/.*", "-o", text(&at("bare.mcap"))]);
    pslam_exits(0, &["replay", text(&at("bare.mcap")), "-o", text(&none)]);
    assert_eq!(pslam(&["diff", text(&none), text(&at("one"))]).status.code(), Some(1));
}

#[test]
fn requests_that_make_no_sense() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("a.mcap");
    let out = text(&log);
    pslam_exits(2, &["record", "--source", "none", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--color", "big", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--flush-interval", "1ms", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--segment", "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--masks", text(folder.path()), "-o", out]);
    pslam_exits(2, &["record", "--source", "synthetic", "--segment-lag", "0", "--segment", "-o", out]);
    pslam_exits(3, &["record", "--librealsense", "/nowhere.so", "-o", out]);
    pslam_exits(3, &[&SMALL[..], &["--duration", "1", "-o", "/nowhere/a.mcap"]].concat());
    fs::write(&log, b"something").unwrap();
    pslam_exits(2, &[&SMALL[..], &["--duration", "1", "-o", out]].concat());
    assert_eq!(fs::read(&log).unwrap(), b"something");
}
