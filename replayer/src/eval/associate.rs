//! Pairs poses of two trajectories by time.

use schemas::Stamp;

use super::{EvalError, Trajectory};

/// Index pairs `(truth, estimate)` in time order. Each pose of the trajectory with fewer poses (the estimate when both
/// have as many) gets the nearest one of the other, if it is at most `max_difference_s` away; of two equally near ones
/// the earlier. One pose of the longer trajectory may serve twice.
///
/// Differences are taken between doubles, as the readers of text files do: an exact tie in nanoseconds must fall to
/// the same side as there, or errors differ in the fifth digit.
///
/// # Errors
/// [`EvalError::NoPairs`] when nothing is near, [`EvalError::Option`] for a difference below zero or not finite.
pub fn associate(
    truth: &Trajectory,
    estimate: &Trajectory,
    max_difference_s: f64,
) -> Result<Vec<(usize, usize)>, EvalError> {
    if !max_difference_s.is_finite() || max_difference_s < 0.0 {
        return Err(EvalError::Option(format!("largest stamp difference {max_difference_s} s: must be 0 or more")));
    }
    let seconds = |t: &Trajectory| t.poses.iter().map(|p| nearest_seconds(p.stamp)).collect::<Vec<_>>();
    let truth_is_shorter = truth.poses.len() < estimate.poses.len();
    let (short, long) = match truth_is_shorter {
        true => (seconds(truth), seconds(estimate)),
        false => (seconds(estimate), seconds(truth)),
    };
    let mut pairs = Vec::with_capacity(short.len());
    for (index, &stamp) in short.iter().enumerate() {
        if let Some(nearest) = nearest(&long, stamp, max_difference_s) {
            pairs.push(if truth_is_shorter { (index, nearest) } else { (nearest, index) });
        }
    }
    if pairs.is_empty() {
        return Err(EvalError::NoPairs {
            estimate: estimate.poses.len(),
            estimate_range: estimate.range(),
            truth: truth.poses.len(),
            truth_range: truth.range(),
            max_difference_s,
        });
    }
    Ok(pairs)
}

/// The double nearest to the stamp's decimal seconds, which is what a reader of its text gets.
fn nearest_seconds(stamp: Stamp) -> f64 {
    stamp.to_decimal9().parse().unwrap_or_else(|_| stamp.as_seconds_f64())
}

/// Index of the entry of `sorted` nearest to `stamp`, the earlier of two equally near ones.
fn nearest(sorted: &[f64], stamp: f64, max_difference_s: f64) -> Option<usize> {
    let after = sorted.partition_point(|&s| s <= stamp);
    let to_after = sorted.get(after).map(|s| s - stamp);
    let to_before = after.checked_sub(1).map(|before| stamp - sorted[before]);
    let (index, difference) = match (to_before, to_after) {
        (Some(before), Some(next)) if next < before => (after, next),
        (Some(before), _) => (after - 1, before),
        (None, Some(next)) => (after, next),
        (None, None) => return None,
    };
    (difference <= max_difference_s).then_some(index)
}

#[cfg(test)]
mod tests {
    use super::super::StampedPose;
    use super::*;
    use slam_math::Se3;

    fn at(ms: &[i64]) -> Trajectory {
        let pose = |&ms| StampedPose { stamp: Stamp(ms * 1_000_000), world_from_camera: Se3::identity() };
        Trajectory { poses: ms.iter().map(pose).collect() }
    }

    #[test]
    fn the_shorter_side_chooses_the_nearest() {
        let (truth, estimate) = (at(&[0, 10, 20, 30, 40]), at(&[4, 16, 60]));
        assert_eq!(associate(&truth, &estimate, 0.01).unwrap(), [(0, 0), (2, 1)]);
        assert_eq!(associate(&estimate, &truth, 0.01).unwrap(), [(0, 0), (1, 2)]);
        assert_eq!(associate(&truth, &estimate, 0.02).unwrap(), [(0, 0), (2, 1), (4, 2)]);
    }

    #[test]
    fn ties_go_to_the_earlier_and_the_limit_is_included() {
        assert_eq!(associate(&at(&[0, 10, 10]), &at(&[5, 10]), 0.005).unwrap(), [(0, 0), (2, 1)]);
    }

    #[test]
    fn different_clocks_are_reported() {
        let error = associate(&at(&[0]), &at(&[1_000_000]), 0.02).unwrap_err().to_string();
        assert!(error.contains("1000.000000000") && error.contains("0.02 s"), "{error}");
        assert!(associate(&at(&[0]), &at(&[0]), f64::NAN).is_err());
    }
}
