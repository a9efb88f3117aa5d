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
    if let Ok(lag) = std::env::var("LAG") {
        let lag: u32 = lag.parse().unwrap();
        config.jobs.mapping_lag_frames = lag.min(2);
        config.jobs.loop_lag_frames = lag;
        config.jobs.global_lag_frames = 3 * lag;
    }
    config
}

#[test]
fn a_round_of_60_m_with_drift_is_closed() {
    let env = |k: &str, d: f64| std::env::var(k).map_or(d, |v| v.parse().unwrap());
    let corridor = Corridor::new(Errors {
        pixel_px: env("PX", 0.5),
        depth_share: env("DS", 0.005),
        shift_px_per_m: env("SHIFT", 0.25),
        bits: env("BITS", 12.0) as usize,
    });
    let ways: Vec<f64> =
        (0..).map(|i| f64::from(i) * env("STEP", 0.12)).take_while(|s| *s < ROUND_M + env("OVER", 8.0)).collect();
    let errors = [false, true].map(|enabled| {
        #[allow(clippy::disallowed_methods)]
        let t = std::time::Instant::now();
        let (slam, truth, events) = corridor.walk(&config(enabled), ways.iter().copied());
        eprintln!(
            "{} tracked {:?} {} kf {} points, {events:?}",
            slam.trajectory().count(),
            t.elapsed(),
            slam.map().keyframe_count(),
            slam.map().point_count()
        );
        ate(&slam, &truth)
    });
    eprintln!("{errors:?}");
    assert!(errors[1] < 0.1 * errors[0], "ATE {:.3} m open, {:.3} m closed", errors[0], errors[1]);
}
