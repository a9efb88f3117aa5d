//! Logs written by the recorder are read back to the last pixel, and damage is named.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use recorder::import::{PanopticSource, TumOptions, tum};
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec, picture};
use replayer::log::{Log, LogError, Severity, check, decode};
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{CameraInfo, Category, CompressedImage, Header, Image, Segment};
use schemas::{Message, Stamp, topics};

const WIDTH: u32 = 16;
const HEIGHT: u32 = 12;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;
const FRAMES: usize = 8;
const STEP_NS: i64 = 33_333_333;
const START_NS: i64 = 1_600_000_006_123_456_789;

fn camera() -> CameraModel {
    CameraModel { width: WIDTH, height: HEIGHT, fx: 20.0, fy: 21.0, cx: 8.0, cy: 6.0, distortion: Distortion::None }
}

fn stamp(frame: usize) -> Stamp {
    Stamp(START_NS + frame as i64 * STEP_NS)
}

/// Noise, so that chunks do not shrink to nothing.
fn rgb(frame: usize) -> Vec<u8> {
    (0..PIXELS * 3).map(|i| (i * i * 31 + frame * 97 + i / 7) as u8).collect()
}

fn depth(frame: usize) -> Vec<u16> {
    (0..PIXELS).map(|i| (i * 137 + frame * 1000) as u16).collect()
}

/// A person in the left half, nothing known in the right.
fn mask() -> Mask {
    let left = |id: u16| (0..PIXELS).map(|i| if i % (WIDTH as usize) < 8 { id } else { 0 }).collect::<Vec<_>>();
    let segment =
        Segment { id: 300, category_id: 1, score: 0.9, width: 8, height: HEIGHT, area: 96, ..Segment::default() };
    Mask { class: left(1), instance: left(300), segments: vec![segment] }
}

/// Eight frames; frame 5 has no depth, frame 6 no mask; depth comes 5 ms late.
fn write_log(path: &Path) {
    let mut spec = RgbdSpec::new("test", "noise", camera());
    let categories = vec![Category { id: 1, name: "person".to_owned(), is_thing: true }];
    spec.layers.push(LayerSpec { name: "panoptic".to_owned(), origin: "test".to_owned(), categories });
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    for frame in 0..FRAMES {
        log.ground_truth(stamp(frame), [frame as f64, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]).unwrap();
        let png = picture::encode_rgb8(WIDTH, HEIGHT, &rgb(frame)).unwrap();
        log.color(stamp(frame), "png", &png).unwrap();
        if frame != 6 {
            log.mask(0, stamp(frame), &mask()).unwrap();
        }
        if frame != 5 {
            log.depth(Stamp(stamp(frame).0 + 5_000_000), &depth(frame)).unwrap();
        }
        if frame % 2 == 1 {
            log.log().flush().unwrap(); // two frames a chunk
        }
    }
    log.log().attach("notes.txt", "text/plain", stamp(FRAMES), b"hello").unwrap();
    log.finish().unwrap();
}

fn fresh() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    write_log(&path);
    (folder, path)
}

#[test]
fn frames_come_back_to_the_last_pixel() {
    let (_folder, path) = fresh();
    let log = Log::open(&path).unwrap();
    assert_eq!(log.camera().unwrap(), camera());
    assert_eq!(log.default_layer(), Some("panoptic"));
    let timeline = log.timeline(Some("panoptic")).unwrap();
    assert_eq!((timeline.frames().len(), timeline.unpaired_color, timeline.unpaired_depth), (FRAMES, 1, 0));
    let mut seen = 0;
    for (index, raw) in timeline.stream(0..FRAMES).unwrap().enumerate() {
        let frame = decode(&raw.unwrap(), &camera()).unwrap();
        assert_eq!((frame.index, frame.stamp), (index, stamp(index)));
        assert_eq!(frame.rgb.data, rgb(index));
        match frame.depth {
            None => assert_eq!(index, 5),
            Some(found) => {
                assert_eq!((found.units, found.units_per_metre), (depth(index), 5000.0));
                assert_eq!(found.stamp.0, stamp(index).0 + 5_000_000);
            }
        }
        match frame.mask {
            None => assert_eq!(index, 6),
            Some(found) => {
                let Mask { class, instance, segments } = mask();
                assert_eq!((found.class, found.instance, found.segments), (class, instance, segments));
            }
        }
        seen += 1;
    }
    assert_eq!(seen, FRAMES);
    assert_eq!(log.ground_truth().poses.len(), FRAMES);
    assert_eq!(log.ground_truth().poses[3].stamp, stamp(3));
    assert_eq!(log.ground_truth().length_m(), (FRAMES - 1) as f64);
    assert_eq!(replayer::read_truth(&path).unwrap(), *log.ground_truth());
    let text = path.with_extension("txt");
    std::fs::write(&text, log.ground_truth().to_tum()).unwrap();
    assert_eq!(replayer::read_truth(&text).unwrap(), *log.ground_truth());
}

#[test]
fn a_range_starts_anywhere_and_ends_at_the_end() {
    let (_folder, path) = fresh();
    let timeline = Log::open(&path).unwrap().timeline(None).unwrap();
    let indices = |range| timeline.stream(range).unwrap().map(|f| f.unwrap().index).collect::<Vec<_>>();
    assert_eq!(indices(3..5), [3, 4]);
    assert_eq!(indices(6..usize::MAX), [6, 7]);
    assert!(indices(50..60).is_empty());
    assert!(Log::open(&path).unwrap().timeline(Some("nets")).unwrap_err().to_string().contains("panoptic"));
}

#[test]
fn info_tells_what_is_there() {
    let (_folder, path) = fresh();
    let info = Log::open(&path).unwrap().info();
    assert_eq!((info.frames, info.frames_with_depth, info.unpaired_depth), (8, 7, 0));
    assert_eq!(info.blake3, blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string());
    assert_eq!((info.layers[0].masked_frames, info.layers[0].things), (7, 1));
    assert_eq!(info.ground_truth.as_ref().unwrap().frames_within, 8);
    assert_eq!((info.attachments[0].name.as_str(), info.attachments[0].bytes), ("notes.txt", 5));
    let depth = info.topics.iter().find(|t| t.topic == "/camera/depth/image").unwrap();
    assert!((depth.largest_gap_s - 2.0 * STEP_NS as f64 / 1e9).abs() < 1e-12);
    assert_eq!(depth.largest_gap_at_ns, Some(Stamp(stamp(4).0 + 5_000_000)));
    let text = info.to_string();
    assert!(text.contains("16x12, fx 20") && text.contains("pslam/source") && !text.contains("WRONG"), "{text}");
    assert!(serde_json::to_string(&info).unwrap().contains("\"largest_gap_s\""));
}

#[test]
fn a_good_log_has_no_errors() {
    let (_folder, path) = fresh();
    let report = check(&path).unwrap();
    assert!(report.is_sound(), "{report}");
    let found: BTreeMap<_, _> = report.findings.iter().map(|f| (f.kind, (f.severity, f.count))).collect();
    let expected = [("picture_without_depth", (Severity::Warning, 1)), ("picture_without_mask", (Severity::Note, 1))];
    assert_eq!(found, BTreeMap::from(expected), "{report}");
    assert_eq!(report.chunks, Log::open(&path).unwrap().info().chunks);
    assert!(report.chunks >= 4);
}

/// One bit flipped in every 23rd byte of the file: always reported, never a panic, and pixels are right or refused.
#[test]
fn every_flipped_bit_is_found() {
    let (folder, path) = fresh();
    let good = std::fs::read(&path).unwrap();
    let damaged = folder.path().join("damaged.mcap");
    for at in (0..good.len()).step_by(23) {
        let mut bytes = good.clone();
        bytes[at] ^= 1 << (at % 8);
        std::fs::write(&damaged, &bytes).unwrap();
        let opened = Log::open(&damaged);
        assert!(opened.is_err(), "byte {at} of {}", good.len());
        match check(&damaged) {
            Ok(report) => assert!(!report.is_sound(), "byte {at} of {}", good.len()),
            Err(error) => assert!(matches!(error, LogError::NotALog(_)), "{error}"),
        }
    }
}

#[test]
fn a_cut_file_says_so() {
    let (folder, path) = fresh();
    let good = std::fs::read(&path).unwrap();
    let cut = folder.path().join("cut.mcap");
    for len in (0..good.len()).step_by(101).chain([good.len() - 1]) {
        std::fs::write(&cut, &good[..len]).unwrap();
        let error = Log::open(&cut).unwrap_err();
        match error {
            LogError::NotALog(_) => assert!(len < 8),
            _ => assert!(error.to_string().contains("pslam recover"), "{len}: {error}"),
        }
        if len >= 8 {
            assert!(!check(&cut).unwrap().is_sound());
        }
    }
    std::fs::write(&cut, [&good[..], b"more"].concat()).unwrap();
    assert!(Log::open(&cut).unwrap_err().to_string().contains("4 bytes follow"));
    assert!(matches!(Log::open(&folder.path().join("none.mcap")), Err(LogError::Io { .. })));
    assert!(matches!(Log::open(folder.path()), Err(LogError::NotALog(_))));
}

#[test]
fn a_file_changed_after_opening_is_refused() {
    let (_folder, path) = fresh();
    let timeline = Log::open(&path).unwrap().timeline(None).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    let third = bytes.len() / 3;
    bytes[third..2 * third].iter_mut().for_each(|byte| *byte ^= 4);
    std::fs::write(&path, &bytes).unwrap();
    let failed = timeline.stream(0..FRAMES).unwrap().filter(Result::is_err).count();
    assert_eq!(failed, 1, "one error, and the stream ends");
}

#[test]
fn contradicting_masks_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut spec = RgbdSpec::new("test", "noise", camera());
    let categories = vec![Category { id: 1, name: "person".to_owned(), is_thing: true }];
    spec.layers.push(LayerSpec { name: "panoptic".to_owned(), origin: "test".to_owned(), categories });
    let mut log = RgbdLog::create(&path, &LogOptions::default(), &spec).unwrap();
    let png = picture::encode_rgb8(WIDTH, HEIGHT, &rgb(0)).unwrap();
    for (frame, change) in [(0, 0u16), (1, 7), (2, 0)] {
        log.color(stamp(frame), "png", if frame == 2 { &png[..200] } else { &png }).unwrap();
        let mut labels = mask();
        labels.instance[0] += change;
        log.mask(0, stamp(frame), &labels).unwrap();
    }
    log.finish().unwrap();
    let report = check(&path).unwrap();
    let kinds: Vec<_> =
        report.findings.iter().filter(|f| f.severity == Severity::Error).map(|f| (f.kind, f.count)).collect();
    assert_eq!(kinds, [("contents", 1), ("mask_contradiction", 1)], "{report}");
    let timeline = Log::open(&path).unwrap().timeline(None).unwrap();
    let last = timeline.stream(2..3).unwrap().next().unwrap().unwrap();
    assert!(decode(&last, &camera()).unwrap_err().to_string().contains("colour picture"));
}

#[test]
fn a_real_sequence_is_whole() {
    let source = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/kitchen_moving_box"));
    if !source.is_dir() {
        eprintln!("skipped: {} is not there", source.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("box.mcap");
    let options = TumOptions { panoptic: vec![PanopticSource::new(&source.join("panoptic"))], ..TumOptions::default() };
    tum(source, &path, &options, &mut |_, _| {}).unwrap();
    let report = check(&path).unwrap();
    assert!(report.is_sound(), "{report}");
    let log = Log::open(&path).unwrap();
    let timeline = log.timeline(log.default_layer()).unwrap();
    assert_eq!((timeline.frames().len(), timeline.unpaired_color), (250, 0));
    let jpeg = std::fs::read_dir(source.join("rgb")).unwrap().map(|f| f.unwrap().path()).min().unwrap();
    let first = timeline.stream(0..1).unwrap().next().unwrap().unwrap();
    assert_eq!(first.color.bytes, std::fs::read(jpeg).unwrap());
    let depth = std::fs::read_dir(source.join("depth")).unwrap().map(|f| f.unwrap().path()).min().unwrap();
    let (_, _, pixels) = picture::decode_gray16(&std::fs::read(depth).unwrap()).unwrap();
    let frame = decode(&first, &log.camera().unwrap()).unwrap();
    assert_eq!(frame.depth.unwrap().units, pixels);
    assert!(frame.mask.unwrap().segments.len() > 1);
}

/// Frames in reverse order, as a merge of several files may leave them.
fn write_foreign(path: &Path, options: mcap::WriteOptions) {
    let mut writer = options.profile("ros2").create(std::fs::File::create(path).unwrap()).unwrap();
    let mut channel = |topic: &str, name: &str, text: &str| {
        let schema = writer.add_schema(name, "ros2msg", text.as_bytes()).unwrap();
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap()
    };
    let color = channel(topics::COLOR, CompressedImage::SCHEMA_NAME, &CompressedImage::schema_text());
    let depths = channel(topics::DEPTH, Image::SCHEMA_NAME, &Image::schema_text());
    let info = channel(topics::COLOR_INFO, CameraInfo::SCHEMA_NAME, &CameraInfo::schema_text());
    let other = channel("/chatter", "std_msgs/msg/String", "string data\n");
    for frame in (0..FRAMES).rev() {
        let header = Header::new(stamp(frame), "camera").unwrap();
        let log_time = stamp(frame).0 as u64 + 1000; // received a little later
        let mut write = |channel_id, data: Vec<u8>| {
            let head = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
            writer.write_to_known_channel(&head, &data).unwrap();
        };
        write(info, camera().to_camera_info(header.clone()).encode());
        let png = picture::encode_rgb8(WIDTH, HEIGHT, &rgb(frame)).unwrap();
        write(color, CompressedImage { header: header.clone(), format: "png".to_owned(), data: png.into() }.encode());
        write(depths, Image::from_u16(header, "16UC1", WIDTH, &depth(frame)).encode());
        write(other, b"\0\x01\0\0\x03\0\0\0hi\0".to_vec());
    }
    writer.finish().unwrap();
}

#[test]
fn logs_of_other_writers_are_read_in_order_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let kinds = [
        mcap::WriteOptions::new().compression(None),
        mcap::WriteOptions::new().compression(Some(mcap::Compression::Lz4)),
        mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd)).chunk_size(Some(3000)),
        mcap::WriteOptions::new().use_chunks(false),
        mcap::WriteOptions::new().calculate_chunk_crcs(false).calculate_data_section_crc(false),
    ];
    for (kind, options) in kinds.into_iter().enumerate() {
        let path = folder.path().join(format!("{kind}.mcap"));
        write_foreign(&path, options);
        let log = Log::open(&path).unwrap();
        assert_eq!(log.depth_units_per_metre().unwrap(), 1000.0, "ROS depth is in millimetres");
        let timeline = log.timeline(log.default_layer()).unwrap();
        for (index, raw) in timeline.stream(0..FRAMES).unwrap().enumerate() {
            let frame = decode(&raw.unwrap(), &camera()).unwrap();
            assert_eq!((frame.stamp, frame.rgb.data), (stamp(index), rgb(index)), "kind {kind}");
            assert_eq!(frame.depth.unwrap().units, depth(index));
        }
        let report = check(&path).unwrap();
        assert!(report.is_sound(), "{report}");
        let kinds: Vec<_> = report.findings.iter().map(|f| (f.kind, f.count)).collect();
        assert!(kinds.contains(&("log_time_differs_from_header", 3 * FRAMES)), "{report}");
        assert!(kinds.contains(&("stamp_goes_back", 4 * (FRAMES - 1))), "{report}");
    }
}

#[test]
fn hostile_bytes_give_errors_and_no_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hostile.mcap");
    // A chunk that claims 2^60 bytes unpacked, a record that claims 2^60 bytes, an attachment of one byte, empty records.
    let mut huge_chunk = vec![0; 16];
    huge_chunk.extend((1u64 << 60).to_le_bytes());
    huge_chunk.extend([0; 4 + 4 + 8]);
    let record = |opcode: u8, len: u64, body: &[u8]| [&[opcode][..], &len.to_le_bytes(), body].concat();
    let mut cases = vec![
        record(6, huge_chunk.len() as u64, &huge_chunk),
        record(6, 1 << 60, b""),
        record(9, 1, b"x"),
        record(9, 6, b"xxxxxx"),
        record(5, 3, b"abc"),
        record(5, 22, &[7; 22]),
    ];
    cases.extend((0..=16).map(|opcode| record(opcode, 0, b"")));
    cases.extend((0..=16).map(|opcode| record(opcode, 40, &[0xff; 40])));
    for case in cases {
        std::fs::write(&path, [mcap::MAGIC, &case, mcap::MAGIC].concat()).unwrap();
        assert!(Log::open(&path).is_err(), "{case:?}");
        assert!(!check(&path).unwrap().is_sound(), "{case:?}");
    }
}
