//! Two views of one camera without depth: where the second one stands, and points. The start of a monocular map.
//!
//! Mur-Artal, Montiel and Tardos 2015 ("ORB-SLAM", T-RO 31(5)), section IV: a homography and a fundamental matrix are
//! fitted side by side; the one that explains the matches better is taken apart into candidate motions; the candidate with
//! clearly the most points in front of both cameras wins; bundle adjustment of the pair ends it. Everything that is not
//! certain is refused with a reason, so that a later frame can try again.

mod candidates;
mod model;

use nalgebra::Vector3;
use slam_math::{Buffer, Buffers, Rng, Se3, float};

use crate::bundle::{BaObservation, BaOptions, BaPose, BaProblem, bundle_adjust};
use crate::camera::{Measurement, Pinhole};
use crate::fundamental::{FundamentalOptions, Match, fundamental_ransac};
use crate::triangulate::triangulate;
use model::{chi2_homography, homography_ransac, score_fundamental, score_homography};

/// 95 % of chi-square with two degrees of freedom: the gate of a pixel.
const CHI2_PIXEL: f64 = 5.991;
/// 95 % of chi-square with one degree of freedom: the gate of a distance from a line.
const CHI2_LINE: f64 = 3.841;

/// Noise, budget and thresholds of [`two_view_reconstruction`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoViewOptions {
    /// Assumed standard deviation of a keypoint, pixels: 1 in the paper, about twice that of a corner. It has to be
    /// generous: with the true one the transfer errors, which hold the noise of both images, would use up a homography's
    /// score, and a plane's ratio would come out below `homography_ratio` (0.39 instead of 0.48).
    pub sigma_px: f64,
    /// Probability with which a sample without outliers is drawn before a search ends early.
    pub confidence: f64,
    /// Most samples for each of the two models.
    pub max_iterations: u32,
    /// `S_H / (S_H + S_F)` above which the homography is taken: 0.45 (the paper, section IV).
    pub homography_ratio: f64,
    /// The candidate in second place may have at most this share of the points of the best.
    pub second_best: f64,
    /// Fewer points are no map.
    pub min_points: usize,
    /// At least `min_points` points need this angle between their rays, radians. One degree: the depth of a point is then
    /// known to a tenth where a keypoint is known to a pixel in 500.
    pub min_parallax_rad: f64,
}

impl Default for TwoViewOptions {
    fn default() -> Self {
        Self {
            sigma_px: 1.0,
            confidence: 0.99,
            max_iterations: 300,
            homography_ratio: 0.45,
            second_best: 0.75,
            min_points: 50,
            min_parallax_rad: 1.0_f64.to_radians(),
        }
    }
}

/// Which model the motion was taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwoViewModel {
    /// A plane, or little parallax.
    Homography,
    /// A scene with depth.
    Fundamental,
}

/// The motion between two views, up to scale.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoViewReconstruction {
    /// Translation of length one: the unit of everything here is the distance of the cameras.
    pub second_from_first: Se3,
    /// Per match: the point in the first camera's frame. `None` for outliers and points with too little parallax.
    pub points_in_first: Vec<Option<Vector3<f64>>>,
    /// Number of points.
    pub points: usize,
    /// So large was the parallax of the `min_points`-th point, sorted by falling parallax, radians.
    pub parallax_rad: f64,
    /// Where the motion came from.
    pub model: TwoViewModel,
    /// `S_H / (S_H + S_F)`.
    pub homography_ratio: f64,
}

/// Why two views give no map. None of these is an error of the program: try with another frame.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TwoViewFailure {
    /// The slices differ in length.
    #[error("{first} pixels in the first view, {second} in the second: they are paired by position")]
    Unpaired {
        /// In the first view.
        first: usize,
        /// In the second view.
        second: usize,
    },
    /// Too few matches with finite pixels.
    #[error("{matches} usable matches, at least {needed} are needed")]
    TooFewMatches {
        /// Usable.
        matches: usize,
        /// `min_points`, at least 8.
        needed: usize,
    },
    /// Neither model is supported.
    #[error("neither a homography nor a fundamental matrix explains the matches")]
    NoModel,
    /// Two candidate motions explain the matches about equally well.
    #[error("two motions explain the matches, with {best} and {second} points")]
    Ambiguous {
        /// Points of the best.
        best: usize,
        /// Points of the one in second place.
        second: usize,
    },
    /// The best candidate has too few points.
    #[error("{points} points can be triangulated, at least {needed} are needed")]
    TooFewPoints {
        /// Points in front of both cameras with some parallax.
        points: usize,
        /// `min_points`.
        needed: usize,
    },
    /// The camera moved too little.
    #[error("parallax of {parallax_rad} rad, at least {needed_rad} are needed")]
    LowParallax {
        /// Of the `min_points`-th point.
        parallax_rad: f64,
        /// `min_parallax_rad`.
        needed_rad: f64,
    },
}

/// Motion and points of two views, from matches of undistorted pixels paired by position.
///
/// # Errors
/// When the views do not determine the motion, see [`TwoViewFailure`]. Pixels that are not finite are outliers.
pub fn two_view_reconstruction(
    rng: &mut Rng,
    camera: &Pinhole,
    pixels_first: &[[f64; 2]],
    pixels_second: &[[f64; 2]],
    options: &TwoViewOptions,
) -> Result<TwoViewReconstruction, TwoViewFailure> {
    let (first, second) = (pixels_first.len(), pixels_second.len());
    if first != second {
        return Err(TwoViewFailure::Unpaired { first, second });
    }
    let is_finite = |&i: &usize| pixels_first[i].iter().chain(&pixels_second[i]).all(|v| v.is_finite());
    let index: Vec<usize> = (0..first).filter(is_finite).collect();
    let matches: Vec<Match> =
        index.iter().map(|&i| Match { last: pixels_first[i], current: pixels_second[i] }).collect();
    let needed = options.min_points.max(8);
    if matches.len() < needed {
        return Err(TwoViewFailure::TooFewMatches { matches: matches.len(), needed });
    }
    let choice = choose_model(rng, camera, &matches, options)?;
    let best = best_candidate(camera, &matches, &choice, options)?;
    let mut found = adjust(camera, &matches, &best, options)?;
    let mut points_in_first = vec![None; first];
    for (&i, point) in index.iter().zip(std::mem::take(&mut found.points_in_first)) {
        points_in_first[i] = point;
    }
    let (model, homography_ratio) = (choice.model, choice.homography_ratio);
    Ok(TwoViewReconstruction { points_in_first, model, homography_ratio, ..found })
}

/// The model that explains the matches, as candidate motions.
struct Choice {
    model: TwoViewModel,
    homography_ratio: f64,
    candidates: Vec<Se3>,
    /// Matches that agree with the model.
    inlier: Vec<bool>,
}

fn choose_model(
    rng: &mut Rng,
    camera: &Pinhole,
    matches: &[Match],
    options: &TwoViewOptions,
) -> Result<Choice, TwoViewFailure> {
    let variance = options.sigma_px * options.sigma_px;
    let homography = homography_ransac(rng, matches, options);
    let (last, current): (Vec<_>, Vec<_>) = matches.iter().map(|m| (m.last, m.current)).unzip();
    let epipolar = FundamentalOptions {
        threshold_px: (CHI2_LINE * variance).sqrt(),
        confidence: options.confidence,
        max_iterations: options.max_iterations,
        ..FundamentalOptions::default()
    };
    let fundamental = fundamental_ransac(rng, &last, &current, &epipolar);
    let by_homography = homography.as_ref().map_or(0.0, |h| score_homography(h, matches, variance));
    let by_fundamental = fundamental.as_ref().map_or(0.0, |f| score_fundamental(&f.matrix, matches, variance));
    let homography_ratio = by_homography / (by_homography + by_fundamental);
    match (homography, fundamental) {
        (Some(h), _) if homography_ratio > options.homography_ratio => {
            let agrees = |m: &Match| chi2_homography(&h, m, variance).iter().all(|chi2| *chi2 <= CHI2_PIXEL);
            let inlier = matches.iter().map(agrees).collect();
            let candidates = candidates::of_homography(&h, camera, matches);
            Ok(Choice { model: TwoViewModel::Homography, homography_ratio, candidates, inlier })
        }
        (_, Some(f)) if homography_ratio.is_finite() => {
            let candidates = candidates::of_fundamental(&f.matrix, camera);
            Ok(Choice { model: TwoViewModel::Fundamental, homography_ratio, candidates, inlier: f.inlier })
        }
        _ => Err(TwoViewFailure::NoModel),
    }
}

/// A candidate motion and the points that it makes of the matches.
struct Candidate {
    second_from_first: Se3,
    points: Vec<Option<Vector3<f64>>>,
    count: usize,
}

fn best_candidate(
    camera: &Pinhole,
    matches: &[Match],
    choice: &Choice,
    options: &TwoViewOptions,
) -> Result<Candidate, TwoViewFailure> {
    let mut found: Vec<Candidate> =
        choice.candidates.iter().map(|motion| reconstruct(camera, matches, &choice.inlier, motion, options)).collect();
    // Stable: the first of equal ones stays first.
    found.sort_by_key(|candidate| std::cmp::Reverse(candidate.count));
    let second = found.get(1).map_or(0, |candidate| candidate.count);
    let needed = options.min_points;
    let Some(best) = found.into_iter().next() else {
        return Err(TwoViewFailure::TooFewPoints { points: 0, needed });
    };
    if best.count < needed {
        return Err(TwoViewFailure::TooFewPoints { points: best.count, needed });
    }
    if second as f64 > options.second_best * best.count as f64 {
        return Err(TwoViewFailure::Ambiguous { best: best.count, second });
    }
    Ok(best)
}

/// Triangulates the inliers: in front of both cameras, reprojected within noise, and with more parallax than noise makes.
fn reconstruct(
    camera: &Pinhole,
    matches: &[Match],
    inlier: &[bool],
    second_from_first: &Se3,
    options: &TwoViewOptions,
) -> Candidate {
    let gate = CHI2_PIXEL * options.sigma_px * options.sigma_px;
    // Three standard deviations of the angle between two rays.
    let noise_rad = 3.0 * std::f64::consts::SQRT_2 * options.sigma_px / camera.fx;
    let near = |point: &Vector3<f64>, pixel: [f64; 2]| {
        let error = camera.project(point).map(|p| [p[0] - pixel[0], p[1] - pixel[1]]);
        error.is_some_and(|[u, v]| u * u + v * v <= gate)
    };
    let point = |m: &Match| {
        let rays = [camera.ray(m.last), camera.ray(m.current)];
        let point = triangulate(&Se3::identity(), second_from_first, rays[0], rays[1], noise_rad)?;
        (near(&point, m.last) && near(&second_from_first.transform(&point), m.current)).then_some(point)
    };
    let points: Vec<_> = matches.iter().zip(inlier).map(|(m, inlier)| inlier.then(|| point(m)).flatten()).collect();
    let count = points.iter().flatten().count();
    Candidate { second_from_first: *second_from_first, points, count }
}

/// Adjusts both views and the points, and judges what is left.
fn adjust(
    camera: &Pinhole,
    matches: &[Match],
    candidate: &Candidate,
    options: &TwoViewOptions,
) -> Result<TwoViewReconstruction, TwoViewFailure> {
    let seen: Vec<usize> = (0..matches.len()).filter(|&i| candidate.points[i].is_some()).collect();
    let weight = 1.0 / (options.sigma_px * options.sigma_px);
    let observation = |pose, point: usize, pixel| {
        let measurement = Measurement { pixel, disparity: None, weight, weight_disparity: 0.0 };
        BaObservation { pose, point: point as u32, measurement }
    };
    let both = |(point, &i): (usize, &usize)| {
        [(0, matches[i].last), (1, matches[i].current)].map(|(pose, pixel)| observation(pose, point, pixel))
    };
    let mut problem = BaProblem {
        camera: *camera,
        bf: 0.0,
        poses: Buffer::from(vec![
            BaPose { camera_from_world: Se3::identity(), fixed: true },
            BaPose { camera_from_world: candidate.second_from_first, fixed: false },
        ]),
        points: candidate.points.iter().flatten().copied().collect(),
        observations: seen.iter().enumerate().flat_map(both).collect(),
    };
    // The scale is free; damping holds it near one, and the unit is set again below.
    bundle_adjust(&mut problem, &BaOptions { iterations: 20, ..BaOptions::default() }, &Buffers::default());
    let mut motion = problem.poses[1].camera_from_world;
    let unit = 1.0 / motion.translation.norm();
    motion.translation *= unit;
    let mut inlier = vec![false; matches.len()];
    seen.iter().for_each(|&i| inlier[i] = true);
    let adjusted = reconstruct(camera, matches, &inlier, &motion, options);
    let (points, needed) = (adjusted.count, options.min_points);
    if points < needed || !motion.is_finite() {
        return Err(TwoViewFailure::TooFewPoints { points, needed });
    }
    let parallax_rad = nth_parallax(&adjusted, needed);
    if parallax_rad < options.min_parallax_rad {
        return Err(TwoViewFailure::LowParallax { parallax_rad, needed_rad: options.min_parallax_rad });
    }
    Ok(TwoViewReconstruction {
        second_from_first: motion,
        points_in_first: adjusted.points,
        points,
        parallax_rad,
        model: TwoViewModel::Fundamental,
        homography_ratio: 0.0,
    })
}

/// Angle at the `n`-th point by falling angle between the rays to both cameras.
fn nth_parallax(candidate: &Candidate, n: usize) -> f64 {
    let second = candidate.second_from_first.inverse().translation;
    let angle = |x: &Vector3<f64>| float::atan2(x.cross(&(x - second)).norm(), x.dot(&(x - second)));
    let mut angles: Vec<f64> = candidate.points.iter().flatten().map(angle).collect();
    angles.sort_by(|a, b| b.total_cmp(a));
    angles.get(n.saturating_sub(1)).copied().unwrap_or(0.0)
}
