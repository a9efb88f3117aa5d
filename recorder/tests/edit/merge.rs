//! Several logs to one.

use crate::support::{Content, picture_stamp, write_log};
use recorder::edit::{Cut, EditError, EditOptions, EditSummary, Filter, LayerNames, merge, rewrite, slice};
use recorder::recover::recover;
use schemas::msg::SegmentTable;
use schemas::{Message, topics};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

fn merged(sources: &[&Path], out: &Path, layers: &LayerNames) -> Result<EditSummary, EditError> {
    merge(sources, out, layers, &EditOptions::new("merge", BTreeMap::new()), &mut |_, _| {})
}

fn filtered(source: &Path, out: &Path, keeps: &dyn Fn(&str) -> bool) {
    rewrite(source, out, &EditOptions::new("filter", BTreeMap::new()), &mut Filter { keeps }, &mut |_, _| {}).unwrap();
}

fn cut(source: &Path, out: &Path, frames: std::ops::Range<usize>) {
    let options = EditOptions::new("slice", BTreeMap::new());
    slice(source, out, (&Cut::Frames(frames), 50_000_000), &|_| true, &options, &mut |_, _| {}).unwrap();
}

fn paths(folder: &tempfile::TempDir) -> [PathBuf; 5] {
    ["a", "b", "c", "d", "e"].map(|name| folder.path().join(name))
}

/// Messages by topic, whatever number they have.
fn by_topic(content: &Content) -> BTreeMap<String, Vec<(i64, Vec<u8>)>> {
    let mut topics = BTreeMap::<_, Vec<_>>::new();
    for (topic, _, time, _, data) in &content.messages {
        topics.entry(topic.clone()).or_default().push((*time, data.clone()));
    }
    topics
}

#[test]
fn topics_of_one_moment_come_together_again() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c, d, e] = paths(&folder);
    write_log(&a);
    filtered(&a, &b, &|topic| !topic.contains("depth"));
    filtered(&a, &c, &|topic| topic.contains("depth"));
    let summary = merged(&[&b, &c], &d, &LayerNames::new()).unwrap();
    let [whole, again] = [&a, &d].map(|path| Content::read(path));
    assert_eq!(by_topic(&whole), by_topic(&again));
    assert_eq!(again.attachments, whole.attachments);
    let times: Vec<i64> = again.messages.iter().map(|m| m.2).collect();
    assert!(times.is_sorted());
    assert_eq!(again.record("pslam/source"), whole.record("pslam/source"));
    // What both say stands there once; both filters and the merge are told.
    assert_eq!(again.metadata.iter().filter(|(name, _)| name == "pslam/source").count(), 1);
    assert_eq!(again.record("pslam/provenance/3").unwrap()["operation"], "merge");
    assert_eq!(again.record("pslam/provenance/3").unwrap()["source/1/blake3"], summary.sources[1].blake3);
    assert!(!recover(&d, &e, false).unwrap().lossy);
}

#[test]
fn pieces_that_overlap_come_together_again() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c, d, _] = paths(&folder);
    write_log(&a);
    cut(&a, &b, 0..7);
    cut(&a, &c, 5..12);
    let summary = merged(&[&b, &c], &d, &LayerNames::new()).unwrap();
    let [whole, again] = [&a, &d].map(|path| by_topic(&Content::read(path)));
    for topic in [topics::COLOR, topics::DEPTH, "/segmentation/panoptic/class", "/segmentation/panoptic/categories"] {
        assert_eq!(whole[topic], again[topic], "{topic}");
    }
    assert_eq!(summary.topics[topics::COLOR].dropped, 2, "frames 5 and 6 were in both");
    let numbers: Vec<u32> = Content::read(&d).on(topics::COLOR).map(|m| m.1).collect();
    assert_eq!(numbers, (0..12).collect::<Vec<_>>());
}

#[test]
fn layers_get_other_names_also_inside() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c, ..] = paths(&folder);
    write_log(&a);
    filtered(&a, &b, &|topic| topics::layer_of(topic).is_some());
    let names = LayerNames::from([((1, "panoptic".to_owned()), "other".to_owned())]);
    merged(&[&a, &b], &c, &names).unwrap();
    let content = Content::read(&c);
    let (old, new) = ("/segmentation/panoptic/class", "/segmentation/other/class");
    let data = |topic: &'static str| content.on(topic).map(|m| m.4.clone()).collect::<Vec<_>>();
    assert_eq!(data(old), data(new));
    let table = content.on("/segmentation/other/segments").next().unwrap();
    assert_eq!(SegmentTable::decode(&table.4).unwrap().layer, "other");
    let record = content.record("pslam/segmentation/other").unwrap();
    assert_eq!(schemas::metadata::verify("pslam/segmentation/other", record), Some(true));
    assert!(content.record("pslam/segmentation/panoptic").is_some());
    let unknown = LayerNames::from([((1, "no_such".to_owned()), "other".to_owned())]);
    let error = merged(&[&a, &b], &folder.path().join("f"), &unknown).unwrap_err();
    assert!(error.to_string().contains("no_such"), "{error}");
}

#[test]
fn contradictions_are_refused_with_the_log_and_the_topic() {
    use recorder::{LogOptions, RgbdLog, RgbdSpec};
    use schemas::calibration::{CameraModel, Preset};
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c, d, e] = paths(&folder);
    write_log(&a);
    let write = |path: &Path, camera: CameraModel, units: &str, frame: i64| {
        let spec = RgbdSpec { depth_units_per_metre: units.to_owned(), ..RgbdSpec::new("test", "other", camera) };
        let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
        log.color(picture_stamp(frame), "png", &[1, 2, 3]).unwrap();
        log.finish().unwrap();
    };
    let camera =
        CameraModel { width: crate::support::WIDTH, height: crate::support::HEIGHT, ..Preset::Freiburg3.camera() };
    // Another picture of the same moment, another camera, another scale.
    write(&b, camera, "5000", 3);
    write(&c, CameraModel { fx: 100.0, ..camera }, "5000", 50);
    write(&d, camera, "1000", 50);
    for (other, part) in [(&b, topics::COLOR), (&c, topics::COLOR_INFO), (&d, "")] {
        let error = merged(&[&a, other], &e, &LayerNames::new()).unwrap_err();
        let said = error.to_string();
        assert!(matches!(error, EditError::Refused(_)) && said.contains(part), "{said}");
        assert!(!e.exists());
    }
    assert!(matches!(merged(&[&a], &e, &LayerNames::new()), Err(EditError::Refused(_))));
    // What only describes is kept beside.
    let far = folder.path().join("far");
    write(&far, camera, "5000", 50);
    merged(&[&a, &far], &e, &LayerNames::new()).unwrap();
    let content = Content::read(&e);
    assert_eq!(content.record("pslam/source").unwrap()["name"], "small");
    assert_eq!(content.record("pslam/source/merged/2").unwrap()["name"], "other");
}
