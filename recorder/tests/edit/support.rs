//! A small log with all kinds of records, and a plain reader.

use recorder::edit::{Item, Source};
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use schemas::Stamp;
use schemas::calibration::{CameraModel, Preset};
use schemas::msg::{Category, Segment, format};
use std::collections::BTreeMap;
use std::path::Path;

pub const WIDTH: u32 = 32;
pub const HEIGHT: u32 = 24;
pub const FRAMES: i64 = 12;

/// Stamp of a picture; its depth image comes 1 ns later.
pub fn picture_stamp(frame: i64) -> Stamp {
    Stamp(1_000_000_000 + frame * 33_333_333)
}

/// Pictures with depth, masks and ground truth at 100 Hz, an attachment and metadata.
pub fn write_log(path: &Path) {
    let camera = CameraModel { width: WIDTH, height: HEIGHT, ..Preset::Freiburg3.camera() };
    let person = Category { id: 1, name: "person".to_owned(), is_thing: true };
    let layer = LayerSpec { name: "panoptic".to_owned(), origin: "test".to_owned(), categories: vec![person] };
    let spec = RgbdSpec { layers: vec![layer], ..RgbdSpec::new("test", "small", camera) };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    log.log().attach("notes.txt", "text/plain", Stamp(1), b"an attached file").unwrap();
    let pixels = (WIDTH * HEIGHT) as usize;
    let mut pose = 0;
    for frame in 0..FRAMES {
        let stamp = picture_stamp(frame);
        while pose * 10_000_000 + 900_000_000 <= stamp.0 {
            let at = Stamp(900_000_000 + pose * 10_000_000);
            log.ground_truth(at, [pose as f64, 0.5, 0.25], [0.0, 0.0, 0.0, 1.0]).unwrap();
            pose += 1;
        }
        let color = vec![frame as u8; 600];
        log.color(stamp, format::PNG, &color).unwrap();
        let class: Vec<u16> = (0..pixels).map(|i| u16::from(i % 7 == 0)).collect();
        let segments = vec![Segment { id: 1, category_id: 1, ..Segment::default() }];
        log.mask(0, stamp, &Mask { instance: class.clone(), class, segments }).unwrap();
        log.depth(Stamp(stamp.0 + 1), &vec![1000 + frame as u16; pixels]).unwrap();
    }
    let counts = BTreeMap::from([("paired".to_owned(), FRAMES.to_string())]);
    log.log().metadata("pslam/import", counts).unwrap();
    log.finish().unwrap();
}

/// Topic, number, log time, publish time, bytes.
pub type Message = (String, u32, i64, i64, Vec<u8>);

/// Everything in a log, in file order.
#[derive(Debug, Default, PartialEq)]
pub struct Content {
    pub channels: Vec<(String, String, BTreeMap<String, String>)>,
    pub messages: Vec<Message>,
    pub metadata: Vec<(String, BTreeMap<String, String>)>,
    pub attachments: Vec<(String, Vec<u8>)>,
}

impl Content {
    pub fn read(path: &Path) -> Self {
        let mut source = Source::open(path).unwrap();
        let mut content = Self::default();
        while let Some(item) = source.next().unwrap() {
            match item {
                Item::Channel(c) => {
                    content.channels.push((c.topic.clone(), c.schema_name().to_owned(), c.metadata.clone()));
                }
                Item::Message(m) => content.messages.push((
                    m.topic().to_owned(),
                    m.sequence,
                    m.log_time.0,
                    m.publish_time.0,
                    m.data.to_vec(),
                )),
                Item::Metadata { name, values } => content.metadata.push((name, values)),
                Item::Attachment(a) => content.attachments.push((a.name.clone(), a.data.to_vec())),
            }
        }
        content
    }

    pub fn topics(&self) -> Vec<&str> {
        self.channels.iter().map(|(topic, ..)| topic.as_str()).collect()
    }

    pub fn on<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = &'a Message> + 'a {
        self.messages.iter().filter(move |message| message.0 == topic)
    }

    pub fn record(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.metadata.iter().find(|(found, _)| found == name).map(|(_, values)| values)
    }

    /// Without what an edit adds.
    pub fn without_provenance(mut self) -> Self {
        self.metadata.retain(|(name, _)| !name.starts_with("pslam/provenance/"));
        self
    }
}
