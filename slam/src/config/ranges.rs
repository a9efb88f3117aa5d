//! What values are allowed.

use super::{Config, ConfigError};

/// A key, its value, whether that is allowed, and what is.
pub(super) type Check = (&'static str, f64, bool, &'static str);

const POSITIVE: &str = "numbers greater than 0";
const SHARE: &str = "0 to 1";

impl Config {
    /// The first key with a value that makes no sense.
    pub(super) fn validate(&self) -> Result<(), ConfigError> {
        let table = toml::Value::try_from(self).expect("plain tables and numbers");
        if let Some((key, value)) = not_finite(&table) {
            return Err(ConfigError::Range { key, value, range: "finite numbers" });
        }
        let (front, back) = (self.front_checks(), self.back_checks());
        let (last, consensus) = (self.r#final.checks(), self.panoptic.consensus.checks());
        let mut all = front.iter().chain(&back).chain(&last).chain(&consensus);
        match all.find(|(_, _, ok, _)| !ok) {
            Some((key, value, _, range)) => Err(ConfigError::Range { key: (*key).to_owned(), value: *value, range }),
            None => Ok(()),
        }
    }

    /// Of what the picture is made into.
    fn front_checks(&self) -> [Check; 11] {
        let c = self;
        [
            ("sensor.bf", c.sensor.bf, c.sensor.bf > 0.0, POSITIVE),
            ("sensor.close_baselines", c.sensor.close_baselines, c.sensor.close_baselines > 0.0, POSITIVE),
            ("sensor.sigma_base_m", c.sensor.sigma_base_m, c.sensor.sigma_base_m > 0.0, POSITIVE),
            ("sensor.sigma_quadratic", c.sensor.sigma_quadratic, c.sensor.sigma_quadratic >= 0.0, "numbers from 0"),
            (
                "sensor.depth_window_px",
                f64::from(c.sensor.depth_window_px),
                c.sensor.depth_window_px % 2 == 1
                    && c.sensor.depth_window_px as usize <= crate::observation::MAX_WINDOW,
                "odd numbers up to 9",
            ),
            ("stereo.sigma_px", c.stereo.sigma_px, c.stereo.sigma_px > 0.0, POSITIVE),
            ("stereo.window_px", f64::from(c.stereo.window_px), (1..=15).contains(&c.stereo.window_px), "1 to 15"),
            ("stereo.slide_px", f64::from(c.stereo.slide_px), (1..=15).contains(&c.stereo.slide_px), "1 to 15"),
            ("monocular.sigma_px", c.monocular.sigma_px, c.monocular.sigma_px > 0.0, POSITIVE),
            (
                "orb.features",
                c.orb.features as f64,
                c.orb.features as f64 * (1.0 + c.panoptic.stuff_floor) <= f64::from(u16::MAX),
                "1 to 65535 with the share panoptic.stuff_floor of it on top",
            ),
            ("orb.levels", c.orb.levels as f64, (2..=16).contains(&c.orb.levels), "2 to 16"),
        ]
    }

    /// Of what is made of it.
    fn back_checks(&self) -> [Check; 8] {
        let c = self;
        [
            ("mapping.ba_every", f64::from(c.mapping.ba_every), c.mapping.ba_every > 0, "numbers from 1"),
            ("tracking.hamming_high", f64::from(c.tracking.hamming_high), c.tracking.hamming_high <= 256, "0 to 256"),
            ("tracking.hamming_low", f64::from(c.tracking.hamming_low), c.tracking.hamming_low <= 256, "0 to 256"),
            ("tracking.ratio", c.tracking.ratio, c.tracking.ratio > 0.0 && c.tracking.ratio <= 1.0, "(0, 1]"),
            (
                "panoptic.motion.history_frames",
                c.panoptic.motion.history_frames.len() as f64,
                c.panoptic.motion.history_frames.iter().all(|age| (1..=300).contains(age)),
                "ages of 1 to 300 frames",
            ),
            ("tracking.good_sigma_share", c.tracking.good_sigma_share, c.tracking.good_sigma_share > 0.0, POSITIVE),
            ("panoptic.stuff_floor", c.panoptic.stuff_floor, (0.0..=1.0).contains(&c.panoptic.stuff_floor), SHARE),
            (
                "panoptic.motion.corner_px",
                c.panoptic.motion.corner_px,
                c.panoptic.motion.corner_px >= 0.0,
                "numbers from 0",
            ),
        ]
    }
}

/// A number that is none, and its key with its section: comparisons with it are always false, which would switch a test off
/// silently.
fn not_finite(value: &toml::Value) -> Option<(String, f64)> {
    let join = |(key, found): (String, Option<(String, f64)>)| {
        found.map(|(inner, value)| (if inner.is_empty() { key } else { format!("{key}.{inner}") }, value))
    };
    match value {
        toml::Value::Float(value) if !value.is_finite() => Some((String::new(), *value)),
        toml::Value::Table(table) => table.iter().map(|(key, v)| (key.clone(), not_finite(v))).find_map(join),
        toml::Value::Array(list) => list.iter().find_map(not_finite),
        _ => None,
    }
}
