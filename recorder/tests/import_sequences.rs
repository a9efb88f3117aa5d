//! Import of tiny EuRoC and KITTI folders made by the test, in the layouts of the data sets.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(clippy::excessive_precision, reason = "the digits that the data set writes")]

use recorder::import::{EurocOptions, KittiOptions, SequenceReport, TruthOf, euroc, kitti};
use recorder::picture::encode_gray8;
use schemas::Message;
use schemas::msg::{CameraInfo, CompressedImage, Imu, PoseStamped};
use schemas::stereo::StereoModel;
use schemas::topics;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const WIDTH: u32 = 8;
const HEIGHT: u32 = 6;

struct Folder {
    dir: tempfile::TempDir,
}

impl Folder {
    fn new() -> Self {
        Self { dir: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn log(&self) -> PathBuf {
        self.path("out.mcap")
    }

    /// Two pairs 50 ms apart, three inertial rows, two poses of the body; lines end as Windows ends them.
    fn euroc() -> Self {
        let folder = Self::new();
        for (camera, y) in [("cam0", 0.0), ("cam1", -0.1)] {
            let yaml = format!(
                "%YAML:1.0\nsensor_type: camera\ncomment: VI-Sensor {camera} (MT9M034)\nT_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, -1.0, 0.0, 0.5,\n\
                 \x20        1.0, 0.0, 0.0, {},\n         0.0, 0.0, 1.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\n\
                 resolution: [{WIDTH}, {HEIGHT}]\ncamera_model: pinhole\nintrinsics: [6.0, 6.0, 3.5, 2.5] #fu, fv, cu, cv\n\
                 distortion_model: radial-tangential\ndistortion_coefficients: [-0.1, 0.01, 0.0, 0.0]\n",
                -y
            );
            folder.write(&format!("V1/mav0/{camera}/sensor.yaml"), yaml);
            let rows = "#timestamp [ns],filename\r\n1403715274262142976,1.png\r\n1403715274312143104,2.png\r\n";
            folder.write(&format!("V1/mav0/{camera}/data.csv"), rows);
            for i in [1_u8, 2] {
                folder.write(&format!("V1/mav0/{camera}/data/{i}.png"), picture(i));
            }
        }
        let imu = "#timestamp [ns],w\n1403715274162142976,-0.046774823953448029,0.1,0.2,9.4470728333333334,-0.9,-3.7\n\
                   1403715274167142912,1,2,3,4,5,6\n1403715274362142976,1,2,3,4,5,6\n";
        folder.write("V1/mav0/imu0/data.csv", imu);
        folder.write("V1/mav0/imu0/sensor.yaml", "sensor_type: imu\n");
        let truth = "#timestamp, p_x\n1403715274262142976,1,2,3,1,0,0,0,9,9,9,9,9,9,9,9,9\n\
                     1403715274312143104,1,2,4,0,0,0,0,9,9,9\n1403715274322143104.25,1,2,4,1,0,0,0\n";
        folder.write("V1/mav0/state_groundtruth_estimate0/data.csv", truth);
        folder
    }

    /// Three frames of the grey cameras in the benchmark's layout, poses in its other folder.
    fn kitti() -> Self {
        let folder = Self::new();
        let calibration = "P0: 7 0 4 0 0 7 3 0 0 0 1 0\nP1: 7 0 4 -3.5 0 7 3 0 0 0 1 0\nP2: 7 0 4 1.4 0 7 3 0 0 0 1 0\n\
                           P3: 7 0 4 -2.1 0 7 3 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n";
        folder.write("sequences/07/calib.txt", calibration);
        folder.write("sequences/07/times.txt", "0.000000e+00\n1.038752e-01\n2.078941e-01\n");
        for camera in 0..4 {
            for i in 0..3_u8 {
                folder.write(&format!("sequences/07/image_{camera}/{i:06}.png"), picture(i));
            }
        }
        let poses = "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 0.5\n0 0 1 0 0 1 0 0 -1 0 0 1\n";
        folder.write("poses/07.txt", poses);
        folder
    }

    fn import_euroc(&self, options: &EurocOptions) -> Result<SequenceReport, String> {
        let options = EurocOptions { force: true, ..options.clone() };
        euroc(&self.path("V1"), &self.log(), &options, &mut |_, _| {}).map_err(|error| error.to_string())
    }

    fn import_kitti(&self, options: &KittiOptions) -> Result<SequenceReport, String> {
        let options = KittiOptions { force: true, ..options.clone() };
        kitti(&self.path("sequences/07"), &self.log(), &options, &mut |_, _| {}).map_err(|error| error.to_string())
    }
}

fn picture(value: u8) -> Vec<u8> {
    let pixels: Vec<u8> = (0..WIDTH * HEIGHT).map(|i| i as u8 ^ value).collect();
    encode_gray8(WIDTH, HEIGHT, &pixels).unwrap()
}

/// Payloads by topic, in file order, with their log times.
fn read(path: &Path) -> BTreeMap<String, Vec<(u64, Vec<u8>)>> {
    let bytes = fs::read(path).unwrap();
    let mut topics: BTreeMap<String, Vec<(u64, Vec<u8>)>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        topics.entry(message.channel.topic.clone()).or_default().push((message.log_time, message.data.to_vec()));
    }
    topics
}

fn pose(message: &[u8]) -> [f64; 7] {
    let p = PoseStamped::decode(message).unwrap().pose;
    let (t, q) = (p.position, p.orientation);
    [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
}

#[test]
fn an_euroc_folder_keeps_every_byte() {
    let folder = Folder::euroc();
    let report = folder.import_euroc(&EurocOptions::default()).unwrap();
    assert_eq!((report.pictures, report.right_pictures, report.paired, report.imu_rows), (2, 2, 2, 3));
    assert!((report.baseline_m.unwrap() - 0.1).abs() < 1e-12);
    let log = read(&folder.log());
    for topic in [topics::COLOR, topics::RIGHT] {
        let messages = &log[topic];
        assert_eq!(messages.iter().map(|m| m.0).collect::<Vec<_>>(), [1403715274262142976, 1403715274312143104]);
        let image = CompressedImage::decode(&messages[1].1).unwrap();
        assert_eq!((image.format.as_str(), image.data.as_ref()), ("png", picture(2).as_slice()));
    }
    let info = |topic: &str| CameraInfo::decode(&log[topic][0].1).unwrap();
    let stereo = StereoModel::from_camera_infos(&info(topics::COLOR_INFO), &info(topics::RIGHT_INFO)).unwrap();
    assert_eq!(stereo.left, report.camera);
    let imu = Imu::decode(&log[topics::IMU][0].1).unwrap();
    assert_eq!(imu.angular_velocity.x, -0.046_774_823_953_448_03);
    assert_eq!(imu.linear_acceleration.x, 9.447_072_833_333_333);
    assert_eq!(imu.orientation_covariance[0], -1.0, "no orientation");
    // The body looks along its own axes; the camera stands 0.5 m along x, turned by a quarter about z.
    let half = 0.5_f64.sqrt();
    let expected = [1.5, 2.0, 3.0, 0.0, 0.0, half, half];
    let found = pose(&log[topics::GROUND_TRUTH][0].1);
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
    assert_eq!(report.ground_truth_poses, 2, "one row is no rotation");
    assert_eq!(report.repairs.values().sum::<u64>(), 2, "{:?}", report.repairs);
}

#[test]
fn an_euroc_folder_can_give_less() {
    let folder = Folder::euroc();
    folder.write("truth.csv", "1403715274262142976.0000,1,2,3,0.5,0.5,0.5,0.5\n");
    let truth = Some((folder.path("truth.csv"), TruthOf::LeftCamera));
    let report = folder.import_euroc(&EurocOptions { stereo: false, truth, ..EurocOptions::default() }).unwrap();
    assert_eq!((report.right_pictures, report.baseline_m, report.ground_truth_poses), (0, None, 1));
    let log = read(&folder.log());
    assert!(!log.contains_key(topics::RIGHT) && !log.contains_key(topics::DEPTH));
    assert_eq!(pose(&log[topics::GROUND_TRUTH][0].1), [1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5]);
    // `mav0` itself, without ground truth and inertial rows.
    for part in ["imu0", "state_groundtruth_estimate0"] {
        fs::remove_dir_all(folder.path("V1/mav0").join(part)).unwrap();
    }
    let options = EurocOptions { force: true, ..EurocOptions::default() };
    let report = euroc(&folder.path("V1/mav0"), &folder.log(), &options, &mut |_, _| {}).unwrap();
    assert_eq!((report.paired, report.imu_rows, report.ground_truth_poses), (2, 0, 0));
}

#[test]
fn what_is_wrong_with_an_euroc_folder_is_said() {
    let cases: [(&str, &[u8], &str); 8] = [
        ("cam0/sensor.yaml", b"camera_model: omni\n", "omni"),
        ("cam0/data.csv", b"1403715274262142976 1.png\n", "line 1"),
        ("cam0/data.csv", b"#x\nnoon,1.png\n", "line 2"),
        ("cam0/data.csv", b"1403715274262142976,3.png\n", "3.png"),
        ("cam0/data.csv", b"", "nothing to import"),
        ("cam1/data/2.png", b"\x89PNG", "2.png"),
        ("imu0/data.csv", b"1403715274162142976,1,2,3,4,5,nan\n", "not a number"),
        ("imu0/data.csv", b"1403715274162142976,1,2,3\n", "too few"),
    ];
    for (name, bytes, expected) in cases {
        let folder = Folder::euroc();
        folder.write(&format!("V1/mav0/{name}"), bytes);
        if bytes.is_empty() {
            for rest in ["cam1", "imu0", "state_groundtruth_estimate0"] {
                fs::remove_dir_all(folder.path("V1/mav0").join(rest)).unwrap();
            }
        }
        let error = folder.import_euroc(&EurocOptions::default()).unwrap_err();
        assert!(error.contains(expected), "{name}: {error}");
        assert!(!folder.log().exists() && !folder.path("out.mcap.partial").exists());
    }
    let folder = Folder::euroc();
    let swapped = fs::read_to_string(folder.path("V1/mav0/cam1/sensor.yaml")).unwrap().replace("0.0, 0.1", "0.0, -0.1");
    folder.write("V1/mav0/cam1/sensor.yaml", swapped);
    assert!(folder.import_euroc(&EurocOptions::default()).unwrap_err().contains("to the right"));
    let error = euroc(&folder.path("nowhere"), &folder.log(), &EurocOptions::default(), &mut |_, _| {}).unwrap_err();
    assert!(error.to_string().contains("mav0/cam0/sensor.yaml"), "{error}");
}

#[test]
fn a_kitti_sequence_is_rectified_already() {
    let folder = Folder::kitti();
    let report = folder.import_kitti(&KittiOptions::default()).unwrap();
    assert_eq!((report.pictures, report.paired, report.ground_truth_poses), (3, 3, 3));
    assert_eq!(report.baseline_m, Some(0.5));
    let log = read(&folder.log());
    assert_eq!(log[topics::COLOR][1].0, 103_875_200, "the source's own digits");
    let info = |topic: &str| CameraInfo::decode(&log[topic][0].1).unwrap();
    let stereo = StereoModel::from_camera_infos(&info(topics::COLOR_INFO), &info(topics::RIGHT_INFO)).unwrap();
    assert!(stereo.is_rectified() && stereo.bf == 3.5);
    let half = 0.5_f64.sqrt();
    let found = pose(&log[topics::GROUND_TRUTH][2].1);
    let expected = [0.0, 0.0, 1.0, 0.0, half, 0.0, half];
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");

    let color = folder.import_kitti(&KittiOptions { color: true, ..KittiOptions::default() }).unwrap();
    assert!((color.baseline_m.unwrap() - 0.5).abs() < 1e-12);
    // Camera 2 stands 0.2 m to the left of camera 0.
    assert!((pose(&read(&folder.log())[topics::GROUND_TRUTH][0].1)[0] + 0.2).abs() < 1e-12);
    let mono = folder.import_kitti(&KittiOptions { stereo: false, ..KittiOptions::default() }).unwrap();
    assert_eq!((mono.right_pictures, mono.baseline_m), (0, None));
}

#[test]
fn what_is_wrong_with_a_kitti_sequence_is_said() {
    let cases: [(&str, &[u8], &str); 7] = [
        ("sequences/07/calib.txt", b"P1: 7 0 4 0 0 7 3 0 0 0 1 0\n", "P0:"),
        ("sequences/07/calib.txt", b"P0: 7 0 4\n", "3 numbers, wanted 12"),
        ("sequences/07/calib.txt", b"P0: 7 1 4 0 0 7 3 0 0 0 1 0\n", "no projection"),
        ("sequences/07/times.txt", b"0\n1\n1\n", "line 3"),
        ("sequences/07/times.txt", b"0\n1\n2\n3\n", "000003.png"),
        ("poses/07.txt", b"1 0 0 0 0 1 0 0 0 0 1 0\n", "1 poses for 3 frames"),
        ("poses/07.txt", b"9 0 0 0 0 1 0 0 0 0 1 0\n", "no rotation"),
    ];
    for (name, bytes, expected) in cases {
        let folder = Folder::kitti();
        folder.write(name, bytes);
        let error = folder.import_kitti(&KittiOptions::default()).unwrap_err();
        assert!(error.contains(expected), "{name}: {error}");
        assert!(!folder.log().exists());
    }
}

#[test]
fn real_pieces_are_imported_whole() {
    let data = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data"));
    if !data.join("euroc_v101_piece").exists() || !data.join("kitti07_piece").exists() {
        return eprintln!("skipped: no pieces of EuRoC and KITTI in {}", data.display());
    }
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("euroc.mcap");
    let report = euroc(&data.join("euroc_v101_piece"), &log, &EurocOptions::default(), &mut |_, _| {}).unwrap();
    assert_eq!((report.pictures, report.paired, report.imu_rows, report.ground_truth_poses), (30, 30, 331, 31));
    assert!(report.repairs.is_empty(), "{:?}", report.repairs);
    let file = data.join("euroc_v101_piece/mav0/cam1/data/1403715274262142976.png");
    let image = read(&log)[topics::RIGHT][0].1.clone();
    assert_eq!(CompressedImage::decode(&image).unwrap().data.as_ref(), fs::read(file).unwrap());
    let log = dir.path().join("kitti.mcap");
    let report = kitti(&data.join("kitti07_piece"), &log, &KittiOptions::default(), &mut |_, _| {}).unwrap();
    assert_eq!((report.pictures, report.right_pictures, report.ground_truth_poses), (45, 0, 45));
}
