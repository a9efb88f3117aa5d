//! The path as well as it can be known at the end.

use fixtures::{World, WorldConfig};
use nalgebra::Vector3;
use slam::offline::seen_twice;
use slam::{Config, Slam, TrajectoryPose};
use slam_math::MapId;
use slam_math::align::umeyama;
use slam_math::par::Pool;

use crate::support::{inputs, room, run};

/// Root mean square of the position error after the best rigid fit, metres; frames of a world in this order.
fn error(path: &[TrajectoryPose], world: &WorldConfig, order: &[u32]) -> f64 {
    let truth = World::new(world).unwrap();
    let at = |p: &TrajectoryPose| truth.world_from_camera(truth.stamp_ns(order[p.id.index()])).translation;
    let found: Vec<Vector3<f64>> = path.iter().map(|p| p.world_from_camera.translation).collect();
    let wanted: Vec<Vector3<f64>> = path.iter().map(at).collect();
    let fit = umeyama(&found, &wanted, false).expect("the path bends");
    let squares = found.iter().zip(&wanted).map(|(f, w)| (fit.transform(f) - w).norm_squared());
    (squares.sum::<f64>() / found.len() as f64).sqrt()
}

/// A slam that makes many keyframes and adjusts next to nothing on its way, so that its map is noisy.
fn careless() -> Config {
    let mut config = Config::default();
    config.keyframes.tracked_share = 0.95;
    (config.mapping.ba_keyframes, config.mapping.ba_iterations, config.mapping.ba_every) = (2, 1, 1000);
    // A quarter of the usual pixels shows fewer points.
    config.r#final.min_inliers = 30;
    config
}

/// A gaze that sweeps, so that there are keyframes.
fn sweep() -> WorldConfig {
    let mut world = room(200);
    world.camera_path.amplitude_m = [0.3, 0.2, 0.1];
    world.camera_path.look_amplitude_m = [6.0, 0.0, 0.0];
    world
}

fn walk(config: &Config, frames: u32) -> (Slam, WorldConfig, Vec<u32>) {
    let (world, order): (_, Vec<u32>) = (sweep(), (0..frames).collect());
    (run(config, &inputs(&world, order.iter().copied())).0, world, order)
}

#[test]
fn a_noisy_map_fits_better_in_the_end_and_the_path_is_no_worse() {
    let (slam, world, order) = walk(&careless(), 60);
    let before: Vec<_> = slam.trajectory().collect();
    let after = slam.final_path(&seen_twice);
    let [before_m, after_m] = [&before, &after.poses].map(|path| error(path, &world, &order));
    eprintln!("{before_m:.4} m, then {after_m:.4} m: {:?}", after.parts);
    // Eight millimetres are what the small pictures give; a tenth of that is noise of the trial of weights.
    assert!(after_m < 1.1 * before_m, "{before_m:.4} m, then {after_m:.4} m");
    let [part] = after.parts[..] else { panic!("one map: {:?}", after.parts) };
    assert!(part.cost[1] < 0.8 * part.cost[0] && part.iterations > 0, "{part:?}");
    assert!(part.outliers > 0 && part.outliers * 5 < part.observations, "{part:?}");
    assert_eq!(part.refined + part.kept + part.keyframes, before.len(), "{part:?}");
    assert!(part.refined > part.kept, "{part:?}");
    let ids = |path: &[TrajectoryPose]| path.iter().map(|p| (p.id, p.stamp, p.map)).collect::<Vec<_>>();
    assert_eq!(ids(&before), ids(&after.poses), "the same frames");
}

#[test]
fn the_number_of_threads_makes_no_difference() {
    let (slam, ..) = walk(&careless(), 40);
    let [one, four] = [1, 4].map(|threads| Pool::new(threads).unwrap().run(|| slam.final_path(&seen_twice)));
    assert_eq!(one, four);
}

#[test]
fn off_it_is_the_path_that_the_last_frame_left() {
    let config = |enabled| {
        let mut config = Config::default();
        config.r#final.enabled = enabled;
        config
    };
    let frames = inputs(&sweep(), 0..24);
    let [(on, with), (off, without)] = [true, false].map(|enabled| run(&config(enabled), &frames));
    let digests = |reports: &[slam::FrameReport]| reports.iter().map(|r| r.records.to_vec()).collect::<Vec<_>>();
    assert_eq!(digests(&with), digests(&without), "no frame knows of it");
    let path = off.final_path(&seen_twice);
    assert!(path.parts.is_empty());
    assert_eq!(path.poses, on.trajectory().collect::<Vec<_>>());
    assert_ne!(path.poses, on.final_path(&seen_twice).poses);
}

#[test]
fn points_that_are_not_trusted_have_no_say() {
    let (slam, ..) = walk(&Config::default(), 24);
    let path = slam.final_path(&|_| false);
    assert_eq!(path.poses, slam.trajectory().collect::<Vec<_>>(), "nothing is left to go by");
    assert_eq!((path.parts[0].iterations, path.parts[0].refined), (0, 0));
    let oldest = slam.final_path(&|point| seen_twice(point) && point.id.0 < 300);
    assert!(oldest.parts[0].points <= 300 && oldest.parts[0].points > 100, "{:?}", oldest.parts);
}

#[test]
fn only_the_newest_frames_are_remembered() {
    let mut config = careless();
    config.r#final.depth_weights = vec![1.0];
    let (all, ..) = walk(&config, 40);
    config.r#final.max_frames = 10;
    let (some, ..) = walk(&config, 40);
    let [all, some] = [all, some].map(|slam| slam.final_path(&seen_twice).parts[0]);
    assert!(some.refined > 0 && some.refined <= 10 && all.refined > 20, "{all:?}, {some:?}");
    assert_eq!((all.refined + all.kept, all.cost), (some.refined + some.kept, some.cost));
}

/// Kidnapped for good: two maps that see nothing in common.
#[test]
fn maps_are_adjusted_one_by_one() {
    let mut config = careless();
    config.relocalization.frames_before_new_map = 3;
    let (slam, _) = run(&config, &inputs(&sweep(), (0..40).chain(110..150)));
    let path = slam.final_path(&seen_twice);
    let maps: Vec<u32> = path.parts.iter().map(|part| part.map).collect();
    assert_eq!(maps, [0, 1]);
    for part in &path.parts {
        let frames = path.poses.iter().filter(|p| p.map == MapId(part.map)).count();
        assert_eq!(part.refined + part.kept + part.keyframes, frames, "{part:?}");
        assert!(part.cost[1] < part.cost[0], "{part:?}");
        // Each stays where its first keyframe stands.
        let root = slam.map().keyframes().find(|k| k.map == MapId(part.map) && k.parent.is_none()).unwrap();
        let first = path.poses.iter().find(|p| p.id == root.frame).unwrap();
        let off = (first.world_from_camera.translation - root.center()).norm();
        assert!(off < 1e-9, "map{} moved by {off} m", part.map);
    }
}
