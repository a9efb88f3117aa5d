//! Where sources hand over what they have; every measurement is counted here, before anything can lose it.

use super::clock::{HostClock, HostTimeline};
use super::encode::{Encoded, Encoder, Measurement, Payload, counter};
use super::engine::RecordOptions;
use super::labelling::Labels;
use super::lane::{Lane, Wait};
use super::ledger::{Cause, Counts, Ledger, Loss, Step};
use super::onlooker::Onlooker;
use super::outbox::Item;
use super::setup::CameraSetup;
use super::stamps::{CameraClock, DeviceTime};
use super::stream::Stream;
use crate::mocap::MocapFrame;
use crate::realsense::{Calibration, Finding, FrameHeader, Sample};
use schemas::msg::{DropRecord, Header, LogEntry, Time, device_clock, level};
use schemas::{Stamp, metadata, topics};
use serde::Serialize;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Kept in memory for the screen; the log has them all.
const MAX_HAPPENINGS: usize = 10_000;

/// How a recording ended.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(tag = "kind", content = "what", rename_all = "snake_case")]
pub enum EndedBy {
    /// Somebody asked for it.
    Request,
    /// It had the length that was asked for.
    Duration,
    /// A source came to its end.
    Source(String),
    /// The disk's free space came down to the reserve.
    Reserve,
    /// The disk is full.
    DiskFull,
    /// The log cannot be written any more.
    WriteFailed(String),
    /// A measurement lacks what a recording needs.
    Refused(String),
}

/// Something that happened, as it stands in the log.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Happening {
    /// When, on the log's timeline.
    pub stamp: Stamp,
    /// See [`mod@level`].
    pub level: u8,
    /// Stable name.
    pub name: String,
    /// In words.
    pub text: String,
}

/// What all threads of a recording share.
pub(super) struct Shared {
    pub clock: Arc<dyn HostClock>,
    pub host: HostTimeline,
    pub encoder: Encoder,
    pub allowed: Allowed,
    pub onlookers: Vec<Arc<dyn Onlooker>>,
    pub labels: Option<Labels>,
    pub color: Lane<Measurement>,
    pub depth: Lane<Measurement>,
    pub small: Lane<Measurement>,
    pub outbox: Lane<Item>,
    book: Mutex<Book>,
    stopping: AtomicBool,
}

/// Findings that do not end a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Allowed {
    /// Frames without the camera's own stamps and counters.
    pub missing_metadata: bool,
}

/// State that changes with every measurement.
#[derive(Default)]
pub(super) struct Book {
    pub ledger: Ledger,
    pub cameras: Vec<Connection>,
    pub setup: Option<CameraSetup>,
    pub mocap: MocapCounts,
    /// Subjects that were asked for and not seen so far.
    pub unseen: Vec<String>,
    /// Whether the mocap saw anything at all.
    pub mocap_sees: bool,
    pub happenings: Vec<Happening>,
    pub ended_by: Option<EndedBy>,
    /// Arrival of the first measurement of all, on the log's timeline.
    pub first: Option<Stamp>,
    /// Streams that were promised.
    pub expected: Vec<Stream>,
    /// Sources that went away: since when while they are away (timeline), and for how long in all, nanoseconds.
    away_since: BTreeMap<&'static str, Stamp>,
    pub away: BTreeMap<&'static str, i64>,
    /// How many of the happenings were told.
    told: usize,
}

/// One connection to the camera.
#[derive(Default)]
pub(super) struct Connection {
    clock: CameraClock,
    /// By stream: time of the last measurement and length of a period, nanoseconds.
    last: [Option<i64>; Stream::ALL.len()],
    period_ns: [i64; Stream::ALL.len()],
    seen: [bool; Stream::ALL.len()],
}

/// Motion capture beyond its frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct MocapCounts {
    /// Bodies in the last frame.
    pub bodies: u64,
    /// Occluded ones in the last frame.
    pub occluded: u64,
    /// Frames in which at least one body was occluded.
    pub frames_with_occlusion: u64,
    /// Occluded bodies over all frames.
    pub occlusions: u64,
}

/// A source's way into the recording.
#[derive(Clone)]
pub struct Inlet {
    pub(super) shared: Arc<Shared>,
    pub(super) wait: Wait,
}

impl Inlet {
    /// The same for a source that can wait without losing anything, such as a file.
    #[must_use]
    pub fn patient(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), wait: Wait::Forever }
    }

    /// Whether the source should come to an end.
    #[must_use]
    pub fn is_stopping(&self) -> bool {
        self.shared.is_stopping()
    }

    /// The clock that arrivals are to be read from.
    #[must_use]
    pub fn clock(&self) -> Arc<dyn HostClock> {
        Arc::clone(&self.shared.clock)
    }

    /// A camera is there, for the first time or again; its samples follow.
    pub fn camera(&self, setup: &CameraSetup) {
        self.away("camera", false);
        self.shared.camera(setup);
        self.shared.onlookers.iter().for_each(|one| one.camera(setup));
    }

    /// A motion capture system will send frames, with these subjects.
    pub fn expect_mocap(&self, subjects: &[String]) {
        let mut book = self.shared.book();
        book.expect(Stream::Mocap);
        book.unseen = subjects.to_vec();
    }

    /// The motion capture system is there, for the first time or again.
    pub fn mocap_connected(&self) {
        self.shared.book().ledger.reconnected(&[Stream::Mocap]);
        self.away("mocap", false);
    }

    /// The motion capture system is lost for now.
    pub fn mocap_lost(&self, reason: &str) {
        self.away("mocap", true);
        self.event(level::ERROR, "mocap.lost", reason);
    }

    /// A source went away, or came back. A second going changes nothing.
    pub(super) fn away(&self, source: &'static str, is_away: bool) {
        let now = self.shared.now();
        let mut book = self.shared.book();
        if is_away {
            book.away_since.entry(source).or_insert(now);
        } else if let Some(since) = book.away_since.remove(source) {
            *book.away.entry(source).or_insert(0) += now.0 - since.0;
        }
    }

    /// Something that the camera said. May wait a little where the log cannot keep up.
    pub fn sample(&self, sample: Sample) {
        match sample {
            Sample::Frame(frame) => {
                let Some(Received { stream, counter, time, calibration }) = self.shared.receive(&frame.header) else {
                    return;
                };
                let arrival = frame.header.arrival;
                let frame = Arc::new(frame);
                self.shared.onlookers.iter().for_each(|one| one.picture(stream, time.stamp, &frame));
                self.shared.label(stream, counter, time.stamp, &frame);
                let payload = Payload::Picture { frame, time, calibration };
                self.send(Measurement { stream, counter, arrival, payload });
            }
            Sample::Motion(motion) => {
                let Some(Received { stream, counter, time, .. }) = self.shared.receive(&motion.header) else { return };
                let arrival = motion.header.arrival;
                self.send(Measurement { stream, counter, arrival, payload: Payload::Motion { motion, time } });
            }
            Sample::Unreadable { reason, .. } => self.event(level::ERROR, "camera.unreadable", &reason),
        }
    }

    /// A frame of the motion capture system.
    pub fn mocap(&self, frame: MocapFrame, source: &Arc<str>) {
        let arrival = frame.arrival;
        let mut guard = self.shared.book();
        let book = &mut *guard;
        book.first.get_or_insert(self.shared.host.stamp(arrival));
        let occluded = frame.bodies.iter().filter(|body| body.world_from_segment.is_none()).count() as u64;
        let counts = &mut book.mocap;
        (counts.bodies, counts.occluded) = (frame.bodies.len() as u64, occluded);
        counts.occlusions += occluded;
        counts.frames_with_occlusion += u64::from(occluded > 0);
        let mut seen = frame.bodies.iter().filter(|body| body.world_from_segment.is_some()).peekable();
        book.mocap_sees |= seen.peek().is_some() || !frame.markers.is_empty();
        if !book.unseen.is_empty() {
            seen.for_each(|body| book.unseen.retain(|subject| *subject != body.subject));
        }
        let step = book.ledger.received(Stream::Mocap, frame.number);
        drop(guard);
        self.shared.take_step(Stream::Mocap, step);
        let stamp = self.shared.host.captured(&frame);
        self.shared.onlookers.iter().for_each(|one| one.mocap(stamp, &frame));
        let counter = frame.number.unwrap_or(0);
        let payload = Payload::Mocap { frame: Box::new(frame), source: Arc::clone(source) };
        self.send(Measurement { stream: Stream::Mocap, counter, arrival, payload });
    }

    /// Something happened; `level` as in [`mod@level`].
    pub fn event(&self, level: u8, name: &str, text: &str) {
        self.shared.event(level, name, text);
    }

    fn send(&self, measurement: Measurement) {
        let weight = measurement.payload.bytes();
        let lane = match measurement.stream {
            Stream::Color => &self.shared.color,
            Stream::Depth => &self.shared.depth,
            Stream::Gyro | Stream::Accel | Stream::Mocap => &self.shared.small,
        };
        for lost in lane.push(measurement, weight, self.wait) {
            self.shared.lost(&lost, Cause::Queue);
        }
    }
}

/// A camera's measurement with its place in the recording.
struct Received {
    stream: Stream,
    counter: u64,
    time: DeviceTime,
    calibration: Arc<Calibration>,
}

impl Book {
    pub fn expect(&mut self, stream: Stream) {
        if !self.expected.contains(&stream) {
            self.expected.push(stream);
        }
    }

    /// Counts of the streams that were promised or came.
    pub fn counts(&self) -> Vec<(Stream, Counts)> {
        let all = Stream::ALL.into_iter().map(|stream| (stream, self.ledger.counts(stream)));
        all.filter(|(stream, counts)| counts.received > 0 || self.expected.contains(stream)).collect()
    }

    /// What happened since the last call.
    pub fn untold(&mut self) -> Vec<Happening> {
        let from = std::mem::replace(&mut self.told, self.happenings.len());
        self.happenings[from..].to_vec()
    }

    /// Counts the time of sources that are still away.
    pub fn end_away(&mut self, now: Stamp) {
        for (source, since) in std::mem::take(&mut self.away_since) {
            *self.away.entry(source).or_insert(0) += now.0 - since.0;
        }
    }

    fn anchors_ns(&self) -> Vec<Option<i64>> {
        self.cameras.iter().map(|connection| connection.clock.anchor_ns()).collect()
    }
}

impl Connection {
    /// How many measurements of a steady stream are missing by the device's time, which the counter does not show.
    fn missing(&mut self, stream: Stream, time: &DeviceTime) -> u64 {
        let period_ns = self.period_ns[stream.index()];
        let last = self.last[stream.index()].replace(time.stamp.0);
        let Some(last) = last.filter(|_| period_ns > 0 && time.clock != device_clock::NONE) else { return 0 };
        let periods = (time.stamp.0 - last + period_ns / 2) / period_ns;
        u64::try_from(periods - 1).unwrap_or(0)
    }
}

impl Shared {
    pub fn new(clock: Arc<dyn HostClock>, host: HostTimeline, options: &RecordOptions, labels: Option<Labels>) -> Self {
        let limits = &options.limits;
        Self {
            clock,
            host,
            encoder: Encoder::new(host, options.encoding),
            allowed: options.allowed,
            onlookers: options.onlookers.clone(),
            labels,
            color: Lane::new(limits.video_bytes),
            depth: Lane::new(limits.video_bytes),
            small: Lane::new(limits.small_bytes),
            outbox: Lane::new(limits.outbox_bytes),
            book: Mutex::new(Book::default()),
            stopping: AtomicBool::new(false),
        }
    }

    pub fn book(&self) -> MutexGuard<'_, Book> {
        self.book.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub fn is_stopping(&self) -> bool {
        self.stopping.load(Ordering::Acquire)
    }

    /// Ends the recording; the first reason counts.
    pub fn end(&self, by: EndedBy) {
        self.book().ended_by.get_or_insert(by);
        self.stopping.store(true, Ordering::Release);
    }

    /// The log's time now.
    pub fn now(&self) -> Stamp {
        self.host.stamp(self.clock.now())
    }

    /// Puts messages into the log that are no measurements.
    pub fn write(&self, messages: Vec<Encoded>) {
        // After a failure nobody takes them, which the verdict tells.
        drop(self.outbox.push(Item::Messages(messages), 0, Wait::No));
    }

    pub fn write_metadata(&self, name: impl Into<Cow<'static, str>>, values: BTreeMap<String, String>) {
        drop(self.outbox.push(Item::Metadata { name: name.into(), values }, 0, Wait::No));
    }

    pub fn event(&self, level: u8, name: &str, text: &str) {
        let moment = self.clock.now();
        let stamp = self.host.stamp(moment);
        let (name, text) = (name.to_owned(), text.to_owned());
        if let Ok(time) = Time::try_from(stamp) {
            let entry = LogEntry { stamp: time, level, name: name.clone(), msg: text.clone(), ..LogEntry::default() };
            self.write(vec![Encoded::new(topics::EVENTS, stamp, Stamp(moment.realtime_ns), &entry)]);
        }
        let mut book = self.book();
        if book.happenings.len() < MAX_HAPPENINGS {
            book.happenings.push(Happening { stamp, level, name, text });
        }
    }

    /// This program lost a measurement.
    pub fn lost(&self, measurement: &Measurement, cause: Cause) {
        let loss = self.book().ledger.lost(measurement.stream, cause, measurement.counter);
        self.record_loss(loss);
    }

    pub fn record_loss(&self, loss: Loss) {
        let moment = self.clock.now();
        let stamp = self.host.stamp(moment);
        let Loss { stream, cause, first, last, count } = loss;
        let Ok(header) = Header::new(stamp, stream.frame()) else { return };
        let (stream, cause) = (stream.name().to_owned(), cause.name().to_owned());
        let record = DropRecord { header, stream, cause, first_counter: first, last_counter: last, count };
        self.write(vec![Encoded::new(topics::DROPS, stamp, Stamp(moment.realtime_ns), &record)]);
    }

    fn take_step(&self, stream: Stream, step: Step) {
        match step {
            Step::Next => {}
            Step::Gap(loss) => self.record_loss(loss),
            Step::Back(last, counter) => {
                let text = format!("the counter of {stream} went from {last} to {counter}", stream = stream.name());
                self.event(level::WARN, "counter.back", &text);
            }
        }
    }

    fn camera(&self, setup: &CameraSetup) {
        let streams = setup.streams();
        let mut connection = Connection::default();
        for (stream, profile) in &streams {
            // Only inertial samples come steadily enough; pictures have a hardware counter instead.
            let steady = profile.stream.kind.is_motion() && profile.rate_hz > 0;
            connection.period_ns[stream.index()] = if steady { 1_000_000_000 / i64::from(profile.rate_hz) } else { 0 };
        }
        let mut book = self.book();
        streams.iter().for_each(|(stream, _)| book.expect(*stream));
        let recorded: Vec<Stream> = streams.iter().map(|(stream, _)| *stream).collect();
        book.ledger.reconnected(&recorded);
        book.cameras.push(connection);
        let changed = book.setup.as_ref().is_some_and(|known| known.calibration != setup.calibration);
        book.setup = Some(setup.clone());
        let (number, anchors_ns) = (book.cameras.len() - 1, book.anchors_ns());
        drop(book);
        self.write_metadata(metadata::DEVICE, setup.device_record(&anchors_ns));
        if number == 0 {
            self.write_metadata(metadata::PAIRING, setup.pairing_record());
            setup.depth_record().into_iter().for_each(|record| self.write_metadata(metadata::DEPTH, record));
        } else {
            self.event(level::WARN, "camera.back", &format!("connection {number} to {}", setup.device.name));
        }
        if changed {
            self.event(level::ERROR, "camera.changed", "the calibration differs from that of the connection before");
        }
        if let Ok(messages) = setup.messages(self.now()) {
            self.write(messages);
        }
    }

    /// Counts a camera's measurement and gives it its time. `None` for streams that are not recorded.
    fn receive(&self, header: &FrameHeader) -> Option<Received> {
        let stream = Stream::of_camera(header.stream)?;
        let counter = counter(header);
        let mut guard = self.book();
        let book = &mut *guard;
        let calibration = Arc::clone(&book.setup.as_ref()?.calibration);
        let connection = book.cameras.last_mut()?;
        let anchored = connection.clock.anchor_ns().is_some();
        let time = connection.clock.time(header, &self.host);
        let is_first = !std::mem::replace(&mut connection.seen[stream.index()], true);
        let missing = connection.missing(stream, &time);
        book.first.get_or_insert(self.host.stamp(header.arrival));
        let step = book.ledger.received(stream, Some(counter));
        let unseen = (step == Step::Next && missing > 0).then(|| book.ledger.missing(stream, counter, missing));
        let newly_anchored = !anchored && connection.clock.anchor_ns().is_some();
        let record = newly_anchored.then(|| Some(book.setup.as_ref()?.device_record(&book.anchors_ns()))).flatten();
        drop(guard);
        self.take_step(stream, step);
        unseen.into_iter().for_each(|loss| self.record_loss(loss));
        record.into_iter().for_each(|record| self.write_metadata(metadata::DEVICE, record));
        if is_first {
            self.judge(header);
        }
        Some(Received { stream, counter, time, calibration })
    }

    /// The first measurement of a stream tells whether the rest is worth recording.
    fn judge(&self, header: &FrameHeader) {
        for finding in Finding::of_frame(header) {
            let text = finding.to_string();
            if self.allowed.missing_metadata {
                self.event(level::WARN, "camera.metadata", &text);
            } else {
                self.end(EndedBy::Refused(format!("{text}; {} records it all the same", finding.allowed_by())));
            }
        }
    }
}

/// How much may wait in memory, and how long.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Limits {
    /// Pictures of one stream that wait for their encoder, bytes.
    pub video_bytes: usize,
    /// Everything else that waits for its encoder, bytes.
    pub small_bytes: usize,
    /// Messages that wait for the disk, bytes.
    pub outbox_bytes: usize,
    /// How long a source that cannot wait is held up before the oldest measurements are given up. Longer than a hiccup of
    /// the scheduler, shorter than the queues of a camera's library last.
    pub patience: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        // 128 MB: 1.5 s of 1280x720 colour at 30 Hz, 2.3 s of depth.
        let (video_bytes, outbox_bytes) = (128 << 20, 128 << 20);
        Self { video_bytes, small_bytes: 16 << 20, outbox_bytes, patience: Duration::from_millis(50) }
    }
}
