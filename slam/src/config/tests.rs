//! The documentation of the defaults, and what is refused.

use super::*;

#[test]
fn the_documented_defaults_are_valid_and_complete() {
    let config = Config::from_toml("").unwrap();
    assert_eq!(config, Config::from_toml(&config.to_toml()).unwrap());
}

#[test]
fn every_key_is_documented() {
    let mut documented = false;
    for line in DEFAULT_TOML.lines() {
        let is_key = line.contains('=') && !line.starts_with('#');
        assert!(!is_key || documented, "no comment above: {line}");
        documented = line.starts_with('#');
    }
}

#[test]
fn unknown_keys_and_bad_values_are_refused() {
    assert!(Config::from_toml("[tracking]\nmin_inlier = 3").is_err());
    assert!(Config::from_toml("[sensor]\nbf = -1.0").unwrap_err().to_string().contains("sensor.bf"));
    assert!(Config::from_toml("[sensor]\nbf = nan").is_err());
    for (text, key) in [
        ("[panoptic.consensus]\nmax_chi2 = nan", "panoptic.consensus.max_chi2"),
        ("[panoptic.motion]\nfree_space_m = inf", "panoptic.motion.free_space_m"),
        ("[final]\ndepth_weights = [1.0, nan]", "final.depth_weights"),
        ("[panoptic]\nstuff_floor = 1.5", "panoptic.stuff_floor"),
        ("[orb]\nfeatures = 50000", "stuff_floor"),
        ("[tracking]\ngood_sigma_share = 0.0", "tracking.good_sigma_share"),
    ] {
        let refused = Config::from_toml(text).unwrap_err().to_string();
        assert!(refused.contains(key), "{text}: {refused}");
    }
    assert!(Config::preset("everything").unwrap_err().to_string().contains("people+things"));
}

#[test]
fn presets_differ_only_in_the_filter() {
    let full = Config::default();
    for name in PRESETS {
        let mut preset = Config::preset(name).unwrap();
        preset.panoptic = full.panoptic.clone();
        assert_eq!(preset, full);
    }
    assert_eq!(Config::preset("full").unwrap(), full);
}
