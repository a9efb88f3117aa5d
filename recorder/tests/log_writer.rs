//! What a log writer refuses.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use recorder::{LayerSpec, LogOptions, LogWriter, Mask, RgbdLog, RgbdSpec, WriteError};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Preset};
use schemas::msg::{Category, Header, Image, PoseStamped, encoding};
use schemas::topics;
use std::fs;

fn camera() -> CameraModel {
    CameraModel { width: 2, height: 1, ..Preset::Freiburg3.camera() }
}

#[test]
fn messages_come_in_order_on_their_own_topics() {
    let dir = tempfile::tempdir().unwrap();
    let mut log = LogWriter::create(&dir.path().join("a.mcap"), &LogOptions::default()).unwrap();
    let pose = PoseStamped::default();
    log.write(topics::GROUND_TRUTH, Stamp(5), &pose).unwrap();
    log.write(topics::GROUND_TRUTH, Stamp(5), &pose).unwrap();
    let early = log.write(topics::GROUND_TRUTH, Stamp(4), &pose);
    assert!(matches!(early, Err(WriteError::OutOfOrder { stamp: Stamp(4), last: Stamp(5), .. })));
    let image = Image::from_u16(Header::default(), encoding::DEPTH, 1, &[1]);
    assert!(matches!(log.write(topics::GROUND_TRUTH, Stamp(6), &image), Err(WriteError::Type { .. })));
    assert!(matches!(log.write(topics::COLOR, Stamp(6), &image), Err(WriteError::Type { .. })));
    // A topic outside the conventions takes any type, but only one.
    log.write("/extra", Stamp(6), &image).unwrap();
    assert!(matches!(log.write("/extra", Stamp(6), &pose), Err(WriteError::Type { .. })));
    log.finish().unwrap();
    let bytes = fs::read(dir.path().join("a.mcap")).unwrap();
    let sequences: Vec<(String, u32)> = mcap::MessageStream::new(&bytes)
        .unwrap()
        .map(|message| message.map(|message| (message.channel.topic.clone(), message.sequence)).unwrap())
        .collect();
    let expected = [(topics::GROUND_TRUTH, 0), (topics::GROUND_TRUTH, 1), ("/extra", 0)];
    assert_eq!(sequences, expected.map(|(topic, sequence)| (topic.to_owned(), sequence)));
}

#[test]
fn stamps_that_ros_cannot_tell_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let spec = RgbdSpec::new("test", "stamps", camera());
    let mut log = RgbdLog::create(&dir.path().join("a.mcap"), &LogOptions::default(), &spec).unwrap();
    for stamp in
        [Stamp(-1), Stamp(i64::MIN), Stamp(i64::MAX), Stamp(i64::from(i32::MAX) * 1_000_000_000 + 1_000_000_000)]
    {
        assert!(matches!(log.depth(stamp, &[1, 2]), Err(WriteError::Stamp(_))), "{stamp}");
    }
    log.discard();
}

#[test]
fn masks_and_specs_are_checked() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mcap");
    let layer = |name: &str, ids: &[u16]| LayerSpec {
        name: name.to_owned(),
        origin: "test".to_owned(),
        categories: ids.iter().map(|id| Category { id: *id, ..Category::default() }).collect(),
    };
    let create = |camera: CameraModel, layers: Vec<LayerSpec>| {
        let spec = RgbdSpec { layers, ..RgbdSpec::new("test", "masks", camera) };
        RgbdLog::create(&path, &LogOptions::default(), &spec)
    };
    for layers in
        [vec![layer("a/b", &[1])], vec![layer("a", &[0])], vec![layer("a", &[3, 3])], vec![layer("a", &[1]); 2]]
    {
        assert!(matches!(create(camera(), layers), Err(WriteError::Invalid(_))));
    }
    assert!(matches!(create(CameraModel { fx: f64::NAN, ..camera() }, Vec::new()), Err(WriteError::Invalid(_))));
    assert!(!path.with_extension("mcap.partial").exists(), "a refused spec leaves no file");

    let mut log = create(camera(), vec![layer("a", &[1])]).unwrap();
    let mask = |class: &[u16]| Mask { class: class.to_vec(), instance: class.to_vec(), segments: Vec::new() };
    log.mask(0, Stamp(1), &mask(&[0, 1])).unwrap();
    assert!(matches!(log.mask(0, Stamp(1), &mask(&[0])), Err(WriteError::Pixels { found: 1, .. })));
    assert!(matches!(log.mask(0, Stamp(1), &mask(&[0, 300])), Err(WriteError::Invalid(_))));
    assert!(matches!(log.mask(1, Stamp(1), &mask(&[0, 1])), Err(WriteError::Invalid(_))));
    assert!(matches!(log.depth(Stamp(1), &[1; 3]), Err(WriteError::Pixels { .. })));
    log.finish().unwrap();
}
