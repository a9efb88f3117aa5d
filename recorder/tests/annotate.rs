//! A log gets one more segmentation layer.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use recorder::annotate::{AnnotateOptions, Annotated, annotate, is_annotated};
use recorder::edit::{Item, Source};
use recorder::picture::encode_rgb8;
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{Category, Segment};
use segment::{Picture, SegmentError, Segmenter};
use std::collections::BTreeMap;
use std::fs;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

const PICTURES: usize = 12;

fn log(path: &Path) {
    let model = CameraModel { width: 4, height: 2, fx: 4.0, fy: 4.0, cx: 2.0, cy: 1.0, distortion: Distortion::None };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &RgbdSpec::new("test", "pictures", model)).unwrap();
    for number in 0..PICTURES {
        let stamp = Stamp(number as i64 * 1_000_000_000);
        log.color(stamp, "png", &encode_rgb8(4, 2, &[number as u8; 24]).unwrap()).unwrap();
        log.depth(stamp, &[5000; 8]).unwrap();
    }
    log.finish().unwrap();
}

/// Labels as many pixels as the picture's grey level says; none in the sixth picture; an error at `fails_at`.
struct Counting<'a> {
    categories: Vec<Category>,
    fails_at: usize,
    asked: &'a AtomicUsize,
}

impl Segmenter for Counting<'_> {
    fn segment(&mut self, picture: &Picture) -> Result<Option<Mask>, SegmentError> {
        self.asked.fetch_add(1, Ordering::Relaxed);
        let level = usize::from(picture.rgb[0]);
        if picture.index == self.fails_at {
            return Err(SegmentError::Picture("out of paint".to_owned()));
        }
        let area = level.min(8);
        let instance: Vec<u16> = (0..8).map(|at| u16::from(at < area)).collect();
        let segment = Segment { id: 1, category_id: 1, score: 0.5, area: area as u32, ..Segment::default() };
        let mask = Mask { class: instance.clone(), instance, segments: vec![segment] };
        Ok((level != 5).then_some(mask))
    }

    fn categories(&self) -> &[Category] {
        &self.categories
    }
}

fn options(threads: usize) -> AnnotateOptions {
    let categories = vec![Category { id: 1, name: "paint".to_owned(), is_thing: true }];
    AnnotateOptions {
        layer: LayerSpec { name: "paint".to_owned(), origin: "grey levels".to_owned(), categories },
        record: BTreeMap::from([("model/0/blake3".to_owned(), "00".to_owned())]),
        time: None,
        limit: None,
        threads: NonZeroUsize::new(threads).unwrap(),
        log: LogOptions::default(),
    }
}

/// Also how many pictures were labelled.
fn run(folder: &Path, out: &str, threads: usize, fails_at: usize) -> (Result<Annotated, String>, usize) {
    static ASKED: [AtomicUsize; 16] = [const { AtomicUsize::new(0) }; 16];
    static NEXT: AtomicUsize = AtomicUsize::new(0);
    let asked = &ASKED[NEXT.fetch_add(1, Ordering::Relaxed)];
    let options = options(threads);
    let categories = options.layer.categories.clone();
    let make = || Ok(Box::new(Counting { categories: categories.clone(), fails_at, asked }) as Box<dyn Segmenter>);
    let done = annotate(&folder.join("log.mcap"), &folder.join(out), &options, &make, &mut |_, _| {});
    (done.map_err(|error| error.to_string()), asked.load(Ordering::Relaxed))
}

#[test]
fn any_number_of_threads_and_interruptions_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    log(&at("log.mcap"));
    let one = run(folder.path(), "one.mcap", 1, PICTURES).0.unwrap();
    assert_eq!((one.pictures, one.labelled, one.resumed), (12, 11, 0));
    let four = run(folder.path(), "four.mcap", 4, PICTURES).0.unwrap();
    assert_eq!(four.labels_blake3, one.labels_blake3);
    assert_eq!(fs::read(at("four.mcap")).unwrap(), fs::read(at("one.mcap")).unwrap());

    let error = run(folder.path(), "cut.mcap", 1, 7).0.unwrap_err();
    assert!(error.contains("log.mcap: picture 7 at 7.000000000 s: out of paint"), "{error}");
    assert!(!at("cut.mcap").exists());
    let (cut, asked) = run(folder.path(), "cut.mcap", 2, PICTURES);
    assert_eq!((cut.unwrap().resumed, asked), (7, 5));
    assert_eq!(fs::read(at("cut.mcap")).unwrap(), fs::read(at("one.mcap")).unwrap());
    assert!(!at("cut.mcap.labels").exists());

    assert!(is_annotated(&at("log.mcap"), &at("one.mcap"), &options(1)).unwrap());
    let mut other = options(1);
    other.record.insert("model/0/blake3".to_owned(), "01".to_owned());
    assert!(!is_annotated(&at("log.mcap"), &at("one.mcap"), &other).unwrap());
    let error = run(folder.path(), "one.mcap", 1, PICTURES).0.unwrap_err();
    assert!(error.contains("one.mcap"), "{error}");
}

#[test]
fn labels_follow_their_picture_and_the_rest_is_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    log(&folder.path().join("log.mcap"));
    run(folder.path(), "out.mcap", 2, PICTURES).0.unwrap();
    let read = |name: &str| {
        let mut source = Source::open(&folder.path().join(name)).unwrap();
        let mut messages = Vec::new();
        while let Some(item) = source.next().unwrap() {
            if let Item::Message(m) = item {
                messages.push((m.topic().to_owned(), m.log_time, m.sequence, m.data.to_vec()));
            }
        }
        messages
    };
    let (before, after) = (read("log.mcap"), read("out.mcap"));
    let (labels, rest): (Vec<_>, Vec<_>) =
        after.into_iter().partition(|(topic, ..)| topic.starts_with("/segmentation/"));
    assert_eq!(rest, before);
    assert_eq!(labels.len(), 2 + 3 * 11, "one table twice, three messages a labelled picture");
    let classes: Vec<i64> = labels
        .iter()
        .filter(|(topic, ..)| topic.ends_with("/class"))
        .map(|(_, stamp, ..)| stamp.0 / 1_000_000_000)
        .collect();
    assert_eq!(classes, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]);

    let again = folder.path().join("again");
    fs::create_dir(&again).unwrap();
    fs::rename(folder.path().join("out.mcap"), again.join("log.mcap")).unwrap();
    let error = run(&again, "out.mcap", 1, PICTURES).0.unwrap_err();
    assert!(error.contains("layer `paint` already"), "{error}");
}
