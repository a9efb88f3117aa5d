//! Which depth image belongs to which colour picture.
//!
//! The rule is the field's own (the TUM benchmark's association): of all pairs closer than the tolerance, take the
//! closest first, each stamp once; equal distances in the order (earlier first stamp, earlier second stamp).

use crate::Stamp;

/// The field's tolerance: 20 ms.
pub const DEFAULT_TOLERANCE_NS: u64 = 20_000_000;

/// Pairs two lists of stamps; both must be ascending. Returns index pairs, ascending. A pair's distance is strictly
/// below `tolerance_ns`.
#[must_use]
pub fn associate(first: &[Stamp], second: &[Stamp], tolerance_ns: u64) -> Vec<(usize, usize)> {
    let mut candidates = Vec::new();
    let mut start = 0;
    for (i, a) in first.iter().enumerate() {
        while start < second.len() && second[start] < *a && a.abs_diff(second[start]) >= tolerance_ns {
            start += 1;
        }
        let near = second[start..].iter().take_while(|b| **b <= *a || a.abs_diff(**b) < tolerance_ns);
        candidates.extend(near.enumerate().map(|(k, b)| (a.abs_diff(*b), i, start + k)));
    }
    candidates.retain(|(distance, ..)| *distance < tolerance_ns);
    candidates.sort_unstable();
    let (mut first_used, mut second_used) = (vec![false; first.len()], vec![false; second.len()]);
    let mut pairs = Vec::new();
    for (_, i, j) in candidates {
        if !first_used[i] && !second_used[j] {
            (first_used[i], second_used[j]) = (true, true);
            pairs.push((i, j));
        }
    }
    pairs.sort_unstable();
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn stamps(values: &[i64]) -> Vec<Stamp> {
        values.iter().map(|v| Stamp(*v)).collect()
    }

    #[test]
    fn closest_first_one_to_one() {
        // 10 is nearer to 11 than to 8, so 8 stays alone although it comes first.
        assert_eq!(associate(&stamps(&[8, 10]), &stamps(&[11]), 5), [(1, 0)]);
        // The tolerance itself is too far; a tie goes to the earlier stamp.
        assert_eq!(associate(&stamps(&[0]), &stamps(&[5]), 5), []);
        assert_eq!(associate(&stamps(&[10]), &stamps(&[9, 11]), 5), [(0, 0)]);
        assert_eq!(associate(&[], &stamps(&[1]), 5), []);
        assert_eq!(associate(&stamps(&[i64::MIN, i64::MAX]), &stamps(&[i64::MAX]), 1), [(1, 0)]);
    }

    /// The rule, written without any search window.
    fn plain(first: &[Stamp], second: &[Stamp], tolerance_ns: u64) -> Vec<(usize, usize)> {
        let mut all: Vec<(u64, usize, usize)> = Vec::new();
        for (i, a) in first.iter().enumerate() {
            all.extend(second.iter().enumerate().map(|(j, b)| (a.abs_diff(*b), i, j)));
        }
        all.sort_unstable();
        let mut pairs: Vec<(usize, usize)> = Vec::new();
        for (distance, i, j) in all {
            if distance < tolerance_ns && pairs.iter().all(|(a, b)| *a != i && *b != j) {
                pairs.push((i, j));
            }
        }
        pairs.sort_unstable();
        pairs
    }

    proptest! {
        #[test]
        fn window_loses_nothing(mut a in prop::collection::vec(0_i64..200, 0..30),
                                mut b in prop::collection::vec(0_i64..200, 0..30), tolerance in 0_u64..30) {
            a.sort_unstable();
            b.sort_unstable();
            let (a, b) = (stamps(&a), stamps(&b));
            prop_assert_eq!(associate(&a, &b, tolerance), plain(&a, &b, tolerance));
        }
    }
}
