//! Offset and drift between the camera's clock and the mocap's, from angular velocities.
//!
//! Both sides see the same rigid body turn. The norms of their angular velocities agree at one lag (coarse); then all
//! three axes are fitted with rotation, gyro bias, offset and drift (fine). The camera side is a gyroscope, or the
//! rotation of any visual odometry, with less accuracy.

use super::correlation::{Peak, best_lag, grid_step_s, norms};
use super::refine::{Drift, DriftPrior, Fit, Model, pairs, refine};
use super::{AngularVelocity, SyncError};
use nalgebra::{Matrix3, Vector3};
use schemas::sync::{Offset, WindowOffset};

/// How to look for the offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetOptions {
    /// Largest offset looked for either way, seconds.
    pub max_offset_s: f64,
    /// Length of the windows in which the offset is looked for again, seconds.
    pub window_s: f64,
    /// What the arrivals tell of the drift.
    pub drift: Option<DriftPrior>,
}

impl Default for OffsetOptions {
    fn default() -> Self {
        Self { max_offset_s: 0.5, window_s: 20.0, drift: None }
    }
}

/// Angular speed (root mean square about its mean) below which nothing can be told from noise, rad/s: five times the
/// noise of 0.05 degree poses over 60 ms.
const MIN_MOTION_RAD_S: f64 = 0.1;
/// Correlation below which the two signals are not of one body.
const MIN_CORRELATION: f64 = 0.6;
/// By how much the peak must rise above the second one.
const MIN_LEAD: f64 = 0.02;
/// Longest stretch in which the lag is looked for, seconds: 50 ppm of drift smear it by 30 ms.
const MAX_STRETCH_S: f64 = 600.0;
/// Longer recordings have longer stretches.
const MAX_STRETCHES: f64 = 100.0;
/// Common samples needed.
const MIN_SAMPLES: usize = 300;
/// Shorter recordings tell no drift by their turning: 10 s at an offset sigma of 0.1 ms leave 30 ppm.
const MIN_DRIFT_SPAN_S: f64 = 30.0;

/// Estimates the offset from the angular velocities of the camera side and of the marker body.
///
/// # Errors
/// Too little data or motion, or signals that do not belong together within the largest offset.
pub fn estimate_offset(
    camera: &AngularVelocity,
    mocap: &AngularVelocity,
    options: &OffsetOptions,
) -> Result<Offset, SyncError> {
    // The origins differ by a known whole number of nanoseconds; everything below is relative to them.
    let origins_s = super::seconds(mocap.origin_ns, camera.origin_ns);
    let mocap_here = AngularVelocity { time_s: mocap.time_s.iter().map(|t| t + origins_s).collect(), ..mocap.clone() };
    let whole = (mocap_here.time_s.first().copied().unwrap_or(0.0), mocap_here.end_s());
    let (piece, peak) = coarse(camera, &mocap_here, options)?;
    let middle_s = middle(piece);
    let start =
        Model { rotation: Matrix3::identity(), bias: Vector3::zeros(), offset_s: peak.lag_s, drift: 0.0, middle_s };
    let both = pairs(&cut(&mocap_here, piece), camera, &start);
    if both.len() < MIN_SAMPLES {
        return Err(SyncError::TooFew {
            what: "mocap samples during the recording",
            found: both.len(),
            needed: MIN_SAMPLES,
        });
    }
    let start = Model { rotation: rotation_between(&both), ..start };
    let fit = grow(&mocap_here, camera, start, piece, whole, options.drift);
    let fit = fit.ok_or(SyncError::NoAgreement {
        what: "clock offset",
        reason: "the angular velocities do not fit each other at any offset".to_owned(),
    })?;
    let to_ns = |mocap_s: f64| camera.origin_ns + (mocap_s * 1e9).round() as i64;
    let windows = windows(&mocap_here, camera, &fit, options);
    let windows = windows.into_iter().map(|(start_s, end_s, deviation_s, sigma_s)| WindowOffset {
        start_ns: to_ns(start_s),
        end_ns: to_ns(end_s),
        deviation_ns: deviation_s * 1e9,
        sigma_ns: sigma_s * 1e9,
    });
    let model = &fit.model;
    let turns: [f64; 9] = std::array::from_fn(|i| model.rotation[(i / 3, i % 3)]);
    Ok(Offset {
        reference_ns: to_ns(model.middle_s),
        offset_ns: (model.offset_s * 1e9).round() as i64,
        offset_sigma_ns: fit.offset_sigma_s * 1e9,
        drift_ppm: model.drift * 1e6,
        drift_sigma_ppm: fit.drift_sigma.is_finite().then_some(fit.drift_sigma * 1e6),
        correlation: peak.correlation,
        rival_correlation: peak.rival,
        residual_rad_s: fit.residual_rad_s,
        motion_rad_s: motion(&both),
        marker_from_sensor: turns,
        bias_rad_s: model.bias.into(),
        samples: fit.samples,
        windows: windows.collect(),
    })
}

/// Neighbouring samples that share their noise: those within the 60 ms of smoothing.
fn smoothing_samples(mocap: &AngularVelocity) -> f64 {
    let interval = (mocap.max_gap_s / 2.5).clamp(1e-4, 1.0);
    slam_math::float::max(0.06 / interval, 1.0)
}

/// First and last moment of a stretch of mocap time, seconds.
type Stretch = (f64, f64);

fn middle((from_s, to_s): Stretch) -> f64 {
    0.5 * (from_s + to_s)
}

/// The samples of a stretch.
fn cut(signal: &AngularVelocity, (from_s, to_s): Stretch) -> AngularVelocity {
    let from = signal.time_s.partition_point(|t| *t < from_s);
    let to = signal.time_s.partition_point(|t| *t <= to_s).max(from);
    let (time_s, rad_s) = (signal.time_s[from..to].to_vec(), signal.rad_s[from..to].to_vec());
    AngularVelocity { time_s, rad_s, ..*signal }
}

/// Fits a stretch, then one of twice the length about it, and so on up to the whole: two clocks that are an hour apart by
/// 100 ms are compared where they agree, and their drift leads on from there.
fn grow(
    mocap: &AngularVelocity,
    camera: &AngularVelocity,
    start: Model,
    stretch: Stretch,
    whole: Stretch,
    prior: Option<DriftPrior>,
) -> Option<Fit> {
    let window = smoothing_samples(mocap);
    let (mut stretch, mut model) = (stretch, start);
    loop {
        let length_s = stretch.1 - stretch.0;
        let middle_s = middle(stretch);
        let offset_s = model.offset_s + model.drift * (middle_s - model.middle_s);
        model = Model { offset_s, middle_s, ..model };
        let is_seen = prior.is_some() || length_s >= MIN_DRIFT_SPAN_S;
        let drift = if is_seen { Drift::Free(prior) } else { Drift::Fixed };
        let fit = refine(&cut(mocap, stretch), camera, model, window, drift)?;
        if stretch.0 <= whole.0 && stretch.1 >= whole.1 {
            return Some(fit);
        }
        model = fit.model;
        let (low, high) = (stretch.0 - 0.5 * length_s, stretch.1 + 0.5 * length_s);
        stretch = (slam_math::float::max(low, whole.0), slam_math::float::min(high, whole.1));
    }
}

/// The lag of the stretch in which it shows best.
fn coarse(
    camera: &AngularVelocity,
    mocap: &AngularVelocity,
    options: &OffsetOptions,
) -> Result<(Stretch, Peak), SyncError> {
    let (from_s, to_s) = (mocap.time_s.first().copied().unwrap_or(0.0), mocap.end_s());
    let count = ((to_s - from_s) / MAX_STRETCH_S).ceil().clamp(1.0, MAX_STRETCHES);
    let edge = |i: usize| if i as f64 == count { to_s } else { from_s + (to_s - from_s) * i as f64 / count };
    let mut best: Result<(Stretch, Peak), SyncError> =
        Err(SyncError::TooFew { what: "samples of the mocap", found: 0, needed: MIN_SAMPLES });
    for i in 0..count as usize {
        let stretch = (edge(i), edge(i + 1));
        let found = coarse_in(camera, &cut(mocap, stretch), options, grid_step_s(to_s - from_s));
        let lead = |peak: &Peak| peak.correlation - peak.rival;
        best = match (best, found) {
            (Ok(best), Ok(peak)) if lead(&peak) > lead(&best.1) => Ok((stretch, peak)),
            (Ok(best), _) => Ok(best),
            (Err(_), Ok(peak)) => Ok((stretch, peak)),
            (Err(error), Err(other)) => Err(if i == 0 { other } else { error }),
        };
    }
    best
}

fn coarse_in(
    camera: &AngularVelocity,
    mocap: &AngularVelocity,
    options: &OffsetOptions,
    step_s: f64,
) -> Result<Peak, SyncError> {
    let first_s = mocap.time_s.first().copied().unwrap_or(0.0);
    let start_s = first_s - options.max_offset_s;
    let count = ((mocap.end_s() + options.max_offset_s - start_s) / step_s) as usize + 1;
    let (a, b) = (norms(camera, start_s, step_s, count), norms(mocap, start_s, step_s, count));
    let motion_rad_s = spread(&b);
    if motion_rad_s < MIN_MOTION_RAD_S {
        return Err(SyncError::Unobservable {
            what: "clock offset",
            reason: format!("the turning varies by {motion_rad_s:.3} rad/s, {MIN_MOTION_RAD_S} are needed"),
            advice: "turn the camera briskly to and fro for some seconds at the beginning and the end",
        });
    }
    let peak = best_lag(&a, &b, (options.max_offset_s / step_s) as usize, step_s);
    let nothing = |reason: String| SyncError::NoAgreement { what: "clock offset", reason };
    let peak = peak.ok_or_else(|| nothing("the two recordings have no time in common".to_owned()))?;
    let at_edge = options.max_offset_s - peak.lag_s.abs() < 2.0 * step_s;
    let (found, rival) = (peak.correlation, peak.rival);
    if found < MIN_CORRELATION || found - rival < MIN_LEAD || at_edge {
        return Err(nothing(format!(
            "the best lag within +-{} s is {:.3} s with correlation {found:.3} (needed {MIN_CORRELATION}), the next best \
             has {rival:.3}: is it the right subject, and is the offset larger?",
            options.max_offset_s, peak.lag_s
        )));
    }
    Ok(peak)
}

/// Standard deviation of what is known.
fn spread(values: &[f64]) -> f64 {
    let known: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    let n = known.len().max(1) as f64;
    let mean = known.iter().fold(0.0, |a, b| a + b) / n;
    (known.iter().fold(0.0, |sum, v| sum + (v - mean) * (v - mean)) / n).sqrt()
}

fn motion(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> f64 {
    spread(&pairs.iter().map(|(mocap, _)| mocap.norm()).collect::<Vec<_>>())
}

/// Rotation that turns the second vectors onto the first ones, about their means (Kabsch): a bias does not count.
fn rotation_between(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Matrix3<f64> {
    let sum = pairs.iter().fold((Vector3::zeros(), Vector3::zeros()), |(a, b), pair| (a + pair.0, b + pair.1));
    let (first, second) = (sum.0 / pairs.len() as f64, sum.1 / pairs.len() as f64);
    let outer =
        pairs.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, (a, b)| sum + (a - first) * (b - second).transpose());
    super::hand_eye::nearest_rotation(&outer).unwrap_or_else(Matrix3::identity)
}

/// `(start, end, deviation, sigma)` of every window with enough samples, seconds.
fn windows(
    mocap: &AngularVelocity,
    camera: &AngularVelocity,
    fit: &Fit,
    options: &OffsetOptions,
) -> Vec<(f64, f64, f64, f64)> {
    let window = smoothing_samples(mocap);
    let mut out = Vec::new();
    let mut from = 0;
    while let Some(start_s) = mocap.time_s.get(from).copied() {
        let to = from + mocap.time_s[from..].partition_point(|t| *t < start_s + options.window_s);
        let piece = cut(mocap, (start_s, mocap.time_s[to - 1]));
        from = to;
        // Rotation and bias belong to the body, not to the piece; they start right and barely move.
        let Some(one) =
            refine(&piece, camera, fit.model, window, Drift::Fixed).filter(|one| one.samples >= MIN_SAMPLES)
        else {
            continue;
        };
        out.push((start_s, piece.end_s(), one.model.offset_s - fit.model.offset_s, one.offset_sigma_s));
    }
    out
}
