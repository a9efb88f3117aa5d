//! How many samples are enough.

use slam_math::float;

/// Samples of `size` after which one free of outliers was drawn with probability `confidence`, when a share of
/// `inlier_share` are inliers; at most `max`.
pub(crate) fn samples_needed(inlier_share: f64, size: u32, confidence: f64, max: u32) -> u32 {
    let good = (0..size).fold(1.0, |product, _| product * inlier_share);
    if good >= 1.0 {
        return u32::min(1, max);
    }
    let log_bad = float::ln(1.0 - good);
    // A share too small to be told from zero: no early end.
    if log_bad >= 0.0 {
        return max;
    }
    let needed = float::ln(1.0 - confidence) / log_bad;
    if needed < f64::from(max) { u32::max(1, needed.ceil() as u32) } else { max }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_counts() {
        // ln(0.01) / ln(1 - 0.5^3) = 34.5, ln(0.01) / ln(1 - 0.5^7) = 587.2 (Hartley and Zisserman, table 4.3).
        assert_eq!(samples_needed(0.5, 3, 0.99, 1000), 35);
        assert_eq!(samples_needed(0.5, 7, 0.99, 1000), 588);
        assert_eq!(samples_needed(1.0, 7, 0.99, 1000), 1);
        assert_eq!(samples_needed(0.0, 7, 0.99, 1000), 1000);
        assert_eq!(samples_needed(0.5, 7, 1.0, 1000), 1000);
    }
}
