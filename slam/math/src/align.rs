//! Best rigid or similarity transform between two point sets (Umeyama, PAMI 1991).

use nalgebra::{Matrix3, Vector3};

use crate::{Se3, Sim3};

/// Least-squares fit `target_from_source`, points paired by position; scale 1 unless asked for. `None` when there are fewer than three pairs,
/// the points lie on one line (the rotation is then undetermined), or a number is not finite.
#[must_use]
pub fn umeyama(source: &[Vector3<f64>], target: &[Vector3<f64>], with_scale: bool) -> Option<Sim3> {
    let n = source.len();
    if n < 3 || n != target.len() {
        return None;
    }
    let mean = |points: &[Vector3<f64>]| points.iter().fold(Vector3::zeros(), |sum, p| sum + p) / n as f64;
    let (source_mean, target_mean) = (mean(source), mean(target));
    let mut covariance = Matrix3::zeros();
    let mut source_variance = 0.0;
    for (s, t) in source.iter().zip(target) {
        let (s, t) = (s - source_mean, t - target_mean);
        covariance += t * s.transpose();
        source_variance += s.dot(&s);
    }
    covariance /= n as f64;
    source_variance /= n as f64;
    if !covariance.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = covariance.try_svd(true, true, f64::EPSILON, 100)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| svd.singular_values[b].total_cmp(&svd.singular_values[a]));
    // Two independent directions fix the rotation; with one, any turn about the line fits as well.
    if svd.singular_values[order[1]] <= svd.singular_values[order[0]] * 1e-12 {
        return None;
    }
    let mut sign = Vector3::repeat(1.0);
    if u.determinant() * v_t.determinant() < 0.0 {
        sign[order[2]] = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&sign) * v_t;
    let scale = if with_scale { svd.singular_values.dot(&sign) / source_variance } else { 1.0 };
    let translation = target_mean - rotation * source_mean * scale;
    Some(Sim3 { scale, se3: Se3 { rotation, translation } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;
    use nalgebra::Vector6;

    #[test]
    fn recovers_a_known_similarity() {
        let mut rng = Rng::at(3, 0, 0, 0);
        for with_scale in [false, true] {
            let truth = Sim3 {
                scale: if with_scale { 1.7 } else { 1.0 },
                se3: Se3::exp(&Vector6::from_fn(|_, _| rng.uniform() * 2.0)),
            };
            let source: Vec<_> = (0..20).map(|_| Vector3::from_fn(|_, _| rng.uniform())).collect();
            let target: Vec<_> = source.iter().map(|p| truth.transform(p)).collect();
            let fit = umeyama(&source, &target, with_scale).unwrap();
            assert!((fit.scale - truth.scale).abs() < 1e-12);
            assert!((fit.se3.rotation - truth.se3.rotation).norm() < 1e-12);
        }
    }

    #[test]
    fn planar_points_give_a_rotation_not_a_mirror() {
        let source = [Vector3::new(0.0, 0.0, 0.0), Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0)];
        let fit = umeyama(&source, &source, false).unwrap();
        assert!((fit.se3.rotation - Matrix3::identity()).norm() < 1e-12);
    }

    #[test]
    fn degenerate_input_is_refused() {
        let line: Vec<_> = (0..5).map(|i| Vector3::new(f64::from(i), 0.0, 0.0)).collect();
        assert!(umeyama(&line, &line, false).is_none());
        assert!(umeyama(&line[..2], &line[..2], false).is_none());
        let nan = vec![Vector3::new(f64::NAN, 0.0, 0.0); 5];
        assert!(umeyama(&nan, &line, false).is_none());
    }
}
