//! A synthetic D435i's samples, and taking samples from a camera.

mod log;

use log::for_each_sample;
use recorder::Arrival;
use recorder::realsense::*;
use schemas::alignment::{Aligner, Intrinsics, LensModel, Rounding};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The library under test, for one test at a time: a recorder has one camera session, and librealsense's first moments
/// are not made for several. Without a library the tests say so and do nothing.
pub fn library() -> Option<(Library, MutexGuard<'static, ()>)> {
    static ONE: Mutex<()> = Mutex::new(());
    if std::env::var_os(LIBRARY_VARIABLE).is_none() {
        eprintln!("SKIPPED: {LIBRARY_VARIABLE} names no librealsense; tests/realsense/run.sh fetches one");
        return None;
    }
    let guard = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    Some((Library::load(None).unwrap(), guard))
}

/// A D435i with a lens on the colour camera and a turned inertial unit.
pub fn spec(mode: VideoMode) -> SoftwareSpec {
    let mut spec = SoftwareSpec::d435i(mode, mode);
    let color = spec.calibration.streams.iter_mut().find(|s| s.profile.stream.kind == StreamKind::Color).unwrap();
    color.intrinsics.as_mut().unwrap().coefficients = [0.125, -0.25, 0.5, -0.0625, 0.75];
    spec
}

/// Samples of all streams in order of time: noise in every pixel, all metadata that matter.
pub fn samples(mode: VideoMode, frames: u32) -> Vec<Sample> {
    let mut samples = Vec::new();
    let start_ms = 1_700_000_000_000.0;
    let mut noise = 0x9e37_79b9_u32;
    let mut random = move || {
        noise ^= noise << 13;
        noise ^= noise >> 17;
        noise ^= noise << 5;
        noise as u8
    };
    let header = |kind, number: u32, at_ms: f64| FrameHeader {
        stream: StreamId::only(kind),
        number: u64::from(number),
        timestamp_ms: start_ms + at_ms,
        domain: TimestampDomain::GlobalTime,
        metadata: vec![
            (metadata::FRAME_COUNTER, i64::from(number)),
            (metadata::FRAME_TIMESTAMP, (at_ms * 1000.0) as i64 + 5_000),
            (metadata::SENSOR_TIMESTAMP, (at_ms * 1000.0) as i64),
            (metadata::ACTUAL_EXPOSURE, 8_000 + i64::from(number)),
        ],
        arrival: Arrival::default(),
    };
    let (width, height) = (mode.width, mode.height);
    for i in 0..frames {
        let at_ms = f64::from(i) * 1000.0 / f64::from(mode.rate_hz);
        for (kind, format) in [(StreamKind::Depth, Format::Z16), (StreamKind::Color, Format::Rgb8)] {
            let count = width as usize * height as usize * format.bytes_per_pixel().unwrap();
            let bytes = (0..count).map(|_| random()).collect();
            samples.push(Sample::Frame(Frame { header: header(kind, i + 1, at_ms), width, height, format, bytes }));
        }
        for j in 0..6 {
            let number = 6 * i + j;
            let at_ms = f64::from(number) * 1000.0 / f64::from(6 * mode.rate_hz);
            for kind in [StreamKind::Gyro, StreamKind::Accel] {
                let xyz = [f32::from(random()) / 64.0, -1.5, number as f32];
                samples.push(Sample::Motion(Motion { header: header(kind, number, at_ms), xyz }));
            }
        }
    }
    samples
}

/// What a camera gives until `work` is done and, for a recording, its end.
pub fn collect(camera: &Camera, profiles: &[StreamProfile], work: impl FnOnce()) -> Vec<Sample> {
    let got = Arc::new(Mutex::new(Vec::new()));
    let sink: Sink = {
        let got = Arc::clone(&got);
        Arc::new(move |sample| got.lock().unwrap().push(sample))
    };
    let streaming = camera.start(profiles, &sink).unwrap();
    work();
    if camera.is_playback() {
        for _ in 0..1000 {
            if streaming.state().unwrap() == State::Ended {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        assert_eq!(streaming.state().unwrap(), State::Ended);
    }
    drop(streaming);
    let mut got = got.lock().unwrap();
    std::mem::take(&mut *got)
}

fn header(sample: &Sample) -> &FrameHeader {
    match sample {
        Sample::Frame(frame) => &frame.header,
        Sample::Motion(motion) => &motion.header,
        Sample::Unreadable { reason, .. } => panic!("{reason}"),
    }
}

/// Stream by stream, in order: everything but the arrival is the same.
pub fn assert_same(fed: &[Sample], got: &[Sample]) {
    for kind in [StreamKind::Depth, StreamKind::Color, StreamKind::Gyro, StreamKind::Accel] {
        let of_kind = |samples: &[Sample]| -> Vec<Sample> {
            samples.iter().filter(|s| header(s).stream.kind == kind).cloned().collect()
        };
        let (fed, got) = (of_kind(fed), of_kind(got));
        assert_eq!(got.len(), fed.len(), "{kind:?}");
        for (fed, mut got) in fed.into_iter().zip(got) {
            assert!(header(&got).arrival.monotonic_ns > 0);
            match &mut got {
                Sample::Frame(frame) => frame.header.arrival = Arrival::default(),
                Sample::Motion(motion) => motion.header.arrival = Arrival::default(),
                Sample::Unreadable { .. } => {}
            }
            assert!(got == fed, "{kind:?}: got {:?}, fed {:?}", header(&got), header(&fed));
        }
    }
}

/// All samples of a log.
pub fn samples_of_log(path: &Path) -> Vec<Sample> {
    let mut samples = Vec::new();
    for_each_sample(path, &mut |_, sample| samples.push(sample));
    samples
}

/// The ending of a recording that this version writes.
fn ending(library: &Library) -> &'static str {
    if minor_version(library) >= 58 { "db3" } else { "bag" }
}

fn minor_version(library: &Library) -> u32 {
    library.version().split('.').nth(1).unwrap().parse().unwrap()
}

/// A recording by the vendor's recorder, in a folder that goes with it.
pub struct Recorded {
    pub library: Library,
    pub spec: SoftwareSpec,
    pub fed: Vec<Sample>,
    pub file: PathBuf,
    pub folder: tempfile::TempDir,
    _one: MutexGuard<'static, ()>,
}

/// Records what `keep` keeps of so many frames; `None` without a library.
pub fn recorded(mode: VideoMode, frames: u32, keep: impl FnMut(&Sample) -> bool) -> Option<Recorded> {
    let (library, _one) = library()?;
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(format!("camera.{}", ending(&library)));
    let (mut fed, spec) = (samples(mode, frames), spec(mode));
    fed.retain(keep);
    let software = SoftwareCamera::new(&library, &spec).unwrap();
    let recording = software.record(&file, true).unwrap();
    fed.iter().for_each(|sample| software.feed(sample).unwrap());
    drop(recording);
    Some(Recorded { library, spec, fed, file, folder, _one })
}

/// A turn about the axis (1, 1, 1), column after column; `a` is the tangent of half the angle, over the root of 3.
pub fn small_rotation(a: f32) -> [f32; 9] {
    let d = 1.0 + 3.0 * a * a;
    let (same, plus, minus) = (1.0 - 4.0 * a * a / d, 2.0 * (a * a + a) / d, 2.0 * (a * a - a) / d);
    [same, plus, minus, minus, same, plus, plus, minus, same]
}

fn picture(spec: &SoftwareSpec, stream: usize, bytes: Vec<u8>) -> Frame {
    let profile = spec.calibration.streams[stream].profile;
    let header = FrameHeader {
        stream: profile.stream,
        number: 1,
        timestamp_ms: 0.0,
        domain: TimestampDomain::HardwareClock,
        metadata: Vec::new(),
        arrival: Arrival::default(),
    };
    Frame { header, width: profile.width, height: profile.height, format: profile.format, bytes }
}

/// Our alignment against the vendor's.
pub fn compare_alignment(library: &Library, spec: &SoftwareSpec, scene: &dyn Fn(&Intrinsics) -> Vec<u16>) {
    let camera = |stream: usize| spec.calibration.streams[stream].intrinsics.unwrap();
    let (depth_camera, color_camera) = (camera(0), camera(1));
    let depth = scene(&depth_camera);
    let color = vec![0; 3 * color_camera.width as usize * color_camera.height as usize];
    let bytes = depth.iter().flat_map(|value| value.to_le_bytes()).collect();
    let theirs = vendor_align(library, spec, &picture(spec, 0, bytes), &picture(spec, 1, color)).unwrap();
    let extrinsics = &spec.calibration.extrinsics[0].transform;
    // The vendor takes every lens for a pinhole but this one.
    let seen = if color_camera.model == LensModel::ModifiedBrownConrady {
        color_camera
    } else {
        Intrinsics { coefficients: [0.0; 5], ..color_camera }
    };
    let rounding = if minor_version(library) >= 58 { Rounding::Corner } else { Rounding::Middle };
    let aligner = Aligner::new(&depth_camera, &seen, extrinsics, 0.001).unwrap().with_rounding(rounding);
    let ours = aligner.align(&depth).unwrap();
    assert_eq!(ours.len(), theirs.len());
    assert!(ours.iter().filter(|value| **value > 0).count() * 10 > ours.len() * 9, "the scene fills the picture");
    let differ = ours.iter().zip(&theirs).filter(|(ours, theirs)| ours != theirs).count();
    assert_eq!(differ, 0, "of {} pixels, {depth_camera:?} to {color_camera:?}", ours.len());
}
