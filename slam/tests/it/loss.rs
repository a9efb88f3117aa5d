//! Track lost in the dark, and found again.

use fixtures::WorldConfig;
use slam::Config;
use slam::report::{FrameReport, TrackingState};
use slam_math::MapId;

use crate::support::{inputs, room, run};

/// Ten frames of light, `dark` frames without, eight of light.
fn through_the_dark(config: &Config, dark: u32) -> (slam::Slam, Vec<FrameReport>) {
    let world = WorldConfig { dark_frames: Some(10..10 + dark), ..room(18 + dark) };
    run(config, &inputs(&world, 0..18 + dark))
}

fn ids(reports: &[FrameReport]) -> Vec<u32> {
    reports.iter().filter(|r| r.camera_from_world.is_some()).map(|r| r.id.0).collect()
}

#[test]
fn the_place_is_found_again_after_the_dark() {
    let (slam, reports) = through_the_dark(&Config::default(), 6);
    for r in &reports[10..16] {
        assert_eq!(r.state, TrackingState::RecentlyLost, "frame {}", r.id);
        assert!(r.camera_from_world.is_none() && r.reference.is_none() && r.new_keyframe.is_none());
        assert!(r.keypoints.iter().all(|k| k.point.is_none()));
    }
    assert!(reports[10].events.iter().any(|e| e.warning && e.text.contains("track lost")), "{:?}", reports[10].events);
    let found = reports[16..].iter().find(|r| r.state == TrackingState::Ok).expect("found again");
    assert!(found.events.iter().any(|e| e.warning && e.text.contains("found again")), "{:?}", found.events);
    assert!(found.id.0 <= 17);
    assert!(reports.iter().all(|r| r.map == MapId(0)), "no new map");
    assert!(reports[found.id.index()..].iter().all(|r| r.state == TrackingState::Ok));
    // No pose is guessed for lost frames.
    let tracked = ids(&reports);
    assert!(tracked.iter().all(|id| *id < 10 || *id >= found.id.0));
    assert_eq!(slam.trajectory().map(|p| p.id.0).collect::<Vec<_>>(), tracked);
    assert_eq!(slam.online_trajectory().map(|p| p.id.0).collect::<Vec<_>>(), tracked);
}

#[test]
fn a_dark_start_is_no_start() {
    let world = WorldConfig { dark_frames: Some(0..3), ..room(6) };
    let (slam, reports) = run(&Config::default(), &inputs(&world, 0..6));
    let states: Vec<_> = reports.iter().map(|r| r.state).collect();
    assert_eq!(states[..3], [TrackingState::NotInitialized; 3]);
    assert_eq!(states[3..], [TrackingState::Ok; 3]);
    assert_eq!(slam.trajectory().count(), 3);
}

#[test]
fn dark_pictures_alone_start_no_new_map() {
    let mut config = Config::default();
    config.relocalization.frames_before_new_map = 2;
    let (_, reports) = through_the_dark(&config, 8);
    assert!(reports.iter().all(|r| r.map == MapId(0)), "unusable pictures do not count");
    assert_eq!(reports.last().unwrap().state, TrackingState::Ok);
}
