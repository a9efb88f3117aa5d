//! The file as a whole: same calls, same bytes; nothing overwritten; bad input refused.

use std::fs;

use rrd::{At, Points2d, Points3d, Rgba, RrdError, RrdWriter};

#[path = "../examples/everything.rs"]
#[allow(dead_code, reason = "the example's main is not called here")]
mod everything;

#[test]
fn same_calls_give_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] =
        ["a.rrd", "b.rrd"].map(|name| fs::read(everything::write(&dir.path().join(name), false).unwrap()).unwrap());
    assert!(a.len() > 20_000, "only {} bytes", a.len());
    assert!(a == b, "files of {} and {} bytes differ", a.len(), b.len());
    assert_eq!(&a[..4], b"RRF2");
}

#[test]
fn files_are_not_overwritten_without_force() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.rrd");
    fs::write(&path, b"precious").unwrap();
    assert!(matches!(RrdWriter::create(&path, "app", "rec", false), Err(RrdError::Exists { path: p }) if p == path));
    assert_eq!(fs::read(&path).unwrap(), b"precious");
    RrdWriter::create(&path, "app", "rec", true).unwrap().finish().unwrap();
    assert_eq!(&fs::read(&path).unwrap()[..4], b"RRF2");
}

#[test]
fn an_unfinished_file_keeps_its_temporary_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("run.rrd");
    let mut file = RrdWriter::create(&path, "app", "rec", false).unwrap();
    file.log("/a", At::Static, &Points3d { positions: &[[0.0; 3]], ..Points3d::default() }).unwrap();
    drop(file);
    assert!(!path.exists());
    let partial = dir.path().join("run.rrd.partial");
    assert!(partial.exists());
    assert!(matches!(RrdWriter::create(&path, "app", "rec", false), Err(RrdError::Exists { path: p }) if p == partial));
}

#[test]
fn an_unwritable_place_is_named() {
    let error = RrdWriter::create("/nowhere/at/all.rrd", "app", "rec", false).err().unwrap();
    assert!(error.to_string().contains("/nowhere/at/all.rrd.partial"), "{error}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_with_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let (path, partial) = (dir.path().join("run.rrd"), dir.path().join("run.rrd.partial"));
    std::os::unix::fs::symlink("/dev/full", &partial).unwrap();
    let mut file = RrdWriter::create(&path, "app", "rec", true).unwrap();
    let far = vec![[1.0; 3]; 1000];
    let points = Points3d { positions: &far, ..Points3d::default() };
    let written = (0..1000).try_for_each(|_| file.log("/a", At::Static, &points)).and_then(|()| file.finish());
    assert!(matches!(&written, Err(RrdError::Io { path, .. }) if *path == partial), "{written:?}");
    assert!(!path.exists());
}

#[test]
fn arrays_that_do_not_fit_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut file = RrdWriter::create(dir.path().join("run.rrd"), "app", "rec", false).unwrap();
    let colors: [Rgba; 2] = [[0; 4]; 2];
    let points = Points2d { positions: &[[0.0; 2]; 3], colors: &colors, ..Points2d::default() };
    let error = file.log("/image/points", At::Static, &points).unwrap_err();
    assert_eq!(error.to_string(), "/image/points: 2 colours given, expected 3");
    let mask = rrd::SegmentationImage {
        width: 4,
        height: 3,
        classes: rrd::ClassIds::U8(&[0; 11]),
        opacity: None,
        draw_order: None,
    };
    let error = file.log("/image/mask", At::Static, &mask).unwrap_err();
    assert_eq!(error.to_string(), "/image/mask: 11 pixels given, expected 12");
}
