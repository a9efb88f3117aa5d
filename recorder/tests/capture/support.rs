//! A camera that follows a script, a clock that follows the test, and reading a recording back.

use recorder::Arrival;
use recorder::capture::{
    CameraSetup, Encoding, End, HostClock, Inlet, Limits, RecordOptions, Source, SystemClock, Verdict, record,
};
use recorder::realsense::*;
use schemas::alignment::{Extrinsics, Intrinsics};
use schemas::msg::{DropRecord, LogEntry};
use schemas::{Message, Stamp, topics};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

pub const WIDTH: u32 = 32;
pub const HEIGHT: u32 = 24;
const RATE_HZ: u32 = 30;

/// The computer's clock with a realtime that the test sets.
#[derive(Default)]
pub struct SetClock {
    pub ahead_ns: AtomicI64,
}

impl HostClock for SetClock {
    fn now(&self) -> Arrival {
        let now = SystemClock.now();
        Arrival { realtime_ns: now.realtime_ns + self.ahead_ns.load(Ordering::Relaxed), ..now }
    }
}

/// A camera of a few pixels.
pub fn setup() -> CameraSetup {
    let lens =
        Intrinsics { width: WIDTH, height: HEIGHT, fx: 30.0, fy: 30.0, cx: 15.5, cy: 11.5, ..Intrinsics::default() };
    let profile = |kind, format: Format| {
        let motion = matches!(kind, StreamKind::Gyro | StreamKind::Accel);
        let (width, height, rate_hz) = if motion { (0, 0, 200) } else { (WIDTH, HEIGHT, RATE_HZ) };
        StreamProfile { stream: StreamId::only(kind), format, width, height, rate_hz }
    };
    let profiles = [
        profile(StreamKind::Depth, Format::Z16),
        profile(StreamKind::Color, Format::Rgb8),
        profile(StreamKind::Gyro, Format::MotionXyz32f),
    ];
    let calibration = |profile: &StreamProfile| StreamCalibration {
        profile: *profile,
        intrinsics: profile.stream.kind.is_video().then_some(lens),
        motion: None,
    };
    let rotation = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let calibration = Calibration {
        streams: profiles.iter().map(calibration).collect(),
        extrinsics: vec![StreamExtrinsics {
            from: StreamId::only(StreamKind::Depth),
            to: StreamId::only(StreamKind::Color),
            transform: Extrinsics { rotation, translation: [0.015, 0.0, 0.0] },
        }],
        depth_units_m: Some(0.001),
    };
    let device = DeviceDescription {
        name: "scripted".to_owned(),
        serial: "1".to_owned(),
        firmware: None,
        usb: Some("3.2".to_owned()),
        product_id: None,
        more: Vec::new(),
        recording: None,
        sensors: Vec::new(),
    };
    CameraSetup {
        library: "none".to_owned(),
        device,
        calibration: Arc::new(calibration),
        attribute_names: vec![(0, "Frame Counter".to_owned())],
    }
}

/// The `number`th sample of a stream; its pixels tell which one it is.
pub fn sample(kind: StreamKind, number: u64) -> Sample {
    let rate = if kind == StreamKind::Gyro { 200 } else { i64::from(RATE_HZ) };
    // Begins 0.1 s before the counter's 32 bits are used up.
    let device_us = (1 << 32) - 100_000 + number as i64 * 1_000_000 / rate;
    let header = FrameHeader {
        stream: StreamId::only(kind),
        number,
        timestamp_ms: device_us as f64 / 1e3,
        domain: TimestampDomain::HardwareClock,
        metadata: if kind == StreamKind::Gyro {
            Vec::new()
        } else {
            vec![
                (metadata::FRAME_COUNTER, number as i64),
                (metadata::FRAME_TIMESTAMP, (device_us + 4_000) % (1 << 32)),
                (metadata::SENSOR_TIMESTAMP, device_us % (1 << 32)),
                (metadata::ACTUAL_EXPOSURE, 8_000 + number as i64),
            ]
        },
        arrival: Arrival::now(),
    };
    if kind == StreamKind::Gyro {
        return Sample::Motion(Motion { header, xyz: [number as f32, -0.5, 0.25] });
    }
    let format = if kind == StreamKind::Color { Format::Rgb8 } else { Format::Z16 };
    let count = WIDTH as usize * HEIGHT as usize * format.bytes_per_pixel().unwrap();
    let bytes = (0..count).map(|i| (i as u64 * 31 + number * 7 + count as u64) as u8).collect();
    Sample::Frame(Frame { header, width: WIDTH, height: HEIGHT, format, bytes })
}

/// What a script does.
pub type Script = Box<dyn FnMut(usize, &Inlet) -> End + Send>;

/// A source that follows a script; it hears how often it was run before.
pub struct Scripted {
    pub script: Script,
    pub runs: usize,
}

impl Source for Scripted {
    fn name(&self) -> &'static str {
        "camera"
    }

    fn run(&mut self, inlet: &Inlet) -> End {
        self.runs += 1;
        (self.script)(self.runs - 1, inlet)
    }
}

pub fn options(path: &Path) -> RecordOptions {
    RecordOptions {
        path: path.to_owned(),
        force: false,
        flush_interval: Duration::from_millis(200),
        duration: None,
        reserve_bytes: 0,
        encoding: Encoding::Auto,
        synchronise: true,
        allowed: Default::default(),
        limits: Limits::default(),
        onlookers: Vec::new(),
        labelling: None,
        program: "test".to_owned(),
        asked: BTreeMap::new(),
    }
}

/// Records what a script does, to its end.
pub fn run(options: &RecordOptions, script: impl FnMut(usize, &Inlet) -> End + Send + 'static) -> Verdict {
    let sources: Vec<Box<dyn Source>> = vec![Box::new(Scripted { script: Box::new(script), runs: 0 })];
    record(sources, options, Arc::new(SystemClock), &|| false, &mut |_| {}).unwrap()
}

/// A message as it stands in the file.
pub struct Stored {
    /// Place among all messages of the file.
    pub place: usize,
    pub log_time: Stamp,
    pub publish_time: Stamp,
    pub data: Vec<u8>,
}

/// A recording, read by the container library.
pub struct Recording {
    pub topics: BTreeMap<String, Vec<Stored>>,
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
}

impl Recording {
    pub fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let mut topics: BTreeMap<String, Vec<Stored>> = BTreeMap::new();
        for (place, message) in mcap::MessageStream::new(&bytes).unwrap().enumerate() {
            let message = message.unwrap();
            let [log_time, publish_time] = [message.log_time, message.publish_time].map(|ns| Stamp(ns as i64));
            let stored = Stored { place, log_time, publish_time, data: message.data.to_vec() };
            topics.entry(message.channel.topic.clone()).or_default().push(stored);
        }
        let records = mcap::read::LinearReader::new(&bytes).unwrap().filter_map(|record| match record.unwrap() {
            mcap::records::Record::Metadata(record) => Some((record.name, record.metadata)),
            _ => None,
        });
        Self { topics, metadata: records.collect() }
    }

    pub fn messages(&self, topic: &str) -> &[Stored] {
        self.topics.get(topic).map_or(&[], Vec::as_slice)
    }

    pub fn drops(&self) -> Vec<(String, String, u64, u64, u64)> {
        let drops = self.messages(topics::DROPS).iter().map(|stored| DropRecord::decode(&stored.data).unwrap());
        drops.map(|d| (d.stream, d.cause, d.first_counter, d.last_counter, d.count)).collect()
    }

    pub fn events(&self) -> Vec<LogEntry> {
        self.messages(topics::EVENTS).iter().map(|stored| LogEntry::decode(&stored.data).unwrap()).collect()
    }
}
