//! How well a homography and a fundamental matrix explain the matches.

use nalgebra::Matrix3;
use slam_math::Rng;

use super::{CHI2_LINE, CHI2_PIXEL, TwoViewOptions};
use crate::fundamental::homography::{direct_linear, transfer_squared};
use crate::fundamental::{Match, epipolar_distance};
use crate::ransac::samples_needed;

/// Fits to all inliers after the best sample.
const REFITS: u32 = 3;

/// Squared normalised transfer errors, into the current image and back.
pub(super) fn chi2_homography(h: &Matrix3<f64>, m: &Match, variance: f64) -> [f64; 2] {
    let back = || h.try_inverse().map_or(f64::INFINITY, |inverse| transfer_squared(&inverse, &swapped(m)));
    [transfer_squared(h, m) / variance, back() / variance]
}

fn swapped(m: &Match) -> Match {
    Match { last: m.current, current: m.last }
}

/// The paper's score (section IV, equation 2): errors below the gate add what is left to the gate of a pixel, in both
/// images.
pub(super) fn score_homography(h: &Matrix3<f64>, matches: &[Match], variance: f64) -> f64 {
    let Some(back) = h.try_inverse() else { return 0.0 };
    let mut score = 0.0;
    for m in matches {
        for squared in [transfer_squared(h, m), transfer_squared(&back, &swapped(m))] {
            let chi2 = squared / variance;
            score += if chi2 < CHI2_PIXEL { CHI2_PIXEL - chi2 } else { 0.0 };
        }
    }
    score
}

/// The same for a fundamental matrix: the gate is that of a line, the reward that of a pixel, so that both models score
/// alike where both fit.
pub(super) fn score_fundamental(f: &Matrix3<f64>, matches: &[Match], variance: f64) -> f64 {
    let back = f.transpose();
    let mut score = 0.0;
    for m in matches {
        for distance in [epipolar_distance(f, m.last, m.current), epipolar_distance(&back, m.current, m.last)] {
            let chi2 = distance * distance / variance;
            score += if chi2 < CHI2_LINE { CHI2_PIXEL - chi2 } else { 0.0 };
        }
    }
    score
}

/// The homography with the best score, `current ~ H last`; `None` when no sample gives one.
pub(super) fn homography_ransac(rng: &mut Rng, matches: &[Match], options: &TwoViewOptions) -> Option<Matrix3<f64>> {
    let variance = options.sigma_px * options.sigma_px;
    let agrees = |h: &Matrix3<f64>| {
        let near = |m: &&Match| transfer_squared(h, m) <= CHI2_PIXEL * variance;
        matches.iter().filter(near).copied().collect::<Vec<Match>>()
    };
    let mut best: Option<(Matrix3<f64>, f64)> = None;
    let (mut needed, mut drawn) = (options.max_iterations, 0);
    while drawn < needed {
        drawn += 1;
        let sample = rng.sample::<4>(matches.len())?.map(|i| matches[i]);
        let Some(h) = direct_linear(&sample) else { continue };
        let score = score_homography(&h, matches, variance);
        if score > best.as_ref().map_or(0.0, |(_, best)| *best) {
            let share = agrees(&h).len() as f64 / matches.len() as f64;
            needed = samples_needed(share, 4, options.confidence, options.max_iterations);
            best = Some((h, score));
        }
    }
    let mut best = best?;
    for _ in 0..REFITS {
        let Some(h) = direct_linear(&agrees(&best.0)) else { break };
        let score = score_homography(&h, matches, variance);
        if score > best.1 {
            best = (h, score);
        }
    }
    Some(best.0)
}
