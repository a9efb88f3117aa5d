//! Two-view epipolar geometry with outliers.
//!
//! Seven-point samples, scored by the truncated Sampson error (MSAC: Torr and Zisserman 2000), every new best one
//! refined on the matches around it, and a test whether the views determine the geometry at all.

mod fit;
pub(crate) mod homography;
mod seven_point;

use nalgebra::{Matrix3, Vector3};
use slam_math::Rng;

use crate::ransac::samples_needed;

/// Widths of the bands of the refinements of one model, in thresholds.
const LOCAL_BANDS: [f64; 6] = [4.0, 3.0, 2.0, 1.5, 1.0, 1.0];
/// Seven matches always fit; fewer than eight support nothing.
const MIN_FIT: usize = 8;

/// Budget and thresholds of [`fundamental_ransac`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FundamentalOptions {
    /// Largest [`sampson_distance`] of an inlier, pixels: about two standard deviations of a keypoint.
    pub threshold_px: f64,
    /// Probability with which a sample without outliers is drawn before the search ends early.
    pub confidence: f64,
    /// Most samples.
    pub max_iterations: u32,
    /// The geometry is degenerate when one homography explains at least this share of the inliers.
    pub homography_share: f64,
}

impl Default for FundamentalOptions {
    fn default() -> Self {
        Self { threshold_px: 1.0, confidence: 0.99, max_iterations: 1000, homography_share: 0.9 }
    }
}

/// Epipolar geometry of two views.
#[derive(Debug, Clone, PartialEq)]
pub struct Fundamental {
    /// `x_current^T F x_last = 0` for homogeneous pixels; rank 2, unit Frobenius norm.
    pub matrix: Matrix3<f64>,
    /// Per match.
    pub inlier: Vec<bool>,
    /// Number of inliers.
    pub inliers: usize,
    /// A homography explains the inliers as well: the camera stood still, only turned, moved too little for the noise, or
    /// saw one plane. The epipolar lines then mean nothing off the inliers.
    pub degenerate: bool,
}

/// Estimates `F` from matches paired by position. `None` when fewer than eight matches are finite or no model is supported
/// by eight of them, or when the slices differ in length.
#[must_use]
pub fn fundamental_ransac(
    rng: &mut Rng,
    pixels_last: &[[f64; 2]],
    pixels_current: &[[f64; 2]],
    options: &FundamentalOptions,
) -> Option<Fundamental> {
    if pixels_last.len() != pixels_current.len() {
        return None;
    }
    let is_finite = |&i: &usize| pixels_last[i].iter().chain(&pixels_current[i]).all(|v| v.is_finite());
    let index: Vec<usize> = (0..pixels_last.len()).filter(is_finite).collect();
    let matches: Vec<Match> =
        index.iter().map(|&i| Match { last: pixels_last[i], current: pixels_current[i] }).collect();
    if matches.len() < MIN_FIT {
        return None;
    }
    let best = search(rng, &matches, options)?;
    let supported = inliers(&best.matrix, &matches, options.threshold_px);
    if supported.len() < MIN_FIT {
        return None;
    }
    let degenerate = homography::explains(&supported, options.threshold_px, options.homography_share);
    let mut inlier = vec![false; pixels_last.len()];
    for (&i, m) in index.iter().zip(&matches) {
        inlier[i] = is_inlier(&best.matrix, m, options.threshold_px);
    }
    Some(Fundamental { matrix: best.matrix, inlier, inliers: supported.len(), degenerate })
}

/// A point's pixel in both views.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Match {
    pub last: [f64; 2],
    pub current: [f64; 2],
}

struct Model {
    matrix: Matrix3<f64>,
    /// Sum of squared Sampson distances, each at most the squared threshold: lower is better.
    score: f64,
}

impl Model {
    fn new(matrix: Matrix3<f64>, matches: &[Match], threshold_px: f64) -> Self {
        let limit = threshold_px * threshold_px;
        let mut score = 0.0;
        for m in matches {
            let squared = sampson_squared(&matrix, m.last, m.current);
            score += if squared <= limit { squared } else { limit };
        }
        Self { matrix, score }
    }
}

fn search(rng: &mut Rng, matches: &[Match], options: &FundamentalOptions) -> Option<Model> {
    let threshold = options.threshold_px;
    let mut best: Option<Model> = None;
    let mut needed = options.max_iterations;
    let mut drawn = 0;
    while drawn < needed {
        drawn += 1;
        let sample = rng.sample::<7>(matches.len())?.map(|i| matches[i]);
        for matrix in seven_point::solve(&sample) {
            let model = Model::new(matrix, matches, threshold);
            if best.as_ref().is_some_and(|best| model.score >= best.score) {
                continue;
            }
            let model = refine(model, matches, threshold);
            let share = inliers(&model.matrix, matches, threshold).len() as f64 / matches.len() as f64;
            needed = samples_needed(share, 7, options.confidence, options.max_iterations);
            best = Some(model);
        }
    }
    best.map(|model| refine(model, matches, threshold))
}

/// Fits the matches around the model again, from a wide band down to the threshold: a minimal sample's model is off by more
/// than the noise, and its own inliers would hold it there. Returns the best of all.
fn refine(model: Model, matches: &[Match], threshold_px: f64) -> Model {
    let mut matrix = model.matrix;
    let mut best = model;
    for band in LOCAL_BANDS {
        let near = inliers(&matrix, matches, band * threshold_px);
        let Some(fitted) = fit::sampson_step(&matrix, &near) else { break };
        matrix = fitted;
        let model = Model::new(matrix, matches, threshold_px);
        if model.score < best.score {
            best = model;
        }
    }
    best
}

/// Matches within a Sampson distance, pixels.
fn inliers(matrix: &Matrix3<f64>, matches: &[Match], threshold_px: f64) -> Vec<Match> {
    matches.iter().filter(|m| is_inlier(matrix, m, threshold_px)).copied().collect()
}

/// The one rule, on squares: rounding would let roots differ from it at the threshold.
fn is_inlier(matrix: &Matrix3<f64>, m: &Match, threshold_px: f64) -> bool {
    sampson_squared(matrix, m.last, m.current) <= threshold_px * threshold_px
}

/// Distance of `current` from the epipolar line of `last`, pixels in the current image (the paper's equation 3, absolute).
/// Zero where there is no line, at the epipole; infinite when a number is not finite.
#[must_use]
pub fn epipolar_distance(f: &Matrix3<f64>, last: [f64; 2], current: [f64; 2]) -> f64 {
    let line = f * homogeneous(last);
    ratio(line.dot(&homogeneous(current)).abs(), (line[0] * line[0] + line[1] * line[1]).sqrt())
}

/// First-order distance of the match from the epipolar constraint, pixels, both images counted (Sampson's approximation).
/// Zero where the constraint is void, infinite when a number is not finite.
#[must_use]
pub fn sampson_distance(f: &Matrix3<f64>, last: [f64; 2], current: [f64; 2]) -> f64 {
    sampson_squared(f, last, current).sqrt()
}

fn sampson_squared(f: &Matrix3<f64>, last: [f64; 2], current: [f64; 2]) -> f64 {
    let error = (f * homogeneous(last)).dot(&homogeneous(current));
    ratio(error * error, gradient_squared(f, &Match { last, current }))
}

/// Squared gradient of `x_current^T F x_last` by the four coordinates.
fn gradient_squared(f: &Matrix3<f64>, m: &Match) -> f64 {
    let (a, b) = (f * homogeneous(m.last), f.tr_mul(&homogeneous(m.current)));
    a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1]
}

fn ratio(a: f64, b: f64) -> f64 {
    let quotient = if a == 0.0 && b == 0.0 { 0.0 } else { a / b };
    if quotient.is_finite() { quotient } else { f64::INFINITY }
}

pub(crate) fn homogeneous(pixel: [f64; 2]) -> Vector3<f64> {
    Vector3::new(pixel[0], pixel[1], 1.0)
}
