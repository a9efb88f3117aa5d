//! Replaying: the same bits for any number of threads, and every difference named.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use fixtures::{RenderedFrame, World, WorldConfig, scenario};
use recorder::picture::encode_rgb8;
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use replayer::OutputError;
use replayer::run::records::{Block, RecordError, RecordReader, RecordWriter};
use replayer::run::{
    CONFIG_TOML, RECORDS_BIN, RUN_JSON, ReplayOptions, RunError, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT,
    bench, diff, replay, verify,
};
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{Category, Segment};
use schemas::{Stamp, topics};
use slam::Config;
use slam_math::Digest;
use tempfile::TempDir;

const FRAMES: u32 = 16;
const DARK: std::ops::Range<u32> = 6..9;
const FORMAT_PNG: &str = schemas::msg::format::PNG;

/// Sixteen frames of the demo's world, rendered once.
fn rendered() -> &'static (World, Vec<RenderedFrame>) {
    static FRAMES_ONCE: OnceLock<(World, Vec<RenderedFrame>)> = OnceLock::new();
    FRAMES_ONCE.get_or_init(|| {
        let camera =
            fixtures::Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 159.5, cy_px: 119.5 };
        let world = World::new(&WorldConfig { camera, texels_per_metre: 160.0, ..scenario::demo() }).unwrap();
        let frames = (0..FRAMES).map(|index| world.frame(index)).collect();
        (world, frames)
    })
}

/// Writes the world's frames as a log; `edit` may change them on the way, `false` leaves depth and mask away.
fn write_log(path: &Path, edit: impl Fn(&mut RenderedFrame) -> bool) {
    let (world, frames) = rendered();
    let camera = world.camera();
    let model = CameraModel {
        width: camera.width,
        height: camera.height,
        fx: camera.fx_px,
        fy: camera.fy_px,
        cx: camera.cx_px,
        cy: camera.cy_px,
        distortion: Distortion::None,
    };
    let category = |c: &fixtures::Category| Category { id: c.id, name: c.name.to_owned(), is_thing: c.is_thing };
    let layer = LayerSpec {
        name: topics::DEFAULT_LAYER.to_owned(),
        origin: "rendered".to_owned(),
        categories: fixtures::categories().iter().map(category).collect(),
    };
    let spec = RgbdSpec {
        depth_units_per_metre: "1000".to_owned(),
        layers: vec![layer],
        ..RgbdSpec::new("synthetic", "test", model)
    };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    for frame in frames {
        let mut frame = frame.clone();
        let complete = edit(&mut frame);
        let stamp = Stamp(frame.stamp_ns);
        log.color(stamp, FORMAT_PNG, &encode_rgb8(camera.width, camera.height, &frame.rgb).unwrap()).unwrap();
        if complete {
            log.depth(stamp, &frame.depth_units).unwrap();
            log.mask(0, stamp, &mask(&frame)).unwrap();
        }
    }
    log.finish().unwrap();
}

fn mask(frame: &RenderedFrame) -> Mask {
    let labels = &frame.panoptic;
    let category = |id: &u16| labels.segments.iter().find(|s| s.id == *id).map_or(0, |s| s.category_id);
    let segment = |s: &fixtures::Segment| Segment {
        id: s.id,
        category_id: s.category_id,
        score: 1.0,
        area: labels.ids.iter().filter(|id| **id == s.id).count() as u32,
        ..Segment::default()
    };
    Mask {
        class: labels.ids.iter().map(category).collect(),
        instance: labels.ids.clone(),
        segments: labels.segments.iter().map(segment).collect(),
    }
}

fn unchanged(_: &mut RenderedFrame) -> bool {
    true
}

fn temp_log(edit: impl Fn(&mut RenderedFrame) -> bool) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("test.mcap");
    write_log(&log, edit);
    (dir, log)
}

fn run(log: &Path, out: &Path, options: &ReplayOptions) -> RunSummary {
    let mut calls = Vec::new();
    let summary = replay(log, out, options, &mut |done, total| calls.push((done, total))).unwrap();
    let total = summary.result.frames;
    assert_eq!(calls, (1..=total).map(|done| (done, total)).collect::<Vec<_>>(), "no frame is skipped");
    summary
}

fn with_threads(threads: usize) -> ReplayOptions {
    // Keyframes in quick succession, so that bundle adjustment, which uses the threads too, has its share.
    let config = Config::from_toml("[keyframes]\nmin_close_tracked = 10000\nmin_close_untracked = 10").unwrap();
    ReplayOptions { config, threads, ..ReplayOptions::default() }
}

fn files_of(run: &Path) -> Vec<Vec<u8>> {
    let names = [TRAJECTORY_TXT, TRAJECTORY_ONLINE_TXT, RECORDS_BIN, CONFIG_TOML];
    names.iter().map(|name| fs::read(run.join(name)).unwrap()).collect()
}

/// `replay` of the unchanged world with one thread, made once.
fn reference() -> &'static (TempDir, PathBuf, PathBuf) {
    static ONCE: OnceLock<(TempDir, PathBuf, PathBuf)> = OnceLock::new();
    ONCE.get_or_init(|| {
        let (dir, log) = temp_log(unchanged);
        let out = dir.path().join("run");
        run(&log, &out, &with_threads(1));
        (dir, log, out)
    })
}

/// Copies a run, to be damaged.
fn copy_of(run: &Path) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(run).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, dir.path().join(path.file_name().unwrap())).unwrap();
    }
    let path = dir.path().to_owned();
    (dir, path)
}

#[test]
fn threads_do_not_change_a_bit() {
    let (_, log, one) = reference();
    let dir = tempfile::tempdir().unwrap();
    let first = RunSummary::read(one).unwrap();
    assert_eq!(first.result.frames, FRAMES as usize);
    assert!(first.result.tracked >= FRAMES as usize - 1 && first.result.keyframes >= 4, "{first}");
    for threads in [2, 4] {
        let out = dir.path().join(threads.to_string());
        let summary = run(log, &out, &with_threads(threads));
        assert_eq!((&summary.fingerprint, &summary.result), (&first.fingerprint, &first.result), "{threads} threads");
        assert_eq!(files_of(&out), files_of(one), "{threads} threads");
        assert_eq!(summary, RunSummary::read(&out).unwrap());
        assert!(diff(one, &out).unwrap().same());
    }
    let measured = bench(log, &with_threads(2), &mut |_, _| {}).unwrap();
    assert_eq!(measured.fingerprint, first.fingerprint);
    let names: Vec<&str> = measured.timing.stages.iter().map(|stage| stage.stage.as_str()).collect();
    assert_eq!((names.len(), names[..2].to_vec()), (10, vec!["decode", "features"]), "{names:?}");
}

#[test]
fn one_pixel_of_a_mask_is_found() {
    let (_, _, whole) = reference();
    let (dir, log) = temp_log(|frame| {
        if frame.index == 5 {
            let person = frame.panoptic.segments.iter().find(|s| s.category_id == 1).expect("a person is in view").id;
            let at = frame.panoptic.ids.iter().position(|id| *id == person).unwrap();
            frame.panoptic.ids[at] = 0;
        }
        true
    });
    let out = dir.path().join("run");
    run(&log, &out, &with_threads(2));
    let report = diff(whole, &out).unwrap();
    assert!(!report.same());
    assert_ne!(report.fingerprints[0], report.fingerprints[1]);
    assert_eq!(report.header.iter().map(|d| d.field.as_str()).collect::<Vec<_>>(), ["log (BLAKE3)"]);
    if let Some(first) = report.first {
        assert!(first.frame >= Some(5), "{first}");
    }
}

#[test]
fn a_changed_mask_is_named_by_frame_stage_and_field() {
    let (_, _, whole) = reference();
    let (dir, log) = temp_log(|frame| {
        if frame.index == 5 {
            frame.panoptic.ids.iter_mut().take(320 * 60).for_each(|id| *id = 0);
        }
        true
    });
    let out = dir.path().join("run");
    run(&log, &out, &with_threads(1));
    let report = diff(whole, &out).unwrap();
    let first = report.first.clone().unwrap();
    assert_eq!((first.frame, first.stage, first.field.as_str()), (Some(5), Some("features"), "keypoints"), "{report}");
    assert_eq!(report.equal_frames, 5);
    assert_ne!(first.values[0], first.values[1]);
    assert!(report.to_string().contains("5 frames are the same, then frame 5 at "), "{report}");
}

#[test]
fn a_changed_configuration_is_named() {
    let (dir, log) = temp_log(unchanged);
    let (_, _, whole) = reference();
    let out = dir.path().join("run");
    let config = with_threads(2).config.with_toml("[orb]\nfeatures = 700").unwrap();
    run(&log, &out, &ReplayOptions { config, ..with_threads(2) });
    let report = diff(whole, &out).unwrap();
    let [header] = report.header.as_slice() else { panic!("{report}") };
    assert_eq!((header.field.as_str(), header.values[1].as_str()), ("config orb.features", "700"));
    let first = report.first.unwrap();
    assert_eq!((first.frame, first.stage, first.field.as_str()), (Some(0), Some("features"), "keypoints"));
}

#[test]
fn ranges_are_clipped_and_count_from_zero() {
    let (dir, log) = temp_log(unchanged);
    let part = |frames, name: &str| {
        let options = ReplayOptions { frames: Some(frames), ..with_threads(2) };
        replay(&log, &dir.path().join(name), &options, &mut |_, _| {})
    };
    let summary = part(10..99, "a").unwrap();
    assert_eq!((summary.result.frames, summary.header.frames.clone()), (6, 10..16));
    let clipped = summary.result.events.iter().find(|event| event.frame.is_none()).unwrap();
    assert_eq!(clipped.text, "frames 10..99 were asked for; the log ends at 16");
    let open = part(14..usize::MAX, "open").unwrap();
    assert_eq!((open.header.frames, open.result.warnings), (14..16, 0));
    let first_stamp = rendered().1[10].stamp_ns;
    let trajectory = fs::read_to_string(dir.path().join("a").join(TRAJECTORY_TXT)).unwrap();
    assert!(trajectory.contains(&Stamp(first_stamp).to_decimal9()), "{trajectory}");
    for empty in [16..20, 5..5] {
        assert!(matches!(part(empty, "b"), Err(RunError::Range { frames: 16, .. })));
    }
    assert!(!dir.path().join("b").exists());
}

#[test]
fn dark_frames_are_lost_and_never_written() {
    let (dir, log) = temp_log(|frame| {
        if DARK.contains(&frame.index) {
            frame.rgb.fill(0);
            frame.depth_units.fill(0);
        }
        true
    });
    let out = dir.path().join("run");
    let summary = run(&log, &out, &with_threads(4));
    assert_eq!(summary.result.frames, FRAMES as usize);
    assert_eq!(summary.result.lost_frames, [DARK], "{summary}");
    assert!(summary.result.events.iter().any(|event| event.warning && event.text.contains("track lost")));
    for name in [TRAJECTORY_TXT, TRAJECTORY_ONLINE_TXT] {
        let text = fs::read_to_string(out.join(name)).unwrap();
        for frame in &rendered().1 {
            let written = text.contains(&Stamp(frame.stamp_ns).to_decimal9());
            assert!(!(written && DARK.contains(&frame.index)), "{name} has the dark frame {}", frame.index);
        }
        assert!(text.lines().count() > 1);
    }
}

#[test]
fn missing_depth_and_mask_are_told() {
    let (dir, log) = temp_log(|frame| frame.index != 4);
    let summary = run(&log, &dir.path().join("run"), &with_threads(2));
    let told: Vec<&str> =
        summary.result.events.iter().filter(|e| e.frame == Some(4) && e.warning).map(|e| e.text.as_str()).collect();
    assert!(told[0].contains("no depth image") && told[1].contains("no mask"), "{told:?}");
}

#[test]
fn verify_passes_and_finds_what_was_changed() {
    let (_, log, whole) = reference();
    let check = |run: &Path| verify(run, Some(log), 2, &mut |_, _| {});
    let report = verify(whole, None, 1, &mut |_, _| {}).unwrap();
    assert!(report.passed() && report.notes.is_empty(), "{report}");
    assert_eq!(report.equal_frames, FRAMES as usize);

    // Records with one digest changed and a chain that agrees with them.
    let (_dir, run) = copy_of(whole);
    let fingerprint = forge(&run, 3);
    let difference = check(&run).unwrap().difference.unwrap();
    assert_eq!(difference.field, "fingerprint in run.json", "{difference}");
    let mut summary = RunSummary::read(&run).unwrap();
    summary.fingerprint = fingerprint.to_string();
    fs::write(run.join(RUN_JSON), serde_json::to_string(&summary).unwrap()).unwrap();
    let report = check(&run).unwrap();
    let difference = report.difference.clone().unwrap();
    assert_eq!((difference.frame, difference.stage, difference.field.as_str()), (Some(3), Some("pose"), "state"));
    assert!(!report.passed() && report.equal_frames == 3, "{report}");

    let (_dir, run) = copy_of(whole);
    let path = run.join(TRAJECTORY_TXT);
    let text = fs::read_to_string(&path).unwrap().replacen(" 0.0", " 0.1", 1);
    fs::write(&path, text).unwrap();
    assert_eq!(check(&run).unwrap().difference.unwrap().field, TRAJECTORY_TXT);

    let (_other_dir, other) = temp_log(|frame| frame.index != 15);
    assert!(matches!(verify(whole, Some(&other), 1, &mut |_, _| {}), Err(RunError::OtherLog { .. })));
}

/// Rewrites the records with another digest for the tracking state of one frame.
fn forge(run: &Path, frame: u32) -> Digest {
    let path = run.join(RECORDS_BIN);
    let mut reader = RecordReader::open(&path).unwrap();
    let mut writer = RecordWriter::default();
    let mut bytes = RecordWriter::preamble();
    bytes.extend(writer.block(&Block::Header(reader.header().clone())));
    while let Some(mut block) = reader.next_block().unwrap() {
        if let Block::Frame(entry) = &mut block
            && entry.frame == frame
        {
            entry.fields.iter_mut().find(|field| field.field == "state").unwrap().digest = Digest(7);
        }
        bytes.extend(writer.block(&block));
    }
    fs::write(&path, bytes).unwrap();
    writer.fingerprint()
}

fn read_all(path: &Path) -> Result<usize, RecordError> {
    let mut reader = RecordReader::open(path)?;
    let mut blocks = 0;
    while reader.next_block()?.is_some() {
        blocks += 1;
    }
    Ok(blocks)
}

#[test]
fn damaged_records_are_refused() {
    let (_, log, whole) = reference();
    let (_dir, run) = copy_of(whole);
    let path = run.join(RECORDS_BIN);
    let good = fs::read(&path).unwrap();
    assert_eq!(read_all(&path).unwrap(), FRAMES as usize + 1);
    for at in (0..good.len()).step_by(97) {
        let mut bad = good.clone();
        bad[at] ^= 1 << (at % 8);
        fs::write(&path, &bad).unwrap();
        assert!(read_all(&path).is_err(), "bit flipped in byte {at}");
        fs::write(&path, &good[..at]).unwrap();
        assert!(read_all(&path).is_err(), "cut at byte {at}");
    }
    fs::write(&path, [good.as_slice(), &[0]].concat()).unwrap();
    let error = verify(&run, Some(log), 1, &mut |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("bytes after the end"), "{error}");
    assert!(matches!(diff(&run, whole), Err(RunError::Records(RecordError::Damaged { .. }))));
}

#[test]
fn nothing_is_overwritten_by_accident() {
    let (dir, log) = temp_log(unchanged);
    let short = |force| ReplayOptions { frames: Some(0..2), force, ..with_threads(1) };
    let go = |out: &Path, force| replay(&log, out, &short(force), &mut |_, _| {});
    let out = dir.path().join("run");
    go(&out, false).unwrap();
    let before = files_of(&out);
    assert!(matches!(go(&out, false), Err(RunError::Output(_))));
    go(&out, true).unwrap();
    assert_eq!(files_of(&out), before);

    let precious = dir.path().join("precious");
    fs::create_dir(&precious).unwrap();
    fs::write(precious.join("thesis.tex"), "years of work").unwrap();
    assert!(matches!(go(&precious, true), Err(RunError::Output(OutputError::NotOurs { .. }))));
    assert_eq!(fs::read_to_string(precious.join("thesis.tex")).unwrap(), "years of work");

    fs::create_dir(dir.path().join("next.partial")).unwrap();
    assert!(matches!(go(&dir.path().join("next"), false), Err(RunError::Output(OutputError::Unfinished { .. }))));
    go(&dir.path().join("next"), true).unwrap();
    let mut names: Vec<_> = fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["next", "precious", "run", "test.mcap"], "no temporary folder is left");
}

#[test]
#[cfg(not(feature = "rerun"))]
fn without_the_viewer_its_file_is_refused_with_a_reason() {
    let (dir, log) = temp_log(unchanged);
    let error = replay(&log, &dir.path().join("run"), &ReplayOptions { rrd: true, ..with_threads(1) }, &mut |_, _| {});
    assert!(error.unwrap_err().to_string().contains("--features rerun"));
    assert!(!dir.path().join("run").exists());
}

#[test]
#[cfg(feature = "rerun")]
fn the_inspection_file_does_not_depend_on_threads() {
    let (_, log, whole) = reference();
    let dir = tempfile::tempdir().unwrap();
    let inspected = |threads: usize| {
        let out = dir.path().join(threads.to_string());
        run(log, &out, &ReplayOptions { rrd: true, ..with_threads(threads) });
        assert_eq!(files_of(&out), files_of(whole), "looking changes nothing");
        fs::read(out.join(replayer::run::INSPECTION_RRD)).unwrap()
    };
    let (one, three) = (inspected(1), inspected(3));
    assert!(one.len() > 100_000, "only {} bytes", one.len());
    assert!(one == three, "files of {} and {} bytes differ", one.len(), three.len());
}
