//! A dataset's folder: complete, consistent, the same bytes every time.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use replayer::card::{CardError, CardOptions, CardReport, Transport, card};
use sha2::{Digest, Sha256};
use support::{rgbd_log, stereo_log};

fn options() -> CardOptions {
    CardOptions {
        title: Some("Noise: \"two\" logs".to_owned()),
        license: Some("CC-BY-4.0".to_owned()),
        authors: vec!["A. Person".to_owned()],
        date: Some("2026-01-31".to_owned()),
        ..CardOptions::default()
    }
}

fn make(dir: &Path, out: &str, options: &CardOptions) -> Result<CardReport, CardError> {
    card(&[dir.join("a.mcap"), dir.join("b.mcap")], &dir.join(out), options, &mut |_, _| {})
}

fn logs() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    rgbd_log(&dir.path().join("a.mcap"), 5000);
    stereo_log(&dir.path().join("b.mcap"));
    dir
}

#[test]
fn the_card_tells_what_the_logs_hold() {
    let dir = logs();
    let report = make(dir.path(), "card", &options()).unwrap();
    let read = |name: &str| fs::read_to_string(dir.path().join("card").join(name)).unwrap();
    let [a, b] = report.logs.as_slice() else { panic!("two logs") };
    assert_eq!((a.camera_kind, a.frames, a.frames_with_depth), ("rgbd", 6, 5));
    assert_eq!((b.camera_kind, b.frames_with_right, b.inertial_messages), ("stereo", 3, 8));
    // 96 of 192 pixels are a wall's or nobody's; (9 of 12 rows are labelled).
    let share = |name: &str| a.classes.iter().find(|class| class.name == name).map(|class| (class.share, class.frames));
    assert_eq!(share("person"), Some((0.375, 5)));
    assert_eq!(share("void"), Some((0.25, 5)));
    assert!(a.depth_coverage.unwrap() > 0.99 && b.depth_coverage.is_none());
    assert!(a.known_issues.iter().any(|issue| issue.contains("mask")), "{:?}", a.known_issues);

    let readme = read("README.md");
    assert!(readme.starts_with("---\nlicense: cc-by-4.0\n"), "{readme}");
    for words in
        ["size_categories:\n- n<1K", "world_from_camera", "not redacted", "FILL IN: who is visible", "wall, \"brick\""]
    {
        assert!(readme.contains(words), "{words}:\n{readme}");
    }
    assert!(read("CITATION.cff").contains("date-released: \"2026-01-31\""));
    let croissant: serde_json::Value = serde_json::from_str(&read("croissant.json")).unwrap();
    let files: BTreeMap<&str, &str> = croissant["distribution"]
        .as_array()
        .unwrap()
        .iter()
        .map(|file| (file["@id"].as_str().unwrap(), file["sha256"].as_str().unwrap()))
        .collect();
    assert_eq!(files.len(), 6, "{files:?}");
    let sums = read("SHA256SUMS");
    assert_eq!(sums.lines().count(), report.files.len());
    for line in sums.lines() {
        let (sum, name) = line.split_once("  ").unwrap();
        let bytes = fs::read(dir.path().join("card").join(name)).unwrap();
        let found: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(found, sum, "{name}");
        assert!(files.get(name).is_none_or(|said| *said == sum), "{name}");
    }
    assert_eq!(read("frames.csv").lines().count(), 1 + 6 + 3);
}

#[test]
fn the_same_bytes_and_no_log_is_lost() {
    let dir = logs();
    make(dir.path(), "one", &options()).unwrap();
    let link = CardOptions { transport: Transport::HardLink, ..options() };
    make(dir.path(), "two", &link).unwrap();
    for name in ["README.md", "SHA256SUMS", "croissant.json", "statistics.json", "preview/a.png"] {
        let [one, two] = ["one", "two"].map(|folder| fs::read(dir.path().join(folder).join(name)).unwrap());
        assert!(one == two, "{name}");
    }
    let twice = [dir.path().join("a.mcap"), dir.path().join("one/logs/a.mcap")];
    let moves = CardOptions { transport: Transport::Move, ..options() };
    let error = card(&twice, &dir.path().join("three"), &moves, &mut |_, _| {}).unwrap_err();
    assert!(matches!(error, CardError::Refused(_)), "{error}");
    let error = make(dir.path(), "one", &moves).unwrap_err();
    assert!(error.to_string().contains("--force"), "{error}");
    assert!(dir.path().join("a.mcap").exists(), "a failed move moves nothing");
    make(dir.path(), "three", &moves).unwrap();
    assert!(!dir.path().join("a.mcap").exists() && dir.path().join("three/logs/a.mcap").exists());
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = logs();
    let bad = [
        CardOptions { date: Some("31.1.2026".to_owned()), ..options() },
        CardOptions { date: Some("2026-13-01".to_owned()), ..options() },
        CardOptions { title: Some("two\nlines".to_owned()), ..options() },
        CardOptions { authors: vec![String::new()], ..options() },
    ];
    for options in bad {
        assert!(matches!(make(dir.path(), "card", &options), Err(CardError::Refused(_))), "{options:?}");
    }
    let mut bytes = fs::read(dir.path().join("a.mcap")).unwrap();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 1;
    fs::write(dir.path().join("a.mcap"), bytes).unwrap();
    let error = make(dir.path(), "card", &options()).unwrap_err().to_string();
    assert!(error.contains("pslam check"), "{error}");
    let left = fs::read_dir(dir.path()).unwrap().count();
    assert_eq!(left, 2, "nothing but the logs");
}
