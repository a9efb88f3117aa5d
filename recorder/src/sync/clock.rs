//! A device clock against the clock of the computer that received its data.
//!
//! `arrival = host_at_origin + (1 + drift) (device - origin) + delay`, and the delay is never negative: transport only
//! ever adds time. So the clocks' relation is the lower envelope of the arrivals. It is found from the earliest arrival
//! of every second, which busy moments of the host leave alone, by Theil and Sen's line (the median of all slopes),
//! which a third of bad seconds does not move.

use super::SyncError;
use schemas::sync::{Arrivals, ClockFit};
use slam_math::float::median_in_place;

/// Windows needed for a drift.
const MIN_WINDOWS: usize = 5;

/// Fits a device's arrivals; its counter is unwrapped already. Of a device whose clock began anew the longest piece counts.
///
/// # Errors
/// Fewer than five seconds of samples.
pub fn fit_clock(arrivals: &Arrivals) -> Result<ClockFit, SyncError> {
    let piece = arrivals.longest();
    let windows = piece.windows();
    let few = |found| SyncError::TooFew { what: "seconds of device time with arrivals", found, needed: MIN_WINDOWS };
    let (first, last) = piece.ends().ok_or(few(0))?;
    if windows.len() < MIN_WINDOWS {
        return Err(few(windows.len()));
    }
    // Relative to the first sample, so that doubles are exact enough; the common rate of 1 is taken out.
    let point = |(device, arrival): (i64, i64)| {
        let device = device - first.0;
        (device as f64, (arrival - first.1 - device) as f64)
    };
    let points: Vec<(f64, f64)> = windows.iter().map(|window| point(window.earliest)).collect();
    let drift = median_slope(&points);
    let above = |(x, y): (f64, f64)| y - drift * x;
    let mut offsets: Vec<f64> = points.iter().copied().map(above).collect();
    let offset = median_in_place(&mut offsets).unwrap_or(0.0);
    let mut deviations: Vec<f64> = points.iter().copied().map(|p| (above(p) - offset).abs()).collect();
    let spread = median_in_place(&mut deviations).unwrap_or(0.0);
    let mut delays: Vec<f64> = windows.iter().map(|window| above(point(window.typical)) - offset).collect();
    let latest = windows.iter().map(|window| above(point(window.latest)) - offset);
    Ok(ClockFit {
        origin_ns: first.0,
        host_at_origin_ns: first.1 + offset.round() as i64,
        drift_ppm: drift * 1e6,
        residual_ns: 1.4826 * spread,
        delay_p50_ns: median_in_place(&mut delays).unwrap_or(0.0),
        delay_max_ns: latest.fold(0.0, slam_math::float::max),
        samples: piece.samples(),
        span_s: (last.0 - first.0) as f64 * 1e-9,
    })
}

/// By how much the shortest transport may have changed from the first to the last second unseen, nanoseconds: a twentieth
/// of a millisecond, the spread of the earliest arrivals of a camera on a busy computer.
const UNSEEN_NS: f64 = 50_000.0;

/// Standard deviation of a fitted drift, seconds a second: that of a line through one point a second, and what no spread
/// shows.
pub(super) fn drift_sigma(fit: &ClockFit) -> f64 {
    let span_ns = slam_math::float::max(fit.span_s, 1.0) * 1e9;
    let windows = span_ns * 1e-9;
    let line = fit.residual_ns * (12.0 / windows).sqrt() / span_ns;
    let unseen = UNSEEN_NS / span_ns;
    (line * line + unseen * unseen).sqrt()
}

fn median_slope(points: &[(f64, f64)]) -> f64 {
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[i + 1..].iter().map(move |b| (a, b)));
    let mut slopes: Vec<f64> = pairs.filter(|(a, b)| b.0 > a.0).map(|(a, b)| (b.1 - a.1) / (b.0 - a.0)).collect();
    median_in_place(&mut slopes).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::Rng;
    use slam_math::float::ln;

    /// 30 Hz for `seconds`, transport of 4 ms plus exponential jitter of 2 ms, and a stall of 80 ms now and then.
    fn arrivals(drift_ppm: f64, seconds: i64) -> Vec<(i64, i64)> {
        let mut rng = Rng::at(5, 0, 0, 0);
        let sample = |i: i64| {
            let device = 7_000_000_000 + i * 33_333_333;
            let host = 900_000_000_000 + ((device as f64) * (1.0 + drift_ppm * 1e-6)) as i64;
            let jitter = -2e6 * ln(1.0 - rng.uniform());
            let stall = if i % 200 < 8 { 80e6 } else { 0.0 };
            (device, host + 4_000_000 + (jitter + stall) as i64)
        };
        (0..seconds * 30).map(sample).collect()
    }

    fn fit(samples: Vec<(i64, i64)>) -> Result<ClockFit, SyncError> {
        fit_clock(&samples.into_iter().collect())
    }

    #[test]
    fn drift_is_found_to_two_parts_per_million() {
        for drift_ppm in [-35.0, 0.0, 20.0] {
            let fit = fit(arrivals(drift_ppm, 120)).unwrap();
            assert!((fit.drift_ppm - drift_ppm).abs() < 2.0, "{fit:?}");
            // The envelope lies a transport of 4 ms above the true relation, within the windows' own jitter.
            let truth = 900_000_000_000 + (7_000_000_000f64 * (1.0 + drift_ppm * 1e-6)) as i64 + 4_000_000;
            assert!((fit.host_ns(7_000_000_000) - truth).abs() < 300_000, "{fit:?}");
            assert!(fit.delay_max_ns > 79e6 && fit.delay_p50_ns < 3e6, "{fit:?}");
        }
    }

    #[test]
    fn a_clock_that_began_anew_is_another_one() {
        let (short, long) = (arrivals(0.0, 20), arrivals(20.0, 60));
        // The device was reset after 20 s and counts from its beginning again, 30 s later.
        let later = long.iter().map(|(device, host)| (device - 7_000_000_000, host + 30_000_000_000));
        let both: Vec<(i64, i64)> = short.into_iter().chain(later).collect();
        let fit = fit(both).unwrap();
        assert!((fit.drift_ppm - 20.0).abs() < 4.0 && fit.samples == long.len(), "{fit:?}");
        assert!(fit.covers(1_000_000_000) && !fit.covers(fit.origin_ns - 1) && !fit.covers(61_000_000_000));
    }

    #[test]
    fn hours_are_fitted_as_well_as_minutes() {
        let found = fit(arrivals(20.0, 3 * 3600)).unwrap();
        assert!((found.drift_ppm - 20.0).abs() < 0.1 && found.span_s > 10_799.0, "{found:?}");
        assert!(found.residual_ns < 300_000.0 && found.delay_max_ns > 79e6 && found.delay_p50_ns < 3e6, "{found:?}");
    }

    #[test]
    fn little_is_refused() {
        assert!(matches!(fit(arrivals(10.0, 3)), Err(SyncError::TooFew { found: 3, .. })));
        assert!(fit(Vec::new()).is_err());
    }
}
