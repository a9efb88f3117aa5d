//! Recordings of librealsense (`.bag`, `.db3`) through its own playback: the same topics as a live recording.

use super::ImportError;
use crate::Arrival;
use crate::capture::{
    Allowed, CameraSetup, Encoding, End, HostClock, Inlet, Limits, RecordError, RecordOptions, Source, Stream,
    StreamCounts, record,
};
use crate::realsense::{
    Camera, CameraError, Context, Format, FrameHeader, Library, Sample, Sink, State, StreamProfile, metadata,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, mpsc};
use std::time::Duration;

/// How often an import that waits looks around.
const LOOK: Duration = Duration::from_millis(20);

/// What an import did.
#[derive(Debug, Clone, Serialize)]
pub struct RealsenseReport {
    /// The recording.
    pub source: PathBuf,
    /// The log.
    pub log: PathBuf,
    /// Its size.
    pub log_bytes: u64,
    /// The library that read it.
    pub library: String,
    /// The camera's name and serial number.
    pub camera: String,
    /// Counts of each stream; what the camera had lost is in the log too.
    pub streams: Vec<StreamCounts>,
    /// Streams of the recording that a log has no topic for.
    pub left_out: Vec<String>,
    /// What the recording lacks, in words.
    pub missing: Vec<String>,
}

impl fmt::Display for RealsenseReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "log            {} ({:.1} MB)", self.log.display(), self.log_bytes as f64 / 1e6)?;
        writeln!(f, "camera         {}, read by {}", self.camera, self.library)?;
        for StreamCounts { stream, counts } in &self.streams {
            let (name, written, lost) = (stream.name(), counts.written, counts.dropped_device);
            writeln!(f, "{name:<14} {written} written, {lost} missing in the recording")?;
        }
        for stream in &self.left_out {
            writeln!(f, "left out       {stream}")?;
        }
        for reason in &self.missing {
            writeln!(f, "missing        {reason}")?;
        }
        Ok(())
    }
}

/// Imports a recording into a log at `out`. Nothing is lost: every picture, every sample, all metadata. Times are those of
/// the recording: arrivals are what librealsense noted as such, else its stamps. `program` is the version of the writer.
///
/// # Errors
/// The library cannot read the file, it holds nothing, or the log cannot be written. No log is left then.
pub fn realsense(
    library: &Library,
    file: &Path,
    out: &Path,
    force: bool,
    program: &str,
) -> Result<RealsenseReport, ImportError> {
    let refused = |source| ImportError::Camera { path: file.to_owned(), source };
    // librealsense's own message for a missing file does not say so.
    let opened = fs::File::open(file);
    opened.map_err(|source| ImportError::Io { path: file.to_owned(), source, hint: String::new() })?;
    let camera = open(library, file).map_err(refused)?;
    let (setup, left_out) = set_up(library, &camera).map_err(refused)?;
    let profiles: Vec<StreamProfile> = setup.streams().into_iter().map(|(_, profile)| profile).collect();
    let name = format!("{} ({})", setup.device.name, setup.device.serial);
    // A camera of its own: a playback that was stopped midway does not begin cleanly again.
    let first = open(library, file).and_then(|camera| first_moment(&camera, &profiles)).map_err(refused)?;
    let first = first.ok_or_else(|| ImportError::content(file, "holds no frame of depth, colour, gyro or accel"))?;

    let clock = Arc::new(FileClock { latest_ns: AtomicI64::new(first.monotonic_ns) });
    let failure = Arc::new(Mutex::new(None));
    let player = Player { camera, setup, profiles, clock: Arc::clone(&clock), failure: Arc::clone(&failure) };
    let options = RecordOptions {
        path: out.to_owned(),
        force,
        flush_interval: Duration::from_secs(1),
        duration: None,
        reserve_bytes: 0,
        encoding: Encoding::Compressed,
        // Arrivals of a playback say nothing about the camera.
        synchronise: false,
        allowed: Allowed { missing_metadata: true },
        limits: Limits::default(),
        onlookers: Vec::new(),
        labelling: None,
        program: program.to_owned(),
        asked: BTreeMap::from([("import".to_owned(), file.display().to_string())]),
    };
    let verdict = record(vec![Box::new(player)], &options, clock, &|| false, &mut |_| {});
    let verdict = verdict.map_err(|error| match error {
        RecordError::Log(error) => ImportError::Write(error),
        other => ImportError::content(out, other.to_string()),
    })?;
    let failed = failure.lock().unwrap_or_else(PoisonError::into_inner).take();
    let written = verdict.file == out;
    if failed.is_some() || !written {
        // The recording still stands; half a log would only be taken for a whole one.
        let _ = fs::remove_file(&verdict.file);
    }
    if let Some(error) = failed {
        return Err(refused(error));
    }
    if !written {
        return Err(ImportError::content(out, verdict.reasons.join("; ")));
    }
    Ok(RealsenseReport {
        source: file.to_owned(),
        log: verdict.file,
        log_bytes: verdict.file_bytes,
        library: format!("librealsense {}", library.version()),
        camera: name,
        streams: verdict.streams,
        left_out,
        missing: verdict.reasons,
    })
}

/// The recording as a camera that waits for whoever takes its frames.
fn open(library: &Library, file: &Path) -> Result<Camera, CameraError> {
    let context = Arc::new(Context::new(library)?);
    context.add_recording(file)?;
    let camera = context.open(None)?;
    camera.set_real_time(false)?;
    Ok(camera)
}

/// One profile for each stream that a log has topics for, and the names of the others.
fn set_up(library: &Library, camera: &Camera) -> Result<(CameraSetup, Vec<String>), CameraError> {
    let device = camera.describe()?;
    let mut profiles: Vec<StreamProfile> = Vec::new();
    let mut left_out = Vec::new();
    for profile in device.sensors.iter().flat_map(|sensor| &sensor.profiles) {
        let known = matches!(profile.format, Format::Z16 | Format::Rgb8 | Format::Bgr8 | Format::MotionXyz32f);
        let taken = profiles.iter().any(|other| other.stream == profile.stream);
        if known && !taken && Stream::of_camera(profile.stream).is_some() {
            profiles.push(*profile);
        } else {
            left_out.push(profile.to_string());
        }
    }
    let setup = CameraSetup {
        library: format!("librealsense {}", library.version()),
        calibration: Arc::new(camera.calibration(&profiles)?),
        device,
        attribute_names: library.metadata_names(),
    };
    Ok((setup, left_out))
}

/// When the first sample came, by the recording.
fn first_moment(camera: &Camera, profiles: &[StreamProfile]) -> Result<Option<Arrival>, CameraError> {
    let (sender, receiver) = mpsc::sync_channel(1);
    let sink: Sink = Arc::new(move |sample| {
        if let Some(moment) = header_of(&sample).and_then(recorded_arrival) {
            // Only the first one fits; the others are of no interest.
            let _ = sender.try_send(moment);
        }
    });
    let streaming = camera.start(profiles, &sink)?;
    loop {
        let ended = streaming.state()? == State::Ended;
        match receiver.recv_timeout(LOOK) {
            Ok(moment) => return Ok(Some(moment)),
            Err(_) if ended => return Ok(None),
            Err(_) => {}
        }
    }
}

fn header_of(sample: &Sample) -> Option<&FrameHeader> {
    match sample {
        Sample::Frame(frame) => Some(&frame.header),
        Sample::Motion(motion) => Some(&motion.header),
        Sample::Unreadable { .. } => None,
    }
}

/// When a sample reached the host that recorded it: what librealsense noted in its metadata, else the sample's stamp.
/// Both clocks get it. `None` for a stamp that is no time.
fn recorded_arrival(header: &FrameHeader) -> Option<Arrival> {
    let noted = header.metadata(metadata::TIME_OF_ARRIVAL).filter(|ms| *ms > 0);
    // Whole milliseconds apart: the product of all of them with a million would be rounded.
    let (ms, fraction) = (header.timestamp_ms.floor(), header.timestamp_ms - header.timestamp_ms.floor());
    let stamped = (0.0..9e12).contains(&ms).then(|| ms as i64 * 1_000_000 + (fraction * 1e6).round() as i64);
    let ns = noted.and_then(|ms| ms.checked_mul(1_000_000)).or(stamped)?;
    Some(Arrival { monotonic_ns: ns, realtime_ns: ns })
}

/// The time of the latest sample, which is "now" while a file is imported.
struct FileClock {
    latest_ns: AtomicI64,
}

impl HostClock for FileClock {
    fn now(&self) -> Arrival {
        let ns = self.latest_ns.load(Ordering::SeqCst);
        Arrival { monotonic_ns: ns, realtime_ns: ns }
    }
}

/// Plays the recording once, as fast as it is written.
struct Player {
    camera: Camera,
    setup: CameraSetup,
    profiles: Vec<StreamProfile>,
    clock: Arc<FileClock>,
    failure: Arc<Mutex<Option<CameraError>>>,
}

impl Player {
    fn play(&self, inlet: &Inlet) -> Result<(), CameraError> {
        inlet.camera(&self.setup);
        let (patient, clock) = (inlet.patient(), Arc::clone(&self.clock));
        let sink: Sink = Arc::new(move |mut sample| {
            let header = match &mut sample {
                Sample::Frame(frame) => &mut frame.header,
                Sample::Motion(motion) => &mut motion.header,
                Sample::Unreadable { .. } => return patient.sample(sample),
            };
            header.arrival = recorded_arrival(header).unwrap_or_else(|| clock.now());
            clock.latest_ns.fetch_max(header.arrival.monotonic_ns, Ordering::SeqCst);
            patient.sample(sample);
        });
        let streaming = self.camera.start(&self.profiles, &sink)?;
        while !inlet.is_stopping() && streaming.state()? == State::Running {
            std::thread::sleep(LOOK);
        }
        Ok(())
    }
}

impl Source for Player {
    fn name(&self) -> &'static str {
        "camera"
    }

    fn run(&mut self, inlet: &Inlet) -> End {
        if let Err(error) = self.play(inlet) {
            *self.failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
        }
        End::Finished
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::realsense::{StreamId, StreamKind, TimestampDomain};

    #[test]
    fn arrivals_are_those_of_the_recording() {
        let mut header = FrameHeader {
            stream: StreamId::only(StreamKind::Depth),
            number: 1,
            timestamp_ms: 1_700_000_000_000.25,
            domain: TimestampDomain::GlobalTime,
            metadata: Vec::new(),
            arrival: Arrival::default(),
        };
        let ns = |header: &FrameHeader| recorded_arrival(header).map(|arrival| arrival.realtime_ns);
        assert_eq!(ns(&header), Some(1_700_000_000_000_250_000));
        header.metadata = vec![(metadata::TIME_OF_ARRIVAL, 1_700_000_000_017)];
        assert_eq!(ns(&header), Some(1_700_000_000_017_000_000));
        header.metadata = vec![(metadata::TIME_OF_ARRIVAL, i64::MAX)];
        assert_eq!(ns(&header), Some(1_700_000_000_000_250_000), "nonsense is passed over");
        header.timestamp_ms = f64::NAN;
        assert_eq!(ns(&header), None);
    }
}
