//! Fits on normalised coordinates (Hartley 1997).

use nalgebra::{Cholesky, Matrix3, SMatrix, SVector, SymmetricEigen, Vector3, Vector6};
use slam_math::Se3;

use super::{Match, gradient_squared, homogeneous};

/// Sweeps after which the eigenvalue iteration gives up; it needs a few a row.
const MAX_SWEEPS: usize = 300;

/// The similarity that moves the centroid of the pixels to the origin and their mean squared distance to two.
pub(super) fn normalization(pixels: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Matrix3<f64>> {
    let (mut n, mut sum, mut squares) = (0.0, [0.0; 2], 0.0);
    for p in pixels.clone() {
        n += 1.0;
        sum = [sum[0] + p[0], sum[1] + p[1]];
    }
    let mean = [sum[0] / n, sum[1] / n];
    for p in pixels {
        let d = [p[0] - mean[0], p[1] - mean[1]];
        squares += d[0] * d[0] + d[1] * d[1];
    }
    let scale = (2.0 * n / squares).sqrt();
    let transform = Matrix3::new(scale, 0.0, -scale * mean[0], 0.0, scale, -scale * mean[1], 0.0, 0.0, 1.0);
    transform.iter().all(|v| v.is_finite()).then_some(transform)
}

/// One Gauss-Newton step on the Sampson error of the matches. `F = U diag(1, s, 0) V^T` has exactly seven parameters, a
/// rotation of U, one of V, and s, so the rank stays 2. The gradient in the error's denominator is held during the step.
pub(super) fn sampson_step(f: &Matrix3<f64>, matches: &[Match]) -> Option<Matrix3<f64>> {
    let last = normalization(matches.iter().map(|m| m.last))?;
    let current = normalization(matches.iter().map(|m| m.current))?;
    let (u, ratio, v) = decompose(&(current.try_inverse()?.transpose() * f * last.try_inverse()?))?;
    let compose = |u: Matrix3<f64>, ratio: f64, v: Matrix3<f64>| {
        current.transpose() * u * Matrix3::from_diagonal(&Vector3::new(1.0, ratio, 0.0)) * v.transpose() * last
    };
    let f = compose(u, ratio, v);
    let (mut normal, mut right) = (SMatrix::<f64, 7, 7>::zeros(), SVector::<f64, 7>::zeros());
    for m in matches {
        let weight = 1.0 / gradient_squared(&f, m);
        let (a, b) = (u.tr_mul(&(current * homogeneous(m.current))), v.tr_mul(&(last * homogeneous(m.last))));
        let error = a[0] * b[0] + ratio * a[1] * b[1];
        // a^T exp([w]) D b and a^T D exp(-[w]) b, both at w = 0.
        let by_u = Vector3::new(b[0], ratio * b[1], 0.0).cross(&a);
        let by_v = Vector3::new(a[0], ratio * a[1], 0.0).cross(&b);
        let row = SVector::from([by_u[0], by_u[1], by_u[2], by_v[0], by_v[1], by_v[2], a[1] * b[1]]);
        if weight.is_finite() {
            normal += row * (row * weight).transpose();
            right -= row * (weight * error);
        }
    }
    let step = Cholesky::new(normal)?.solve(&right);
    let turn = |at: usize| Se3::exp(&Vector6::new(0.0, 0.0, 0.0, step[at], step[at + 1], step[at + 2])).rotation;
    unit_norm(compose(u * turn(0), ratio + step[6], v * turn(3)))
}

/// `U`, the ratio of the second to the first singular value, and `V`, columns by falling singular value.
fn decompose(f: &Matrix3<f64>) -> Option<(Matrix3<f64>, f64, Matrix3<f64>)> {
    let svd = f.try_svd(true, true, f64::EPSILON, MAX_SWEEPS)?;
    let (u, v) = (svd.u?, svd.v_t?.transpose());
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    let sorted = |m: &Matrix3<f64>| Matrix3::from_columns(&order.map(|i| m.column(i)));
    Some((sorted(&u), svd.singular_values[order[1]] / svd.singular_values[order[0]], sorted(&v)))
}

/// Coefficients of F, row by row, in `x_current^T F x_last`.
pub(super) fn epipolar_row(last: &Vector3<f64>, current: &Vector3<f64>) -> SVector<f64, 9> {
    SVector::from_fn(|i, _| current[i / 3] * last[i % 3])
}

/// Adds `weight * row * row^T` to the lower triangle, the only one that is read.
pub(super) fn add_row(normal: &mut SMatrix<f64, 9, 9>, row: &SVector<f64, 9>, weight: f64) {
    for c in 0..9 {
        let scaled = weight * row[c];
        for r in c..9 {
            normal[(r, c)] += scaled * row[r];
        }
    }
}

/// Eigenvector of the smallest eigenvalue of a symmetric matrix given by its lower triangle.
pub(super) fn smallest_eigenvector(lower: &SMatrix<f64, 9, 9>) -> Option<SVector<f64, 9>> {
    let scale = lower.diagonal().amax();
    if !(scale.is_finite() && scale > 0.0) {
        return None;
    }
    let symmetric = SMatrix::<f64, 9, 9>::from_fn(|r, c| lower[(r.max(c), r.min(c))] / scale);
    let eigen = SymmetricEigen::try_new(symmetric, f64::EPSILON, MAX_SWEEPS)?;
    let smallest = (1..9).fold(0, |best, i| if eigen.eigenvalues[i] < eigen.eigenvalues[best] { i } else { best });
    Some(eigen.eigenvectors.column(smallest).into_owned())
}

/// `None` when the matrix is zero or not finite.
pub(super) fn unit_norm(matrix: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let unit = matrix / matrix.norm();
    unit.iter().all(|v| v.is_finite()).then_some(unit)
}
