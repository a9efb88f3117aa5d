//! Is this the same place? The similarity, or the rigid motion, between two cameras that both know points in 3-D.
//!
//! RANSAC on three pairs of points and then Levenberg-Marquardt on the projections both ways: the points of the first
//! camera into the second image, those of the second into the first (Mur-Artal et al. 2015, "ORB-SLAM", section VII).
//! Projections say nothing about the scale where both cameras stand at the same place, so each pair's ratio of depths does
//! its part.

use nalgebra::{Cholesky, Matrix3, SMatrix, SVector, Vector3};
use slam_math::se3::skew;
use slam_math::{Rng, Sim3, float};

use crate::absolute::{AbsoluteOptions, similarity_ransac};
use crate::camera::{DepthCamera, Linearized, Measurement};
use crate::levenberg::{Budget, Damping, Trial, minimize};
use crate::robust::{Gates, Kernel};

/// Of ratios of depths: 95 % of chi-square with one degree of freedom.
const DEPTH_KERNEL: Kernel = Kernel::Huber { gate: 3.841 };
/// Optimisations of a similarity, each followed by a new choice of inliers.
const ROUNDS: u32 = 2;

/// A point that two cameras know, each in its own frame and in its own unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    /// In the first camera's frame.
    pub in_first: Vector3<f64>,
    /// In the second camera's frame.
    pub in_second: Vector3<f64>,
    /// Where the first camera saw it.
    pub seen_by_first: Measurement,
    /// Where the second camera saw it.
    pub seen_by_second: Measurement,
}

/// Budget and gates of [`find_similarity`] and [`refine_similarity`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimilarityOptions {
    /// The scale is one: depth was measured on both sides.
    pub fix_scale: bool,
    /// RANSAC: probability with which a sample without outliers is drawn before the search ends early.
    pub confidence: f64,
    /// RANSAC: most samples.
    pub max_iterations: u32,
    /// A similarity that fewer pairs agree with is no answer.
    pub min_inliers: usize,
    /// Most linear solves of each of the two rounds of the refinement.
    pub iterations: u32,
    /// A round ends when the cost decreases by less than this share of itself.
    pub relative_decrease: f64,
    /// Gate of each of the two projections: 99 % of chi-square with two degrees of freedom.
    pub chi2_mono: f64,
    /// The same where the measurement has a disparity: three degrees of freedom.
    pub chi2_stereo: f64,
    /// Where the scale is free: standard deviation of the logarithm of a pair's ratio of depths.
    pub log_depth_sigma: f64,
}

impl Default for SimilarityOptions {
    /// ORB-SLAM3's numbers (Campos et al. 2021). Depths: a point that two views show with a parallax of one degree, the least
    /// that a map starts with, is known to 1 px / (500 px * 0.0175 rad) = 11 %.
    fn default() -> Self {
        Self {
            fix_scale: false,
            confidence: 0.99,
            max_iterations: 300,
            min_inliers: 15,
            iterations: 10,
            relative_decrease: 1e-5,
            chi2_mono: 9.210,
            chi2_stereo: 11.345,
            log_depth_sigma: 0.11,
        }
    }
}

/// What pairs of points say about two cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct SimilarityResult {
    /// The estimate; scale 1 when it was fixed.
    pub second_from_first: Sim3,
    /// Per pair: both projections within their gates.
    pub inlier: Vec<bool>,
    /// Number of inliers.
    pub inliers: usize,
}

/// The similarity that most pairs agree with, refined. `None` when fewer than `min_inliers` agree.
#[must_use]
pub fn find_similarity(
    rng: &mut Rng,
    camera: &DepthCamera,
    pairs: &[PointPair],
    options: &SimilarityOptions,
) -> Option<SimilarityResult> {
    let problem = Problem::new(camera, pairs, options);
    let (first, second): (Vec<_>, Vec<_>) = pairs.iter().map(|p| (p.in_first, p.in_second)).unzip();
    let budget = AbsoluteOptions {
        confidence: options.confidence,
        max_iterations: options.max_iterations,
        min_inliers: options.min_inliers,
    };
    let agrees = |i: usize, motion: &Sim3| problem.agrees(&pairs[i], motion, &motion.inverse());
    let (motion, inlier) = similarity_ransac(rng, &first, &second, !options.fix_scale, agrees, &budget)?;
    Some(problem.refine(motion, inlier)).filter(|found| found.inliers >= options.min_inliers)
}

/// Minimises the robust reprojection error both ways, from a similarity that is about right and pairs that mostly are. Those
/// that don't agree with it at the start may come in later.
#[must_use]
pub fn refine_similarity(
    camera: &DepthCamera,
    pairs: &[PointPair],
    initial_second_from_first: &Sim3,
    options: &SimilarityOptions,
) -> SimilarityResult {
    let problem = Problem::new(camera, pairs, options);
    // All pairs that can be seen take part in the first round: the kernel bounds what the wrong ones do.
    let visible = problem.chi2(initial_second_from_first).iter().map(|c| c.is_some()).collect();
    problem.refine(*initial_second_from_first, visible)
}

/// Chi-square values of a pair: projected into the second camera, into the first, and the ratio of depths.
type Terms = [f64; 3];

struct Problem<'a> {
    camera: &'a DepthCamera,
    pairs: &'a [PointPair],
    options: &'a SimilarityOptions,
    gates: Gates,
}

impl<'a> Problem<'a> {
    fn new(camera: &'a DepthCamera, pairs: &'a [PointPair], options: &'a SimilarityOptions) -> Self {
        let gates = Gates { mono: options.chi2_mono, stereo: options.chi2_stereo };
        Self { camera, pairs, options, gates }
    }

    fn chi2_of(&self, pair: &PointPair, motion: &Sim3, back: &Sim3) -> Option<Terms> {
        let usable = pair.seen_by_first.is_usable() && pair.seen_by_second.is_usable();
        let in_second = motion.transform(&pair.in_first);
        let into_second = self.camera.chi2(&in_second, &pair.seen_by_second)?;
        let into_first = self.camera.chi2(&back.transform(&pair.in_second), &pair.seen_by_first)?;
        let depth = self.log_depth_ratio(&in_second, pair);
        usable.then_some([into_second, into_first, depth * depth])
    }

    /// By how much too far the second camera sees the point of the first, in sigmas; 0 when the scale is fixed.
    fn log_depth_ratio(&self, in_second: &Vector3<f64>, pair: &PointPair) -> f64 {
        let ratio = in_second[2] / pair.in_second[2];
        let is_free = !self.options.fix_scale && ratio > 0.0;
        if is_free { float::ln(ratio) / self.options.log_depth_sigma } else { 0.0 }
    }

    fn chi2(&self, motion: &Sim3) -> Vec<Option<Terms>> {
        let back = motion.inverse();
        self.pairs.iter().map(|pair| self.chi2_of(pair, motion, &back)).collect()
    }

    fn agrees(&self, pair: &PointPair, motion: &Sim3, back: &Sim3) -> bool {
        self.chi2_of(pair, motion, back).is_some_and(|[second, first, _]| {
            second <= self.gate(&pair.seen_by_second) && first <= self.gate(&pair.seen_by_first)
        })
    }

    fn gate(&self, measurement: &Measurement) -> f64 {
        self.gates.of(measurement.disparity.is_some())
    }

    fn refine(&self, mut motion: Sim3, mut active: Vec<bool>) -> SimilarityResult {
        for _ in 0..ROUNDS {
            self.minimize(&mut motion, &active);
            let back = motion.inverse();
            active = self.pairs.iter().map(|pair| self.agrees(pair, &motion, &back)).collect();
        }
        let inliers = active.iter().filter(|a| **a).count();
        SimilarityResult { second_from_first: motion, inlier: active, inliers }
    }

    fn minimize(&self, motion: &mut Sim3, active: &[bool]) {
        // A projection that a step hides keeps the value it had, so that hiding neither pays nor blocks.
        let start = self.chi2(motion);
        let active: Vec<usize> = (0..active.len()).filter(|&i| active[i] && start[i].is_some()).collect();
        let cost = |motion: &Sim3| {
            let back = motion.inverse();
            let mut cost = 0.0;
            for &i in &active {
                let pair = &self.pairs[i];
                let [second, first, depth] = self.chi2_of(pair, motion, &back).or(start[i]).unwrap_or_default();
                cost += self.kernel(&pair.seen_by_second).cost(second) + self.kernel(&pair.seen_by_first).cost(first);
                cost += DEPTH_KERNEL.cost(depth);
            }
            cost
        };
        let budget = Budget {
            iterations: self.options.iterations,
            relative_decrease: self.options.relative_decrease,
            initial_damping: 1e-5,
        };
        let initial_cost = cost(motion);
        let linearize = |motion: &Sim3| self.normal_equations(motion, &active);
        minimize(motion, initial_cost, budget, linearize, |motion, (information, gradient), damping: &Damping| {
            let scale = information.diagonal().map(|d| damping.of(d));
            let step = -Cholesky::new(information + SMatrix::from_diagonal(&scale))?.solve(gradient);
            let predicted = step.dot(&(scale.component_mul(&step) - gradient));
            let state = Sim3::exp(&step) * *motion;
            let state = Sim3 { se3: state.se3.normalized(), ..state };
            state.is_finite().then(|| Trial { state, cost: cost(&state), predicted })
        });
    }

    fn kernel(&self, measurement: &Measurement) -> Kernel {
        self.gates.kernel(true, measurement.disparity.is_some())
    }

    fn normal_equations(&self, motion: &Sim3, active: &[usize]) -> (SMatrix<f64, 7, 7>, SVector<f64, 7>) {
        let (mut information, mut gradient) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
        let back = motion.inverse();
        let mut add = |x: &Vector3<f64>, by_motion: &SMatrix<f64, 3, 7>, measurement: &Measurement| {
            if let Some(Linearized { chi2, information: m, gradient: g }) = self.camera.linearize(x, measurement) {
                let weight = self.kernel(measurement).weight(chi2);
                information += by_motion.transpose() * (m * weight) * by_motion;
                gradient += by_motion.transpose() * (g * weight);
            }
        };
        for pair in active.iter().map(|&i| &self.pairs[i]) {
            let x = motion.transform(&pair.in_first);
            add(&x, &by_left_step(&x), &pair.seen_by_second);
            let by_back = back.se3.rotation * -back.scale * by_left_step(&pair.in_second);
            add(&back.transform(&pair.in_second), &by_back, &pair.seen_by_first);
        }
        for pair in active.iter().map(|&i| &self.pairs[i]).filter(|_| !self.options.fix_scale) {
            let x = motion.transform(&pair.in_first);
            let residual = self.log_depth_ratio(&x, pair);
            let by_motion = by_left_step(&x).row(2).transpose() / (x[2] * self.options.log_depth_sigma);
            let weight = DEPTH_KERNEL.weight(residual * residual);
            information += by_motion * by_motion.transpose() * weight;
            gradient += by_motion * (residual * weight);
        }
        if self.options.fix_scale {
            information.row_mut(6).fill(0.0);
            information.column_mut(6).fill(0.0);
            (information[(6, 6)], gradient[6]) = (1.0, 0.0);
        }
        (information, gradient)
    }
}

/// Derivative of `exp(delta) x` by delta.
fn by_left_step(x: &Vector3<f64>) -> SMatrix<f64, 3, 7> {
    let mut out = SMatrix::<f64, 3, 7>::zeros();
    out.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
    out.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(x));
    out.fixed_view_mut::<3, 1>(0, 6).copy_from(x);
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Pinhole;

    #[test]
    fn the_gradient_equals_finite_differences() {
        let pinhole = Pinhole { fx: 535.4, fy: 539.2, cx: 320.1, cy: 247.6 };
        let camera = DepthCamera { pinhole, bf: 40.0 };
        let mut rng = Rng::at(1, 0, 0, 0);
        let motion = Sim3::exp(&SVector::from_fn(|_, _| 0.2 * rng.normal()));
        let pairs: Vec<PointPair> = (0..10)
            .map(|i| {
                let in_first = Vector3::new(rng.normal() * 0.3, rng.normal() * 0.3, 3.0 + rng.uniform());
                let in_second = motion.transform(&in_first);
                let mut seen = |x: &Vector3<f64>, weight| Measurement {
                    pixel: pinhole.project(x).unwrap().map(|v| v + rng.normal()),
                    disparity: (i % 2 == 0).then(|| 40.0 / x[2] + 0.1),
                    weight,
                    weight_disparity: 0.7,
                };
                let (seen_by_first, seen_by_second) = (seen(&in_first, 0.5), seen(&in_second, 0.8));
                PointPair { in_first, in_second, seen_by_first, seen_by_second }
            })
            .collect();
        let options = SimilarityOptions { chi2_mono: 1e9, chi2_stereo: 1e9, ..SimilarityOptions::default() };
        let problem = Problem::new(&camera, &pairs, &options);
        let all: Vec<usize> = (0..10).collect();
        let cost = |motion: &Sim3| {
            problem.chi2(motion).iter().flatten().map(|[a, b, c]| a + b + DEPTH_KERNEL.cost(*c)).sum::<f64>()
        };
        let (_, gradient) = problem.normal_equations(&motion, &all);
        for c in 0..7 {
            let mut step = SVector::<f64, 7>::zeros();
            step[c] = 1e-6;
            let numeric = (cost(&(Sim3::exp(&step) * motion)) - cost(&(Sim3::exp(&-step) * motion))) / 2e-6;
            assert!((numeric - 2.0 * gradient[c]).abs() < 1e-4 * (1.0 + numeric.abs()), "{c}: {numeric}");
        }
    }
}
