//! Settings of the extractor and the tables that follow from them.

use crate::VisionError;

/// Settings of [`crate::OrbExtractor`]. The defaults are those of ORB-SLAM for 640 x 480 RGB-D sequences.
#[derive(Debug, Clone, PartialEq)]
pub struct OrbConfig {
    /// Largest number of features per image, at most 65,535, shared among the levels in proportion to their width.
    pub features: usize,
    /// Ratio of the sizes of neighbouring pyramid levels, above 1 and at most 4.
    pub scale_factor: f64,
    /// Number of pyramid levels, 1 to 16.
    pub levels: usize,
    /// FAST threshold, in grey levels, at least 1.
    pub fast_threshold: u8,
    /// FAST threshold in cells without a corner at `fast_threshold`; not above it, at least 1.
    pub fast_threshold_min: u8,
    /// Wanted side of such a cell in pixels, at least 1.
    pub cell_px: usize,
}

impl Default for OrbConfig {
    fn default() -> Self {
        Self { features: 1000, scale_factor: 1.2, levels: 8, fast_threshold: 20, fast_threshold_min: 7, cell_px: 35 }
    }
}

impl OrbConfig {
    /// Checks every setting against its range.
    pub fn validate(&self) -> Result<(), VisionError> {
        let refuse = |name, value, allowed| Err(VisionError::Config { name, value, allowed });
        if self.features == 0 || self.features > usize::from(u16::MAX) {
            return refuse("features", self.features as f64, "1 to 65535");
        }
        if !(self.scale_factor > 1.0 && self.scale_factor <= 2.0) {
            return refuse("scale_factor", self.scale_factor, "above 1 and at most 2");
        }
        if !(1..=16).contains(&self.levels) {
            return refuse("levels", self.levels as f64, "1 to 16");
        }
        if self.fast_threshold == 0 {
            return refuse("fast_threshold", 0.0, "at least 1");
        }
        if self.fast_threshold_min == 0 || self.fast_threshold_min > self.fast_threshold {
            return refuse("fast_threshold_min", f64::from(self.fast_threshold_min), "1 to `fast_threshold`");
        }
        if self.cell_px == 0 {
            return refuse("cell_px", 0.0, "at least 1");
        }
        Ok(())
    }

    /// `scale_factor^level`, by repeated multiplication.
    pub(super) fn scales(&self) -> Vec<f64> {
        std::iter::successors(Some(1.0), |scale| Some(scale * self.scale_factor)).take(self.levels).collect()
    }

    /// Features per level: a geometric series over the levels' widths, the rest to the last level.
    pub(super) fn quotas(&self) -> Vec<usize> {
        let weights: Vec<f64> = self.scales().iter().map(|scale| 1.0 / scale).collect();
        let total: f64 = weights.iter().sum();
        let mut left = self.features;
        let mut quotas: Vec<usize> = weights
            .iter()
            .map(|weight| {
                let quota = ((self.features as f64 * weight / total).round() as usize).min(left);
                left -= quota;
                quota
            })
            .collect();
        quotas[self.levels - 1] += left;
        quotas
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quotas_follow_the_published_series() {
        assert_eq!(OrbConfig::default().quotas(), [217, 181, 151, 126, 105, 87, 73, 60]);
        for features in 1..50 {
            let config = OrbConfig { features, ..OrbConfig::default() };
            assert_eq!(config.quotas().iter().sum::<usize>(), features);
        }
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let bad = [
            (OrbConfig { features: 0, ..OrbConfig::default() }, "features"),
            (OrbConfig { scale_factor: f64::NAN, ..OrbConfig::default() }, "scale_factor"),
            (OrbConfig { scale_factor: 1.0, ..OrbConfig::default() }, "scale_factor"),
            (OrbConfig { levels: 0, ..OrbConfig::default() }, "levels"),
            (OrbConfig { fast_threshold: 0, ..OrbConfig::default() }, "fast_threshold"),
            (OrbConfig { fast_threshold_min: 21, ..OrbConfig::default() }, "fast_threshold_min"),
            (OrbConfig { cell_px: 0, ..OrbConfig::default() }, "cell_px"),
        ];
        for (config, field) in bad {
            let Err(VisionError::Config { name, .. }) = config.validate() else { panic!("{field} accepted") };
            assert_eq!(name, field);
        }
    }
}
