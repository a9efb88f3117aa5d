//! People out of a log.

use crate::support::Content;
use recorder::edit::redact::{Method, Reason, RedactOptions, RedactReport, redact};
use recorder::edit::{EditError, EditOptions};
use recorder::picture::{ColorPixels, decode_color, encode_color};
use recorder::{LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec};
use schemas::calibration::{CameraModel, Preset};
use schemas::msg::{Category, CategoryTable, CompressedImage, Image, Segment, SegmentTable, format};
use schemas::{Message, Stamp, metadata, topics};
use std::collections::BTreeMap;
use std::path::Path;

const SIZE: (usize, usize) = (96, 64);
const FRAMES: usize = 40;

fn stamp(frame: usize) -> Stamp {
    Stamp(1_000_000_000 + frame as i64 * 33_333_333)
}

/// A person, 12 pixels wide and 20 high, who walks a pixel a frame.
fn is_person(frame: usize, pixel: usize) -> bool {
    let (x, y) = (pixel % SIZE.0, pixel / SIZE.0);
    (25 + frame / 2..37 + frame / 2).contains(&x) && (20..40).contains(&y)
}

/// What the mask says of a frame: none for no mask at all.
type Seen<'a> = &'a dyn Fn(usize) -> Option<bool>;

fn write_log(path: &Path, seen: Seen<'_>, extra: &mut dyn FnMut(&mut RgbdLog)) {
    let camera = CameraModel { width: SIZE.0 as u32, height: SIZE.1 as u32, ..Preset::Freiburg3.camera() };
    let category = |id, name: &str| Category { id, name: name.to_owned(), is_thing: true };
    let layer = |name: &str, categories| LayerSpec { name: name.to_owned(), origin: "test".to_owned(), categories };
    let layers = vec![
        layer("panoptic", vec![category(1, "person"), category(2, "wall")]),
        layer("plain", vec![category(7, "thing")]),
    ];
    let spec = RgbdSpec { layers, ..RgbdSpec::new("test", "people", camera) };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    extra(&mut log);
    for frame in 0..FRAMES {
        let at = stamp(frame);
        let person = |pixel: usize| is_person(frame, pixel);
        let all = 0..SIZE.0 * SIZE.1;
        let data = all.clone().flat_map(|p| if person(p) { [200, 10, 10] } else { [(p % 251) as u8, 90, frame as u8] });
        let pixels = ColorPixels { width: camera.width, height: camera.height, channels: 3, data: data.collect() };
        log.color(at, format::PNG, &encode_color(&pixels).unwrap()).unwrap();
        log.depth(at, &all.clone().map(|p| if person(p) { 5000 } else { 9000 }).collect::<Vec<_>>()).unwrap();
        let Some(seen) = seen(frame) else { continue };
        // Nobody claims the upper right corner.
        let is_unknown = |p: usize| p % SIZE.0 >= 88 && p / SIZE.0 < 8;
        let label = |p: usize| if seen && person(p) { 1 } else { 2 * u16::from(!is_unknown(p)) };
        let class: Vec<u16> = all.clone().map(label).collect();
        let segment = |id, area| Segment { id, category_id: id, score: 0.9, area, ..Segment::default() };
        let segments = if seen { vec![segment(1, 240), segment(2, 1)] } else { vec![segment(2, 1)] };
        log.mask(0, at, &Mask { instance: class.clone(), class, segments }).unwrap();
        let things = vec![7; SIZE.0 * SIZE.1];
        let segments = vec![Segment { id: 7, category_id: 7, ..Segment::default() }];
        log.mask(1, at, &Mask { instance: things.clone(), class: things, segments }).unwrap();
    }
    log.finish().unwrap();
}

fn redacted(source: &Path, out: &Path, asked: &RedactOptions<'_>) -> Result<RedactReport, EditError> {
    redact(source, out, asked, &EditOptions::new("redact", BTreeMap::new()), &mut |_, _| {})
}

fn options(cover_doubtful: bool) -> RedactOptions<'static> {
    RedactOptions { margin_px: 4, bridge: 5, cover_doubtful, ..RedactOptions::new("panoptic") }
}

/// Every picture and depth image of a log.
fn pictures(path: &Path) -> Vec<(Vec<u8>, Vec<u16>)> {
    let content = Content::read(path);
    let depth = content.on(topics::DEPTH).map(|m| Image::decode(&m.4).unwrap().pixels_u16().unwrap());
    let color = content.on(topics::COLOR).map(|m| decode_color(&CompressedImage::decode(&m.4).unwrap().data).unwrap());
    color.map(|color| color.data).zip(depth).collect()
}

#[test]
fn nothing_of_a_person_is_left_and_nothing_else_changes() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    // Missed in two frames, no mask in one.
    write_log(&a, &|frame| (frame != 20).then_some(frame != 9 && frame != 10), &mut |_| {});
    for method in [Method::Fill, Method::Pixelate { block_px: 16 }, Method::Blur { block_px: 16 }] {
        let report = redacted(&a, &b, &RedactOptions { method, ..options(false) }).unwrap();
        assert!(!report.refused, "{report}");
        let doubts: BTreeMap<usize, bool> = report.redacted.doubts.iter().map(|d| (d.frame, d.bridged)).collect();
        assert_eq!(doubts, BTreeMap::from([(9, true), (10, true), (20, true)]));
        let (before, after) = (pictures(&a), pictures(&b));
        for (frame, ((color, depth), (new_color, new_depth))) in before.iter().zip(&after).enumerate() {
            let mut covered = 0;
            for pixel in 0..SIZE.0 * SIZE.1 {
                let range = 3 * pixel..3 * pixel + 3;
                if is_person(frame, pixel) {
                    assert_eq!(new_depth[pixel], 0, "frame {frame} pixel {pixel}");
                    assert_ne!(new_color[range.clone()], [200, 10, 10], "frame {frame} pixel {pixel}");
                }
                if new_depth[pixel] == 0 {
                    covered += 1;
                } else {
                    assert_eq!((&new_color[range.clone()], new_depth[pixel]), (&color[range], depth[pixel]));
                }
            }
            assert_eq!(covered, report.redacted.pixels[frame]);
        }
        std::fs::remove_file(&b).unwrap();
    }
}

#[test]
fn what_no_class_claims_goes_with_the_people_unless_it_is_to_stay() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|name| folder.path().join(name));
    // The person is missed in a frame, which gets twice the margin.
    write_log(&a, &|frame| Some(frame != 9), &mut |_| {});
    let report = redacted(&a, &b, &RedactOptions { cover_unknown: true, ..options(false) }).unwrap();
    let kept = redacted(&a, &c, &options(false)).unwrap();
    let (hidden, shown) = (pictures(&b), pictures(&c));
    for frame in 0..FRAMES {
        for pixel in (0..SIZE.0 * SIZE.1).filter(|p| p % SIZE.0 >= 88 && p / SIZE.0 < 8) {
            assert_eq!(hidden[frame].1[pixel], 0, "frame {frame} pixel {pixel}");
            assert_eq!(shown[frame].1[pixel], 9000, "frame {frame} pixel {pixel}");
        }
        // 8 x 8 pixels and one square of 4 around them, inside the picture.
        assert_eq!(report.redacted.pixels[frame] - kept.redacted.pixels[frame], 12 * 12, "frame {frame}");
    }
    let [before, missed] = [8, 9].map(|frame| kept.redacted.pixels[frame]);
    assert!(missed as f64 > 1.2 * before as f64, "{before} {missed}");
    let asked = |report: &RedactReport| report.options["unknown"].clone();
    assert_eq!((asked(&report), asked(&kept)), ("cover".to_owned(), "keep".to_owned()));
}

#[test]
fn masks_say_what_is_redacted_and_keep_their_rules() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a, &|_| Some(true), &mut |_| {});
    redacted(&a, &b, &options(false)).unwrap();
    let content = Content::read(&b);
    let depths = pictures(&b);
    for (layer, class_id) in [("panoptic", 1), ("plain", 0)] {
        let topics = topics::LayerTopics::new(layer);
        let images = |topic: &str| {
            content.on(topic).map(|m| Image::decode(&m.4).unwrap().pixels_u16().unwrap()).collect::<Vec<_>>()
        };
        let (classes, instances) = (images(&topics.class), images(&topics.instance));
        let tables: Vec<SegmentTable> =
            content.on(&topics.segments).map(|m| SegmentTable::decode(&m.4).unwrap()).collect();
        assert_eq!(CategoryTable::decode(&content.on(&topics.categories).next().unwrap().4).unwrap().layer, layer);
        for frame in 0..FRAMES {
            for pixel in (0..SIZE.0 * SIZE.1).filter(|pixel| depths[frame].1[*pixel] == 0) {
                assert_eq!(classes[frame][pixel], class_id, "{layer} frame {frame}");
            }
            let mut areas = BTreeMap::<u16, u32>::new();
            instances[frame].iter().filter(|id| **id != 0).for_each(|id| *areas.entry(*id).or_default() += 1);
            let told: BTreeMap<u16, u32> = tables[frame].segments.iter().map(|s| (s.id, s.area)).collect();
            assert_eq!(areas, told, "{layer} frame {frame}");
        }
    }
    // The log tells what was done; doing it again changes nothing of the pictures but a wider border.
    let record = content.record(metadata::REDACTION).unwrap();
    assert_eq!((record["classes"].as_str(), record["method"].as_str()), ("person", "fill"));
    assert_eq!(record["pixels_by_frame"].split(' ').count(), FRAMES);
    assert_eq!(metadata::verify(metadata::REDACTION, record), Some(true));
    redacted(&b, &folder.path().join("c"), &options(false)).unwrap();
}

#[test]
fn doubtful_frames_are_refused_or_covered_whole() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    // The person is lost in the middle of the picture for longer than can be bridged.
    write_log(&a, &|frame| Some(!(10..25).contains(&frame)), &mut |_| {});
    let report = redacted(&a, &b, &options(false)).unwrap();
    assert!(report.refused && !b.exists() && report.to_string().contains("REFUSED"), "{report}");
    let open: Vec<usize> = report.redacted.doubts.iter().filter(|d| !d.bridged).map(|d| d.frame).collect();
    assert_eq!(open, [10, 11, 12, 13, 14, 20, 21, 22, 23, 24]);
    assert!(report.redacted.doubts.iter().all(|d| d.reasons.contains(&Reason::Vanished)));
    let report = redacted(&a, &b, &options(true)).unwrap();
    assert!(!report.refused);
    for frame in open {
        let (color, depth) = &pictures(&b)[frame];
        assert!(color.iter().all(|value| *value == 128) && depth.iter().all(|value| *value == 0));
    }
    // No mask for longer than can be bridged; no mask at all.
    let [c, d] = ["c", "d"].map(|name| folder.path().join(name));
    write_log(&c, &|frame| (!(12..26).contains(&frame)).then_some(false), &mut |_| {});
    let report = redacted(&c, &folder.path().join("e"), &options(false)).unwrap();
    assert!(report.refused);
    write_log(&d, &|_| None, &mut |_| {});
    let error = redacted(&d, &folder.path().join("e"), &options(true)).unwrap_err();
    assert!(error.to_string().contains("no pictures with masks"), "{error}");
}

#[test]
fn what_no_mask_covers_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a, &|_| Some(true), &mut |log| {
        let picture = CompressedImage { header: Default::default(), format: "png".to_owned(), data: vec![0].into() };
        log.log().write("/other/camera", Stamp(1), &picture).unwrap();
        // Half a second before the first picture.
        log.depth(Stamp(500_000_000), &[9000; SIZE.0 * SIZE.1]).unwrap();
        log.log().attach("photo.jpg", "image/jpeg", Stamp(1), b"x").unwrap();
        log.log().attach("calibration/camera.json", "application/json", Stamp(1), b"{}").unwrap();
    });
    let error = redacted(&a, &b, &options(false)).unwrap_err();
    let said = error.to_string();
    assert!(matches!(error, EditError::Refused(_)) && said.contains("/other/camera, photo.jpg"), "{said}");
    assert!(!said.contains("calibration/") && !said.contains("/camera/depth"), "{said}");
    let drops = |name: &str| name == "/other/camera";
    let allows = |name: &str| name == "photo.jpg";
    redacted(&a, &b, &RedactOptions { drops: &drops, allows: &allows, ..options(false) }).unwrap();
    let content = Content::read(&b);
    assert!(!content.topics().contains(&"/other/camera") && content.attachments.len() == 2);
    let far = Image::decode(&content.on(topics::DEPTH).next().unwrap().4).unwrap().pixels_u16().unwrap();
    assert!(far.iter().all(|value| *value == 0), "nobody knows who was there");
    let unknown = RedactOptions { classes: ["unicorn".to_owned()].into(), ..options(false) };
    let error = redacted(&a, &folder.path().join("c"), &unknown).unwrap_err();
    assert!(error.to_string().contains("unicorn"), "{error}");
}
