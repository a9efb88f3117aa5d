//! Import of small folders made by the test, with everything that can be wrong with them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use recorder::import::{CameraSource, ImportError, ImportReport, PanopticSource, TumOptions, tum};
use recorder::picture::{encode_gray16, encode_rgb8};
use schemas::calibration::{CameraModel, Preset};
use schemas::msg::{CameraInfo, CategoryTable, CompressedImage, Image, PoseStamped, SegmentTable};
use schemas::topics::{self, LayerTopics};
use schemas::{Message, Stamp, metadata};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const WIDTH: u32 = 4;
const HEIGHT: u32 = 2;

struct Folder {
    dir: tempfile::TempDir,
}

impl Folder {
    /// Three colour pictures at 0, 0.1, 0.2 s and depth 1 ms later; two poses.
    fn new() -> Self {
        let folder = Self { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(folder.path("")).unwrap();
        for sub in ["rgb", "depth"] {
            fs::create_dir(folder.path(sub)).unwrap();
        }
        for i in 0..3_u8 {
            folder.write(
                &format!("rgb/{i}.png"),
                &encode_rgb8(WIDTH, HEIGHT, &[i; (WIDTH * HEIGHT * 3) as usize]).unwrap(),
            );
            let depth = [u16::from(i) * 1000 + 1; (WIDTH * HEIGHT) as usize];
            folder.write(&format!("depth/{i}.png"), &encode_gray16(WIDTH, HEIGHT, &depth).unwrap());
        }
        folder.write("rgb.txt", b"# color\n100.000000 rgb/0.png\n100.100000 rgb/1.png\n100.200000 rgb/2.png\n");
        folder.write("depth.txt", b"100.001000 depth/0.png\n100.101000 depth/1.png\n100.201000 depth/2.png\n");
        folder.write("groundtruth.txt", b"99.9 1 2 3 0 0 0 1\n100.123456789 4 5 6 0 0 0.6 0.8\n");
        folder.write("camera.json", br#"{"fx": 3, "fy": 3, "cx": 2, "cy": 1}"#);
        folder
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join("sequence").join(name)
    }

    fn write(&self, name: &str, bytes: &[u8]) {
        fs::write(self.path(name), bytes).unwrap();
    }

    fn log(&self) -> PathBuf {
        self.dir.path().join("out.mcap")
    }

    fn import(&self, options: &TumOptions) -> Result<ImportReport, ImportError> {
        tum(&self.path(""), &self.log(), &TumOptions { force: true, ..options.clone() }, &mut |_, _| {})
    }

    /// The error's text; nothing may be left behind.
    fn error(&self) -> String {
        let error =
            self.import(&TumOptions { panoptic: self.panoptic(), ..TumOptions::default() }).unwrap_err().to_string();
        assert!(!self.log().exists() && !self.dir.path().join("out.mcap.partial").exists());
        error
    }

    fn panoptic(&self) -> Vec<PanopticSource> {
        let dir = self.path("panoptic");
        if dir.exists() { vec![PanopticSource::new(&dir)] } else { Vec::new() }
    }

    /// Labels for pictures 0 and 1: a person, a wall, void, and an id that no segment has.
    fn add_panoptic(&self, person: u32, wall: u32) {
        fs::create_dir(self.path("panoptic")).unwrap();
        let color = |id: u32| [id as u8, (id >> 8) as u8, (id >> 16) as u8];
        let ids = [person, person, 0, wall, wall, person, 77, wall];
        let pixels: Vec<u8> = ids.into_iter().flat_map(color).collect();
        for i in 0..2 {
            self.write(&format!("panoptic/{i}.png"), &encode_rgb8(WIDTH, HEIGHT, &pixels).unwrap());
        }
        let annotation = |i: u32| {
            format!(
                r#"{{"image_id": {i}, "file_name": "{i}.png", "segments_info": [
                {{"id": {wall}, "category_id": 199, "area": 3, "bbox": [0, 0, 4, 2], "iscrowd": 0}},
                {{"id": {person}, "category_id": 1, "area": 99, "score": 0.5}}]}}"#
            )
        };
        let text = format!(
            r#"{{"annotations": [{}, {}], "categories": [{{"id": 199, "name": "wall", "isthing": 0}},
            {{"id": 1, "name": "person", "isthing": 1, "color": [1, 2, 3]}}]}}"#,
            annotation(0),
            annotation(1)
        );
        self.write("panoptic.json", text.as_bytes());
    }
}

/// Payloads by topic, in file order, with their log times.
fn read(path: &Path) -> BTreeMap<String, Vec<(Stamp, Vec<u8>)>> {
    let bytes = fs::read(path).unwrap();
    let mut topics: BTreeMap<String, Vec<(Stamp, Vec<u8>)>> = BTreeMap::new();
    let mut last = 0;
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        assert!(message.log_time >= last, "messages must stand in order of time");
        last = message.log_time;
        let entry = (Stamp(message.log_time as i64), message.data.to_vec());
        topics.entry(message.channel.topic.clone()).or_default().push(entry);
    }
    topics
}

fn metadata_of(path: &Path, name: &str) -> BTreeMap<String, String> {
    let bytes = fs::read(path).unwrap();
    let records = mcap::read::LinearReader::new(&bytes).unwrap();
    let mut found = records.filter_map(|record| match record.unwrap() {
        mcap::records::Record::Metadata(metadata) if metadata.name == name => Some(metadata.metadata),
        _ => None,
    });
    found.next().unwrap_or_else(|| panic!("no metadata {name}"))
}

#[test]
fn everything_arrives_exactly() {
    let folder = Folder::new();
    let report = folder.import(&TumOptions::default()).unwrap();
    assert_eq!((report.color_images, report.depth_images, report.ground_truth_poses), (3, 3, 2));
    assert_eq!((report.pairing.paired, report.pairing.largest_gap_ns), (3, 1_000_000));
    assert!(report.repairs.is_empty(), "{report}");
    assert_eq!(report.span, (Stamp(99_900_000_000), Stamp(100_201_000_000)));
    let topics = read(&folder.log());
    for (i, (stamp, bytes)) in topics[topics::COLOR].iter().enumerate() {
        let message = CompressedImage::decode(bytes).unwrap();
        assert_eq!(*stamp, Stamp(100_000_000_000 + i as i64 * 100_000_000));
        assert_eq!(Stamp::from(message.header.stamp), *stamp);
        assert_eq!(message.data, fs::read(folder.path(&format!("rgb/{i}.png"))).unwrap(), "PNG bytes stay as they are");
    }
    let (stamp, depth) = &topics[topics::DEPTH][2];
    assert_eq!(*stamp, Stamp(100_201_000_000));
    assert_eq!(Image::decode(depth).unwrap().pixels_u16().unwrap(), [2001; 8]);
    let (stamp, pose) = &topics[topics::GROUND_TRUTH][1];
    let pose = PoseStamped::decode(pose).unwrap().pose;
    assert_eq!(*stamp, Stamp(100_123_456_789));
    assert_eq!((pose.position.y, pose.orientation.z, pose.orientation.w), (5.0, 0.6, 0.8));
    let info = CameraInfo::decode(&topics[topics::COLOR_INFO][0].1).unwrap();
    let camera = CameraModel::from_camera_info(&info).unwrap();
    assert_eq!((camera, camera.width, camera.height, camera.fx), (report.camera, WIDTH, HEIGHT, 3.0));
    for name in [metadata::SOURCE, metadata::CONVENTIONS, metadata::DEPTH, metadata::PAIRING, metadata::IMPORT] {
        assert_eq!(metadata::verify(name, &metadata_of(&folder.log(), name)), Some(true), "{name}");
    }
    assert_eq!(metadata_of(&folder.log(), metadata::DEPTH)[metadata::DEPTH_UNITS_PER_METRE], "5000");
    assert_eq!(metadata_of(&folder.log(), metadata::PAIRING)[metadata::TOLERANCE_NS], "20000000");
}

#[test]
fn the_same_folder_gives_the_same_bytes() {
    let folder = Folder::new();
    folder.add_panoptic(257, 48_128);
    let options = TumOptions { panoptic: folder.panoptic(), ..TumOptions::default() };
    folder.import(&options).unwrap();
    let first = fs::read(folder.log()).unwrap();
    folder.import(&options).unwrap();
    assert!(first == fs::read(folder.log()).unwrap(), "two imports differ");
    let refused = tum(&folder.path(""), &folder.log(), &TumOptions::default(), &mut |_, _| {});
    assert!(refused.unwrap_err().to_string().contains("exists already"));
    assert!(first == fs::read(folder.log()).unwrap(), "a refused import changed the file");
}

#[test]
fn panoptic_labels_become_class_instance_and_segments() {
    // Ids that fit 16 bits stay; a larger one makes the frame's ids 1, 2, ... in their order.
    for (person, wall, expected) in [(257, 48_128, (257, 48_128)), (70_000, 300, (2, 1))] {
        let folder = Folder::new();
        folder.add_panoptic(person, wall);
        let report = folder.import(&TumOptions { panoptic: folder.panoptic(), ..TumOptions::default() }).unwrap();
        assert_eq!(report.masks["panoptic"], 2);
        assert_eq!(report.repairs["colour picture without a mask in layer panoptic"], 1);
        assert_eq!(report.repairs["mask pixel with an id that the JSON does not list made void"], 2);
        assert_eq!(report.repairs["segment area differs from the JSON, counted from the pixels"], 2);
        let topics = read(&folder.log());
        let layer = LayerTopics::new("panoptic");
        let pixels = |topic: &str| Image::decode(&topics[topic][1].1).unwrap().pixels_u16().unwrap();
        let (p, w) = expected;
        assert_eq!(pixels(&layer.class), [1, 1, 0, 199, 199, 1, 0, 199]);
        assert_eq!(pixels(&layer.instance), [p, p, 0, w, w, p, 0, w]);
        let table = SegmentTable::decode(&topics[&layer.segments][1].1).unwrap();
        let person = table.segments.iter().find(|segment| segment.id == p).unwrap();
        assert_eq!((person.category_id, person.area, person.score), (1, 3, 0.5));
        assert_eq!((person.x, person.y, person.width, person.height), (0, 0, 2, 2));
        let categories = CategoryTable::decode(&topics[&layer.categories][0].1).unwrap().categories;
        let kinds: Vec<(u16, bool)> = categories.iter().map(|c| (c.id, c.is_thing)).collect();
        assert_eq!(kinds, [(1, true), (199, false)]);
        assert_eq!(topics[&layer.label_info].len(), 1);
        assert_eq!(topics[&layer.class][1].0, Stamp(100_100_000_000), "masks carry the picture's stamp");
    }
}

#[test]
fn damaged_labels_are_errors() {
    let cases: [(&str, &[u8], &str); 6] = [
        ("panoptic.json", b"{}", "not COCO panoptic"),
        ("panoptic/0.png", b"", "neither PNG nor JPEG"),
        (
            "panoptic.json",
            br#"{"annotations": [], "categories": [{"id": 0, "name": "a"}]}"#,
            "category 0",
        ),
        (
            "panoptic.json",
            br#"{"annotations": [{"file_name": "0.png", "segments_info": [{"id": 1, "category_id": 9}]}], "categories": []}"#,
            "category 9",
        ),
        (
            "panoptic.json",
            br#"{"annotations": [{"file_name": "0.png", "segments_info": [{"id": 0, "category_id": 9}]}], "categories": []}"#,
            "means void",
        ),
        (
            "panoptic.json",
            br#"{"annotations": [{"file_name": "0.png", "segments_info": [{"id": 4, "category_id": 1}, {"id": 4, "category_id": 1}]}],
                "categories": [{"id": 1, "name": "a"}]}"#,
            "twice",
        ),
    ];
    for (name, bytes, expected) in cases {
        let folder = Folder::new();
        folder.add_panoptic(257, 300);
        folder.write(name, bytes);
        let error = folder.error();
        assert!(error.contains(expected), "{name}: {error}");
    }
    let folder = Folder::new();
    folder.add_panoptic(257, 300);
    fs::remove_file(folder.path("panoptic/1.png")).unwrap();
    assert!(folder.error().contains("1.png"));
}

#[test]
fn damaged_folders_are_errors() {
    let large = encode_rgb8(WIDTH, HEIGHT + 1, &[0; (WIDTH * (HEIGHT + 1) * 3) as usize]).unwrap();
    let large_depth = encode_gray16(WIDTH + 1, HEIGHT, &[0; ((WIDTH + 1) * HEIGHT) as usize]).unwrap();
    let shallow = encode_rgb8(WIDTH, HEIGHT, &[0; (WIDTH * HEIGHT * 3) as usize]).unwrap();
    let cases: [(&str, &[u8], &str); 12] = [
        ("rgb/1.png", &large, "4x3 pixels"),
        ("depth/1.png", &large_depth, "5x2 pixels"),
        ("depth/2.png", &shallow, "wanted 16-bit greyscale"),
        ("rgb/2.png", b"", "neither PNG nor JPEG"),
        ("rgb/2.png", b"\xFF\xD8\xFF\xE0", "the file is cut"),
        ("rgb.txt", b"# nothing\n", "lists no pictures"),
        ("rgb.txt", b"1 rgb/0.png\nx rgb/1.png\n", "rgb.txt line 2"),
        ("rgb.txt", b"1 rgb/0.png\n2 rgb/9.png\n", "9.png"),
        ("rgb.txt", b"\xFF\xFE1\0", "UTF-8"),
        ("groundtruth.txt", b"1 2 3\n", "groundtruth.txt line 1"),
        ("camera.json", br#"{"fx": 3}"#, "no cx"),
        ("camera.json", br#"{"fx": 3, "fy": 3, "cx": 2, "cy": 1, "width": 5, "height": 2}"#, "for 5x2"),
    ];
    for (name, bytes, expected) in cases {
        let folder = Folder::new();
        folder.write(name, bytes);
        let error = folder.error();
        assert!(error.contains(expected), "{name}: {error}");
    }
    for name in ["rgb.txt", "depth.txt", "rgb/0.png", "depth/1.png", "camera.json"] {
        let folder = Folder::new();
        fs::remove_file(folder.path(name)).unwrap();
        let error = folder.error();
        let named = if name == "camera.json" { "preset" } else { name };
        assert!(error.contains(named), "{name}: {error}");
    }
}

#[test]
fn repairs_are_stated() {
    let folder = Folder::new();
    folder.write("rgb.txt", b"100.2 rgb/2.png\r\n100.000000 rgb/0.png  \r\n\r\n100.1 rgb/1.png\r\n100.1 rgb/1.png\r\n");
    folder.write("depth.txt", b"100.001 depth/0.png\n100.5 depth/1.png\n");
    folder.write("groundtruth.txt", b"99.9 nan 2 3 0 0 0 1\n100 1 2 3 0 0 0 1\n101 1 2 3 0 0 0 0\n");
    let report = folder.import(&TumOptions::default()).unwrap();
    let p = &report.pairing;
    assert_eq!((p.paired, p.unpaired_color, p.unpaired_depth, p.largest_gap_ns), (1, 2, 1, 1_000_000));
    assert_eq!((report.color_images, report.depth_images, report.ground_truth_poses), (3, 2, 1));
    assert_eq!(report.repairs["row of rgb.txt out of order sorted in"], 1);
    assert_eq!(report.repairs["row of rgb.txt with a repeated stamp left out"], 1);
    assert_eq!(report.repairs["ground-truth row with NaN or infinity left out"], 1);
    assert_eq!(report.repairs["ground-truth row without a rotation (quaternion near zero) left out"], 1);
    let recorded = metadata_of(&folder.log(), metadata::IMPORT);
    for (what, count) in &report.repairs {
        assert_eq!(recorded[what], count.to_string());
        assert!(report.to_string().contains(what));
    }
    // Unpaired pictures are in the log as well.
    assert_eq!(read(&folder.log())[topics::COLOR].len(), 3);
}

#[test]
fn calibration_and_scale_have_a_stated_origin() {
    let folder = Folder::new();
    let camera = CameraModel { width: WIDTH, height: HEIGHT, fx: 9.0, ..Preset::Bonn.camera() };
    let options = TumOptions {
        camera: CameraSource::Model(camera),
        depth_units_per_metre: Some("1000".to_owned()),
        ..TumOptions::default()
    };
    let report = folder.import(&options).unwrap();
    assert_eq!((report.camera, report.depth_units_per_metre.as_str()), (camera, "1000"));
    assert_eq!(metadata_of(&folder.log(), metadata::DEPTH)[metadata::DEPTH_UNITS_PER_METRE], "1000");
    let read_back = CameraInfo::decode(&read(&folder.log())[topics::DEPTH_INFO][0].1).unwrap();
    assert_eq!(CameraModel::from_camera_info(&read_back), Ok(camera));
    let error = folder.import(&TumOptions { camera: CameraSource::Preset(Preset::Bonn), ..TumOptions::default() });
    assert!(error.unwrap_err().to_string().contains("preset bonn"));
    for scale in ["0", "-5", "1e3", "nan", ""] {
        let options = TumOptions { depth_units_per_metre: Some(scale.to_owned()), ..TumOptions::default() };
        assert!(folder.import(&options).unwrap_err().to_string().contains("depth scale"), "{scale}");
    }
    fs::remove_file(folder.path("groundtruth.txt")).unwrap();
    assert_eq!(folder.import(&TumOptions::default()).unwrap().ground_truth_poses, 0);
}

#[test]
fn real_sequence() {
    let dir = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/kitchen_moving_box"));
    if !dir.exists() {
        eprintln!("skipped: {} is not there", dir.display());
        return;
    }
    let out = tempfile::tempdir().unwrap();
    let log = out.path().join("log.mcap");
    let options = TumOptions { panoptic: vec![PanopticSource::new(&dir.join("panoptic"))], ..TumOptions::default() };
    let mut last = (0, 0);
    let report = tum(&dir, &log, &options, &mut |done, total| last = (done, total)).unwrap();
    assert_eq!((report.color_images, report.depth_images, report.masks["panoptic"]), (250, 250, 250));
    assert_eq!((report.pairing.paired, report.pairing.largest_gap_ns, report.ground_truth_poses), (250, 0, 881));
    assert!(report.repairs.is_empty(), "{report}");
    assert_eq!(last, (250 * 3 + 881, 250 * 3 + 881));
    let topics = read(&log);
    let first = CompressedImage::decode(&topics[topics::COLOR][0].1).unwrap();
    assert_eq!(first.data, fs::read(dir.join("rgb/1600000006.666667.jpg")).unwrap());
    assert_eq!((Stamp::from(first.header.stamp), first.format.as_str()), (Stamp(1_600_000_006_666_667_000), "jpeg"));
}
