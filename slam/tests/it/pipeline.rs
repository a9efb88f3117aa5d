//! Whole runs on a synthetic room.

use std::sync::{Arc, OnceLock};

use fixtures::{RenderedFrame, World};
use nalgebra::Vector3;
use slam::report::{KeypointClass, Stage, TrackingState, Verdict};
use slam::{Config, FrameInput, FrameReport, Slam, SlamError};
use slam_math::align::umeyama;
use slam_math::{FrameId, MapId};
use slam_vision::GrayImage;

use crate::support::{blank, depth, feed, input_of, room, run, setup};

const FRAMES: u32 = 16;

fn frames() -> &'static [RenderedFrame] {
    static FRAMES_ONCE: OnceLock<Vec<RenderedFrame>> = OnceLock::new();
    FRAMES_ONCE.get_or_init(|| {
        let world = World::new(&room(FRAMES)).unwrap();
        (0..FRAMES).map(|i| world.frame(i)).collect()
    })
}

fn inputs() -> Vec<FrameInput> {
    frames().iter().map(|f| input_of(f, f.index)).collect()
}

fn slam() -> Slam {
    Slam::new(&Config::default(), &setup()).unwrap()
}

#[test]
fn a_static_room_is_tracked() {
    let (slam, reports) = run(&Config::default(), &inputs());
    assert!(reports.iter().all(|r| r.state == TrackingState::Ok && r.map == MapId(0)));
    for path in [slam.trajectory().collect::<Vec<_>>(), slam.online_trajectory().collect()] {
        assert_eq!(path.len(), FRAMES as usize);
        let found: Vec<Vector3<f64>> = path.iter().map(|p| p.world_from_camera.translation).collect();
        let truth: Vec<Vector3<f64>> = frames().iter().map(|f| f.world_from_camera.translation).collect();
        let fit = umeyama(&found, &truth, false).expect("the path bends");
        let squares: f64 = found.iter().zip(&truth).map(|(f, t)| (fit.transform(f) - t).norm_squared()).sum();
        let ate_m = (squares / found.len() as f64).sqrt();
        let length_m: f64 = truth.windows(2).map(|w| (w[1] - w[0]).norm()).sum();
        assert!(length_m > 0.05, "the camera moves: {length_m} m");
        // At 3 m the depth noise is 23 mm a pixel.
        assert!(ate_m < 0.015, "{ate_m} m");
    }
    let last = reports.last().unwrap();
    assert!(last.counts.map_points > 200, "{:?}", last.counts);
}

#[test]
fn two_runs_are_equal_field_by_field() {
    let inputs = inputs();
    let [(_, a), (_, b)] = [run(&Config::default(), &inputs), run(&Config::default(), &inputs)];
    for (a, b) in a.iter().zip(&b) {
        assert_eq!(a.records, b.records);
        assert_eq!(a.records.iter().map(|r| r.stage).collect::<Vec<_>>(), Stage::ALL);
    }
}

#[test]
fn frames_out_of_order_are_refused_and_change_nothing() {
    let inputs = inputs();
    let mut slam = slam();
    let order = |slam: &mut Slam, input: &FrameInput| match feed(slam, input) {
        Err(SlamError::Order { got, expected }) => (got, expected),
        other => panic!("{other:?}"),
    };
    assert_eq!(order(&mut slam, &inputs[1]), (1, 0));
    feed(&mut slam, &inputs[0]).unwrap();
    assert_eq!(order(&mut slam, &inputs[0]), (0, 1));
    assert_eq!(order(&mut slam, &inputs[2]), (2, 1));
    let (_, straight) = run(&Config::default(), &inputs[..2]);
    assert_eq!(feed(&mut slam, &inputs[1]).unwrap().records, straight[1].records);
}

#[test]
fn pictures_of_another_size_are_refused() {
    let good = inputs()[0].clone();
    let refused = |input: &FrameInput, wanted: &str| {
        let error = feed(&mut slam(), input).expect_err(wanted);
        assert!(matches!(error, SlamError::Size { .. } | SlamError::Pixels { .. }));
        assert!(error.to_string().contains(wanted), "{error}");
    };
    refused(&FrameInput { gray: GrayImage::new(319, 240, 0), ..good.clone() }, "picture has 319 x 240");
    refused(&FrameInput { gray: GrayImage::new(0, 0, 0), ..good.clone() }, "picture has 0 x 0");
    let mut short = good.gray.clone();
    short.data.truncate(99);
    refused(&FrameInput { gray: short, ..good.clone() }, "99");
    let mut wrong = good.clone();
    Arc::make_mut(wrong.depth.as_mut().unwrap()).height = 239;
    refused(&wrong, "depth image has 320 x 239");
    let mut wrong = good.clone();
    Arc::make_mut(wrong.depth.as_mut().unwrap()).units.truncate(5);
    refused(&wrong, "depth image");
    let mut wrong = good.clone();
    Arc::make_mut(wrong.panoptic.as_mut().unwrap()).width = 1;
    refused(&wrong, "panoptic mask has 1 x 240");
    let mut wrong = good;
    Arc::make_mut(wrong.panoptic.as_mut().unwrap()).ids.clear();
    refused(&wrong, "panoptic mask");
}

/// Runs the room with some frames changed.
fn run_with(edit: impl Fn(u32, &mut FrameInput)) -> (Slam, Vec<FrameReport>) {
    let mut inputs = inputs();
    inputs.iter_mut().for_each(|input| edit(input.id.0, input));
    run(&Config::default(), &inputs)
}

fn poses(reports: &[FrameReport]) -> Vec<bool> {
    reports.iter().map(|r| r.camera_from_world.is_some()).collect()
}

#[test]
fn without_any_depth_no_map_is_started() {
    let zero = depth(vec![0; frames()[0].depth_units.len()]);
    for none in [None, Some(zero)] {
        let (slam, reports) = run_with(|_, input| input.depth = none.clone());
        assert!(reports.iter().all(|r| r.state == TrackingState::NotInitialized));
        assert_eq!((slam.trajectory().count(), slam.map().point_count()), (0, 0));
    }
}

#[test]
fn a_frame_without_depth_is_tracked_by_its_picture() {
    let (_, reports) = run_with(|id, input| {
        if id == 6 {
            input.depth = None;
        }
    });
    assert_eq!(poses(&reports), [true; FRAMES as usize]);
    assert!(reports[6].keypoints.iter().all(|k| k.depth_m == 0.0));
}

#[test]
fn a_missing_mask_is_unknown_and_without_any_all_is_background() {
    let (_, reports) = run_with(|id, input| {
        if id % 3 == 1 {
            input.panoptic = None;
        }
    });
    assert_eq!(poses(&reports), [true; FRAMES as usize]);
    assert!(reports[4].keypoints.iter().all(|k| k.class == KeypointClass::Unknown));
    assert!(reports[4].keypoints.iter().filter(|k| k.verdict == Verdict::Static).count() > 50, "known by its place");
    assert!(reports[3].keypoints.iter().any(|k| k.class == KeypointClass::Stuff));
    let (_, reports) = run_with(|_, input| input.panoptic = None);
    assert_eq!(poses(&reports), [true; FRAMES as usize]);
    assert!(reports.iter().flat_map(|r| &r.keypoints[..]).all(|k| k.class == KeypointClass::Stuff));
}

#[test]
fn dark_and_white_frames_have_no_features_and_no_pose() {
    for grey in [0, 255] {
        let (_, reports) = run(&Config::default(), &[blank(0, grey), blank(1, grey)]);
        assert!(reports.iter().all(|r| r.keypoints.is_empty() && r.camera_from_world.is_none()));
    }
}

#[test]
fn a_single_feature_is_no_map_and_no_panic() {
    let dot = |input: &mut FrameInput| {
        input.gray = GrayImage::new(320, 240, 30);
        (0..5).for_each(|i| input.gray.data[(118 + i) * 320 + 160..][..5].fill(220));
    };
    let (_, reports) = run_with(|_, input| dot(input));
    assert!(reports.iter().all(|r| r.state == TrackingState::NotInitialized && r.keypoints.len() < 60));
    assert!(reports.iter().any(|r| !r.keypoints.is_empty()));
    let (_, reports) = run_with(|id, input| {
        if id >= 6 {
            dot(input);
        }
    });
    assert_eq!(poses(&reports), (0..FRAMES).map(|i| i < 6).collect::<Vec<_>>());
}

#[test]
fn one_bit_of_depth_under_a_keypoint_changes_the_features_digest() {
    let first = inputs()[0].clone();
    let of = |input: &FrameInput| feed(&mut slam(), input).unwrap();
    let before = of(&first);
    let mut changed = first.clone();
    let picture = Arc::make_mut(changed.depth.as_mut().unwrap());
    // A keypoint whose median is the value at its own pixel, alone: that bit is then what is read.
    let units = |x: i64, y: i64, p: &slam::DepthImage| p.units[y as usize * 320 + x as usize];
    let pixel = before.keypoints.iter().filter(|k| k.depth_m > 0.0).find_map(|k| {
        let (x, y) = ((k.pixel[0] + 0.5) as i64, (k.pixel[1] + 0.5) as i64);
        let middle = (k.depth_m * 1000.0 + 0.5) as u16;
        let window = (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (x + dx, y + dy)));
        let equal: Vec<(i64, i64)> = window.filter(|(x, y)| units(*x, *y, picture) == middle).collect();
        (equal.len() == 1).then(|| equal[0])
    });
    let (x, y) = pixel.expect("such a keypoint");
    picture.units[y as usize * 320 + x as usize] ^= 1;
    let after = of(&changed);
    let digests = |r: &FrameReport| r.records[0].fields.iter().map(|f| (f.name, f.digest)).collect::<Vec<_>>();
    let (before, after) = (digests(&before), digests(&after));
    let differing: Vec<&str> = before.iter().zip(&after).filter(|(a, b)| a != b).map(|(a, _)| a.0).collect();
    assert_eq!(differing, ["depth"], "and the record names the field");
}

#[test]
fn stamps_and_ids_are_passed_through() {
    let (slam, reports) = run(&Config::default(), &inputs()[..3]);
    for (i, (report, frame)) in reports.iter().zip(frames()).enumerate() {
        assert_eq!((report.id, report.stamp.0), (FrameId(i as u32), frame.stamp_ns));
    }
    assert!(slam.trajectory().zip(frames()).all(|(p, f)| p.stamp.0 == f.stamp_ns && p.map == MapId(0)));
}
