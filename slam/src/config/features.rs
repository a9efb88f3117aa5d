//! Features as the extractor wants them.

use slam_vision::OrbConfig;

use super::OrbSection;

impl OrbSection {
    /// The extractor's configuration.
    #[must_use]
    pub fn to_extractor(&self) -> OrbConfig {
        OrbConfig {
            features: self.features,
            scale_factor: self.scale_factor,
            levels: self.levels,
            fast_threshold: self.fast_threshold,
            fast_threshold_min: self.fast_threshold_min,
            ..OrbConfig::default()
        }
    }
}
