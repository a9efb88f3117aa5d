//! A place seen again after a long way.

use nalgebra::Vector3;
use slam::{Config, Slam};
use slam_math::Se3;
use slam_math::align::umeyama;

use crate::corridor::{Corridor, Errors, ROUND_M};
use crate::jobs::Lazy;
use crate::scene::{PERSON, WALL};

/// Root mean square of the position error after the best rigid fit, metres.
fn ate(slam: &Slam, truth: &[Se3]) -> f64 {
    let path: Vec<_> = slam.trajectory().collect();
    let found: Vec<Vector3<f64>> = path.iter().map(|p| p.world_from_camera.translation).collect();
    let wanted: Vec<Vector3<f64>> = path.iter().map(|p| truth[p.id.index()].translation).collect();
    let fit = umeyama(&found, &wanted, false).expect("the path bends");
    let squares = found.iter().zip(&wanted).map(|(f, w)| (fit.transform(f) - w).norm_squared());
    (squares.sum::<f64>() / found.len() as f64).sqrt()
}

fn config(enabled: bool) -> Config {
    let mut config = Config::default();
    config.looping.enabled = enabled;
    config
}

/// Once round and half a round more, 12 cm a frame.
fn ways() -> impl Iterator<Item = f64> {
    (0..).map(|i| f64::from(i) * 0.12).take_while(|s| *s < 1.5 * ROUND_M)
}

const ERRORS: Errors = Errors { pixel_px: 1.0, depth_share: 0.02, bits: 12 };

#[test]
fn a_round_of_60_m_with_drift_is_closed() {
    let corridor = Corridor::new(ERRORS);
    let [open, closed] = [false, true].map(|enabled| corridor.walk(&config(enabled), ways()));
    assert!(!open.events.iter().any(|e| e.contains("loop")), "{:?}", open.events);
    assert!(closed.events.iter().any(|e| e.contains("loop closed")), "{:?}", closed.events);
    let [open_m, closed_m] = [&open, &closed].map(|walk| ate(&walk.slam, &walk.truth));
    assert!(closed_m < 0.1 * open_m, "ATE {open_m:.3} m open, {closed_m:.3} m closed");
}

#[test]
fn a_loop_closes_when_it_is_due_whoever_searches() {
    let corridor = Corridor::new(ERRORS);
    for lag in [0, 7] {
        let mut config = config(true);
        (config.jobs.loop_lag_frames, config.jobs.global_lag_frames) = (lag, 3 * lag);
        let walk = corridor.walk(&config, ways());
        let lazy = corridor.walk_with(&config, ways(), &mut Lazy::default());
        assert!(walk.events.iter().any(|e| e.contains("loop closed")), "{:?}", walk.events);
        assert_eq!((&walk.events, &walk.records), (&lazy.events, &lazy.records), "lag {lag}");
        let paths = [&walk, &lazy].map(|w| w.slam.trajectory().collect::<Vec<_>>());
        assert_eq!(paths[0], paths[1], "lag {lag}");
    }
}

/// The same person, who looks the same, goes ahead of the camera in two corridors 20 m apart.
#[test]
fn whoever_comes_along_makes_no_place() {
    let ways = || (0..).map(|i| f64::from(i) * 0.12).take_while(|s| *s < 0.7 * ROUND_M);
    let of = |category: u16| {
        let mut corridor = Corridor::new(ERRORS);
        corridor.companion = Some((vec![2.0..7.0, 30.0..36.0], category));
        corridor.walk(&config(true), ways())
    };
    let person = of(PERSON);
    assert!(!person.events.iter().any(|e| e.contains("loop")), "{:?}", person.events);
    assert!(ate(&person.slam, &person.truth) < 0.5);
    // Not that they would do no harm.
    let taken_for_static = of(WALL);
    assert!(ate(&taken_for_static.slam, &taken_for_static.truth) > 1.0);
}
