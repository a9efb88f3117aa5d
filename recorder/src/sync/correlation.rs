//! The coarse offset: where the norms of two angular velocities agree best. Norms need no rotation between the frames.

use super::AngularVelocity;

/// The peak of a correlation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// Lag to add to the second signal's time, seconds.
    pub lag_s: f64,
    /// Correlation coefficient there, -1..=1.
    pub correlation: f64,
    /// The best coefficient more than [`APART_S`] from the peak: how unique it is.
    pub rival: f64,
}

/// A second peak nearer than this belongs to the first.
const APART_S: f64 = 0.1;

/// Steps of the grid: a millisecond, as the peak is refined by a parabola; long recordings take four.
pub fn grid_step_s(span_s: f64) -> f64 {
    if span_s <= 600.0 { 0.001 } else { 0.004 }
}

/// Norm of a signal on a regular grid from `start_s`; NaN where it is not known.
pub fn norms(signal: &AngularVelocity, start_s: f64, step_s: f64, count: usize) -> Vec<f64> {
    (0..count).map(|i| signal.at(start_s + i as f64 * step_s).map_or(f64::NAN, |(v, _)| v.norm())).collect()
}

/// The best lag of up to `max_lag` steps either way by which `b` must move to fit `a`; both on one grid. `None` when no
/// lag has a tenth of the known samples in common.
pub fn best_lag(a: &[f64], b: &[f64], max_lag: usize, step_s: f64) -> Option<Peak> {
    let known = |values: &[f64]| values.iter().filter(|value| !value.is_nan()).count();
    let needed = (known(a).min(known(b)) / 10).max(10);
    let lags = -(max_lag as i64)..=max_lag as i64;
    let scores: Vec<(i64, f64)> =
        lags.filter_map(|lag| coefficient(a, b, lag, needed).map(|score| (lag, score))).collect();
    // The first of equal peaks, so that the result does not hang on the order of comparison.
    let best = scores.iter().enumerate().fold(None, |best: Option<(usize, f64)>, (i, (_, score))| match best {
        Some((_, top)) if *score <= top => best,
        _ => Some((i, *score)),
    });
    let (at, correlation) = best?;
    let lag = scores[at].0;
    let neighbours = at.checked_sub(1).and_then(|before| Some((scores.get(before)?.1, scores.get(at + 1)?.1)));
    let vertex = neighbours.map_or(0.0, |(before, after)| {
        let curvature = before - 2.0 * correlation + after;
        if curvature < 0.0 { (0.5 * (before - after) / curvature).clamp(-0.5, 0.5) } else { 0.0 }
    });
    let apart = (APART_S / step_s) as i64;
    let rivals = scores.iter().filter(|(other, _)| (other - lag).abs() > apart).map(|(_, score)| *score);
    Some(Peak { lag_s: (lag as f64 + vertex) * step_s, correlation, rival: rivals.fold(-1.0, slam_math::float::max) })
}

/// Correlation coefficient of `a[i]` and `b[i - lag]` where both are known.
fn coefficient(a: &[f64], b: &[f64], lag: i64, needed: usize) -> Option<f64> {
    let from = lag.max(0) as usize;
    let to = (a.len() as i64).min(b.len() as i64 + lag);
    if to <= from as i64 {
        return None;
    }
    let a = &a[from..to as usize];
    let b = &b[(from as i64 - lag) as usize..];
    let (mut n, mut sums) = (0usize, [0.0; 5]);
    for (x, y) in a.iter().zip(b).filter(|(x, y)| !x.is_nan() && !y.is_nan()) {
        n += 1;
        for (sum, term) in sums.iter_mut().zip([*x, *y, x * x, y * y, x * y]) {
            *sum += term;
        }
    }
    if n < needed {
        return None;
    }
    let [x, y, xx, yy, xy] = sums.map(|sum| sum / n as f64);
    let spread = ((xx - x * x) * (yy - y * y)).sqrt();
    (spread > 0.0).then(|| (xy - x * y) / spread)
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::float::sin;

    fn wave(t: f64) -> f64 {
        sin(3.0 * t) + 0.7 * sin(7.3 * t) + 0.4 * sin(11.9 * t)
    }

    #[test]
    fn a_shift_is_found_between_the_steps_of_the_grid() {
        let sampled = |shift: f64| -> Vec<f64> { (0..4000).map(|i| wave(i as f64 * 0.002 + shift)).collect() };
        for shift in [-0.2131, 0.0, 0.0373] {
            let mut b = sampled(shift);
            b[1000..1200].fill(f64::NAN);
            let peak = best_lag(&sampled(0.0), &b, 250, 0.002).unwrap();
            assert!((peak.lag_s - shift).abs() < 1e-4, "{shift}: {peak:?}");
            assert!(peak.correlation > 0.999 && peak.rival < peak.correlation);
        }
    }

    #[test]
    fn nothing_in_common_is_no_peak() {
        assert!(best_lag(&[f64::NAN; 100], &[1.0; 100], 10, 0.001).is_none());
        assert!(best_lag(&[], &[], 10, 0.001).is_none());
        assert!(best_lag(&[1.0; 100], &[1.0; 100], 10, 0.001).is_none(), "a constant has no correlation");
    }
}
