//! The command line: exit codes, JSON, refusals.

use crate::support::{pslam, pslam_exits, small_world, text, write_log};
use serde_json::Value;
use std::fs;

const COMMANDS: [&str; 14] = [
    "import", "export", "card", "info", "check", "recover", "config", "replay", "verify", "diff", "eval", "bench",
    "suite", "demo",
];

fn json(output: &str) -> Value {
    serde_json::from_str(output).unwrap_or_else(|e| panic!("{e}: {output}"))
}

#[test]
fn every_command_has_help() {
    let help = pslam_exits(0, &["--help"]);
    for code in ["  0  ", "  1  ", "  2  ", "  3  "] {
        assert!(help.contains(code), "exit code {code} is not documented");
    }
    for command in COMMANDS {
        assert!(help.contains(command), "{command}");
        assert!(pslam_exits(0, &[command, "--help"]).contains("Usage: pslam"), "{command}");
    }
    let ungrouped = panoptic_slam::help::command();
    assert_eq!(panoptic_slam::help::ungrouped(&ungrouped), [""; 0], "commands without a group in src/help.rs");
    assert!(pslam_exits(0, &["import", "tum", "--help"]).contains("--max-difference-ms"));
}

#[test]
fn senseless_requests_exit_with_2() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.toml");
    fs::write(&bad, "[tracking]\nno_such_key = 1\n").unwrap();
    let out = folder.path().join("out");
    for arguments in [
        vec!["nonsense"],
        vec!["info"],
        vec!["replay", "x.mcap", "-o", text(&out), "--frames", "5..5"],
        vec!["replay", "x.mcap", "-o", text(&out), "--threads", "0"],
        vec!["replay", "x.mcap", "-o", text(&out), "--config", text(&bad)],
        vec!["config", "--preset", "everything"],
        vec!["eval", text(&bad), text(&bad), "--rpe-delta", "5parsec"],
        vec!["import", "tum", ".", "-o", text(&out), "--preset", "kodak"],
        vec!["import", "tum", ".", "-o", text(&out), "--max-difference-ms", "NaN"],
        vec!["demo", "-o", text(folder.path())],
    ] {
        pslam_exits(2, &arguments);
    }
    assert!(!out.exists());
}

#[test]
fn missing_and_damaged_files_exit_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let garbage = folder.path().join("garbage.mcap");
    fs::write(&garbage, b"no log at all").unwrap();
    let out = folder.path().join("out");
    for file in ["/nonexistent/a.mcap", text(&garbage)] {
        for arguments in [
            vec!["info", file],
            vec!["check", file],
            vec!["recover", file, "-o", text(&out)],
            vec!["replay", file, "-o", text(&out)],
            vec!["bench", file],
            vec!["verify", file],
            vec!["diff", file, file],
            vec!["eval", file, file],
            vec!["import", "tum", file, "-o", text(&out)],
        ] {
            pslam_exits(3, &arguments);
        }
    }
    assert!(!out.exists());
}

#[test]
fn a_log_from_its_making_to_its_recovery() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (log, run, cut, saved) = (path("a.mcap"), path("run"), path("cut.mcap"), path("saved.mcap"));
    write_log(&small_world(12), &log, &mut |_| {});
    let (log, run) = (text(&log), text(&run));

    let info = json(&pslam_exits(0, &["info", log, "--json"]));
    assert_eq!((info["frames"].as_u64(), info["frames_with_depth"].as_u64()), (Some(12), Some(12)));
    assert_eq!(info["layers"][0]["masked_frames"].as_u64(), Some(12));
    assert!(pslam_exits(0, &["info", log]).contains("12 png pictures"));
    assert_eq!(json(&pslam_exits(0, &["check", log, "--json"]))["findings"], Value::Array(Vec::new()));

    let summary = json(&pslam_exits(0, &["replay", log, "-o", run, "--json"]));
    assert_eq!(summary["result"]["frames"].as_u64(), Some(12));
    pslam_exits(2, &["replay", log, "-o", run]);
    pslam_exits(0, &["replay", log, "-o", run, "--force"]);
    assert!(json(&pslam_exits(0, &["verify", run, "--json"]))["difference"].is_null());
    let evaluation = json(&pslam_exits(0, &["eval", run, "--json"]));
    assert!(evaluation["ate_m"]["rmse"].as_f64().unwrap() < 0.02, "{evaluation}");
    let plot = path("plot.svg");
    pslam_exits(0, &["eval", run, log, "--sim3", "--rpe-delta", "2f,0.01m", "--plot", text(&plot)]);
    assert!(fs::read_to_string(&plot).unwrap().starts_with("<svg"));
    pslam_exits(2, &["eval", run, log, "--plot", text(&plot)]);
    assert_eq!(json(&pslam_exits(0, &["bench", log, "--frames", "..5", "--json"]))["frames"].as_u64(), Some(5));

    let bytes = fs::read(log).unwrap();
    fs::write(&cut, &bytes[..bytes.len() * 2 / 3]).unwrap();
    pslam_exits(3, &["info", text(&cut)]);
    pslam_exits(1, &["check", text(&cut)]);
    assert_eq!(json(&pslam_exits(1, &["recover", text(&cut), "-o", text(&saved), "--json"]))["lossy"], true);
    pslam_exits(2, &["recover", text(&cut), "-o", text(&saved)]);
    pslam_exits(0, &["check", text(&saved)]);
    pslam_exits(3, &["replay", text(&cut), "-o", text(&path("never"))]);
}

#[test]
fn the_printed_configuration_is_the_default() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("c.toml");
    fs::write(&file, pslam_exits(0, &["config"])).unwrap();
    let from_file = pslam_exits(0, &["config", "--config", text(&file)]);
    assert_eq!(from_file, pslam_exits(0, &["config", "--preset", "full"]));
    assert_ne!(from_file, pslam_exits(0, &["config", "--preset", "none"]));
    assert!(pslam_exits(0, &["config", "--presets"]).lines().any(|line| line == "people+unknown"));
}

#[test]
fn a_reader_may_go_away() {
    let program = env!("CARGO_BIN_EXE_pslam");
    let output =
        std::process::Command::new("sh").args(["-c", &format!("'{program}' config | head -c 1")]).output().unwrap();
    assert!(output.status.success() && output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_demo_is_not_written_over_foreign_files() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("thesis.tex"), "years of work").unwrap();
    let output = pslam(&["demo", "-o", text(folder.path())]);
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}
