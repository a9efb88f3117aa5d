//! Rendered rooms that are harder than the demo's: no data is needed. All seven: `pslam suite rooms`.

use crate::support::{beginning, write_log};
use fixtures::{WorldConfig, scenario};
use replayer::robust::{Judged, Perturbation, Sequence, judge_all};
use slam::Config;

/// Replays a world as rendered and in a mirror, which must lose no frame either.
fn both(world: &WorldConfig) -> Vec<Judged> {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.mcap");
    write_log(world, &log, &mut |_| {});
    let config = Config::default();
    let sequence = Sequence::open(&log, &config, None).unwrap();
    let tasks = [(Perturbation::AsRecorded, &config), (Perturbation::Mirrored, &config)];
    let judged = judge_all(&sequence, &tasks, 1, &|_| {});
    let judged: Vec<Judged> = judged.into_iter().map(|verdict| verdict.unwrap().judged.unwrap()).collect();
    for (done, (perturbation, _)) in judged.iter().zip(&tasks) {
        let (rmse_m, largest_m) = (done.error_m.rmse, done.error_m.max);
        eprintln!("{perturbation}: {rmse_m:.4} m, at most {largest_m:.4} m");
        assert_eq!(done.tracked, done.frames, "{perturbation}: frames are lost");
    }
    judged
}

/// A camera that stands among six people who walk: whatever it is taken to have moved is an error.
#[test]
fn a_crowd_moves_no_fixed_camera() {
    for done in both(&scenario::fixed_crowd()) {
        assert!(done.error_m.max < 0.02 && done.error_m.rmse < 0.008, "{done:?}");
    }
}

/// A box that no network knows fills a third of the picture and moves 3 cm a second.
#[test]
fn a_box_that_creeps_takes_the_camera_nowhere() {
    for done in both(&beginning(scenario::slow_mover(), 100)) {
        assert!(done.error_m.rmse < 0.02, "{done:?}");
    }
}
