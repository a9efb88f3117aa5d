//! Bundle adjustment: poses and points together.
//!
//! Levenberg-Marquardt with the Schur complement: every point's 3x3 block is eliminated, the remaining system over the free
//! poses is factored by blocks of 6x6 in the poses' order, and the points follow by substitution. Every sum runs in an
//! order that comes from the sorted observations: neither the order of the input nor the number of threads shows in the
//! result. The reduced system is dense: 144 bytes times the square of the number of free poses.

mod cholesky;
mod layout;
mod linear;
mod reduced;
mod solver;

use nalgebra::Vector3;
use slam_math::{Buffer, Buffers, Se3};

use crate::camera::{Measurement, Pinhole};
use solver::Solver;

/// A camera of the problem.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaPose {
    /// The estimate.
    pub camera_from_world: Se3,
    /// Held as it is. When no pose is fixed, the first one is held.
    pub fixed: bool,
}

/// Point number `point` was seen by camera number `pose`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaObservation {
    /// Index into [`BaProblem::poses`].
    pub pose: u32,
    /// Index into [`BaProblem::points`].
    pub point: u32,
    /// Where it was seen.
    pub measurement: Measurement,
}

/// Poses, points and what ties them. [`bundle_adjust`] changes poses and points in place.
#[derive(Debug, Clone, PartialEq)]
pub struct BaProblem {
    /// Intrinsics, the same for every camera.
    pub camera: Pinhole,
    /// Virtual baseline times fx, metres * pixels.
    pub bf: f64,
    /// The cameras.
    pub poses: Buffer<BaPose>,
    /// World coordinates, metres.
    pub points: Buffer<Vector3<f64>>,
    /// In any order.
    pub observations: Buffer<BaObservation>,
}

/// Schedule and gates of [`bundle_adjust`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaOptions {
    /// Optimisations, each followed by a new choice of inliers among all observations.
    pub rounds: u32,
    /// The first so many rounds use Huber's kernel, the others plain squares.
    pub robust_rounds: u32,
    /// Most linear solves in a round, accepted or not.
    pub iterations: u32,
    /// A round ends when the cost decreases by less than this share of itself.
    pub relative_decrease: f64,
    /// First factor on the diagonal.
    pub initial_damping: f64,
    /// Inlier gate without depth: 95 % of chi-square with two degrees of freedom.
    pub chi2_mono: f64,
    /// Inlier gate with depth: 95 % of chi-square with three degrees of freedom.
    pub chi2_stereo: f64,
}

impl Default for BaOptions {
    /// ORB-SLAM3's gates and kernel (Campos et al. 2021), but in two rounds: what the first one shows to be an outlier
    /// does not pull at the second.
    fn default() -> Self {
        Self {
            rounds: 2,
            robust_rounds: 2,
            iterations: 10,
            relative_decrease: 1e-4,
            initial_damping: 1e-5,
            chi2_mono: 5.991,
            chi2_stereo: 7.815,
        }
    }
}

/// What [`bundle_adjust`] did.
#[derive(Debug, Clone, PartialEq)]
pub struct BaReport {
    /// Huber cost of all observations that could be seen at the start.
    pub initial_cost: f64,
    /// Huber cost of the same observations at the end; a point hidden since then counts as when it was last visible.
    pub final_cost: f64,
    /// Linear solves of all rounds.
    pub iterations: u32,
    /// How many of them gave a step that was taken.
    pub accepted: u32,
    /// Per observation, in the input's order: above its gate at the end, behind the camera, not usable, or naming a pose
    /// or point that is not there.
    pub outlier: Buffer<bool>,
}

/// Minimises the robust reprojection error over the free poses and all points that are observed.
pub fn bundle_adjust(problem: &mut BaProblem, options: &BaOptions, buffers: &Buffers) -> BaReport {
    let mut solver = Solver::new(problem, options, buffers);
    let initial_cost = solver.initial_cost();
    let mut round = 0;
    while round < options.rounds {
        let converged = solver.minimize(round < options.robust_rounds, options);
        let changed = solver.select_inliers();
        round += 1;
        if converged && !changed && round < options.robust_rounds {
            round = options.robust_rounds;
        }
    }
    solver.finish(problem, initial_cost)
}
