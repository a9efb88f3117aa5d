//! `F` from seven matches: the two-dimensional null space of their equations, cut by `det F = 0`.

use nalgebra::Matrix3;
use slam_math::float;

use super::{Match, fit, homogeneous};

/// Up to three solutions, in a fixed order; none when the matches are degenerate.
pub(super) fn solve(sample: &[Match; 7]) -> impl Iterator<Item = Matrix3<f64>> + use<> {
    solutions(sample).into_iter().flatten().flatten()
}

fn solutions(sample: &[Match; 7]) -> Option<[Option<Matrix3<f64>>; 3]> {
    let last = fit::normalization(sample.iter().map(|m| m.last))?;
    let current = fit::normalization(sample.iter().map(|m| m.current))?;
    let rows = sample.map(|m| {
        let row = fit::epipolar_row(&(last * homogeneous(m.last)), &(current * homogeneous(m.current)));
        row.data.0[0]
    });
    let [a, b] = null_space(rows)?.map(|v| Matrix3::from_row_slice(&v));
    // det(a + s b) = det a + tr(adj(a) b) s + tr(adj(b) a) s^2 + det b s^3.
    let cubic = [a.determinant(), adjugate(&a).dot(&b.transpose()), adjugate(&b).dot(&a.transpose()), b.determinant()];
    let back = |s: f64| fit::unit_norm(current.transpose() * (a + b * s) * last);
    Some(real_roots(cubic).map(|root| root.and_then(back)))
}

fn adjugate(m: &Matrix3<f64>) -> Matrix3<f64> {
    let (r0, r1, r2) = (m.row(0).transpose(), m.row(1).transpose(), m.row(2).transpose());
    Matrix3::from_columns(&[r1.cross(&r2), r2.cross(&r0), r0.cross(&r1)])
}

/// Two independent vectors orthogonal to seven rows, by elimination with full pivoting; `None` when the rank is below 7.
fn null_space(mut rows: [[f64; 9]; 7]) -> Option<[[f64; 9]; 2]> {
    let mut order: [usize; 9] = std::array::from_fn(|i| i);
    for step in 0..7 {
        let mut pivot = (step, step);
        for r in step..7 {
            for c in step..9 {
                if rows[r][order[c]].abs() > rows[pivot.0][order[pivot.1]].abs() {
                    pivot = (r, c);
                }
            }
        }
        rows.swap(step, pivot.0);
        order.swap(step, pivot.1);
        let column = order[step];
        let divisor = rows[step][column];
        if divisor.abs() < 1e-9 {
            return None;
        }
        let lead = rows[step].map(|v| v / divisor);
        rows[step] = lead;
        for (_, row) in rows.iter_mut().enumerate().filter(|(r, _)| *r != step) {
            let factor = row[column];
            for (v, l) in row.iter_mut().zip(&lead) {
                *v -= factor * l;
            }
        }
    }
    Some([7, 8].map(|free| {
        let mut vector = [0.0; 9];
        vector[order[free]] = 1.0;
        for (row, &column) in rows.iter().zip(&order) {
            vector[column] = -row[order[free]];
        }
        vector
    }))
}

/// Real roots of `c0 + c1 s + c2 s^2 + c3 s^3`.
fn real_roots(c: [f64; 4]) -> [Option<f64>; 3] {
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

    #[test]
    fn repeated_matches_have_no_solution() {
        let one = Match { last: [10.0, 20.0], current: [11.0, 19.0] };
        assert_eq!(solve(&[one; 7]).count(), 0);
    }
}
