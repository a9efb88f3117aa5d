use serde::{Deserialize, Serialize};

/// Summary of errors of one unit (metres or degrees, as the field that holds it says).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    /// Number of errors.
    pub count: usize,
    /// Root of the mean square.
    pub rmse: f64,
    /// Arithmetic mean.
    pub mean: f64,
    /// Middle value; mean of the two middle ones for an even count.
    pub median: f64,
    /// Standard deviation of the population (divided by the count).
    pub std: f64,
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
    /// Sum of squares.
    pub sse: f64,
}

impl Statistics {
    /// `None` without errors.
    #[must_use]
    pub fn of(errors: &[f64]) -> Option<Self> {
        let mut sorted = errors.to_vec();
        sorted.sort_by(f64::total_cmp);
        let (&min, &max) = (sorted.first()?, sorted.last()?);
        let n = errors.len() as f64;
        let sse = errors.iter().fold(0.0, |sum, e| sum + e * e);
        let mean = errors.iter().fold(0.0, |sum, e| sum + e) / n;
        let variance = errors.iter().fold(0.0, |sum, e| sum + (e - mean) * (e - mean)) / n;
        let middle = |i: usize| sorted[i / 2];
        let median = (middle(errors.len() - 1) + middle(errors.len())) / 2.0;
        Some(Self { count: errors.len(), rmse: (sse / n).sqrt(), mean, median, std: variance.sqrt(), min, max, sse })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_numbers() {
        let s = Statistics::of(&[4.0, 1.0, 2.0, 1.0]).unwrap();
        assert_eq!((s.count, s.mean, s.median, s.min, s.max, s.sse), (4, 2.0, 1.5, 1.0, 4.0, 22.0));
        assert!((s.rmse - 5.5f64.sqrt()).abs() < 1e-15 && (s.std - 1.5f64.sqrt()).abs() < 1e-15);
        assert_eq!(Statistics::of(&[]), None);
    }
}
