//! Pose of one camera from known points: robust Levenberg-Marquardt on SE(3).

use nalgebra::{Cholesky, Matrix6, Vector3, Vector6};
use slam_math::{Buffer, Buffers, Se3};

use crate::camera::{DepthCamera, Measurement, Pinhole, pose_gradient, pose_information};
use crate::levenberg::Damping;
use crate::robust::Gates;

/// Fewer observations than this can't fix a pose.
const MIN_OBSERVATIONS: usize = 3;

/// A known point and where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseObservation {
    /// Metres.
    pub point_in_world: Vector3<f64>,
    /// Where the camera saw it.
    pub measurement: Measurement,
}

/// Schedule and gates of [`optimize_pose`]. Defaults: ORB-SLAM3's numbers (Campos et al. 2021).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseOptions {
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

impl Default for PoseOptions {
    fn default() -> Self {
        Self {
            rounds: 4,
            robust_rounds: 3,
            iterations: 10,
            relative_decrease: 1e-5,
            initial_damping: 1e-5,
            chi2_mono: 5.991,
            chi2_stereo: 7.815,
        }
    }
}

/// What [`optimize_pose`] found.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseResult {
    /// The estimate; the initial pose when it could not be improved.
    pub camera_from_world: Se3,
    /// Per observation, at the estimate.
    pub inlier: Buffer<bool>,
    /// Squared normalised residual per observation, at the estimate; infinite for one that can't be seen or used.
    pub chi2: Buffer<f64>,
    /// Number of inliers.
    pub inliers: usize,
    /// Linear solves of all rounds.
    pub iterations: u32,
    /// The last round ended because the cost no longer changed. False: out of iterations, or too few observations.
    pub converged: bool,
    /// `J^T W J` of the inliers at the estimate, for `exp([translation, rotation]) * camera_from_world`: the inverse is
    /// the covariance (square metres, square radians).
    pub information: Matrix6<f64>,
}

/// Minimises the robust reprojection error over the pose.
///
/// `bf` is the virtual baseline times fx (metres * pixels). Every round starts where the last one ended; outliers of one
/// round may return in the next. Rounds that could change nothing (converged, same inliers, same kernel) are skipped.
#[must_use]
pub fn optimize_pose(
    camera: &Pinhole,
    bf: f64,
    observations: &[PoseObservation],
    initial_camera_from_world: &Se3,
    options: &PoseOptions,
    buffers: &Buffers,
) -> PoseResult {
    let gates = Gates { mono: options.chi2_mono, stereo: options.chi2_stereo };
    let mut solver = Solver {
        camera: DepthCamera { pinhole: *camera, bf },
        gates,
        observations,
        pose: *initial_camera_from_world,
        chi2: buffers.filled(observations.len(), f64::INFINITY),
        active: buffers.collect(observations.iter().map(|o| o.measurement.is_usable())),
        iterations: 0,
    };
    let mut converged = false;
    let mut round = 0;
    while round < options.rounds {
        converged = solver.minimize(round < options.robust_rounds, options);
        let changed = solver.select_inliers();
        round += 1;
        if converged && !changed && round < options.robust_rounds {
            round = options.robust_rounds;
        }
    }
    solver.pose = solver.pose.normalized();
    solver.select_inliers();
    solver.into_result(converged)
}

/// What observations say about a pose, linearised there.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseEquations {
    /// `J^T W J` with Huber's weights, for `exp([translation, rotation]) * camera_from_world`.
    pub information: Matrix6<f64>,
    /// `J^T W residual`: zero where the observations would have the camera stay.
    pub gradient: Vector6<f64>,
    /// Observations that can be seen from there.
    pub seen: usize,
}

/// The normal equations of a pose that is not to be changed, with Huber's kernel at the gates of `options`.
#[must_use]
pub fn pose_equations(
    camera: &Pinhole,
    bf: f64,
    observations: impl Iterator<Item = PoseObservation>,
    camera_from_world: &Se3,
    options: &PoseOptions,
) -> PoseEquations {
    let camera = DepthCamera { pinhole: *camera, bf };
    let gates = Gates { mono: options.chi2_mono, stereo: options.chi2_stereo };
    let mut sums = PoseEquations { information: Matrix6::zeros(), gradient: Vector6::zeros(), seen: 0 };
    for o in observations.filter(|o| o.measurement.is_usable()) {
        let x = camera_from_world.transform(&o.point_in_world);
        let Some(l) = camera.linearize(&x, &o.measurement) else { continue };
        let weight = gates.kernel(true, o.measurement.disparity.is_some()).weight(l.chi2);
        sums.information += pose_information(&(l.information * weight), &x);
        sums.gradient += pose_gradient(&(l.gradient * weight), &x);
        sums.seen += 1;
    }
    sums
}

struct Solver<'a> {
    camera: DepthCamera,
    gates: Gates,
    observations: &'a [PoseObservation],
    pose: Se3,
    /// Where the point was last visible. While a step hides it behind the camera it keeps that value, so that hiding
    /// neither pays nor blocks.
    chi2: Buffer<f64>,
    active: Buffer<bool>,
    iterations: u32,
}

impl Solver<'_> {
    /// One round; true when it converged.
    fn minimize(&mut self, robust: bool, options: &PoseOptions) -> bool {
        if self.leave_out_hidden() < MIN_OBSERVATIONS {
            return false;
        }
        let mut damping = Damping::new(options.initial_damping);
        let (mut cost, mut information, mut gradient) = self.normal_equations(robust);
        for _ in 0..options.iterations {
            self.iterations += 1;
            let mut damped = information;
            let mut scale = Vector6::zeros();
            for i in 0..6 {
                scale[i] = damping.of(information[(i, i)]);
                damped[(i, i)] += scale[i];
            }
            let Some(factor) = Cholesky::new(damped) else {
                damping.raise();
                continue;
            };
            let step = -factor.solve(&gradient);
            let trial = Se3::exp(&step) * self.pose;
            let predicted = step.dot(&(scale.component_mul(&step) - gradient));
            let verdict = damping.judge(cost, self.cost(&trial, robust), predicted, options.relative_decrease);
            if verdict.accepts() {
                self.pose = trial;
            }
            if verdict.stops() {
                return true;
            }
            if verdict.accepts() {
                (cost, information, gradient) = self.normal_equations(robust);
            }
        }
        false
    }

    /// Leaves observations that can't be seen at the current pose out of this round; returns how many remain.
    fn leave_out_hidden(&mut self) -> usize {
        for (i, o) in self.observations.iter().enumerate().filter(|(i, _)| self.active[*i]) {
            let chi2 = self.camera.chi2(&self.pose.transform(&o.point_in_world), &o.measurement);
            self.chi2[i] = chi2.unwrap_or(f64::INFINITY);
        }
        for (active, chi2) in self.active.iter_mut().zip(&self.chi2) {
            *active &= chi2.is_finite();
        }
        self.active.iter().filter(|a| **a).count()
    }

    fn normal_equations(&mut self, robust: bool) -> (f64, Matrix6<f64>, Vector6<f64>) {
        let (mut cost, mut information, mut gradient) = (0.0, Matrix6::zeros(), Vector6::zeros());
        for (i, o) in self.observations.iter().enumerate().filter(|(i, _)| self.active[*i]) {
            let kernel = self.gates.kernel(robust, o.measurement.disparity.is_some());
            let x = self.pose.transform(&o.point_in_world);
            if let Some(l) = self.camera.linearize(&x, &o.measurement) {
                let weight = kernel.weight(l.chi2);
                self.chi2[i] = l.chi2;
                information += pose_information(&(l.information * weight), &x);
                gradient += pose_gradient(&(l.gradient * weight), &x);
            }
            cost += kernel.cost(self.chi2[i]);
        }
        (cost, information, gradient)
    }

    fn cost(&self, pose: &Se3, robust: bool) -> f64 {
        let mut cost = 0.0;
        for (i, o) in self.observations.iter().enumerate().filter(|(i, _)| self.active[*i]) {
            let kernel = self.gates.kernel(robust, o.measurement.disparity.is_some());
            let chi2 = self.camera.chi2(&pose.transform(&o.point_in_world), &o.measurement);
            cost += kernel.cost(chi2.unwrap_or(self.chi2[i]));
        }
        cost
    }

    /// Classifies every observation at the current pose; true when a class changed.
    fn select_inliers(&mut self) -> bool {
        let mut changed = false;
        for (i, o) in self.observations.iter().enumerate() {
            let x = self.pose.transform(&o.point_in_world);
            let usable = o.measurement.is_usable();
            let chi2 = self.camera.chi2(&x, &o.measurement).filter(|_| usable).unwrap_or(f64::INFINITY);
            let inlier = chi2 <= self.gates.of(o.measurement.disparity.is_some());
            changed |= inlier != self.active[i];
            self.chi2[i] = chi2;
            self.active[i] = inlier;
        }
        changed
    }

    fn into_result(mut self, converged: bool) -> PoseResult {
        let (_, information, _) = self.normal_equations(false);
        PoseResult {
            camera_from_world: self.pose,
            inliers: self.active.iter().filter(|a| **a).count(),
            inlier: self.active,
            chi2: self.chi2,
            iterations: self.iterations,
            converged,
            information,
        }
    }
}
