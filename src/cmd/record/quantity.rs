//! Times and sizes as people write them.

use std::time::Duration;

/// `90`, `90s`, `0.5`, `5m`, `1h`.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let units = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let value = scaled(text, &units).filter(|s| *s <= 1e8);
    value.map(Duration::from_secs_f64).ok_or_else(|| format!("`{text}` is not a time like 90, 90s, 5m or 1h"))
}

/// `0`, `4096`, `500M`, `2G`; powers of 1000.
pub fn bytes(text: &str) -> Result<u64, String> {
    let units = [("k", 1e3), ("M", 1e6), ("G", 1e9), ("T", 1e12), ("B", 1.0)];
    let value = scaled(text, &units).filter(|bytes| *bytes <= 1e18);
    value.map(|bytes| bytes as u64).ok_or_else(|| format!("`{text}` is not a size like 4096, 500M or 2G"))
}

fn scaled(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let scaled = units.iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, *factor)));
    let (number, factor) = scaled.unwrap_or((text, 1.0));
    number.parse::<f64>().ok().map(|value| value * factor).filter(|value| value.is_finite() && *value >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_write_units() {
        let times = [("90", 90_000), ("1.5s", 1_500), ("20ms", 20), ("5m", 300_000), ("1h", 3_600_000)];
        for (text, ms) in times {
            assert_eq!(seconds(text), Ok(Duration::from_millis(ms)), "{text}");
        }
        for (text, size) in [("0", 0), ("4096", 4096), ("500M", 500_000_000), ("1.5G", 1_500_000_000)] {
            assert_eq!(bytes(text), Ok(size), "{text}");
        }
        for text in ["", "-1", "s", "1d", "nan", "inf", "1 h", "1e300"] {
            assert!(seconds(text).is_err() && bytes(text).is_err(), "{text}");
        }
    }
}
