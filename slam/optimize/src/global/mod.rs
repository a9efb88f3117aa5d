//! Global bundle adjustment: all keyframes and points of a map together.
//!
//! The same problem and cost as [`bundle_adjust`](crate::bundle_adjust), made for long chains: the points are eliminated
//! one after the other (Schur complement; Triggs et al. 2000, "Bundle Adjustment - A Modern Synthesis", section 6), and the
//! system over the poses, which has a block only where two cameras see a common point, is factored by
//! [`SparseCholesky`]. Nothing is stored per observation but an index, a flag and a number: what
//! is linearised is thrown away and formed again for the points. Time and memory grow about linearly with the number of
//! keyframes as long as each shares points with a bounded number of others.
//!
//! The gauge is explicit. Every connected part needs a fixed pose, and it is an error when one has none. Where a part has
//! a single fixed centre and no disparity, its scale is free too: damping keeps the solver from running along it, and at
//! the end the part is scaled about its fixed centre so that the camera that was farthest from it keeps its distance.

mod layout;
mod normal;
mod scale;

use nalgebra::Vector3;
use slam_math::{Se3, par};

use crate::bundle::{BaOptions, BaProblem, BaReport};
use crate::camera::DepthCamera;
use crate::levenberg::{Budget, Damping, Trial, minimize};
use crate::robust::Gates;
use crate::sparse::SparseCholesky;
use layout::Layout;
use normal::Normal;

/// What [`global_bundle_adjust`] did.
#[derive(Debug, Clone, PartialEq)]
pub struct GlobalBaReport {
    /// As for a local one.
    pub ba: BaReport,
    /// Blocks of 6x6 in the factor of the reduced system.
    pub factor_blocks: usize,
    /// How many of them the reduced system does not have.
    pub fill_in: usize,
    /// Poses whose distance from the fixed centre of their part was kept, because nothing else fixes its scale. Ascending.
    pub scale_kept_at: Vec<usize>,
}

/// A part of the problem could move as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("pose {pose} and what it sees is tied to no fixed pose: fix one of them or leave them out")]
pub struct LoosePose {
    /// The part's smallest pose.
    pub pose: usize,
}

/// Estimate of all poses and points.
#[derive(Clone)]
struct State {
    poses: Vec<Se3>,
    points: Vec<Vector3<f64>>,
}

/// The problem without its estimate, and which observations take part.
struct Model<'a> {
    problem: &'a BaProblem,
    layout: Layout,
    camera: DepthCamera,
    gates: Gates,
    /// Per observation in the layout's order: takes part in the round.
    active: Vec<bool>,
    /// Squared normalised residual at the start of the last round where it could be seen, infinite before. A step that hides
    /// a point leaves it at that, so that hiding neither pays nor blocks.
    last_seen: Vec<f64>,
    robust: bool,
}

/// Minimises the robust reprojection error over the free poses and all points that are observed.
///
/// # Errors
/// When a pose is tied to no fixed one by observations that can be seen at the start. The problem is then as it was.
pub fn global_bundle_adjust(problem: &mut BaProblem, options: &BaOptions) -> Result<GlobalBaReport, LoosePose> {
    let mut state =
        State { poses: problem.poses.iter().map(|p| p.camera_from_world).collect(), points: problem.points.to_vec() };
    let mut model = Model::new(problem, &state, options);
    let parts = scale::parts(problem, &model)?;
    let counted = model.active.clone();
    let initial_cost = model.cost(&state);
    let mut factor = SparseCholesky::new(&model.layout.pattern);
    let (mut iterations, mut accepted, mut round) = (0, 0, 0);
    while round < options.rounds {
        model.robust = round < options.robust_rounds;
        let outcome = model.minimize(&mut state, &mut factor, options);
        iterations += outcome.iterations;
        accepted += outcome.accepted;
        let changed = model.select_inliers(&state);
        round += 1;
        if outcome.converged && !changed && round < options.robust_rounds {
            round = options.robust_rounds;
        }
    }
    for &pose in &model.layout.free_poses {
        state.poses[pose as usize] = state.poses[pose as usize].normalized();
    }
    let scale_kept_at = scale::restore(&parts, problem, &mut state);
    let outlier = model.outliers();
    (model.active, model.robust) = (counted, true);
    let final_cost = model.cost(&state);
    let ba = BaReport { initial_cost, final_cost, iterations, accepted, outlier: outlier.into() };
    for (pose, camera_from_world) in problem.poses.iter_mut().zip(state.poses) {
        pose.camera_from_world = camera_from_world;
    }
    problem.points = state.points.into();
    Ok(GlobalBaReport { ba, factor_blocks: factor.blocks(), fill_in: factor.fill_in(), scale_kept_at })
}

impl<'a> Model<'a> {
    fn new(problem: &'a BaProblem, state: &State, options: &BaOptions) -> Self {
        let mut model = Self {
            problem,
            layout: Layout::new(problem),
            camera: DepthCamera { pinhole: problem.camera, bf: problem.bf },
            gates: Gates { mono: options.chi2_mono, stereo: options.chi2_stereo },
            active: Vec::new(),
            last_seen: Vec::new(),
            robust: true,
        };
        model.last_seen = model.chi2(state);
        model.active = model.last_seen.iter().map(|chi2| chi2.is_finite()).collect();
        model
    }

    fn minimize(
        &mut self,
        state: &mut State,
        factor: &mut SparseCholesky<6>,
        options: &BaOptions,
    ) -> crate::levenberg::Outcome {
        for (at, chi2) in self.chi2(state).into_iter().enumerate() {
            self.active[at] &= chi2.is_finite();
            self.last_seen[at] = if chi2.is_finite() { chi2 } else { self.last_seen[at] };
        }
        let budget = Budget {
            iterations: options.iterations,
            relative_decrease: options.relative_decrease,
            initial_damping: options.initial_damping,
        };
        let cost = self.cost(state);
        let mut normal = Normal::new(&self.layout.pattern);
        // Nothing is kept between trials: the linearisation is larger than the time it takes.
        minimize(state, cost, budget, |_| (), |state, (), damping| self.trial(state, &mut normal, factor, damping))
    }

    fn trial(
        &self,
        state: &State,
        normal: &mut Normal,
        factor: &mut SparseCholesky<6>,
        damping: &Damping,
    ) -> Option<Trial<State>> {
        normal.build(self, state, damping);
        factor.factor(&normal.matrix).ok()?;
        let steps = factor.solve(&normal.right);
        let mut predicted = normal.predicted(&steps, damping);
        let mut trial = state.clone();
        for (&pose, step) in self.layout.free_poses.iter().zip(&steps) {
            trial.poses[pose as usize] = Se3::exp(step) * trial.poses[pose as usize];
        }
        predicted += normal::move_points(self, state, &steps, damping, &mut trial.points);
        let cost = self.cost(&trial);
        Some(Trial { state: trial, cost, predicted })
    }

    /// Squared normalised residuals in the layout's order, infinite where a point can't be seen.
    fn chi2(&self, state: &State) -> Vec<f64> {
        let chunk = |_: usize, points: &std::ops::Range<usize>| {
            let mut out = Vec::new();
            for point in points.clone() {
                for at in self.layout.of_point(point) {
                    let o = &self.problem.observations[self.layout.order[at] as usize];
                    let x = state.poses[o.pose as usize].transform(&state.points[point]);
                    out.push(self.camera.chi2(&x, &o.measurement).unwrap_or(f64::INFINITY));
                }
            }
            out
        };
        par::ordered_map(&self.layout.chunks, chunk).concat()
    }

    /// Sum of the kernel over the active observations.
    fn cost(&self, state: &State) -> f64 {
        let mut cost = 0.0;
        for (at, now) in self.chi2(state).into_iter().enumerate().filter(|(at, _)| self.active[*at]) {
            let stereo = self.problem.observations[self.layout.order[at] as usize].measurement.disparity.is_some();
            let chi2 = if now.is_finite() { now } else { self.last_seen[at] };
            cost += self.gates.kernel(self.robust, stereo).cost(chi2);
        }
        cost
    }

    /// Classifies every observation at the current estimate; true when a class changed.
    fn select_inliers(&mut self, state: &State) -> bool {
        let mut changed = false;
        for (at, chi2) in self.chi2(state).into_iter().enumerate() {
            let stereo = self.problem.observations[self.layout.order[at] as usize].measurement.disparity.is_some();
            let inlier = chi2 <= self.gates.of(stereo);
            changed |= inlier != self.active[at];
            self.active[at] = inlier;
        }
        changed
    }

    /// In the input's order.
    fn outliers(&self) -> Vec<bool> {
        let mut outlier = vec![true; self.problem.observations.len()];
        for (&index, active) in self.layout.order.iter().zip(&self.active) {
            outlier[index as usize] = !active;
        }
        outlier
    }
}
