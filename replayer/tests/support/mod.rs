//! Small logs with everything in them, and their messages.

#![allow(dead_code, reason = "each test takes what it needs")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use recorder::{Beside, LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec, picture};
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{Category, Header, Image, Imu, SCORE_UNKNOWN, Segment, Vector3};
use schemas::stereo::StereoModel;
use schemas::{Message, Stamp, topics};

pub const WIDTH: u32 = 16;
pub const HEIGHT: u32 = 12;
const PIXELS: usize = (WIDTH * HEIGHT) as usize;
/// Odd nanoseconds, which six decimals of a second would lose.
const START_NS: i64 = 1_600_000_006_123_456_789;
const STEP_NS: i64 = 33_333_333;

/// Log time and bytes by topic.
pub type Messages = BTreeMap<String, Vec<(u64, Vec<u8>)>>;

/// All messages of a log, read with the container library alone.
pub fn messages(log: &Path) -> Messages {
    let bytes = fs::read(log).unwrap();
    let mut topics = Messages::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let topic = topics.entry(message.channel.topic.clone()).or_default();
        topic.push((message.log_time, message.data.to_vec()));
    }
    topics
}

/// Depth values by stamp.
pub fn depths(log: &Path) -> BTreeMap<u64, Vec<u16>> {
    let messages = messages(log);
    let image = |(stamp, data): &(u64, Vec<u8>)| (*stamp, Image::decode(data).unwrap().pixels_u16().unwrap());
    messages[topics::DEPTH].iter().map(image).collect()
}

fn stamp(frame: usize) -> Stamp {
    Stamp(START_NS + frame as i64 * STEP_NS)
}

/// Numbers with long tails, so that a lost digit shows.
fn camera() -> CameraModel {
    let distortion = Distortion::Radtan { k1: 0.1 / 3.0, k2: -0.2 / 7.0, p1: 1e-4 / 3.0, p2: -1e-5, k3: 0.0 };
    CameraModel { width: WIDTH, height: HEIGHT, fx: 20.0 / 3.0, fy: 21.0 / 3.1, cx: 8.1, cy: 6.7, distortion }
}

fn rgb(frame: usize) -> Vec<u8> {
    let pixels: Vec<u8> = (0..PIXELS * 3).map(|i| (i * i * 31 + frame * 97 + i / 7) as u8).collect();
    picture::encode_rgb8(WIDTH, HEIGHT, &pixels).unwrap()
}

fn layer(name: &str) -> LayerSpec {
    let category = |id, name: &str, is_thing| Category { id, name: name.to_owned(), is_thing };
    // Commas and quotes are allowed in names.
    let categories = vec![category(1, "person", true), category(400, "wall, \"brick\"", false)];
    LayerSpec { name: name.to_owned(), origin: "test".to_owned(), categories }
}

/// A person of many, a wall, and nothing known below.
fn mask(frame: usize) -> Mask {
    let id = |i: usize| match (i % WIDTH as usize, i / WIDTH as usize) {
        (_, 9..) => 0,
        (0..8, _) => 300 + frame as u16,
        _ => 7,
    };
    let instance: Vec<u16> = (0..PIXELS).map(id).collect();
    let class = instance
        .iter()
        .map(|id| match id {
            0 => 0,
            7 => 400,
            _ => 1,
        })
        .collect();
    let wall = Segment {
        id: 7,
        category_id: 400,
        score: SCORE_UNKNOWN,
        x: 8,
        y: 0,
        width: 8,
        height: 9,
        area: 72,
        is_crowd: false,
    };
    let person = Segment {
        id: 300 + frame as u16,
        category_id: 1,
        score: 0.1 + 0.2,
        x: 0,
        y: 0,
        width: 8,
        height: 9,
        area: 72,
        is_crowd: frame.is_multiple_of(2),
    };
    Mask { class, instance, segments: vec![wall, person] }
}

/// Six frames with two layers; the first picture of one layer has no mask, the last depth image comes far too late.
pub fn rgbd_log(path: &Path, units: u16) {
    let spec = RgbdSpec {
        depth_units_per_metre: units.to_string(),
        layers: vec![layer("panoptic"), layer("exact")],
        ..RgbdSpec::new("test", "noise", camera())
    };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    for frame in 0..6 {
        let f = frame as f64;
        log.ground_truth(stamp(frame), [f / 3.0, -f / 7.0, 1e-9], [0.6, 0.0, 0.0, 0.8]).unwrap();
        log.color(stamp(frame), "png", &rgb(frame)).unwrap();
        if frame != 0 {
            log.mask(0, stamp(frame), &mask(frame)).unwrap();
        }
        log.mask(1, stamp(frame), &mask(frame)).unwrap();
        let depth: Vec<u16> = (0..PIXELS).map(|i| (i * 137 + frame * 1000) as u16).collect();
        let late = if frame == 5 { 30_000_000 } else { 1_000_001 };
        log.depth(Stamp(stamp(frame).0 + late), &depth).unwrap();
    }
    log.ground_truth(stamp(7), [9.0, 9.0, 9.0], [0.0, 0.0, 0.0, 1.0]).unwrap();
    log.finish().unwrap();
}

/// Three pairs of a camera pair that must be rectified, with inertial rows; no calibration file is attached.
pub fn stereo_log(path: &Path) {
    let (s, c) = (0.02_f64, (1.0 - 0.02_f64 * 0.02).sqrt());
    let right = CameraModel { cx: 8.4, ..camera() };
    // The right camera is turned by about a degree around y, 11 cm to the right.
    let turned = [c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c];
    let stereo = StereoModel::rectify(camera(), right, turned, [-0.11 * c, 0.0, -0.11 * s]).unwrap();
    let spec = RgbdSpec { beside: Beside::Right(stereo), ..RgbdSpec::new("test", "pair", camera()) };
    let mut log = RgbdLog::create(path, &LogOptions::default(), &spec).unwrap();
    for frame in 0..3 {
        log.ground_truth(stamp(frame), [1.0, 2.0, frame as f64 / 3.0], [0.6, 0.0, 0.0, 0.8]).unwrap();
        imu(&mut log, stamp(frame));
        log.color(stamp(frame), "png", &rgb(frame)).unwrap();
        log.right(stamp(frame), "png", &rgb(frame + 50)).unwrap();
        for late in [10_000_000, 20_000_000] {
            if frame < 2 || late == 10_000_000 {
                imu(&mut log, Stamp(stamp(frame).0 + late));
            }
        }
    }
    log.finish().unwrap();
}

fn imu(log: &mut RgbdLog, stamp: Stamp) {
    let mut imu = Imu { header: Header::new(stamp, topics::frame::IMU).unwrap(), ..Imu::default() };
    imu.orientation_covariance[0] = -1.0;
    imu.angular_velocity = Vector3 { x: 0.1 / 3.0, y: -1e-7, z: 0.0 };
    imu.linear_acceleration = Vector3 { x: 9.81 / 7.0, y: stamp.0 as f64 * 1e-18, z: -9.0 };
    log.log().write(topics::IMU, stamp, &imu).unwrap();
}
