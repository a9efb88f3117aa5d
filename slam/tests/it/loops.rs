//! A place seen again after a long way.

use nalgebra::Vector3;
use slam::{Config, Slam};
use slam_math::Se3;
use slam_math::align::umeyama;

use crate::corridor::{Corridor, Errors, ROUND_M};

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
