//! Logs go out as folders of other programs' layouts and come back equal, message by message.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use recorder::import::{BagOptions, EurocOptions, PanopticSource, TumOptions, euroc, png as import_png, rosbag2, tum};
use replayer::export::{ExportError, ExportOptions, ExportReport, Format, export};
use schemas::topics::{self, LayerTopics};
use support::{Messages, messages, rgbd_log, stereo_log};

fn out(log: &Path, folder: &Path, format: Format) -> ExportReport {
    export(log, folder, format, &ExportOptions::default(), &mut |_, _| {}).unwrap()
}

/// Fails with the first topic that differs; `lost` may be missing in the second log.
fn same(before: &Path, after: &Path, lost: &[&str]) {
    let (before, mut after) = (messages(before), messages(after));
    let before: Messages = before.into_iter().filter(|(topic, _)| !lost.contains(&topic.as_str())).collect();
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    for (topic, expected) in before {
        assert!(!expected.is_empty());
        assert!(after.remove(&topic).unwrap() == expected, "{topic} differs");
    }
}

fn panoptic(folder: &Path) -> Vec<PanopticSource> {
    let second = PanopticSource { layer: "exact".to_owned(), ..PanopticSource::new(&folder.join("panoptic_exact")) };
    // In the order of their names, as the log's topics are compared.
    vec![PanopticSource::new(&folder.join("panoptic")), second]
}

fn back_from_tum(folder: &Path, labels: &Path, log: &Path) {
    let options = TumOptions { panoptic: panoptic(labels), ..TumOptions::default() };
    let report = tum(folder, log, &options, &mut |_, _| {}).unwrap();
    let repaired: Vec<&String> = report.repairs.keys().filter(|what| !what.contains("without a mask")).collect();
    assert!(repaired.is_empty(), "{repaired:?}");
}

#[test]
fn colour_and_depth_come_back_equal() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let log = at("a.mcap");
    rgbd_log(&log, 5000);

    let report = out(&log, &at("tum"), Format::Tum);
    assert_eq!((report.pictures, report.depth_images, report.ground_truth_poses), (6, 6, 7));
    assert_eq!(report.masks, BTreeMap::from([("exact".to_owned(), 6), ("panoptic".to_owned(), 5)]));
    assert_eq!(report.left_out, BTreeMap::new());
    back_from_tum(&at("tum"), &at("tum"), &at("tum.mcap"));
    same(&log, &at("tum.mcap"), &[]);
    let lists = fs::read_to_string(at("tum/associations.txt")).unwrap();
    assert_eq!(lists.lines().count(), 5, "the last depth image is too far from any picture");

    out(&log, &at("bonn"), Format::Bonn);
    back_from_tum(&at("bonn"), &at("bonn"), &at("bonn.mcap"));
    same(&log, &at("bonn.mcap"), &[]);

    out(&log, &at("coco"), Format::CocoPanoptic);
    back_from_tum(&at("tum"), &at("coco"), &at("coco.mcap"));
    same(&log, &at("coco.mcap"), &[]);

    out(&log, &at("png"), Format::Png);
    import_png(&at("png"), &at("png.mcap"), false, &mut |_, _| {}).unwrap();
    same(&log, &at("png.mcap"), &[]);

    let report = out(&log, &at("euroc"), Format::Euroc);
    assert_eq!(report.left_out, BTreeMap::from([(topics::DEPTH.to_owned(), 6)]), "told, not silently lost");
    let options = EurocOptions { panoptic: panoptic(&at("euroc")), ..EurocOptions::default() };
    euroc(&at("euroc"), &at("euroc.mcap"), &options, &mut |_, _| {}).unwrap();
    same(&log, &at("euroc.mcap"), &[topics::DEPTH, topics::DEPTH_INFO]);

    out(&log, &at("bag"), Format::Rosbag2);
    let report = rosbag2(&at("bag"), &at("bag.mcap"), &BagOptions::default(), &mut |_, _| {}).unwrap();
    assert!(report.same_bytes);
    assert!(fs::read(&log).unwrap() == fs::read(at("bag.mcap")).unwrap());
}

#[test]
fn a_pair_comes_back_equal_with_its_rectification() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let log = at("a.mcap");
    stereo_log(&log);
    let report = out(&log, &at("euroc"), Format::Euroc);
    assert_eq!((report.pictures, report.right_pictures, report.imu_rows), (3, 3, 8));
    assert_eq!(report.left_out, BTreeMap::new());
    euroc(&at("euroc"), &at("euroc.mcap"), &EurocOptions::default(), &mut |_, _| {}).unwrap();
    same(&log, &at("euroc.mcap"), &[]);
    // Where the right camera stands, for programs that do not know our matrices.
    let yaml = fs::read_to_string(at("euroc/mav0/cam1/sensor.yaml")).unwrap();
    let place = yaml.split_once("data: [").unwrap().1.split_once(']').unwrap().0;
    let place: Vec<f64> = place.split(',').map(|v| v.trim().parse().unwrap()).collect();
    assert!((place[3] - 0.11).abs() < 1e-12 && place[7].abs() < 1e-12, "{place:?}");
    assert!((place[0] - 0.9998).abs() < 1e-4 && (place[2] - 0.02).abs() < 1e-4, "{place:?}");

    out(&log, &at("png"), Format::Png);
    import_png(&at("png"), &at("png.mcap"), false, &mut |_, _| {}).unwrap();
    same(&log, &at("png.mcap"), &[]);
    let refused = export(&log, &at("tum"), Format::Tum, &ExportOptions::default(), &mut |_, _| {}).unwrap_err();
    assert!(matches!(refused, ExportError::Refused(_)), "{refused}");
    assert!(!at("tum").exists() && !at("tum.partial").exists());
}

#[test]
fn a_part_in_another_scale() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let log = at("a.mcap");
    rgbd_log(&log, 1000);
    let options = ExportOptions {
        layers: Some(vec!["exact".to_owned()]),
        frames: Some(1..3),
        depth_units_per_metre: Some(5000.0),
        force: false,
    };
    let report = export(&log, &at("part"), Format::Tum, &options, &mut |_, _| {}).unwrap();
    assert_eq!((report.pictures, report.depth_images, report.masks.len()), (2, 2, 1));
    assert_eq!(report.depth_units_per_metre, Some(5000.0));
    assert_eq!(report.left_out[LayerTopics::new("panoptic").class.as_str()], 5);
    tum(&at("part"), &at("part.mcap"), &TumOptions::default(), &mut |_, _| {}).unwrap();
    let depth = |log: &Path| support::depths(log);
    let (before, after) = (depth(&log), depth(&at("part.mcap")));
    assert_eq!(after.len(), 2);
    let mut too_far = 0;
    for (stamp, units) in &after {
        for (a, b) in before[stamp].iter().zip(units) {
            let fits = u32::from(*a) * 5 <= u32::from(u16::MAX);
            too_far += usize::from(!fits);
            assert_eq!(u32::from(*b), if fits { u32::from(*a) * 5 } else { 0 });
        }
    }
    let lost = report.left_out.iter().find(|(what, _)| what.contains("16 bits")).map(|(_, count)| *count);
    assert_eq!(lost, Some(too_far).filter(|n| *n > 0));
    for (frames, layers) in [(Some(9..12), None), (None, Some(vec!["nothing".to_owned()]))] {
        let options = ExportOptions { frames, layers, ..ExportOptions::default() };
        let error = export(&log, &at("none"), Format::Tum, &options, &mut |_, _| {}).unwrap_err().to_string();
        assert!(error.contains("6") || error.contains("panoptic"), "{error}");
    }
    let options = ExportOptions { frames: Some(0..1), ..ExportOptions::default() };
    assert!(export(&log, &at("none"), Format::Rosbag2, &options, &mut |_, _| {}).is_err(), "a bag is whole");
    assert!(!at("none").exists());
}

/// All files under a folder with their bytes.
fn tree(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(tree(&path).into_iter().map(|(name, bytes)| (path.join(name), bytes)));
        } else {
            files.insert(path.file_name().unwrap().into(), fs::read(&path).unwrap());
        }
    }
    files.into_iter().map(|(path, bytes)| (path.strip_prefix(folder).unwrap_or(&path).to_owned(), bytes)).collect()
}

#[test]
fn the_same_log_gives_the_same_folder_and_nothing_is_replaced_by_mistake() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let log = at("a.mcap");
    rgbd_log(&log, 5000);
    for format in [Format::Tum, Format::Euroc, Format::Rosbag2, Format::CocoPanoptic, Format::Png] {
        let (one, two) = (at("one"), at("two"));
        out(&log, &one, format);
        out(&log, &two, format);
        assert!(tree(&one) == tree(&two), "{format:?}");
        assert!(tree(&one).len() > 2);
        let again =
            |force| export(&log, &two, format, &ExportOptions { force, ..ExportOptions::default() }, &mut |_, _| {});
        assert!(again(false).unwrap_err().to_string().contains("--force"));
        again(true).unwrap();
        assert!(tree(&one) == tree(&two), "{format:?}");
        fs::remove_dir_all(one).unwrap();
        fs::remove_dir_all(two).unwrap();
    }
    fs::create_dir(at("mine")).unwrap();
    fs::write(at("mine/thesis.txt"), "years of work").unwrap();
    let options = ExportOptions { force: true, ..ExportOptions::default() };
    let error = export(&log, &at("mine"), Format::Png, &options, &mut |_, _| {}).unwrap_err().to_string();
    assert!(error.contains("export.json") && at("mine/thesis.txt").exists(), "{error}");
}

#[test]
fn a_damaged_log_leaves_nothing_behind() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    rgbd_log(&at("a.mcap"), 5000);
    let mut bytes = fs::read(at("a.mcap")).unwrap();
    bytes.truncate(bytes.len() / 2);
    fs::write(at("cut.mcap"), bytes).unwrap();
    for format in [Format::Tum, Format::Rosbag2] {
        let error = export(&at("cut.mcap"), &at("out"), format, &ExportOptions::default(), &mut |_, _| {}).unwrap_err();
        assert!(error.to_string().contains("cut.mcap"), "{error}");
    }
    let left: Vec<_> = fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}
