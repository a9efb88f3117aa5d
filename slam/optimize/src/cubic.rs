//! Cubic equations, and where they come from here: the singular members of a pencil of 3x3 matrices.

use nalgebra::Matrix3;
use slam_math::float;

/// `det(a + s b)` as a cubic in `s`, constant first.
pub(crate) fn pencil_determinant(a: &Matrix3<f64>, b: &Matrix3<f64>) -> [f64; 4] {
    // det a + tr(adj(a) b) s + tr(adj(b) a) s^2 + det b s^3.
    [a.determinant(), adjugate(a).dot(&b.transpose()), adjugate(b).dot(&a.transpose()), b.determinant()]
}

fn adjugate(m: &Matrix3<f64>) -> Matrix3<f64> {
    let (r0, r1, r2) = (m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose());
    Matrix3::from_columns(&[r1.cross(&r2), r2.cross(&r0), r0.cross(&r1)])
}

/// Real roots of `c0 + c1 s + c2 s^2 + c3 s^3`.
pub(crate) fn real_roots(c: [f64; 4]) -> [Option<f64>; 3] {
    let scale = c.iter().fold(0.0, |largest, v| float::max(largest, v.abs()));
    if c[3].abs() <= 1e-12 * scale {
        return quadratic_roots([c[0], c[1], c[2]]);
    }
    let [p0, p1, p2] = [c[0] / c[3], c[1] / c[3], c[2] / c[3]];
    // s = t - p2 / 3 gives t^3 - 3 q t - 2 r = 0.
    let shift = p2 / 3.0;
    let q = shift * shift - p1 / 3.0;
    let r = shift * p1 / 2.0 - shift * shift * shift - p0 / 2.0;
    let discriminant = r * r - q * q * q;
    let polished = |t: f64| Some(newton(&[p0, p1, p2], t - shift));
    if discriminant < 0.0 {
        let angle = float::acos(r / (q * q.sqrt())) / 3.0;
        let third = 2.0 * std::f64::consts::PI / 3.0;
        return [0.0, 1.0, 2.0].map(|k| polished(2.0 * q.sqrt() * float::cos(angle - k * third)));
    }
    let magnitude = float::pow(r.abs() + discriminant.sqrt(), 1.0 / 3.0);
    let t = if magnitude == 0.0 { 0.0 } else { (magnitude + q / magnitude) * r.signum() };
    [polished(t), None, None]
}

/// Two steps on the monic cubic: the closed forms lose digits where roots are close.
fn newton(p: &[f64; 3], start: f64) -> f64 {
    let mut s = start;
    for _ in 0..2 {
        let value = p[0] + s * (p[1] + s * (p[2] + s));
        let slope = p[1] + s * (2.0 * p[2] + 3.0 * s);
        let next = s - value / slope;
        s = if next.is_finite() { next } else { s };
    }
    s
}

fn quadratic_roots(c: [f64; 3]) -> [Option<f64>; 3] {
    let discriminant = c[1] * c[1] - 4.0 * c[2] * c[0];
    // The sum without cancellation; its partner follows from the product of the roots.
    let sum = -0.5 * (c[1] + if c[1] < 0.0 { -1.0 } else { 1.0 } * discriminant.sqrt());
    [sum / c[2], c[0] / sum, f64::NAN].map(|root| Some(root).filter(|v| v.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expanded(roots: [f64; 3], scale: f64) -> [f64; 4] {
        let [a, b, c] = roots;
        [-a * b * c, a * b + a * c + b * c, -(a + b + c), 1.0].map(|v| v * scale)
    }

    #[test]
    fn cubics_give_back_their_roots() {
        for roots in [[1.0, 2.0, 3.0], [-5.0, 0.1, 0.2], [1e3, -1e-3, 2.0], [0.0, 0.5, -0.5]] {
            for scale in [1.0, -7.0] {
                let mut found: Vec<f64> = real_roots(expanded(roots, scale)).into_iter().flatten().collect();
                let mut expected = roots.to_vec();
                found.sort_by(f64::total_cmp);
                expected.sort_by(f64::total_cmp);
                assert_eq!(found.len(), 3, "{roots:?}");
                assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-8 * (1.0 + b.abs())), "{found:?}");
            }
        }
        // (s - 2)(s^2 + 1) and s^2 - 3 s + 2.
        let one: Vec<f64> = real_roots([-2.0, 1.0, -2.0, 1.0]).into_iter().flatten().collect();
        assert!(one.len() == 1 && (one[0] - 2.0).abs() < 1e-12, "{one:?}");
        let two: Vec<f64> = real_roots([2.0, -3.0, 1.0, 0.0]).into_iter().flatten().collect();
        assert!(two.len() == 2 && (two[0] + two[1] - 3.0).abs() < 1e-12, "{two:?}");
    }
}
