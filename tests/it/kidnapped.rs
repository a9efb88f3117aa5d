//! The camera is taken away and put down elsewhere, on real pictures: a new map is begun, and joined to the old one where the two
//! meet. Skipped where the data is not at hand.

use crate::support::shared_data;
use panoptic_slam::suite::Degrade;
use recorder::import::{PanopticSource, TumOptions, tum};
use replayer::eval::{Coverage, EvalOptions, Trajectory, evaluate};
use replayer::log::Log;
use replayer::run::{ReplayOptions, TRAJECTORY_TXT, replay};

/// As for the same pictures in their own order, `data.rs`.
const MAX_ATE_M: f64 = 0.015;

#[test]
fn maps_meet_among_people_and_robots() {
    let Some(data) = shared_data() else { return };
    let source = data.join("kitchen_robots_people");
    if !source.is_dir() {
        eprintln!("SKIPPED: {} is not there", source.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let [log, kidnapped, run] = ["log.mcap", "kidnapped.mcap", "run"].map(|name| folder.path().join(name));
    let panoptic = vec![PanopticSource::new(&source.join("panoptic"))];
    tum(&source, &log, &TumOptions { panoptic, ..TumOptions::default() }, &mut |_, _| {}).unwrap();
    Degrade::Kidnapped.apply(&log, &kidnapped, &mut |_, _| {}).unwrap();

    let options = ReplayOptions { threads: 2, ..ReplayOptions::default() };
    let result = replay(&kidnapped, &run, &options, &mut |_, _| {}).unwrap().result;
    let says = |words: &str| result.events.iter().any(|event| event.text.contains(words));
    assert!(says("map1 started") && says("map1 joined map0"), "{:#?}", result.events);
    assert_eq!(result.in_trajectory, result.tracked, "one map in the end");
    let path = Trajectory::read_tum(&run.join(TRAJECTORY_TXT)).unwrap();
    let coverage = Coverage { tracked: path.poses.len(), frames: result.frames };
    let truth = Log::open(&kidnapped).unwrap().ground_truth().clone();
    let error = evaluate(&truth, &path, Some(coverage), &EvalOptions::default()).unwrap();
    assert!(error.ate_m.rmse < MAX_ATE_M, "{:.4} m: the two maps do not fit", error.ate_m.rmse);
}
