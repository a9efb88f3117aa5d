//! Does one homography explain the matches as well as the epipolar geometry does?

use nalgebra::{Matrix3, SMatrix, SVector};

use super::{Match, fit, homogeneous};

/// Refits on the better half.
const REFITS: u32 = 3;

/// Whether at least `share` of the matches agree with one homography within noise. `threshold_px` is the Sampson threshold:
/// one degree of freedom at 95 % (3.84), where a transfer error has two (5.99) and the noise of both images.
pub(super) fn explains(matches: &[Match], threshold_px: f64, share: f64) -> bool {
    let limit = threshold_px * threshold_px * 2.0 * 5.991 / 3.841;
    let mut support = matches.to_vec();
    for _ in 0..REFITS {
        // Matches that don't even fix a homography lie in one place or on one line.
        let Some(h) = direct_linear(&support) else { return true };
        let mut errors: Vec<(f64, usize)> = matches.iter().map(|m| transfer_squared(&h, m)).zip(0..).collect();
        let near = errors.iter().filter(|(e, _)| *e <= limit).count();
        if near as f64 >= share * matches.len() as f64 {
            return true;
        }
        errors.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let half = usize::max(matches.len() / 2, 4).min(matches.len());
        support = errors[..half].iter().map(|(_, i)| matches[*i]).collect();
    }
    false
}

/// Squared distance in the current image, px^2.
pub(crate) fn transfer_squared(h: &Matrix3<f64>, m: &Match) -> f64 {
    let moved = h * homogeneous(m.last);
    let (dx, dy) = (moved[0] / moved[2] - m.current[0], moved[1] / moved[2] - m.current[1]);
    let squared = dx * dx + dy * dy;
    if squared.is_finite() { squared } else { f64::INFINITY }
}

/// Normalised direct linear transform: `current ~ H last`, from at least four matches.
pub(crate) fn direct_linear(matches: &[Match]) -> Option<Matrix3<f64>> {
    let last = fit::normalization(matches.iter().map(|m| m.last))?;
    let current = fit::normalization(matches.iter().map(|m| m.current))?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for m in matches {
        let (x, y) = (last * homogeneous(m.last), current * homogeneous(m.current));
        for axis in 0..2 {
            // y[axis] * (h_2 . x) - h_axis . x = 0.
            let row = SVector::<f64, 9>::from_fn(|i, _| match i / 3 {
                2 => y[axis] * x[i % 3],
                r if r == axis => -x[i % 3],
                _ => 0.0,
            });
            fit::add_row(&mut normal, &row, 1.0);
        }
    }
    let h = Matrix3::from_row_slice(fit::smallest_eigenvector(&normal)?.as_slice());
    Some(current.try_inverse()? * h * last)
}
