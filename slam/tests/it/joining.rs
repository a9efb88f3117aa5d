//! A kidnapped camera starts a second map, and the two are joined when it comes back.

use fixtures::{World, WorldConfig};
use nalgebra::Vector3;
use slam::report::{TrackingState, Verdict};
use slam::{Config, FrameInput, Inline, Sensor, Setup, Slam};
use slam_math::align::umeyama;
use slam_math::{MapId, float};

use crate::support::{camera, feed, inputs, room, run, setup};

/// Frames of a sequence in which the gaze sweeps from the middle of the room far to the right and back. The camera
/// starts in the middle, is carried off to the right, and turns back to the middle.
fn sweep() -> (WorldConfig, Vec<u32>) {
    let mut world = room(200);
    world.camera_path.amplitude_m = [0.1, 0.05, 0.02];
    world.camera_path.look_amplitude_m = [6.0, 0.0, 0.0];
    let order = (0..6).chain(64..134).collect();
    (world, order)
}

#[test]
fn a_kidnapped_camera_starts_a_map_that_is_joined_later() {
    let mut config = Config::default();
    config.relocalization.frames_before_new_map = 3;
    let (world, order) = sweep();
    let (slam, reports) = run(&config, &inputs(&world, order.iter().copied()));
    let started = reports.iter().position(|r| r.map == MapId(1)).expect("a second map");
    assert!((9..14).contains(&started), "frame {started}");
    assert!(reports[6..started].iter().all(|r| r.camera_from_world.is_none()), "nothing is guessed in between");
    assert_eq!(reports[6].state, TrackingState::RecentlyLost);
    assert_eq!(reports[started - 1].state, TrackingState::Lost);
    assert_eq!(reports[started].state, TrackingState::Ok);
    let joined = reports[started..].iter().position(|r| r.map == MapId(0)).expect("joined") + started;
    assert!(reports[joined].events.iter().any(|e| e.warning && e.text.contains("joined")));
    assert!(reports[started..joined].iter().all(|r| r.map == MapId(1) && r.state == TrackingState::Ok));
    assert!(reports[joined..].iter().all(|r| r.map == MapId(0) && r.state == TrackingState::Ok));
    assert_eq!(slam.map().keyframe_count_of(MapId(1)), 0);

    // What was remembered moved along: right after the join nothing static looks as if it had moved.
    for r in &reports[joined + 1..] {
        let moved = r.keypoints.iter().filter(|k| k.verdict.is_dynamic() || k.verdict == Verdict::Border).count();
        assert!(moved * 10 < r.keypoints.len(), "{moved} of {} in frame {}", r.keypoints.len(), r.id);
        assert!(r.counts.motion_matches > 100, "the motion model goes on: {:?}", r.counts);
    }

    // One frame of coordinates for the whole path; the online path keeps the one it had.
    let off = one_frame(&slam, &world, &order);
    assert!(off < 0.05, "{off} m off");
    let online: Vec<MapId> = slam.online_trajectory().map(|p| p.map).collect();
    let reported: Vec<MapId> = reports.iter().filter(|r| r.camera_from_world.is_some()).map(|r| r.map).collect();
    assert_eq!(online, reported);
}

/// All poses are of one map; how far the worst one is off after a rigid fit, metres.
fn one_frame(slam: &Slam, world: &WorldConfig, order: &[u32]) -> f64 {
    let truth = World::new(world).unwrap();
    let path: Vec<_> = slam.trajectory().collect();
    assert!(path.iter().all(|p| p.map == MapId(0)));
    let at = |id: u32| truth.world_from_camera(truth.stamp_ns(order[id as usize]));
    let found: Vec<Vector3<f64>> = path.iter().map(|p| p.world_from_camera.translation).collect();
    let wanted: Vec<Vector3<f64>> = path.iter().map(|p| at(p.id.0).translation).collect();
    let fit = umeyama(&found, &wanted, false).expect("the path bends");
    found.iter().zip(&wanted).fold(0.0, |worst, (f, w)| float::max(worst, (fit.transform(f) - w).norm()))
}

/// The same with two pictures in place of depth images.
#[test]
fn maps_of_a_stereo_camera_are_joined_as_well() {
    const BASELINE_M: f64 = 0.11;
    let mut config = Config::default();
    config.relocalization.frames_before_new_map = 3;
    let (world, order) = sweep();
    let world = WorldConfig { right_camera_m: BASELINE_M, ..world };
    let sensor = Sensor::Stereo { bf: BASELINE_M * camera().fx };
    let mut slam = Slam::new(&config, &Setup { sensor, ..setup() }).unwrap();
    let mut events = Vec::new();
    for input in inputs(&world, order.iter().copied()) {
        let report = feed(&mut slam, &FrameInput { depth: None, ..input }).unwrap();
        events.extend(report.events.into_iter().map(|event| format!("{}: {}", report.id, event.text)));
    }
    slam.settle(&mut Inline).unwrap();
    assert!(events.iter().any(|e| e.contains("map1 joined map0")), "{events:?}");
    let off = one_frame(&slam, &world, &order);
    eprintln!("stereo: {off:.3} m off at worst");
    assert!(off < 0.05, "{off} m off");
}
