//! The fine offset: all three axes, with rotation, bias, offset and drift at once.

use super::AngularVelocity;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use slam_math::Se3;
use slam_math::se3::skew;

/// Residual from which a sample counts less (Huber), rad/s; that of mocap.md's prototype: twice the noise of poses.
const HUBER_RAD_S: f64 = 0.05;
/// Rounds of reweighted least squares; five suffice from a coarse offset that is 20 ms off.
const ROUNDS: usize = 20;

/// `mocap(t) = rotation (camera(t + offset + drift (t - middle)) - bias)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// `marker_from_gyro`.
    pub rotation: Matrix3<f64>,
    /// Of the camera side's gyroscope, rad/s.
    pub bias: Vector3<f64>,
    /// Seconds to add to mocap time in the middle.
    pub offset_s: f64,
    /// Seconds a second.
    pub drift: f64,
    /// Mocap time at which the offset holds, seconds.
    pub middle_s: f64,
}

/// What is known of a drift before the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriftPrior {
    /// Seconds a second, by which the camera's clock is faster than the mocap's.
    pub drift: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Result of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The parameters.
    pub model: Model,
    /// Standard deviation of the offset, seconds.
    pub offset_sigma_s: f64,
    /// Standard deviation of the drift, seconds a second.
    pub drift_sigma: f64,
    /// Root of the weighted mean square of the residuals, rad/s a vector.
    pub residual_rad_s: f64,
    /// Samples used.
    pub samples: usize,
}

/// Rotation, bias, offset, drift.
type Parameters = SVector<f64, 8>;

impl Model {
    /// Camera time of a mocap time, seconds.
    pub fn camera_time(&self, mocap_s: f64) -> f64 {
        mocap_s + self.offset_s + self.drift * (mocap_s - self.middle_s)
    }
}

/// Pairs of vectors at one moment by a first offset: mocap, camera.
pub fn pairs(mocap: &AngularVelocity, camera: &AngularVelocity, model: &Model) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let both = mocap.time_s.iter().zip(&mocap.rad_s);
    both.filter_map(|(t, m)| Some((*m, camera.at(model.camera_time(*t))?.0))).collect()
}

/// Whether a fit moves the drift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Drift {
    /// It stays as it starts.
    Fixed,
    /// It is moved, from what is known of it.
    Free(Option<DriftPrior>),
}

/// Refines a model whose offset is right to some tens of milliseconds. `window` is the number of neighbouring mocap
/// samples that share their noise through smoothing. `None` without samples in common or when the system is singular.
pub fn refine(
    mocap: &AngularVelocity,
    camera: &AngularVelocity,
    start: Model,
    window: f64,
    drift: Drift,
) -> Option<Fit> {
    let mut model = start;
    let mut last = None;
    for _ in 0..ROUNDS {
        let mut system = System::build(mocap, camera, &model, drift != Drift::Fixed);
        if let Drift::Free(Some(prior)) = drift {
            system.know(&prior, &model, window);
        }
        let inverse = system.normal.cholesky()?.inverse();
        let step: Parameters = inverse * system.gradient;
        model.rotation *= Se3::exp(&nalgebra::Vector6::new(0.0, 0.0, 0.0, step[0], step[1], step[2])).rotation;
        model.bias += step.fixed_rows::<3>(3);
        model.offset_s += step[6];
        model.drift += step[7];
        last = Some((system, inverse));
        if step[6].abs() < 1e-9 && step[7].abs() < 1e-12 {
            break;
        }
    }
    let (system, inverse) = last?;
    // Three axes a sample, each with this variance; smoothing makes `window` neighbours one measurement.
    let variance = system.variance(window);
    let sigma = |i: usize| (inverse[(i, i)] * variance).sqrt();
    let residual_rad_s = (system.cost / system.weight).sqrt();
    let drift_sigma = if drift == Drift::Fixed { f64::INFINITY } else { sigma(7) };
    model.offset_s.is_finite().then_some(Fit {
        model,
        offset_sigma_s: sigma(6),
        drift_sigma,
        residual_rad_s,
        samples: system.samples,
    })
}

/// Normal equations of one round.
struct System {
    normal: SMatrix<f64, 8, 8>,
    gradient: Parameters,
    cost: f64,
    weight: f64,
    samples: usize,
}

impl System {
    /// Of one axis of a sample, (rad/s)^2, as if neighbours that share their noise were one.
    fn variance(&self, window: f64) -> f64 {
        self.cost / (3.0 * self.weight) * window
    }

    /// Adds what is known of the drift, weighed against the samples by their variance.
    fn know(&mut self, prior: &DriftPrior, model: &Model, window: f64) {
        let weight = self.variance(window) / (prior.sigma * prior.sigma);
        self.normal[(7, 7)] += weight;
        self.gradient[7] += weight * (prior.drift - model.drift);
    }

    fn build(mocap: &AngularVelocity, camera: &AngularVelocity, model: &Model, with_drift: bool) -> Self {
        let (mut normal, mut gradient) = (SMatrix::<f64, 8, 8>::zeros(), Parameters::zeros());
        let (mut cost, mut total, mut samples) = (0.0, 0.0, 0);
        for (t, measured) in mocap.time_s.iter().zip(&mocap.rad_s) {
            let Some((value, slope)) = camera.at(model.camera_time(*t)) else { continue };
            let turned = value - model.bias;
            let residual = measured - model.rotation * turned;
            let size = residual.norm();
            let weight = if size <= HUBER_RAD_S { 1.0 } else { HUBER_RAD_S / size };
            let mut jacobian = SMatrix::<f64, 3, 8>::zeros();
            jacobian.fixed_columns_mut::<3>(0).copy_from(&(-model.rotation * skew(&turned)));
            jacobian.fixed_columns_mut::<3>(3).copy_from(&-model.rotation);
            let along = model.rotation * slope;
            jacobian.fixed_columns_mut::<1>(6).copy_from(&along);
            jacobian.fixed_columns_mut::<1>(7).copy_from(&(along * (t - model.middle_s)));
            normal += jacobian.transpose() * jacobian * weight;
            gradient += jacobian.transpose() * residual * weight;
            cost += weight * size * size;
            total += weight;
            samples += 1;
        }
        if !with_drift {
            normal.row_mut(7).fill(0.0);
            normal.column_mut(7).fill(0.0);
            normal[(7, 7)] = 1.0;
            gradient[7] = 0.0;
        }
        // Keeps a turn about a single axis solvable: what the data do not move stays where it started.
        for i in 0..6 {
            normal[(i, i)] += 1e-6 * total;
        }
        Self { normal, gradient, cost, weight: total, samples }
    }
}
