//! Labels that are made while a recording runs, by somebody who is slower than the camera.

use crate::support::{HEIGHT, Recording, WIDTH, options, run, sample, setup};
use recorder::LayerSpec;
use recorder::capture::{End, Inlet, LabelCounts, Labelling, RecordError, RecordOptions, SystemClock, record};
use recorder::realsense::StreamKind;
use schemas::msg::{Category, CategoryTable, Image, LabelRecord, NOT_TOLD, Segment};
use schemas::{Message, Stamp, topics};
use segment::{Mask, Picture, SegmentError, Segmenter};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};

/// Tells which picture it has taken and labels it when it is told to.
struct Slow {
    categories: Vec<Category>,
    took: Sender<usize>,
    go: Receiver<Answer>,
}

#[derive(Clone, Copy)]
enum Answer {
    Mask,
    Nothing,
    Error,
    /// A category that the table does not have room for.
    Foreign,
}

fn mask(class: u16) -> Mask {
    let pixels = (WIDTH * HEIGHT) as usize;
    let segment = Segment { id: 1, category_id: class, area: pixels as u32, ..Segment::default() };
    Mask { class: vec![class; pixels], instance: vec![1; pixels], segments: vec![segment] }
}

impl Segmenter for Slow {
    fn segment(&mut self, picture: &Picture) -> Result<Option<Mask>, SegmentError> {
        assert_eq!((picture.width, picture.height), (WIDTH as usize, HEIGHT as usize));
        let _ = self.took.send(picture.index);
        match self.go.recv() {
            Ok(Answer::Mask) => Ok(Some(mask(7))),
            Ok(Answer::Foreign) => Ok(Some(mask(300))),
            Ok(Answer::Nothing) => Ok(None),
            Ok(Answer::Error) | Err(_) => Err(SegmentError::Picture("out of paint".to_owned())),
        }
    }

    fn categories(&self) -> &[Category] {
        &self.categories
    }
}

/// The other ends of the segmenter's wires.
struct Wires {
    took: Receiver<usize>,
    go: Sender<Answer>,
}

fn labelled(path: &Path, lag: u32) -> (RecordOptions, Wires) {
    let categories = vec![Category { id: 7, name: "paint".to_owned(), is_thing: false }];
    let ((tell, took), (go, told)) = (channel(), channel());
    let slow = Mutex::new(Some(Slow { categories: categories.clone(), took: tell, go: told }));
    let make = move || {
        let slow = slow.lock().unwrap().take();
        slow.map(|slow| Box::new(slow) as Box<dyn Segmenter>)
            .ok_or_else(|| SegmentError::Runtime("only one".to_owned()))
    };
    let labelling = Labelling {
        layer: LayerSpec { name: "slow".to_owned(), origin: "a test".to_owned(), categories },
        record: BTreeMap::from([("model/0/blake3".to_owned(), "00".to_owned())]),
        time: Some("now".to_owned()),
        lag: lag.try_into().unwrap(),
        threads: 1.try_into().unwrap(),
        make: Arc::new(make),
    };
    (RecordOptions { labelling: Some(labelling), ..options(path) }, Wires { took, go })
}

/// The records of labels with the numbers of their pictures, and the pictures with a mask.
fn outcomes(recording: &Recording) -> (Vec<LabelRecord>, Vec<u64>) {
    let records: Vec<LabelRecord> =
        recording.messages(topics::LABELS).iter().map(|m| LabelRecord::decode(&m.data).unwrap()).collect();
    let layer = topics::LayerTopics::new("slow");
    let number = |stamp: Stamp| {
        let of = |record: &&LabelRecord| Stamp::from(record.header.stamp) == stamp;
        records.iter().find(of).unwrap().picture
    };
    let masks = [&layer.class, &layer.instance, &layer.segments]
        .map(|topic| recording.messages(topic).iter().map(|m| number(m.log_time)).collect::<Vec<_>>());
    assert!(masks.iter().all(|topic| *topic == masks[0]));
    let [masks, ..] = masks;
    (records, masks)
}

/// A camera and a segmenter in lock-step: which pictures come while it works at which.
fn drive(wires: &Wires, inlet: &Inlet) -> End {
    inlet.camera(&setup());
    let push = |numbers: std::ops::RangeInclusive<u64>| {
        numbers.for_each(|number| inlet.sample(sample(StreamKind::Color, number)));
    };
    let took = |number: usize| assert_eq!(wires.took.recv(), Ok(number));
    let answer = |answer: Answer| wires.go.send(answer).unwrap();
    push(0..=0);
    took(0);
    push(1..=2);
    answer(Answer::Mask); // 0 is due at 3, which is not there yet.
    took(2); // The newest; 1 is skipped.
    push(3..=5); // 2 is due at 5: late. 3 and 4 are skipped.
    answer(Answer::Mask); // Thrown away.
    took(5);
    push(6..=6);
    answer(Answer::Nothing);
    took(6);
    push(7..=7);
    answer(Answer::Error);
    took(7);
    push(8..=8);
    answer(Answer::Foreign);
    took(8);
    answer(Answer::Mask); // Meets the end of the recording.
    End::Finished
}

#[test]
fn a_mask_that_is_due_and_not_ready_is_never_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (options, wires) = labelled(&path, 3);
    let script = move |_: usize, inlet: &Inlet| drive(&wires, inlet);
    let verdict = run(&options, script);
    let recording = Recording::read(&path);
    let (records, masks) = outcomes(&recording);
    let told: Vec<(u64, &str)> = records.iter().map(|record| (record.picture, record.outcome.as_str())).collect();
    let expected = [
        (0, "labelled"),
        (1, "busy"),
        (2, "late"),
        (3, "busy"),
        (4, "busy"),
        (5, "unlabelled"),
        (6, "failed"),
        (7, "failed"),
    ];
    assert_eq!(told[..8], expected, "in order of the pictures");
    assert!([(8, "labelled"), (8, "ended")].contains(&told[8]) && told.len() == 9, "{told:?}");
    let last = told[8].1 == "labelled";
    assert_eq!(masks, if last { vec![0, 8] } else { vec![0] });

    let stamp = |record: &LabelRecord| Stamp::from(record.header.stamp);
    let pictures: Vec<Stamp> = recording.messages(topics::COLOR).iter().map(|m| m.log_time).collect();
    assert_eq!(records.iter().map(stamp).collect::<Vec<_>>(), pictures, "one record a picture, with its stamp");
    let places = |topic: &str| recording.messages(topic).iter().map(|m| m.place).collect::<Vec<_>>();
    let behind = places(topics::COLOR).into_iter().zip(places(topics::LABELS)).all(|(picture, label)| picture < label);
    assert!(behind, "labels come behind their picture");
    assert!(records.iter().all(|record| record.counter == record.picture && record.layer == "slow"));
    assert!(
        records
            .iter()
            .all(|record| (record.duration_ns == NOT_TOLD) == ["busy", "late", "ended"].contains(&&*record.outcome))
    );
    assert!(records.iter().all(|record| record.decided_ns >= stamp(&records[0]).0));
    let layer = topics::LayerTopics::new("slow");
    let mask = &recording.messages(&layer.class)[0];
    assert!(Image::decode(&mask.data).unwrap().data.iter().all(|class| *class == 7));
    assert_eq!(mask.publish_time, recording.messages(topics::LABELS)[0].publish_time, "the moment of delivery");
    assert_eq!(CategoryTable::decode(&recording.messages(&layer.categories)[0].data).unwrap().categories.len(), 1);

    let counts = verdict.segmentation.unwrap();
    let LabelCounts { pictures, labelled, skipped_busy, skipped_late, unlabelled, failed, ended, .. } = counts;
    assert_eq!((pictures, skipped_busy, skipped_late, unlabelled, failed), (9, 3, 1, 1, 2));
    assert_eq!((labelled, ended), if last { (2, 0) } else { (1, 1) });
    assert!(verdict.reasons.iter().any(|reason| reason == "segmentation: 2 pictures could not be labelled"));
    let events = recording.events().into_iter().filter(|event| event.name == "segmentation.failed");
    assert_eq!(events.count(), 2);
    let record = &recording.metadata["pslam/segmentation/slow"];
    let value = |key: &str| record[key].as_str();
    assert_eq!([value("origin"), value("model/0/blake3"), value("time")], ["a test", "00", "now"]);
    assert_eq!([value("live/lag_pictures"), value("pictures"), value("live/skipped_late")], ["3", "9", "1"]);
}

#[test]
fn who_cannot_label_at_all_refuses_the_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (mut options, _wires) = labelled(&path, 1);
    options.labelling.as_mut().unwrap().make = Arc::new(|| Err(SegmentError::Runtime("no such network".to_owned())));
    let refused = record(Vec::new(), &options, Arc::new(SystemClock), &|| false, &mut |_| {});
    assert!(matches!(&refused, Err(RecordError::Refused(text)) if text.contains("no such network")), "{refused:?}");
    options.labelling.as_mut().unwrap().layer.name = "no/name".to_owned();
    let refused = record(Vec::new(), &options, Arc::new(SystemClock), &|| false, &mut |_| {});
    assert!(matches!(&refused, Err(RecordError::Log(_))), "{refused:?}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left");
}
