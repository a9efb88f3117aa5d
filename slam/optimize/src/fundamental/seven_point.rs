//! `F` from seven matches: the two-dimensional null space of their equations, cut by `det F = 0`.

use nalgebra::Matrix3;

use super::{Match, fit, homogeneous};
use crate::cubic::{pencil_determinant, real_roots};

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
    let back = |s: f64| fit::unit_norm(current.transpose() * (a + b * s) * last);
    Some(real_roots(pencil_determinant(&a, &b)).map(|root| root.and_then(back)))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_matches_have_no_solution() {
        let one = Match { last: [10.0, 20.0], current: [11.0, 19.0] };
        assert_eq!(solve(&[one; 7]).count(), 0);
    }
}
