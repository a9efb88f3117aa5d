//! The inspection file is a function of the frames: same frames, same bytes.
#![cfg(feature = "rerun")]
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;
use std::sync::Arc;

use replayer::eval::{StampedPose, Trajectory};
use replayer::inspect::{InspectError, Inspector};
use slam::input::{Category, DepthImage, FrameInput, PanopticMask, Segment, Sensor, Setup};
use slam::{Config, Inline, Slam, Unobserved};
use slam_math::{FrameId, Rng, Stamp};
use slam_vision::{Camera, Distortion, GrayImage, Workspace};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const FRAMES: u32 = 6;

fn setup() -> Setup {
    let camera = Camera {
        fx: 260.0,
        fy: 260.0,
        cx: 160.0,
        cy: 120.0,
        width: WIDTH as u32,
        height: HEIGHT as u32,
        distortion: Distortion::None,
    };
    let category = |id, name: &str, is_thing| Category { id, name: name.to_owned(), is_thing };
    Setup { camera, sensor: Sensor::Rgbd, categories: vec![category(1, "person", true), category(2, "wall", false)] }
}

/// A wall of random bricks 2 m away that slides left by two pixels a frame, with a person on it and an unknown patch.
fn frame(index: u32) -> FrameInput {
    let mut rng = Rng::at(7, 0, 0, 0);
    let bricks: Vec<u8> = (0..100 * 60).map(|_| rng.below(256) as u8).collect();
    let mut gray = GrayImage::new(WIDTH, HEIGHT, 0);
    let mut ids = vec![1u16; WIDTH * HEIGHT];
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            gray.data[y * WIDTH + x] = bricks[y / 8 * 100 + (x + 2 * index as usize) / 8];
            ids[y * WIDTH + x] = match x {
                0..40 => 2,
                280.. => 0,
                _ => 1,
            };
        }
    }
    let depth = DepthImage { width: WIDTH, height: HEIGHT, units: vec![2000; WIDTH * HEIGHT], metres_per_unit: 0.001 };
    let segment = |id, category| Segment { id, category, score: 1.0 };
    let mask = PanopticMask { width: WIDTH, height: HEIGHT, ids, segments: vec![segment(1, 2), segment(2, 1)] };
    let stamp = Stamp(i64::from(index) * 33_333_333);
    FrameInput {
        id: FrameId(index),
        stamp,
        gray,
        right: None,
        depth: Some(Arc::new(depth)),
        panoptic: Some(Arc::new(mask)),
    }
}

fn write(path: &Path) -> Vec<u8> {
    let mut slam = Slam::new(&Config::default(), &setup()).unwrap();
    let mut inspector = Inspector::create(path, "wall", &setup(), false).unwrap();
    let mut workspace = Workspace::default();
    for index in 0..FRAMES {
        let input = frame(index);
        let observation = Arc::new(slam.front_end().observe(&input, &mut workspace).unwrap());
        let report = slam.step(&input, observation, &mut Inline, &mut Unobserved).unwrap();
        inspector.frame(&input, None, &report, slam.map()).unwrap();
    }
    let pose = |p: slam::TrajectoryPose| StampedPose {
        stamp: schemas::Stamp(p.stamp.0),
        world_from_camera: p.world_from_camera,
    };
    let estimate = Trajectory { poses: slam.trajectory().map(pose).collect() };
    assert_eq!(estimate.poses.len(), FRAMES as usize, "the wall is easy to track");
    std::fs::read(inspector.finish(&estimate, Some(&estimate)).unwrap()).unwrap()
}

#[test]
fn same_frames_give_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] = ["a.rrd", "b.rrd"].map(|name| write(&dir.path().join(name)));
    assert!(a.len() > 100_000, "only {} bytes", a.len());
    assert!(a == b, "files of {} and {} bytes differ", a.len(), b.len());
}

#[test]
fn a_depth_picture_of_the_wrong_size_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut slam = Slam::new(&Config::default(), &setup()).unwrap();
    let mut input = frame(0);
    let observation = Arc::new(slam.front_end().observe(&input, &mut Workspace::default()).unwrap());
    let report = slam.step(&input, observation, &mut Inline, &mut Unobserved).unwrap();
    let short = DepthImage { width: WIDTH, height: HEIGHT, units: vec![0; 10], metres_per_unit: 0.001 };
    input.depth = Some(Arc::new(short));
    let mut inspector = Inspector::create(&dir.path().join("run.rrd"), "wall", &setup(), false).unwrap();
    let error = inspector.frame(&input, None, &report, slam.map()).unwrap_err();
    assert!(matches!(error, InspectError::Picture { what: "depth picture", .. }), "{error}");
    assert!(error.to_string().contains("20 bytes instead of 153600"), "{error}");
}
