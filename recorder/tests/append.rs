//! One more record in a closed log: nothing else changes, and every reader is content.

#![allow(clippy::unwrap_used, reason = "a test")]

use recorder::recover::recover;
use recorder::sync::append_record;
use recorder::{LogOptions, LogWriter, WriteError};
use schemas::Stamp;
use schemas::msg::{Header, PoseStamped};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

fn log(path: &Path) {
    let mut log = LogWriter::create(path, &LogOptions::default()).unwrap();
    for i in 0..1000 {
        let stamp = Stamp(1_000_000_000 + i * 10_000_000);
        let pose = PoseStamped { header: Header::new(stamp, "world").unwrap(), ..PoseStamped::default() };
        log.write("/ground_truth/pose", stamp, &pose).unwrap();
        log.flush_if_due(stamp).unwrap();
    }
    log.metadata("pslam/source", BTreeMap::from([("kind".to_owned(), "test".to_owned())])).unwrap();
    log.finish().unwrap();
}

fn values(text: &str) -> BTreeMap<String, String> {
    BTreeMap::from([("report".to_owned(), text.to_owned())])
}

/// Log time and bytes of every message, with all checksums verified.
fn messages(path: &Path) -> Vec<(u64, Vec<u8>)> {
    let bytes = fs::read(path).unwrap();
    mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap()).map(|m| (m.log_time, m.data.to_vec())).collect()
}

fn named(path: &Path, name: &str) -> Vec<BTreeMap<String, String>> {
    let bytes = fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let found = summary.metadata_indexes.iter().filter(|index| index.name == name);
    let stats = summary.stats.as_ref().unwrap();
    assert_eq!(stats.metadata_count as usize, summary.metadata_indexes.len(), "the statistics count the record");
    found.map(|index| mcap::read::metadata(&bytes, index).unwrap().metadata).collect()
}

#[test]
fn a_record_is_added_and_nothing_else_changes() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    log(&source);
    append_record(&source, &out, "pslam/sync", values("one"), false).unwrap();
    // In place, and a second time.
    append_record(&out, &out, "pslam/sync", values("two"), false).unwrap();
    assert_eq!(messages(&out), messages(&source));
    let records = named(&out, "pslam/sync");
    assert_eq!(records.iter().map(|r| r["report"].as_str()).collect::<Vec<_>>(), ["one", "two"]);
    assert!(records.iter().all(|r| schemas::metadata::verify("pslam/sync", r) == Some(true)));
    assert_eq!(named(&out, "pslam/source").len(), 1);
    // The strictest reader we have: every checksum, every count.
    let report = recover(&out, &folder.path().join("c.mcap"), false).unwrap();
    assert!(!report.lossy, "{report:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "no temporary file is left");
}

#[test]
fn what_is_no_closed_log_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (source, out) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    log(&source);
    let whole = fs::read(&source).unwrap();
    for length in [0, 10, whole.len() / 2, whole.len() - 1] {
        let cut = folder.path().join("cut.mcap");
        fs::write(&cut, &whole[..length]).unwrap();
        let error = append_record(&cut, &cut, "pslam/sync", values("x"), false).unwrap_err();
        assert!(error.to_string().contains("recover"), "{error}");
        assert_eq!(fs::read(&cut).unwrap(), whole[..length]);
    }
    // A footer that points anywhere else.
    let at = whole.len() - 8 - 20;
    for start in [0u64, 1, u64::MAX, whole.len() as u64] {
        let mut bytes = whole.clone();
        bytes[at..at + 8].copy_from_slice(&start.to_le_bytes());
        fs::write(&out, &bytes).unwrap();
        assert!(append_record(&out, &out, "pslam/sync", values("x"), false).is_err(), "{start}");
    }
    assert!(matches!(append_record(&source, &out, "pslam/sync", values("x"), false), Err(WriteError::Exists(_))));
}
