//! The slam with two pictures and with one.

use fixtures::{World, WorldConfig};
use nalgebra::Vector3;
use slam::report::RegionState::{Dynamic, Static};
use slam::report::{KeypointClass, TrackingState};
use slam::{Config, FrameInput, FrameReport, Sensor, Setup, Slam};
use slam_math::align::umeyama;
use slam_vision::Workspace;

use crate::scene::{Board, CHAIR, Film};
use crate::support::{camera, feed, input_of, room, setup};

/// Distance of the cameras, metres.
const BASELINE_M: f64 = 0.11;

fn stereo() -> Sensor {
    Sensor::Stereo { bf: BASELINE_M * camera().fx }
}

/// Frames without depth images, with the true camera centres.
fn frames(count: u32) -> (Vec<FrameInput>, Vec<Vector3<f64>>) {
    let world = World::new(&WorldConfig { right_camera_m: BASELINE_M, ..room(count) }).unwrap();
    let one = |i: u32| {
        let frame = world.frame(i);
        (FrameInput { depth: None, ..input_of(&frame, i) }, frame.world_from_camera.translation)
    };
    (0..count).map(one).unzip()
}

fn run(sensor: Sensor, inputs: &[FrameInput]) -> Vec<FrameReport> {
    let mut slam = Slam::new(&Config::default(), &Setup { sensor, ..setup() }).unwrap();
    inputs.iter().map(|input| feed(&mut slam, input).unwrap()).collect()
}

/// Root mean square distance of the tracked centres from the true ones after alignment, metres, and the frames tracked.
fn error(reports: &[FrameReport], truth: &[Vector3<f64>], with_scale: bool) -> (f64, usize) {
    let tracked = reports.iter().zip(truth).filter_map(|(r, t)| Some((r.camera_from_world?.inverse().translation, *t)));
    let (estimate, truth): (Vec<_>, Vec<_>) = tracked.unzip();
    let fit = umeyama(&estimate, &truth, with_scale).unwrap();
    let squares = estimate.iter().zip(&truth).map(|(e, t)| (fit.transform(e) - t).norm_squared());
    ((squares.fold(0.0, |sum, s| sum + s) / truth.len() as f64).sqrt(), truth.len())
}

#[test]
fn depth_of_a_pair_is_that_of_the_room() {
    let world = World::new(&WorldConfig { right_camera_m: BASELINE_M, ..room(1) }).unwrap();
    let frame = world.frame(0);
    let input = FrameInput { depth: None, ..input_of(&frame, 0) };
    let slam = Slam::new(&Config::default(), &Setup { sensor: stereo(), ..setup() }).unwrap();
    let obs = slam.front_end().observe(&input, &mut Workspace::default()).unwrap();
    let bf = BASELINE_M * camera().fx;
    let error = |i: usize| {
        let [x, y] = obs.raw_pixel[i].map(|v| (v + 0.5) as usize);
        let units = frame.depth_exact_units[y * 320 + x];
        let truth = f64::from(units) / world.config().depth_units_per_metre;
        (units > 0).then(|| Some((bf / obs.depth(i)? - bf / truth).abs()))?
    };
    let mut errors: Vec<f64> = (0..obs.len()).filter_map(error).collect();
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() * 2 > obs.len(), "{} of {} keypoints have depth", errors.len(), obs.len());
    let at = |share: f64| errors[(share * errors.len() as f64) as usize];
    eprintln!("disparity errors: median {:.3} px, 68 % {:.3} px, 90 % {:.3} px", at(0.5), at(0.68), at(0.9));
    assert!(at(0.5) < 0.3 && at(0.9) < 2.0, "median {} px, 90 % {} px", at(0.5), at(0.9));
}

#[test]
fn a_pair_is_tracked_in_metres() {
    let (inputs, truth) = frames(16);
    let (rmse, tracked) = error(&run(stereo(), &inputs), &truth, false);
    assert_eq!(tracked, 16, "from the first frame on");
    assert!(rmse < 0.01, "{rmse} m");
}

#[test]
fn one_picture_needs_a_second_view_and_then_has_the_path_up_to_scale() {
    let (inputs, truth) = frames(40);
    let reports = run(Sensor::Monocular, &inputs);
    assert_eq!(reports[0].state, TrackingState::NotInitialized);
    assert!(reports[0].camera_from_world.is_none(), "no pose is guessed");
    let start = reports.iter().position(|r| r.state == TrackingState::Ok).unwrap();
    assert!((1..30).contains(&start), "started at {start}");
    let (rmse, tracked) = error(&reports, &truth, true);
    assert_eq!(tracked, 40 - start, "and never lost");
    // The first poses after the start lean on two views that are 1 degree apart: 46 mm with all of them.
    assert!(rmse < 0.06, "{rmse} m");
}

#[test]
fn points_on_still_things_are_told_from_background_without_depth_too() {
    let (inputs, _) = frames(120);
    for sensor in [stereo(), Sensor::Monocular] {
        let mut slam = Slam::new(&Config::default(), &Setup { sensor, ..setup() }).unwrap();
        inputs.iter().for_each(|input| drop(feed(&mut slam, input).unwrap()));
        let map = slam.map();
        let seen_on = |point: &slam::map::MapPoint, class: KeypointClass| {
            let is_on = |s: &slam::map::Sighting| {
                map.keyframe(s.keyframe).is_some_and(|keyframe| keyframe.class[s.index as usize] == class)
            };
            2 * point.seen_in.iter().filter(|s| is_on(s)).count() > point.seen_in.len()
        };
        for class in [KeypointClass::Thing, KeypointClass::Stuff] {
            let seen: Vec<_> = map.points().filter(|point| seen_on(point, class)).collect();
            let alike = seen.iter().filter(|point| point.class == class).count();
            assert!(seen.len() >= 30, "{} points of {sensor:?} on {class:?}", seen.len());
            assert!(alike * 10 >= seen.len() * 9, "{alike} of {} points of {sensor:?} on {class:?}", seen.len());
        }
    }
}

#[test]
fn a_camera_that_stands_still_starts_no_monocular_map() {
    let (inputs, _) = frames(1);
    let again = |id: u32| FrameInput { id: slam_math::FrameId(id), ..inputs[0].clone() };
    let reports = run(Sensor::Monocular, &(0..6).map(again).collect::<Vec<_>>());
    assert!(reports.iter().all(|r| r.state == TrackingState::NotInitialized && r.counts.map_points == 0));
    assert!(reports[3].events.iter().any(|event| event.text.contains("no map yet")), "{:?}", reports[3].events);
}

/// States after a film in which the camera and a chair move, metres a frame.
fn film(camera_m: [f64; 3], chair_m: [f64; 3]) -> Vec<slam::report::RegionState> {
    let mut film = Film::monocular(&Config::default());
    let step = |v: [f64; 3], frame: u32| v.map(|m| m * f64::from(frame));
    let chair = Board::new(1, Some((5, CHAIR)));
    let mut states = Vec::new();
    for frame in 0..20 {
        film.camera_m = step(camera_m, frame);
        let [x, y, z] = step(chair_m, frame);
        states = film.show(&[chair.at([x, y, 2.0 + z])]).states();
    }
    states
}

#[test]
fn without_depth_the_filter_sees_what_leaves_its_epipolar_line() {
    assert_eq!(film([0.01, 0.0, 0.0], [0.0; 3]), [Static], "a still chair before a moving camera");
    assert_eq!(film([0.0; 3], [0.0; 3]), [Static], "a still chair before a still camera");
    assert_eq!(film([0.01, 0.0, 0.0], [0.0, 0.02, 0.0]), [Dynamic], "across the epipolar line");
    assert_eq!(film([0.0; 3], [0.02, 0.0, 0.0]), [Dynamic], "a still camera sees every motion across its view");
    assert_eq!(film([0.01, 0.0, 0.0], [0.02, 0.0, 0.0]), [Dynamic], "along the line, but beyond infinity");
    // What one camera can't see: against its own motion, a chair looks like a still one that is nearer.
    assert_eq!(film([0.01, 0.0, 0.0], [-0.005, 0.0, 0.0]), [Static]);
}
