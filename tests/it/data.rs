//! Real data: the project's promises on seven sequences, as recorded and under one change each that must not matter. Skipped
//! where they are not at hand.

use crate::support::shared_data;
use recorder::import::{CameraSource, PanopticSource, TumOptions, tum};
use replayer::robust::{Judged, Perturbation, Sequence, judge_all};
use schemas::calibration::Preset;
use slam::Config;

/// A sequence and what is promised of it; errors are the RMSE of positions. Every frame is tracked in any case.
struct Promise {
    /// Folder of the data.
    name: &'static str,
    /// Camera of the folder; `None` where a file there tells it.
    camera: Option<Preset>,
    /// As recorded, metres.
    max_error_m: f64,
    /// What else is done to it.
    perturbation: Perturbation,
    /// The error then, metres.
    max_perturbed_m: f64,
    /// Without the filter the error is larger, metres; `None` where nothing moves or the camera stands still.
    fails_above_m: Option<f64>,
}

/// Imports a sequence, replays it with the default configuration and compares with the promise.
fn keeps(promise: &Promise) {
    let Some(data) = shared_data() else { return };
    let source = data.join(promise.name);
    if !source.is_dir() {
        eprintln!("SKIPPED: {} is not there", source.display());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("log.mcap");
    let panoptic = vec![PanopticSource::new(&source.join("panoptic"))];
    let camera = promise.camera.map_or(CameraSource::Auto, CameraSource::Preset);
    tum(&source, &log, &TumOptions { panoptic, camera, ..TumOptions::default() }, &mut |_, _| {}).unwrap();

    let (full, none) = (Config::preset("full").unwrap(), Config::preset("none").unwrap());
    let sequence = Sequence::open(&log, &full, None).unwrap();
    let mut tasks = vec![(Perturbation::AsRecorded, &full), (promise.perturbation, &full)];
    tasks.extend(promise.fails_above_m.map(|_| (Perturbation::AsRecorded, &none)));
    let judged = judge_all(&sequence, &tasks, 1, &|_| {});
    let judged: Vec<Judged> = judged.into_iter().map(|verdict| verdict.unwrap().judged.unwrap()).collect();

    for (done, (perturbation, max_m)) in judged
        .iter()
        .zip([(Perturbation::AsRecorded, promise.max_error_m), (promise.perturbation, promise.max_perturbed_m)])
    {
        let (name, error_m) = (promise.name, done.error_m.rmse);
        eprintln!("{name} {perturbation}: {error_m:.4} m, {} of {} frames", done.tracked, done.frames);
        assert_eq!(done.tracked, done.frames, "{name} {perturbation}: frames are lost");
        assert!(error_m < max_m, "{name} {perturbation}: {error_m:.4} m, at most {max_m}");
    }
    if let (Some(fails_m), Some(none)) = (promise.fails_above_m, judged.get(2)) {
        let error_m = none.error_m.rmse;
        assert!(error_m > fails_m, "{}: {error_m:.4} m without the filter, so it proves nothing", promise.name);
    }
}

#[test]
fn a_kitchen_where_nothing_moves() {
    keeps(&Promise {
        name: "kitchen_static",
        camera: None,
        max_error_m: 0.010,
        perturbation: Perturbation::Backwards,
        max_perturbed_m: 0.012,
        fails_above_m: None,
    });
}

#[test]
fn a_kitchen_with_a_box_that_is_carried() {
    keeps(&Promise {
        name: "kitchen_moving_box",
        camera: None,
        max_error_m: 0.012,
        perturbation: Perturbation::Mirrored,
        max_perturbed_m: 0.012,
        fails_above_m: Some(0.1),
    });
}

#[test]
fn a_kitchen_with_a_box_that_is_put_down() {
    keeps(&Promise {
        name: "kitchen_placing_box",
        camera: None,
        max_error_m: 0.010,
        perturbation: Perturbation::EverySecond,
        max_perturbed_m: 0.015,
        fails_above_m: Some(0.1),
    });
}

#[test]
fn a_kitchen_with_robots_and_people() {
    keeps(&Promise {
        name: "kitchen_robots_people",
        camera: None,
        max_error_m: 0.015,
        perturbation: Perturbation::LabelNoise,
        max_perturbed_m: 0.020,
        fails_above_m: Some(0.1),
    });
}

#[test]
fn a_slow_box_before_little_texture() {
    keeps(&Promise {
        name: "kitchen_slip",
        camera: None,
        max_error_m: 0.015,
        perturbation: Perturbation::Start(7),
        max_perturbed_m: 0.015,
        fails_above_m: Some(0.1),
    });
}

/// The camera stands still: the error is how far positions are from their mean.
#[test]
fn a_crowd_before_a_fixed_camera() {
    keeps(&Promise {
        name: "lab_fixed_camera_crowd",
        camera: None,
        max_error_m: 0.005,
        perturbation: Perturbation::LabelNoise,
        max_perturbed_m: 0.006,
        fails_above_m: None,
    });
}

#[test]
fn people_who_cross_close_to_the_camera() {
    keeps(&Promise {
        name: "tum_fr3_walking_halfsphere",
        camera: Some(Preset::Freiburg3),
        max_error_m: 0.015,
        perturbation: Perturbation::EverySecond,
        max_perturbed_m: 0.025,
        fails_above_m: Some(0.08),
    });
}
