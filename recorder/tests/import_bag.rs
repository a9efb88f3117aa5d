//! ROS 2 bags of other programs, made by the test with the container library alone.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use mcap::records::MessageHeader;
use recorder::import::{BagOptions, TopicReport, rosbag2};
use recorder::picture::decode_rgb8;
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{CompressedImage, Header, Image, Imu, PoseStamped};
use schemas::{Message, Stamp, topics};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const WIDTH: u32 = 4;
const HEIGHT: u32 = 2;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;

fn header(ns: i64) -> Header {
    Header::new(Stamp(ns), "somebodys_camera").unwrap()
}

fn camera() -> CameraModel {
    CameraModel { width: WIDTH, height: HEIGHT, fx: 3.0, fy: 3.0, cx: 2.0, cy: 1.0, distortion: Distortion::None }
}

fn image(ns: i64, encoding: &str, data: Vec<u8>) -> Vec<u8> {
    let step = data.len() as u32 / HEIGHT;
    let encoding = encoding.to_owned();
    Image { header: header(ns), height: HEIGHT, width: WIDTH, encoding, is_bigendian: 0, step, data: Cow::Owned(data) }
        .encode()
}

struct Bag {
    dir: tempfile::TempDir,
    /// Topic, type, log time, data; in the order of the file.
    messages: Vec<(&'static str, &'static str, u64, Vec<u8>)>,
}

impl Bag {
    /// Two frames; the second picture comes before the first depth image, as it does on a network.
    fn new() -> Self {
        let (image_type, info_type) = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo");
        let bgr = |v: u8| [v, v + 1, v + 2].repeat(PIXELS);
        let metres = |m: f32| m.to_le_bytes().repeat(PIXELS);
        let info = camera().to_camera_info(header(1_000)).encode();
        let pose = PoseStamped { header: header(1_500), ..PoseStamped::default() };
        let mut true_pose = pose.clone();
        true_pose.pose.orientation.w = 1.0;
        let messages = vec![
            ("/cam/color/camera_info", info_type, 90, info),
            ("/cam/color/image_raw", image_type, 100, image(1_000, "bgr8", bgr(10))),
            ("/cam/color/image_raw", image_type, 200, image(2_000, "bgr8", bgr(20))),
            ("/cam/color/image_raw", image_type, 201, image(2_000, "bgr8", bgr(99))),
            ("/cam/aligned_depth/image_raw", image_type, 210, image(1_100, "32FC1", metres(1.5))),
            ("/cam/aligned_depth/image_raw", image_type, 220, image(2_100, "32FC1", metres(f32::NAN))),
            ("/imu", "sensor_msgs/msg/Imu", 230, Imu { header: header(1_050), ..Imu::default() }.encode()),
            ("/pose", "geometry_msgs/msg/PoseStamped", 240, true_pose.encode()),
            ("/pose", "geometry_msgs/msg/PoseStamped", 250, pose.encode()),
            ("/chatter", "std_msgs/msg/String", 260, vec![0, 1, 0, 0, 1, 0, 0, 0, 0]),
        ];
        Self { dir: tempfile::tempdir().unwrap(), messages }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn write(&self) -> &Self {
        fs::create_dir_all(self.path("bag")).unwrap();
        let file = fs::File::create(self.path("bag/bag_0.mcap")).unwrap();
        let mut writer = mcap::WriteOptions::new().profile("ros2").create(file).unwrap();
        for (topic, kind, time, data) in &self.messages {
            let schema = writer.add_schema(kind, "ros2msg", b"").unwrap();
            let channel_id = writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap();
            let header = MessageHeader { channel_id, sequence: 0, log_time: *time, publish_time: *time };
            writer.write_to_known_channel(&header, data).unwrap();
        }
        writer.finish().unwrap();
        self.yaml("mcap", "bag_0.mcap")
    }

    fn yaml(&self, storage: &str, file: &str) -> &Self {
        let text = format!(
            "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: {storage}\n  relative_file_paths:\n    - {file}\n\
             \x20 duration:\n    nanoseconds: 1\n  compression_mode: \"\"\n"
        );
        fs::write(self.path("bag/metadata.yaml"), text).unwrap();
        self
    }

    fn import(&self, options: &BagOptions) -> Result<TopicReport, String> {
        let report = rosbag2(&self.path("bag"), &self.path("out.mcap"), options, &mut |_, _| {});
        assert!(!self.path("out.mcap.partial").exists());
        report.map_err(|error| error.to_string())
    }
}

fn messages(log: &Path, topic: &str) -> Vec<Vec<u8>> {
    let bytes = fs::read(log).unwrap();
    let all = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    all.filter(|message| message.channel.topic == topic).map(|message| message.data.to_vec()).collect()
}

#[test]
fn pictures_depth_and_rows_of_another_program() {
    let bag = Bag::new();
    let options = BagOptions { pose: Some("/pose".to_owned()), ..BagOptions::default() };
    let report = bag.write().import(&options).unwrap();
    assert!(!report.same_bytes);
    assert_eq!(report.span, Some((Stamp(1_000), Stamp(2_100))));
    assert_eq!((report.taken["/cam/color/image_raw"], report.taken["/pose"]), (2, 1));
    assert_eq!(report.repairs["message on /chatter left out"], 1);
    assert_eq!(report.repairs["repeated stamp on /cam/color/image_raw left out"], 1);
    assert_eq!(report.repairs["repeated stamp on /pose left out"], 1);
    let log = bag.path("out.mcap");
    let colors = messages(&log, topics::COLOR);
    let picture = CompressedImage::decode(&colors[1]).unwrap();
    assert_eq!(Stamp::from(picture.header.stamp), Stamp(2_000));
    assert_eq!(decode_rgb8(&picture.data).unwrap(), (WIDTH, HEIGHT, [22, 21, 20].repeat(PIXELS)));
    let depth: Vec<Vec<u16>> =
        messages(&log, topics::DEPTH).iter().map(|data| Image::decode(data).unwrap().pixels_u16().unwrap()).collect();
    assert_eq!(depth, [vec![1500; PIXELS], vec![0; PIXELS]]);
    assert_eq!((messages(&log, topics::IMU).len(), messages(&log, topics::GROUND_TRUTH).len()), (1, 1));
}

#[test]
fn what_cannot_be_told_apart_or_read_is_named() {
    let no_poses =
        || Bag { messages: Bag::new().messages.into_iter().filter(|m| m.0 != "/pose").collect(), ..Bag::new() };
    let mut two = no_poses();
    two.messages.push(("/other/image_raw", "sensor_msgs/msg/Image", 300, image(1_000, "rgb8", vec![0; PIXELS * 3])));
    let error = two.write().import(&BagOptions::default()).unwrap_err();
    assert!(error.contains("--color") && error.contains("/other/image_raw"), "{error}");
    let one = BagOptions { color: Some("/cam/color/image_raw".to_owned()), ..BagOptions::default() };
    two.import(&one).unwrap();

    let mut blind = no_poses();
    blind.messages.retain(|message| message.0 != "/cam/color/camera_info");
    assert!(blind.write().import(&BagOptions::default()).unwrap_err().contains("--info"));
    let mut wide = no_poses();
    wide.messages[4].3 = image(1_100, "32FC1", vec![0; PIXELS * 4 - 8]);
    assert!(wide.write().import(&BagOptions::default()).unwrap_err().contains("do not fit"));
    for (storage, file, expected) in [
        ("sqlite3", "bag_0.db3", "sqlite3"),
        ("mcap", "../../etc/passwd", "not a file of the folder"),
        ("mcap", "x.mcap", "x.mcap"),
    ] {
        let error = no_poses().write().yaml(storage, file).import(&BagOptions::default()).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
    let cut = no_poses();
    let bytes = fs::read(cut.write().path("bag/bag_0.mcap")).unwrap();
    fs::write(cut.path("bag/bag_0.mcap"), &bytes[..bytes.len() - 20]).unwrap();
    assert!(cut.import(&BagOptions::default()).unwrap_err().contains("pslam recover"));
    assert!(cut.import(&BagOptions { imu: Some("/none".to_owned()), ..BagOptions::default() }).is_err());
}
