//! The transform between marker body and camera, from motions of both: `A X = X B` (Tsai and Lenz 1989; the two-step
//! solution with singular values after Park and Martin 1994).

use super::SyncError;
use nalgebra::{Matrix3, Vector3};
use schemas::sync::{HandEye, Offset};
use slam_math::{Se3, Track, float};

/// Which motions are used.
#[derive(Debug, Clone, PartialEq)]
pub struct HandEyeOptions {
    /// Lengths of the motions, seconds, ascending. Short ones see what a path is out by from picture to picture, long ones
    /// how it bends: each length counts by its own residuals.
    pub lengths_s: Vec<f64>,
    /// Motions that turn less than this say nothing, radians.
    pub min_turn_rad: f64,
    /// Motions that turn more are near the half turn where the axis flips, radians.
    pub max_turn_rad: f64,
}

impl Default for HandEyeOptions {
    fn default() -> Self {
        Self { lengths_s: vec![0.1, 0.2, 0.4, 0.8, 1.6, 3.2], min_turn_rad: 0.01, max_turn_rad: 2.8 }
    }
}

/// Motions needed that turn by [`TELLING_RAD`].
const MIN_MOTIONS: usize = 30;
/// A turn well above the noise of camera poses, radians.
const TELLING_RAD: f64 = 0.07;
/// Ratio of the largest to the smallest singular value of the stacked `R_A - I` beyond which one direction of the
/// translation is not seen: 1.2 to 1.7 for motion about all axes, 20 for turns about one axis (measured on simulated
/// motion, see the tests).
const MAX_CONDITION: f64 = 10.0;
/// Rounds of reweighted least squares.
const ROUNDS: usize = 10;

/// A motion seen from both sides: `marker_before_from_marker_after` and the same of the camera.
struct Motion {
    /// Which of the lengths it has.
    length: usize,
    marker: Se3,
    camera: Se3,
    marker_turn: Vector3<f64>,
    camera_turn: Vector3<f64>,
}

/// Solves for `marker_from_camera` from camera poses in any world of their own (visual odometry, a calibration board)
/// and marker poses in the mocap's, after time alignment. Marker poses are interpolated only where they have no gap.
///
/// # Errors
/// Too few motions, or turns about one axis only: then the camera's place along that axis does not show.
pub fn hand_eye(
    camera: &Track,
    marker: &Track,
    offset: &Offset,
    options: &HandEyeOptions,
) -> Result<HandEye, SyncError> {
    let motions = motions(camera, marker, offset, options);
    let telling = motions.iter().filter(|motion| motion.marker_turn.norm() >= TELLING_RAD).count();
    if telling < MIN_MOTIONS {
        return Err(SyncError::TooFew {
            what: "motions seen by camera and mocap that turn by four degrees",
            found: telling,
            needed: MIN_MOTIONS,
        });
    }
    let condition = condition(&motions);
    if condition > MAX_CONDITION {
        let axis = main_axis(&motions);
        return Err(SyncError::Unobservable {
            what: "marker to camera transform",
            reason: format!(
                "all turns are about the marker's axis [{:.2}, {:.2}, {:.2}] (condition {condition:.0}, at most \
                 {MAX_CONDITION} is usable)",
                axis[0], axis[1], axis[2]
            ),
            advice: "add a minute of hand-held motion that tilts by 20 degrees or more about two other axes",
        });
    }
    let no_rotation = || SyncError::NoAgreement { what: "hand-eye rotation", reason: "it is singular".to_owned() };
    let (rotation, rotation_residual) = solve_rotation(&motions).ok_or_else(no_rotation)?;
    let (translation, translation_residual, sigma) = solve_translation(&motions, &rotation).ok_or_else(no_rotation)?;
    let marker_from_camera = Se3 { rotation, translation };
    // Overlapping motions repeat each other's noise: only as many as fit side by side count.
    let independent = float::max(motions.len() as f64 / overlap(camera, options), 1.0);
    let turn_rms =
        (motions.iter().fold(0.0, |sum, m| sum + m.marker_turn.norm_squared()) / motions.len() as f64).sqrt();
    Ok(HandEye {
        rotation_xyzw: marker_from_camera.quaternion_xyzw(),
        translation_m: translation.into(),
        rotation_sigma_deg: (rotation_residual / turn_rms / independent.sqrt()).to_degrees(),
        translation_sigma_m: sigma * (motions.len() as f64 / independent).sqrt(),
        rotation_residual_deg: rotation_residual.to_degrees(),
        translation_residual_m: translation_residual,
        condition,
        motions: motions.len(),
    })
}

fn motions(camera: &Track, marker: &Track, offset: &Offset, options: &HandEyeOptions) -> Vec<Motion> {
    let mut out = Vec::new();
    let poses: Vec<(i64, Se3, Se3)> = camera
        .poses()
        .iter()
        .filter_map(|pose| Some((pose.stamp_ns, pose.world_from_body, marker.at(offset.mocap_ns(pose.stamp_ns))?)))
        .collect();
    for (length, length_s) in options.lengths_s.iter().enumerate() {
        let length_ns = (length_s * 1e9) as i64;
        for (i, (stamp, camera_before, marker_before)) in poses.iter().enumerate() {
            let j = i + poses[i..].partition_point(|(other, _, _)| *other < stamp + length_ns);
            let Some((other, camera_after, marker_after)) = poses.get(j) else { break };
            // The next pose may stand behind a gap.
            if other - stamp > 2 * length_ns {
                continue;
            }
            let (marker, camera) = (marker_before.inverse() * *marker_after, camera_before.inverse() * *camera_after);
            let turn = |motion: &Se3| motion.log().fixed_rows::<3>(3).into_owned();
            let (marker_turn, camera_turn) = (turn(&marker), turn(&camera));
            if (options.min_turn_rad..options.max_turn_rad).contains(&marker_turn.norm()) {
                out.push(Motion { length, marker, camera, marker_turn, camera_turn });
            }
        }
    }
    out
}

/// How many motions share a moment's noise: as many as there are lengths, over the longest of them.
fn overlap(camera: &Track, options: &HandEyeOptions) -> f64 {
    let interval_s = float::max(camera.interval_s(), 1e-3);
    let longest_s = options.lengths_s.iter().copied().fold(0.0, float::max);
    options.lengths_s.len() as f64 * float::max(longest_s / interval_s, 1.0)
}

/// Weight of each residual: against the typical one of its length 1 up to it, then falling with the square (Geman and
/// McClure); lengths against each other by the square of what is typical. The typical motion of all weighs about 1.
fn weights(motions: &[Motion], residuals: &[f64]) -> Vec<f64> {
    let median = |of: &dyn Fn(&Motion) -> bool| {
        let mut known: Vec<f64> = motions.iter().zip(residuals).filter(|(m, _)| of(m)).map(|(_, r)| *r).collect();
        float::max(float::median_in_place(&mut known).unwrap_or(0.0) * 2.0, 1e-12)
    };
    let all = median(&|_| true);
    let lengths = motions.iter().map(|motion| motion.length + 1).max().unwrap_or(0);
    let typical: Vec<f64> = (0..lengths).map(|length| median(&|motion| motion.length == length)).collect();
    let weight = |(motion, residual): (&Motion, &f64)| {
        let typical = typical[motion.length];
        let (ratio, share) = (residual / typical, all / typical);
        share * share / ((1.0 + ratio * ratio) * (1.0 + ratio * ratio))
    };
    motions.iter().zip(residuals).map(weight).collect()
}

/// Rotation with the weighted mean residual, radians.
fn solve_rotation(motions: &[Motion]) -> Option<(Matrix3<f64>, f64)> {
    let mut rotation = Matrix3::identity();
    let mut weight = vec![1.0; motions.len()];
    for _ in 0..ROUNDS {
        let outer = motions
            .iter()
            .zip(&weight)
            .fold(Matrix3::zeros(), |sum: Matrix3<f64>, (m, w)| sum + m.marker_turn * m.camera_turn.transpose() * *w);
        rotation = nearest_rotation(&outer)?;
        let residuals: Vec<f64> = motions.iter().map(|m| (m.marker_turn - rotation * m.camera_turn).norm()).collect();
        weight = weights(motions, &residuals);
    }
    let residual = |m: &Motion| (m.marker_turn - rotation * m.camera_turn).norm_squared();
    Some((rotation, weighted_rms(motions.iter().map(residual), &weight)))
}

/// Translation, weighted residual and standard deviation along the worst axis as if motions were independent; metres.
fn solve_translation(motions: &[Motion], rotation: &Matrix3<f64>) -> Option<(Vector3<f64>, f64, f64)> {
    let mut translation = Vector3::zeros();
    let mut weight = vec![1.0; motions.len()];
    let parts =
        |m: &Motion| (m.marker.rotation - Matrix3::identity(), rotation * m.camera.translation - m.marker.translation);
    let mut normal = Matrix3::zeros();
    for _ in 0..ROUNDS {
        let mut right = Vector3::zeros();
        normal = Matrix3::zeros();
        for (m, w) in motions.iter().zip(&weight) {
            let (a, b) = parts(m);
            normal += a.transpose() * a * *w;
            right += a.transpose() * b * *w;
        }
        translation = normal.try_inverse()? * right;
        let residuals: Vec<f64> = motions.iter().map(parts).map(|(a, b)| (a * translation - b).norm()).collect();
        weight = weights(motions, &residuals);
    }
    let residual = motions.iter().map(parts).map(|(a, b)| (a * translation - b).norm_squared());
    let rms = weighted_rms(residual, &weight);
    let smallest = normal.symmetric_eigenvalues().iter().copied().fold(f64::INFINITY, float::min);
    Some((translation, rms, rms / smallest.sqrt()))
}

fn weighted_rms(squares: impl Iterator<Item = f64>, weight: &[f64]) -> f64 {
    let (sum, total) = squares.zip(weight).fold((0.0, 0.0), |(sum, total), (r2, w)| (sum + r2 * w, total + w));
    if total > 0.0 { (sum / total).sqrt() } else { 0.0 }
}

/// Ratio of the singular values of the stacked `R_A - I`.
fn condition(motions: &[Motion]) -> f64 {
    let normal = motions.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, m| {
        let a = m.marker.rotation - Matrix3::identity();
        sum + a.transpose() * a
    });
    let values = normal.symmetric_eigenvalues();
    let (low, high) =
        values.iter().fold((f64::INFINITY, 0.0), |(low, high), v| (float::min(low, *v), float::max(high, *v)));
    if low > 0.0 { (high / low).sqrt() } else { f64::INFINITY }
}

/// The direction about which most turning happens.
fn main_axis(motions: &[Motion]) -> Vector3<f64> {
    let spread =
        motions.iter().fold(Matrix3::zeros(), |sum: Matrix3<f64>, m| sum + m.marker_turn * m.marker_turn.transpose());
    let eigen = spread.symmetric_eigen();
    let best = (1..3).fold(0, |best, i| if eigen.eigenvalues[i] > eigen.eigenvalues[best] { i } else { best });
    eigen.eigenvectors.column(best).into_owned()
}

/// The rotation nearest to a sum of outer products `target source^T`.
pub fn nearest_rotation(outer: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = outer.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let smallest = (1..3).fold(0, |best, i| if svd.singular_values[i] < svd.singular_values[best] { i } else { best });
    let mut sign = Vector3::repeat(1.0);
    if u.determinant() * v_t.determinant() < 0.0 {
        sign[smallest] = -1.0;
    }
    Some(u * Matrix3::from_diagonal(&sign) * v_t)
}
