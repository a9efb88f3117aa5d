//! How long measurements take from arrival into the file.

/// Width of a bin: finer than anything a disk does.
const BIN_NS: i64 = 100_000;
/// Bins up to 10 s; what takes longer is counted in the last.
const BINS: usize = 100_000;

/// A histogram of bounded size.
#[derive(Debug, Clone)]
pub struct Latency {
    bins: Vec<u32>,
    count: u64,
    largest_ns: i64,
}

impl Default for Latency {
    fn default() -> Self {
        Self { bins: vec![0; BINS], count: 0, largest_ns: 0 }
    }
}

impl Latency {
    /// Counts one measurement.
    pub fn add(&mut self, latency_ns: i64) {
        let bin = (latency_ns.max(0) / BIN_NS) as usize;
        let bin = &mut self.bins[bin.min(BINS - 1)];
        *bin = bin.saturating_add(1);
        self.count += 1;
        self.largest_ns = self.largest_ns.max(latency_ns);
    }

    /// The time that `share` (0..=1) of all measurements did not exceed, milliseconds, to a tenth; 0 without any.
    #[must_use]
    pub fn quantile_ms(&self, share: f64) -> f64 {
        let wanted = (share * self.count as f64).ceil() as u64;
        let mut sum = 0;
        let bin = self.bins.iter().position(|count| {
            sum += u64::from(*count);
            sum >= wanted.max(1)
        });
        bin.map_or(0.0, |bin| (bin as i64 + 1) as f64 * BIN_NS as f64 / 1e6)
    }

    /// The longest, milliseconds.
    #[must_use]
    pub fn largest_ms(&self) -> f64 {
        self.largest_ns as f64 / 1e6
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles() {
        let mut latency = Latency::default();
        assert_eq!(latency.quantile_ms(0.99), 0.0);
        (0..100).for_each(|i| latency.add(i * 1_000_000));
        assert_eq!((latency.quantile_ms(0.99), latency.quantile_ms(0.5), latency.largest_ms()), (98.1, 49.1, 99.0));
        latency.add(i64::MAX);
        assert_eq!(latency.quantile_ms(1.0), 10_000.0);
    }
}
