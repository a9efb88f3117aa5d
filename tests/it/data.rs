//! Real data: the project's promises on four sequences. Skipped where they are not at hand.

use crate::support::shared_data;
use recorder::import::{PanopticSource, TumOptions, tum};
use replayer::eval::{Coverage, EvalOptions, Evaluation, Trajectory, evaluate};
use replayer::log::Log;
use replayer::run::{ReplayOptions, TRAJECTORY_TXT, replay};
use slam::Config;
use std::path::Path;

/// Sequence, largest absolute trajectory error, and whether something moves in it. ORB-SLAM3 without a filter has 0.006,
/// 0.387, 0.318 and 0.367 m.
const SEQUENCES: [(&str, f64, bool); 4] = [
    ("kitchen_static", 0.008, false),
    ("kitchen_moving_box", 0.012, true),
    ("kitchen_placing_box", 0.010, true),
    ("kitchen_robots_people", 0.015, true),
];
/// Without the filter the track follows the movers.
const FAILS_M: f64 = 0.1;

fn judge(log: &Path, out: &Path, preset: &str) -> Evaluation {
    let config = Config::preset(preset).unwrap();
    let options = ReplayOptions { config, config_name: preset.to_owned(), threads: 2, ..ReplayOptions::default() };
    let result = replay(log, out, &options, &mut |_, _| {}).unwrap().result;
    let path = Trajectory::read_tum(&out.join(TRAJECTORY_TXT)).unwrap();
    let coverage = Coverage { tracked: path.poses.len(), frames: result.frames };
    let truth = Log::open(log).unwrap().ground_truth().clone();
    evaluate(&truth, &path, Some(coverage), &EvalOptions::default()).unwrap()
}

#[test]
fn kitchens_are_tracked_among_movers() {
    let Some(data) = shared_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut broken = Vec::new();
    for (name, limit_m, moves) in SEQUENCES {
        let source = data.join(name);
        if !source.is_dir() {
            eprintln!("SKIPPED: {} is not there", source.display());
            continue;
        }
        let log = folder.path().join(format!("{name}.mcap"));
        let panoptic = vec![PanopticSource::new(&source.join("panoptic"))];
        tum(&source, &log, &TumOptions { panoptic, ..TumOptions::default() }, &mut |_, _| {}).unwrap();
        let full = judge(&log, &folder.path().join(format!("{name}-full")), "full");
        let (ate, coverage) = (full.ate_m.rmse, full.coverage.unwrap());
        eprintln!("{name}: full {ate:.4} m, {} of {} frames", coverage.tracked, coverage.frames);
        if coverage.tracked != coverage.frames || ate > limit_m {
            broken.push(format!("{name}: {ate:.4} m (at most {limit_m}), {coverage:?}"));
        }
        if moves {
            let none = judge(&log, &folder.path().join(format!("{name}-none")), "none").ate_m.rmse;
            eprintln!("{name}: none {none:.4} m");
            if none <= FAILS_M {
                broken.push(format!("{name}: {none:.4} m without the filter, so it proves nothing"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}
