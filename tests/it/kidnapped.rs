//! The camera is taken away and put down elsewhere, on real pictures: a new map is begun, and joined to the old one where the two
//! meet. Skipped where the data is not at hand.

use crate::support::shared_data;
use panoptic_slam::suite::Degrade;
use recorder::import::{PanopticSource, TumOptions, tum};
use replayer::eval::{Coverage, EvalOptions, Trajectory, evaluate};
use replayer::log::Log;
use replayer::run::{ReplayOptions, TRAJECTORY_TXT, replay};
use slam::config::SensorChoice;

/// As for the same pictures in their own order, `data.rs`.
const MAX_ATE_M: f64 = 0.015;
/// Without depth: two maps of different scale, each drifting in its own.
const MAX_MONOCULAR_ATE_M: f64 = 0.03;

#[test]
fn maps_meet_among_people_and_robots() {
    let Some(data) = shared_data() else { return };
    let source = data.join("kitchen_robots_people");
    if !source.is_dir() {
        eprintln!("SKIPPED: {} is not there", source.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [log, kidnapped] = ["log.mcap", "kidnapped.mcap"].map(|name| folder.path().join(name));
    let panoptic = vec![PanopticSource::new(&source.join("panoptic"))];
    tum(&source, &log, &TumOptions { panoptic, ..TumOptions::default() }, &mut |_, _| {}).unwrap();
    Degrade::Kidnapped.apply(&log, &kidnapped, &mut |_, _| {}).unwrap();

    for (sensor, max_ate_m) in [(SensorChoice::Auto, MAX_ATE_M), (SensorChoice::Monocular, MAX_MONOCULAR_ATE_M)] {
        let run = folder.path().join(format!("{sensor:?}"));
        let mut options = ReplayOptions { threads: 2, ..ReplayOptions::default() };
        options.config.sensor.kind = sensor;
        let result = replay(&kidnapped, &run, &options, &mut |_, _| {}).unwrap().result;
        let says = |words: &str| result.events.iter().any(|event| event.text.contains(words));
        assert!(says("map1 started") && says("map1 joined map0"), "{sensor:?}: {:#?}", result.events);
        assert_eq!(result.in_trajectory, result.tracked, "{sensor:?}: one map in the end");
        let path = Trajectory::read_tum(&run.join(TRAJECTORY_TXT)).unwrap();
        let coverage = Coverage { tracked: path.poses.len(), frames: result.frames };
        let truth = Log::open(&kidnapped).unwrap().ground_truth().clone();
        let error = evaluate(&truth, &path, Some(coverage), &EvalOptions::for_sensor(&result.sensor)).unwrap();
        let ate_m = error.ate_m.rmse;
        assert!(ate_m < max_ate_m, "{sensor:?}: {ate_m:.4} m: the two maps do not fit");
    }
}
