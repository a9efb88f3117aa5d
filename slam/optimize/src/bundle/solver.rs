//! The iteration: which step is tried, taken, and which observations take part.

use slam_math::{Buffer, Buffers, Se3};

use super::layout::Layout;
use super::linear::{Model, State};
use super::reduced::{self, Step};
use super::{BaOptions, BaProblem, BaReport};
use crate::camera::DepthCamera;
use crate::levenberg::Damping;
use crate::robust::Gates;

pub(super) struct Solver {
    model: Model,
    state: State,
    /// Per sorted observation: takes part in the round.
    active: Buffer<bool>,
    /// Per sorted observation: could be seen at the very start.
    counted: Buffer<bool>,
    /// Per sorted observation, where it was last visible. While a step hides a point it keeps that value, so that hiding
    /// neither pays nor blocks.
    chi2: Buffer<f64>,
    iterations: u32,
    accepted: u32,
}

impl Solver {
    pub fn new(problem: &BaProblem, options: &BaOptions, buffers: &Buffers) -> Self {
        let layout = Layout::new(problem, buffers);
        let model = Model {
            camera: DepthCamera { pinhole: problem.camera, bf: problem.bf },
            gates: Gates { mono: options.chi2_mono, stereo: options.chi2_stereo },
            layout,
            buffers: buffers.clone(),
        };
        let state = State {
            poses: buffers.collect(problem.poses.iter().map(|p| p.camera_from_world)),
            points: problem.points.clone(),
        };
        let chi2 = model.chi2(&state);
        let counted = buffers.collect(chi2.iter().map(Option::is_some));
        let chi2 = buffers.collect(chi2.iter().map(|chi2| chi2.unwrap_or(f64::INFINITY)));
        Self { model, state, active: counted.clone(), counted, chi2, iterations: 0, accepted: 0 }
    }

    /// Huber cost of everything that could be seen at the start.
    pub fn initial_cost(&self) -> f64 {
        self.model.cost(true, &self.counted, self.chi2.iter().copied())
    }

    /// One round; true when it converged.
    pub fn minimize(&mut self, robust: bool, options: &BaOptions) -> bool {
        let mut damping = Damping::new(options.initial_damping);
        let mut linear = self.model.linearize(&self.state, robust, &self.active);
        for _ in 0..options.iterations {
            self.iterations += 1;
            let Some(step) = reduced::solve(&self.model, &linear, &damping) else {
                damping.raise();
                continue;
            };
            let trial = self.moved(&step);
            let seen = self.model.chi2(&trial);
            let last_seen = seen.iter().zip(&self.chi2).map(|(now, last)| now.unwrap_or(*last));
            let trial_chi2 = self.model.buffers.collect(last_seen);
            let cost = self.model.cost(robust, &self.active, self.chi2.iter().copied());
            let trial_cost = self.model.cost(robust, &self.active, trial_chi2.iter().copied());
            let verdict = damping.judge(cost, trial_cost, step.predicted, options.relative_decrease);
            if verdict.accepts() {
                self.accepted += 1;
                (self.state, self.chi2) = (trial, trial_chi2);
            }
            if verdict.stops() {
                return true;
            }
            if verdict.accepts() {
                // The old one goes first: its memory is used again.
                drop(linear);
                linear = self.model.linearize(&self.state, robust, &self.active);
            }
        }
        false
    }

    fn moved(&self, step: &Step) -> State {
        let mut state = self.state.clone();
        for (&pose, delta) in self.model.layout.free_poses.iter().zip(&step.poses) {
            state.poses[pose] = Se3::exp(delta) * state.poses[pose];
        }
        for (point, delta) in state.points.iter_mut().zip(&step.points) {
            *point += delta;
        }
        state
    }

    /// Classifies every observation at the current estimate; true when a class changed.
    pub fn select_inliers(&mut self) -> bool {
        let mut changed = false;
        let seen = self.model.chi2(&self.state);
        for (i, &chi2) in seen.iter().enumerate() {
            let stereo = self.model.layout.observations[i].1.disparity.is_some();
            let inlier = chi2.is_some_and(|chi2| chi2 <= self.model.gates.of(stereo));
            self.chi2[i] = chi2.unwrap_or(self.chi2[i]);
            changed |= inlier != self.active[i];
            self.active[i] = inlier;
        }
        changed
    }

    /// Writes the estimate back.
    pub fn finish(mut self, problem: &mut BaProblem, initial_cost: f64) -> BaReport {
        for &pose in &self.model.layout.free_poses {
            self.state.poses[pose] = self.state.poses[pose].normalized();
        }
        self.select_inliers();
        let mut outlier = self.model.buffers.filled(problem.observations.len(), true);
        for ((index, _), inlier) in self.model.layout.observations.iter().zip(&self.active) {
            outlier[*index] = !inlier;
        }
        let final_cost = self.model.cost(true, &self.counted, self.chi2.iter().copied());
        for (pose, camera_from_world) in problem.poses.iter_mut().zip(&self.state.poses) {
            pose.camera_from_world = *camera_from_world;
        }
        problem.points = self.state.points;
        BaReport { initial_cost, final_cost, iterations: self.iterations, accepted: self.accepted, outlier }
    }
}
