//! Runs a recording from its first to its last byte.

use super::clock::{HostClock, HostTimeline, StepWatch, synchronisation};
use super::disk::{folder_of, is_named, place_of, room_bytes};
use super::effort::Encoding;
use super::encode::Encoded;
use super::inlet::{Allowed, Book, EndedBy, Inlet, Limits, Shared};
use super::labelling::{self, LabelCounts, Labelling, Labels};
use super::lane::Wait;
use super::onlooker::Onlooker;
use super::outbox::{Progress, Scribe, append, encode_all, sync_all};
use super::source::{End, Source};
use super::status::{Status, StreamCounts, StreamStatus, Verdict, room_s};
use super::stream::Stream;
use crate::sync::{SyncOptions, solve};
use crate::{Arrival, LogOptions, LogWriter, WriteError};
use schemas::msg::{ClockPair, Header, level};
use schemas::{Stamp, metadata, topics};
use std::collections::BTreeMap;
use std::fs::File;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How to record.
#[derive(Debug, Clone)]
pub struct RecordOptions {
    /// The log to write.
    pub path: PathBuf,
    /// Replace an existing file.
    pub force: bool,
    /// What the death of this process may cost at most.
    pub flush_interval: Duration,
    /// End after so long, counted from the first measurement; after so long too if none comes at all.
    pub duration: Option<Duration>,
    /// End when the disk has no more room than this, bytes.
    pub reserve_bytes: u64,
    /// How colour is packed.
    pub encoding: Encoding,
    /// Estimate clocks and offsets at the end.
    pub synchronise: bool,
    /// What is recorded in spite of its faults.
    pub allowed: Allowed,
    /// How much may wait in memory, and how long.
    pub limits: Limits,
    /// Who looks on.
    pub onlookers: Vec<Arc<dyn Onlooker>>,
    /// Who labels colour pictures meanwhile.
    pub labelling: Option<Labelling>,
    /// Version of the writing program, as `pslam 0.1.0`.
    pub program: String,
    /// What was asked for, in words, for the log.
    pub asked: BTreeMap<String, String>,
}

/// Why there is no recording at all.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The log cannot be started.
    #[error(transparent)]
    Log(#[from] WriteError),
    /// The disk is full before the start.
    #[error("{} has {room} bytes of room, which is not more than the reserve of {reserve}", folder.display())]
    NoRoom {
        /// Where the log should stand.
        folder: PathBuf,
        /// Room there.
        room: u64,
        /// What is to be left.
        reserve: u64,
    },
    /// The first measurements lack what a recording needs; nothing is left on the disk.
    #[error("{0}")]
    Refused(String),
}

/// Space that the log owns ahead of its end: the chunks in flight and the closing records of many hours.
const AHEAD_BYTES: u64 = 32 << 20;
const TICK: Duration = Duration::from_millis(20);
const STATUS_NS: i64 = 1_000_000_000;
/// Pauses between attempts to get a lost source back: each twice the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

/// Records until `stop` says so, the duration is over, a source comes to its end, or the disk is full. `told` hears how it
/// goes once a second.
///
/// # Errors
/// The log cannot be started, or the measurements are refused. What goes wrong later stands in the verdict.
pub fn record(
    sources: Vec<Box<dyn Source>>,
    options: &RecordOptions,
    clock: Arc<dyn HostClock>,
    stop: &dyn Fn() -> bool,
    told: &mut dyn FnMut(&Status),
) -> Result<Verdict, RecordError> {
    let labels = options.labelling.as_ref().map(Labels::new).transpose()?;
    let log = create(options)?;
    let start = clock.now();
    let host = HostTimeline::starting_at(start);
    let shared = Arc::new(Shared::new(clock, host, options, labels));
    let progress = Mutex::new(Progress::default());
    let mut run =
        Run { options, shared: &shared, progress: &progress, watch: StepWatch::new(start), start, last: None };
    run.introduce();
    let file = log.file()?;
    let (log, partial) = run.run(log, &file, sources, stop, told)?;
    run.close(log, &file, partial)
}

fn create(options: &RecordOptions) -> Result<LogWriter, RecordError> {
    let folder = folder_of(&options.path);
    let reserve = options.reserve_bytes;
    let room = room_bytes(folder, 0).map_err(|source| WriteError::Io { path: folder.to_owned(), source })?;
    let log_options = LogOptions {
        force: options.force,
        compress: options.encoding != Encoding::Raw,
        growing_chunks: true,
        ahead_bytes: AHEAD_BYTES.min(room / 4),
        ..LogOptions::default()
    };
    if room <= reserve {
        return Err(RecordError::NoRoom { folder: folder.to_owned(), room, reserve });
    }
    Ok(LogWriter::create(&options.path, &log_options)?)
}

/// A running recording, seen from the thread that watches it.
struct Run<'a> {
    options: &'a RecordOptions,
    shared: &'a Arc<Shared>,
    progress: &'a Mutex<Progress>,
    watch: StepWatch,
    start: Arrival,
    /// The last status with its time.
    last: Option<(i64, Status)>,
}

impl Run<'_> {
    /// Runs all threads to their end; returns the log, unless it could not be written, and the unfinished file's name.
    fn run(
        &mut self,
        log: LogWriter,
        file: &File,
        sources: Vec<Box<dyn Source>>,
        stop: &dyn Fn() -> bool,
        told: &mut dyn FnMut(&Status),
    ) -> Result<(Option<LogWriter>, PathBuf), RecordError> {
        let partial = log.partial().to_owned();
        let (sync, wake) = sync_channel(1);
        let shared = &**self.shared;
        let inlet = Inlet { shared: Arc::clone(self.shared), wait: Wait::AtMost(self.options.limits.patience) };
        let scribe = Scribe { shared, progress: self.progress, flush_interval: self.options.flush_interval, sync };
        let log = std::thread::scope(|scope| {
            let writer = scope.spawn(move || scribe.write_all(log));
            scope.spawn(move || sync_all(file, &wake, shared));
            let encoders =
                [&shared.color, &shared.depth, &shared.small].map(|lane| scope.spawn(|| encode_all(lane, shared)));
            let labellers = labelling::start(scope, shared);
            let sources: Vec<_> = sources
                .into_iter()
                .map(|mut source| {
                    let inlet = inlet.clone();
                    scope.spawn(move || keep_running(&mut *source, &inlet))
                })
                .collect();
            self.watch_over(&|| is_named(file, &partial), stop, told);
            // In the order of the flow: nothing that came in is lost on the way.
            sources.into_iter().for_each(|thread| drop(thread.join()));
            shared.labels.iter().for_each(|labels| labels.end(shared.clock.now()));
            [&shared.color, &shared.depth, &shared.small].into_iter().for_each(super::lane::Lane::close);
            encoders.into_iter().for_each(|thread| drop(thread.join()));
            shared.labels.iter().for_each(|labels| labels.passed(Stamp(i64::MAX)));
            labellers.into_iter().for_each(|thread| drop(thread.join()));
            shared.outbox.close();
            writer.join().ok().flatten()
        });
        Ok((log, partial))
    }

    /// What is known before the first measurement.
    fn introduce(&self) {
        let text = |entries: &[(&str, &str)]| -> BTreeMap<String, String> {
            entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
        };
        let options = self.options;
        let name = options.path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let source = [
            ("kind", "recording"),
            ("name", &name),
            ("program", &options.program),
            ("log_format", metadata::LOG_FORMAT),
        ];
        self.shared.write_metadata(metadata::SOURCE, text(&source));
        self.shared.write_metadata(metadata::CONVENTIONS, text(CONVENTIONS));
        let (anchor, started) = (self.shared.host.anchor_ns.to_string(), self.start.realtime_ns.to_string());
        let flush = options.flush_interval.as_nanos().to_string();
        let mut recording = text(&[
            ("host_anchor_ns", &anchor),
            ("started", &started),
            ("flush_interval_ns", &flush),
            ("encoding", options.encoding.words()),
            ("clock", &synchronisation()),
        ]);
        recording.extend(options.asked.iter().map(|(key, value)| (format!("option/{key}"), value.clone())));
        self.shared.write_metadata(metadata::RECORDING, recording);
        if let Some((name, values)) = self.shared.labels.as_ref().map(|labels| labels.record(false)) {
            self.shared.write_metadata(name, values);
        }
        self.shared.event(level::INFO, "recording.started", &options.program);
        self.clock_pair(self.start, 0);
    }

    /// Looks after everything until the recording ends.
    fn watch_over(&mut self, is_in_place: &dyn Fn() -> bool, stop: &dyn Fn() -> bool, told: &mut dyn FnMut(&Status)) {
        let mut next_ns = self.start.monotonic_ns + STATUS_NS;
        while !self.shared.is_stopping() {
            std::thread::sleep(TICK);
            let now = self.shared.clock.now();
            let since = self.shared.book().first.unwrap_or_else(|| self.shared.host.stamp(self.start));
            let passed = self.shared.host.stamp(now).0 - since.0;
            if stop() {
                self.shared.end(EndedBy::Request);
            } else if self.options.duration.is_some_and(|duration| passed >= duration.as_nanos() as i64) {
                self.shared.end(EndedBy::Duration);
            }
            if now.monotonic_ns >= next_ns {
                next_ns = now.monotonic_ns + STATUS_NS;
                self.look_at_clock(now);
                if !is_in_place() {
                    let text = format!("{} or its folder was moved or removed", self.options.path.display());
                    self.shared.event(level::ERROR, "log.gone", &text);
                    self.shared.end(EndedBy::WriteFailed(text));
                }
                let status = self.status(now);
                if status.room_bytes == 0 {
                    self.shared.end(EndedBy::Reserve);
                }
                told(&status);
            }
        }
    }

    fn look_at_clock(&mut self, now: Arrival) {
        let step_ns = self.watch.look(now);
        if step_ns != 0 {
            let text = format!("the host's realtime clock was set by {:.3} s; stamps stay", step_ns as f64 / 1e9);
            self.shared.event(level::WARN, "clock.step", &text);
        }
        self.clock_pair(now, step_ns);
    }

    fn clock_pair(&self, now: Arrival, step_ns: i64) {
        let after = self.shared.clock.now();
        let stamp = self.shared.host.stamp(now);
        let Ok(header) = Header::new(stamp, "") else { return };
        let pair = ClockPair {
            header,
            monotonic_ns: now.monotonic_ns,
            realtime_ns: now.realtime_ns,
            step_ns,
            uncertainty_ns: after.monotonic_ns - now.monotonic_ns,
        };
        self.shared.write(vec![Encoded::new(topics::CLOCK, stamp, Stamp(now.realtime_ns), &pair)]);
    }

    fn status(&mut self, now: Arrival) -> Status {
        let (file_bytes, latency_p99_ms) = self.written();
        let elapsed_s = (now.monotonic_ns - self.start.monotonic_ns) as f64 / 1e9;
        let last = self.last.as_ref();
        let since_s = last.map_or(elapsed_s, |(ns, _)| (now.monotonic_ns - ns) as f64 / 1e9);
        let per_s = |count: u64, before: u64| count.saturating_sub(before) as f64 / since_s;
        let room = room_bytes(folder_of(&self.options.path), file_bytes).unwrap_or(u64::MAX);
        let room_bytes = room.saturating_sub(self.options.reserve_bytes);
        let mut book = self.shared.book();
        let received = |stream: Stream| {
            let known = last.and_then(|(_, last)| last.streams.iter().find(|s| s.stream == stream));
            known.map_or(0, |known| known.counts.received)
        };
        let streams = book.counts().into_iter().map(|(stream, counts)| StreamStatus {
            stream,
            rate_hz: per_s(counts.received, received(stream)),
            waiting: match stream {
                Stream::Color => self.shared.color.load().items,
                Stream::Depth => self.shared.depth.load().items,
                Stream::Gyro | Stream::Accel | Stream::Mocap => 0,
            },
            counts,
        });
        let streams: Vec<StreamStatus> = streams.collect();
        let flushed = streams.iter().map(|stream| stream.counts.flushed).sum();
        let bytes_per_s = per_s(file_bytes, last.map_or(0, |(_, last)| last.file_bytes));
        let status = Status {
            kind: "status",
            elapsed_s,
            streams,
            file_bytes,
            bytes_per_s,
            waiting_bytes: self.shared.outbox.load().weight,
            room_bytes,
            room_s: room_s(room_bytes, bytes_per_s, flushed),
            clock: self.watch.health(),
            mocap: book.mocap,
            segmentation: self.shared.labels.as_ref().map(Labels::counts),
            latency_p99_ms,
            happenings: book.untold(),
        };
        drop(book);
        self.last = Some((now.monotonic_ns, status.clone()));
        status
    }

    /// Size of the file and the p99 of the latencies, milliseconds.
    fn written(&self) -> (u64, f64) {
        let progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        (progress.bytes, progress.latency.quantile_ms(0.99))
    }

    /// The last records, the log's name, and the verdict.
    fn close(&mut self, log: Option<LogWriter>, file: &File, partial: PathBuf) -> Result<Verdict, RecordError> {
        let now = self.shared.clock.now();
        self.watch.look(now);
        let (ended_by, setup) = {
            let mut book = self.shared.book();
            book.end_away(self.shared.host.stamp(now));
            (book.ended_by.clone().unwrap_or(EndedBy::Request), book.setup.clone())
        };
        if let EndedBy::Refused(reason) = ended_by {
            log.into_iter().for_each(LogWriter::discard);
            return Err(RecordError::Refused(reason));
        }
        let mut verdict = self.verdict(now, ended_by);
        let finished = log.map(|mut log| {
            if let Some(setup) = setup {
                append(&mut log, &setup.messages(self.shared.host.stamp(now))?)?;
            }
            if let Some((name, values)) = self.shared.labels.as_ref().map(|labels| labels.record(true)) {
                log.metadata(&name, values)?;
            }
            self.synchronise(&mut log)?;
            log.metadata(metadata::VERDICT, record_of(&verdict))?;
            log.finish()
        });
        match finished {
            Some(Ok(bytes)) => verdict.file_bytes = bytes,
            other => {
                if let (Some(Err(error)), false) = (other, matches!(verdict.ended_by, EndedBy::WriteFailed(_))) {
                    verdict.ended_by = EndedBy::WriteFailed(error.to_string());
                }
                if let EndedBy::WriteFailed(error) = &verdict.ended_by {
                    verdict.reasons.push(error.clone());
                }
                let place = place_of(file);
                verdict.reasons.push(place.as_ref().map_or_else(
                    || "the file was removed while it was written: nothing of it is left".to_owned(),
                    |place| format!("what was written stands in {}: recover it", place.display()),
                ));
                let partial = place.unwrap_or(partial);
                (verdict.complete, verdict.file, verdict.file_bytes) = (false, partial, self.written().0);
            }
        }
        Ok(verdict)
    }

    /// Estimates clocks and offsets from what was recorded. The hand-eye transform needs the camera's path, and so a replay:
    /// `pslam sync` does that.
    fn synchronise(&self, log: &mut LogWriter) -> Result<(), WriteError> {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        let signals = std::mem::take(&mut progress.signals).into_signals();
        drop(progress);
        if !self.options.synchronise || (signals.bodies.is_empty() && signals.arrivals.is_empty()) {
            return Ok(());
        }
        log.metadata(metadata::SYNC, solve(&signals, &SyncOptions::default()).to_metadata())
    }

    fn verdict(&self, now: Arrival, ended_by: EndedBy) -> Verdict {
        let book = self.shared.book();
        let segmentation = self.shared.labels.as_ref().map(Labels::counts);
        let mut reasons = reasons(&book, &ended_by, self.options.duration.is_some());
        reasons.extend(segmentation.iter().filter_map(LabelCounts::lacking));
        let streams = book.counts().into_iter().map(|(stream, counts)| StreamCounts { stream, counts }).collect();
        let progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        Verdict {
            kind: "verdict",
            complete: reasons.is_empty(),
            reasons,
            ended_by,
            file: self.options.path.clone(),
            file_bytes: 0,
            duration_s: book.first.map_or(0.0, |first| (self.shared.host.stamp(now).0 - first.0) as f64 / 1e9),
            streams,
            mocap: book.mocap,
            segmentation,
            clock: self.watch.health(),
            latency_p99_ms: progress.latency.quantile_ms(0.99),
            latency_max_ms: progress.latency.largest_ms(),
            happenings: book.happenings.clone(),
        }
    }
}

/// What a recording lacks.
fn reasons(book: &Book, ended_by: &EndedBy, had_duration: bool) -> Vec<String> {
    let mut reasons = Vec::new();
    for (stream, counts) in book.counts() {
        let name = stream.name();
        if counts.received == 0 {
            reasons.push(format!("{name}: nothing came"));
        }
        if counts.dropped_device > 0 {
            reasons.push(format!("{name}: {} lost before they came here", counts.dropped_device));
        }
        if counts.dropped_host > 0 {
            reasons.push(format!("{name}: {} lost here", counts.dropped_host));
        }
        if counts.restarts > 0 {
            reasons.push(format!("{name}: its counter went back {} x", counts.restarts));
        }
    }
    let mocap = book.ledger.counts(Stream::Mocap).received > 0;
    if mocap && !book.mocap_sees {
        reasons.push("mocap: frames came, but nothing was ever seen in them".to_owned());
    }
    let unseen = book.unseen.iter().filter(|_| mocap);
    reasons.extend(unseen.map(|subject| {
        format!("mocap: subject `{subject}` was never seen; `pslam devices` lists those that the system knows")
    }));
    reasons.extend(book.away.iter().map(|(source, ns)| format!("{source} was away for {:.3} s", *ns as f64 / 1e9)));
    match ended_by {
        EndedBy::Reserve => reasons.push("the disk came down to the reserve".to_owned()),
        EndedBy::DiskFull => reasons.push("the disk is full".to_owned()),
        EndedBy::Source(name) if had_duration => reasons.push(format!("{name} ended before the duration was over")),
        _ => {}
    }
    reasons
}

fn record_of(verdict: &Verdict) -> BTreeMap<String, String> {
    let mut record = BTreeMap::new();
    let mut put = |key: String, value: String| drop(record.insert(key, value));
    put("verdict".to_owned(), if verdict.complete { "complete" } else { "incomplete" }.to_owned());
    put("reason".to_owned(), verdict.reasons.join("; "));
    put("ended_by".to_owned(), format!("{:?}", verdict.ended_by));
    put("duration_ns".to_owned(), ((verdict.duration_s * 1e9) as i64).to_string());
    put("clock_steps".to_owned(), verdict.clock.steps.to_string());
    put("latency_p99_ms".to_owned(), format!("{:.1}", verdict.latency_p99_ms));
    verdict.segmentation.iter().for_each(|counts| put("segmentation".to_owned(), counts.to_string()));
    for StreamCounts { stream, counts } in &verdict.streams {
        let name = stream.name();
        put(format!("{name}/written"), counts.written.to_string());
        put(format!("{name}/dropped_device"), counts.dropped_device.to_string());
        put(format!("{name}/dropped_host"), counts.dropped_host.to_string());
    }
    record
}

/// Frames and units in words.
const CONVENTIONS: &[(&str, &str)] = &[
    (
        "time",
        "log time = header stamp = device time plus one constant a device; publish time = host realtime at arrival",
    ),
    ("order", "messages stand in order of arrival: sort by log time"),
    ("world", "fixed frame of the motion capture system, metres"),
    ("camera", "colour camera: x right, y down, z forward, pixel centres at whole numbers"),
    ("poses", "PoseStamped and TF: world_from_body, quaternion x y z w"),
    ("depth", "16UC1 along z of the depth camera, 0 = none; units_per_metre in pslam/depth"),
    ("imu", "rad/s and m/s^2 in the sensor's axes, not corrected by imu_info"),
];

/// Runs a source again and again until the recording ends.
fn keep_running(source: &mut dyn Source, inlet: &Inlet) {
    let shared = &inlet.shared;
    let mut pause = FIRST_PAUSE;
    let mut last_reason = None;
    while !shared.is_stopping() {
        let began = shared.clock.now().monotonic_ns;
        let reason = match source.run(inlet) {
            End::Stopped => return,
            End::Finished => return shared.end(EndedBy::Source(source.name().to_owned())),
            End::Lost(reason) => reason,
        };
        inlet.away(source.name(), true);
        if last_reason.as_ref() != Some(&reason) {
            shared.event(level::ERROR, &format!("{}.lost", source.name()), &reason);
        }
        last_reason = Some(reason);
        let lasted = Duration::from_nanos((shared.clock.now().monotonic_ns - began).unsigned_abs());
        pause = if lasted > LONGEST_PAUSE { FIRST_PAUSE } else { (pause * 2).min(LONGEST_PAUSE) };
        let mut waited = Duration::ZERO;
        while waited < pause && !shared.is_stopping() {
            std::thread::sleep(TICK);
            waited += TICK;
        }
    }
}
