//! The real librealsense, without a camera: a synthetic one inside the library, and recordings of it that are played.
//! Needs `PSLAM_LIBREALSENSE`; `tests/realsense/run.sh` fetches two versions and runs this for both.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod realsense_support;

use realsense_support::{Recorded, assert_same, collect, library, recorded, samples, samples_of_log, spec};
use recorder::capture::{
    Allowed, CameraSetup, CameraSource, Encoding, EndedBy, Limits, Pace, RecordOptions, SystemClock, record,
};
use recorder::import::realsense;
use recorder::realsense::*;
use schemas::alignment::{Intrinsics, LensModel};
use std::sync::Arc;

const MODE: VideoMode = VideoMode { width: 64, height: 48, rate_hz: 30 };
const ALL: Wish = Wish { color: Some(MODE), depth: Some(MODE), imu: true };

#[test]
fn a_synthetic_camera_gives_what_it_was_fed() {
    let Some((library, _one)) = library() else { return };
    let software = SoftwareCamera::new(&library, &spec(MODE)).unwrap();
    let camera = software.camera().unwrap();
    let description = camera.describe().unwrap();
    assert_eq!((description.serial.as_str(), description.usb.as_deref()), ("000000000435", Some("3.2")));
    assert!(!camera.is_playback() && description.recording.is_none());
    let selection = camera.select(&ALL).unwrap();
    assert_eq!((selection.profiles.len(), selection.findings.len()), (4, 0));
    let fed = samples(MODE, 20);
    let got = collect(&camera, &selection.profiles, || fed.iter().for_each(|sample| software.feed(sample).unwrap()));
    assert_same(&fed, &got);
}

/// librealsense 2.56 keeps the extrinsics of all devices in one list that it does not lock: without the recorder's own lock
/// this ends in a segmentation fault.
#[test]
fn cameras_are_made_on_several_threads() {
    let Some((library, _one)) = library() else { return };
    std::thread::scope(|scope| {
        let make = || (0..300).for_each(|_| drop(SoftwareCamera::new(&library, &spec(MODE)).unwrap()));
        for thread in [(); 8].map(|()| scope.spawn(make)) {
            thread.join().unwrap();
        }
    });
}

#[test]
fn a_camera_is_calibrated_and_set() {
    let Some((library, _one)) = library() else { return };
    let spec = spec(MODE);
    let camera = SoftwareCamera::new(&library, &spec).unwrap().camera().unwrap();
    let profiles = camera.select(&ALL).unwrap().profiles;
    let calibration = camera.calibration(&profiles).unwrap();
    assert_eq!(calibration.depth_units_m, Some(0.001));
    assert_eq!(calibration.extrinsics.len(), 12, "every stream to every other");
    for wanted in &spec.calibration.streams {
        assert_eq!(calibration.stream(wanted.profile.stream), Some(wanted));
    }
    for wanted in &spec.calibration.extrinsics {
        assert_eq!(calibration.extrinsics(wanted.from, wanted.to), Some(wanted.transform));
    }
    let set = camera.set_option("emitter-enabled", 0.0).unwrap();
    assert_eq!((set.len(), set[0].name.as_str(), set[0].value), (1, "Emitter Enabled", 0.0));
    let told = camera.describe().unwrap();
    let options = told.sensors.iter().flat_map(|sensor| &sensor.options);
    assert!(options.clone().any(|option| option.name == "Emitter Enabled" && option.value == 0.0));
    assert!(matches!(camera.set_option("Emitter Enabled", 17.0), Err(CameraError::Option { .. })));
    assert!(matches!(camera.set_option("Depth Units", 0.1), Err(CameraError::Option { .. })), "it only tells");
    assert!(matches!(camera.set_option("Brilliance", 1.0), Err(CameraError::Option { .. })));
}

#[test]
fn a_recording_is_a_camera() {
    let Some(Recorded { library, spec, fed, file, folder: _folder, .. }) = recorded(MODE, 20, |_| true) else { return };
    let context = Arc::new(Context::new(&library).unwrap());
    assert!(matches!(context.open(None), Err(CameraError::NoCamera)));
    context.add_recording(&file).unwrap();
    let devices = context.devices().unwrap();
    assert_eq!(devices.len(), 1);
    assert_eq!(devices[0].recording.as_deref(), file.to_str());
    assert!(
        matches!(context.open(Some("1")), Err(CameraError::Serial { found, .. }) if found == [spec.serial.clone()])
    );
    let camera = context.open(Some(&spec.serial)).unwrap();
    let profiles = camera.select(&ALL).unwrap().profiles;
    let calibration = camera.calibration(&profiles).unwrap();
    assert_eq!((calibration.depth_units_m, &calibration.streams), (Some(0.001), &spec.calibration.streams));
    let to_color = &spec.calibration.extrinsics[0];
    assert_eq!(calibration.extrinsics(to_color.from, to_color.to), Some(to_color.transform));
    camera.set_real_time(false).unwrap();
    assert_same(&fed, &collect(&camera, &profiles, || {}));
    // And once more from the beginning.
    assert_same(&fed, &collect(&camera, &profiles, || {}));
}

#[test]
fn an_imported_recording_is_what_was_fed() {
    // Depth frames 11 and 12 never came.
    let is_lost = |sample: &Sample| matches!(sample, Sample::Frame(f) if f.format == Format::Z16 && (11..=12).contains(&f.header.number));
    let Some(Recorded { library, fed, file, folder, .. }) = recorded(MODE, 40, |sample| !is_lost(sample)) else {
        return;
    };
    let log = folder.path().join("log.mcap");
    let report = realsense(&library, &file, &log, false, "test").unwrap();
    let counts: Vec<(&str, u64, u64)> =
        report.streams.iter().map(|s| (s.stream.name(), s.counts.written, s.counts.dropped_device)).collect();
    assert_eq!(counts, [("color", 40, 0), ("depth", 38, 2), ("gyro", 240, 0), ("accel", 240, 0)]);
    let kept = samples_of_log(&log);
    assert_same(&fed, &kept);
    for sample in &kept {
        let (Sample::Frame(Frame { header, .. }) | Sample::Motion(Motion { header, .. })) = sample else { panic!() };
        let behind_ns = header.arrival.realtime_ns - (header.timestamp_ms * 1e3) as i64 * 1000;
        assert!(behind_ns.abs() <= 1000, "arrivals are the recording's: {header:?}");
    }
    // It does not overwrite, and leaves nothing behind when it fails.
    let again = realsense(&library, &file, &log, false, "test").unwrap_err().to_string();
    assert!(again.contains("exists already"), "{again}");
    std::fs::write(&file, b"not a recording").unwrap();
    let other = folder.path().join("other.mcap");
    assert!(realsense(&library, &file, &other, false, "test").is_err());
    assert!(realsense(&library, &folder.path().join("none.bag"), &other, false, "test").is_err());
    assert!(!other.exists());
}

#[test]
fn planted_faults_are_found() {
    let Some((library, _one)) = library() else { return };
    let faulty = SoftwareSpec { usb: "2.1".to_owned(), ..spec(MODE) };
    let software = SoftwareCamera::new(&library, &faulty).unwrap();
    let camera = software.camera().unwrap();
    let wish = Wish { color: Some(VideoMode { rate_hz: 60, ..MODE }), depth: Some(MODE), imu: false };
    let Selection { profiles, findings } = camera.select(&wish).unwrap();
    assert_eq!(findings.iter().map(Finding::allowed_by).collect::<Vec<_>>(), ["--allow-usb2", "--allow-other-profile"]);
    let mut fed = samples(MODE, 6);
    fed.retain(|sample| !matches!(sample, Sample::Frame(frame) if (3..=4).contains(&frame.header.number)));
    for sample in &mut fed {
        if let Sample::Frame(frame) = sample
            && frame.header.stream.kind == StreamKind::Color
        {
            frame.header.domain = TimestampDomain::SystemTime;
            frame.header.metadata.clear();
        }
    }
    let got = collect(&camera, &profiles, || {
        fed.iter().filter(|s| matches!(s, Sample::Frame(_))).for_each(|sample| software.feed(sample).unwrap());
    });
    let mut counters = Vec::new();
    for sample in got {
        let Sample::Frame(Frame { header, .. }) = sample else { panic!("{sample:?}") };
        let findings = Finding::of_frame(&header);
        if header.stream.kind == StreamKind::Depth {
            counters.push(header.metadata(metadata::FRAME_COUNTER).unwrap());
            assert_eq!(findings, []);
        } else {
            let stream = header.stream;
            let missing = Finding::MissingMetadata { stream, missing: vec!["Frame Counter", "Sensor Timestamp"] };
            assert_eq!(findings, [Finding::SystemTime { stream }, missing]);
        }
    }
    assert_eq!(counters, [1, 2, 5, 6], "the hole is where it was planted");
}

fn opened(context: &Arc<Context>, serial: &str) -> Result<(Camera, CameraSetup), CameraError> {
    let camera = context.open(Some(serial))?;
    let calibration = Arc::new(camera.calibration(&camera.select(&ALL)?.profiles)?);
    let (library, device) = ("librealsense".to_owned(), camera.describe()?);
    Ok((camera, CameraSetup { library, device, calibration, attribute_names: Vec::new() }))
}

/// The library takes a device away while it streams, and has it again a second later. It is the library that tells, by its
/// callback and its list of devices, as of a camera that is pulled out.
#[test]
fn an_unplugged_camera_is_told_and_comes_back() {
    let Some(Recorded { library, spec, fed, file, folder, .. }) = recorded(MODE, 120, |_| true) else { return };
    let context = Arc::new(Context::new(&library).unwrap());
    context.add_recording(&file).unwrap();
    let first = opened(&context, &spec.serial).unwrap();
    let again = {
        let (context, serial) = (Arc::clone(&context), spec.serial.clone());
        Box::new(move || opened(&context, &serial))
    };
    let log = folder.path().join("log.mcap");
    let options = RecordOptions {
        labelling: None,
        path: log.clone(),
        force: false,
        flush_interval: std::time::Duration::from_millis(200),
        duration: None,
        reserve_bytes: 0,
        encoding: Encoding::Auto,
        synchronise: true,
        allowed: Allowed::default(),
        limits: Limits::default(),
        onlookers: Vec::new(),
        program: "test".to_owned(),
        asked: Default::default(),
    };
    let (mut plugged, mut happened, mut before) = (true, Vec::new(), 0);
    let source = CameraSource::new(first, again, Pace::Recorded);
    let verdict = record(vec![Box::new(source)], &options, Arc::new(SystemClock), &|| false, &mut |status| {
        happened.extend(status.happenings.iter().map(|happening| format!("{}: {}", happening.name, happening.text)));
        let is_lost = happened.iter().any(|text| text.starts_with("camera.lost"));
        if plugged && !is_lost && status.streams.iter().all(|stream| stream.counts.received > 20) {
            plugged = false;
            before = status.streams[0].counts.received;
            context.remove_recording(&file).unwrap();
        } else if !plugged && is_lost {
            plugged = true;
            context.add_recording(&file).unwrap();
        }
    });
    let verdict = verdict.unwrap();
    assert!(happened.iter().any(|text| text == "camera.lost: it was unplugged or has reset itself"), "{happened:?}");
    assert!(happened.iter().any(|text| text.starts_with("camera.back: connection 1 to ")), "{happened:?}");
    assert_eq!(verdict.ended_by, EndedBy::Source("camera".to_owned()));
    assert!(verdict.reasons.iter().any(|reason| reason.starts_with("camera was away for ")), "{:?}", verdict.reasons);
    // What came before stands, and after it the whole recording once more.
    let kept = samples_of_log(&log);
    let colors = |samples: &[Sample]| -> Vec<Sample> {
        let is_color = |s: &&Sample| matches!(s, Sample::Frame(frame) if frame.format == Format::Rgb8);
        samples.iter().filter(is_color).cloned().collect()
    };
    let (kept, fed) = (colors(&kept), colors(&fed));
    let cut = kept.len() - fed.len();
    assert!(cut as u64 >= before && cut < fed.len(), "{cut} pictures before it was unplugged, {before} were told");
    assert_same(&fed[..cut], &kept[..cut]);
    assert_same(&fed, &kept[cut..]);
}

/// The library's own camera model, which its headers offer to everybody.
struct VendorLens {
    library: libloading::Library,
    lens: RawLens,
}

#[repr(C)]
struct RawLens {
    size: [i32; 2],
    centre: [f32; 2],
    focal: [f32; 2],
    model: i32,
    coefficients: [f32; 5],
}

impl VendorLens {
    fn new(path: &std::path::Path, lens: &Intrinsics, model: i32) -> Self {
        let size = [lens.width as i32, lens.height as i32];
        let (centre, focal, coefficients) = ([lens.cx, lens.cy], [lens.fx, lens.fy], lens.coefficients);
        // SAFETY: the library is loaded already.
        let library = unsafe { libloading::Library::new(path) }.unwrap();
        Self { library, lens: RawLens { size, centre, focal, model, coefficients } }
    }

    fn project(&self, point: [f32; 3]) -> [f32; 2] {
        type Project = unsafe extern "C" fn(*mut [f32; 2], *const RawLens, *const f32);
        let mut pixel = [0.0; 2];
        // SAFETY: the header's declaration: two numbers out, the lens, three numbers in.
        unsafe {
            let function = self.library.get::<Project>("rs2_project_point_to_pixel").unwrap();
            function(&mut pixel, &self.lens, point.as_ptr());
        }
        pixel
    }

    /// x / z and y / z.
    fn direction(&self, pixel: [f32; 2]) -> [f32; 2] {
        type Deproject = unsafe extern "C" fn(*mut [f32; 3], *const RawLens, *const f32, f32);
        let mut point = [0.0; 3];
        // SAFETY: the header's declaration: three numbers out, the lens, two numbers in, the depth.
        unsafe {
            let function = self.library.get::<Deproject>("rs2_deproject_pixel_to_point").unwrap();
            function(&mut point, &self.lens, pixel.as_ptr(), 1.0);
        }
        [point[0], point[1]]
    }
}

#[test]
fn lenses_bend_as_the_vendors_do() {
    let Some((library, _one)) = library() else { return };
    // A D455's colour camera, as people post its calibration.
    let d455 = [-0.055, 0.066, 0.000_6, -0.000_4, -0.021];
    let models = [
        (LensModel::None, 0, true),
        // librealsense has no way back from this one.
        (LensModel::ModifiedBrownConrady, 1, false),
        (LensModel::InverseBrownConrady, 2, true),
        (LensModel::BrownConrady, 4, true),
    ];
    for (model, number, both_ways) in models {
        let coefficients = if model == LensModel::None { [0.0; 5] } else { d455 };
        let (width, height, fx, fy, cx, cy) = (1280, 720, 637.5, 636.25, 641.5, 359.0);
        let ours = Intrinsics { width, height, fx, fy, cx, cy, model, coefficients };
        let theirs = VendorLens::new(library.path(), &ours, number);
        for pixel in (0..=1280).step_by(64).flat_map(|x| (0..=720).step_by(48).map(move |y| [x as f32, y as f32])) {
            let [x, y] = ours.direction(pixel);
            if both_ways {
                let [their_x, their_y] = theirs.direction(pixel);
                let apart_px = [(x - their_x) * fx, (y - their_y) * fy];
                assert!(
                    apart_px.iter().all(|apart| apart.abs() < 2e-3),
                    "{model:?} {pixel:?}: {x} {y}, theirs {their_x} {their_y}"
                );
            }
            let point = [1.5 * x, 1.5 * y, 1.5];
            let ([u, v], [their_u, their_v]) = (ours.project(point), theirs.project(point));
            assert!(
                [u - their_u, v - their_v].iter().all(|apart_px| apart_px.abs() < 2e-3),
                "{model:?} {pixel:?}: {u} {v}, theirs {their_u} {their_v}"
            );
        }
    }
}

/// A slanted wall with a step, holes and noise, so that rays of all kinds occur.
fn scene(camera: &Intrinsics) -> Vec<u16> {
    let mut noise = 12_345_u32;
    let pixels = (0..camera.height).flat_map(|row| (0..camera.width).map(move |column| (row, column)));
    let value = |(row, column): (u32, u32)| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let wall = 900 + 2 * column + row + (noise >> 29);
        let step = if column > camera.width / 2 && row < camera.height / 2 { 700 } else { 0 };
        if noise.is_multiple_of(17) { 0 } else { (wall + step) as u16 }
    };
    pixels.map(value).collect()
}

#[test]
fn alignment_equals_the_vendors() {
    let Some((library, _one)) = library() else { return };
    let modes = [(640, 480, 640, 480), (848, 480, 640, 480), (640, 360, 1280, 720), (1280, 720, 424, 240)];
    let lenses = [
        (LensModel::None, [0.0; 5]),
        (LensModel::InverseBrownConrady, [0.0; 5]),
        (LensModel::InverseBrownConrady, [-0.055, 0.065, 0.000_6, -0.000_4, -0.021]),
        (LensModel::BrownConrady, [0.1, -0.2, 0.001, -0.001, 0.05]),
        (LensModel::ModifiedBrownConrady, [0.1, -0.2, 0.0, 0.0, 0.05]),
    ];
    for (dw, dh, cw, ch) in modes {
        for (model, coefficients) in lenses {
            let mode = |width, height| VideoMode { width, height, rate_hz: 30 };
            let mut spec = SoftwareSpec::d435i(mode(cw, ch), mode(dw, dh));
            let color = spec.calibration.streams[1].intrinsics.as_mut().unwrap();
            (color.model, color.coefficients) = (model, coefficients);
            // A turn of half a degree about each axis.
            let transform = &mut spec.calibration.extrinsics[0].transform;
            transform.rotation = realsense_support::small_rotation(0.005);
            transform.translation = [0.0148, 0.000_3, -0.000_2];
            realsense_support::compare_alignment(&library, &spec, &scene);
        }
    }
}
