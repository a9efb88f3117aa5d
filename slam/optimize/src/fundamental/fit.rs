//! Linear fits on normalised coordinates: the normalised eight-point algorithm (Hartley 1997).

use nalgebra::{Matrix3, SMatrix, SVector, SymmetricEigen};

use super::{Match, homogeneous};

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

/// The `F` of rank 2 that minimises the weighted algebraic error. `None` when the matches coincide.
pub(super) fn eight_point(matches: &[Match], weights: &[f64]) -> Option<Matrix3<f64>> {
    let last = normalization(matches.iter().map(|m| m.last))?;
    let current = normalization(matches.iter().map(|m| m.current))?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    // The weights come in 1/gradient^2; only their ratio counts.
    for (m, weight) in matches.iter().zip(weights).filter(|(_, w)| w.is_finite()) {
        add_row(
            &mut normal,
            &epipolar_row(&(last * homogeneous(m.last)), &(current * homogeneous(m.current))),
            *weight,
        );
    }
    let f = Matrix3::from_row_slice(smallest_eigenvector(&normal)?.as_slice());
    let f = current.transpose() * rank_two(&f)? * last;
    unit_norm(f)
}

/// Coefficients of F, row by row, in `x_current^T F x_last`.
pub(super) fn epipolar_row(last: &nalgebra::Vector3<f64>, current: &nalgebra::Vector3<f64>) -> SVector<f64, 9> {
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

/// The nearest matrix of rank 2.
fn rank_two(f: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = f.try_svd(true, true, f64::EPSILON, MAX_SWEEPS)?;
    let (u, v_t, mut values) = (svd.u?, svd.v_t?, svd.singular_values);
    let smallest = (1..3).fold(0, |best, i| if values[i] < values[best] { i } else { best });
    values[smallest] = 0.0;
    Some(u * Matrix3::from_diagonal(&values) * v_t)
}

pub(super) fn unit_norm(matrix: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let unit = matrix / matrix.norm();
    unit.iter().all(|v| v.is_finite()).then_some(unit)
}
