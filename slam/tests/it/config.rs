//! What a configuration file may say.

use slam::Config;
use slam::config::{PRESETS, Rule};

#[test]
fn each_section_refuses_an_unknown_key() {
    let table: toml::Table = toml::from_str(&Config::default().to_toml()).unwrap();
    let mut sections = vec![String::new()];
    let mut todo: Vec<(String, toml::Table)> = vec![(String::new(), table)];
    while let Some((path, table)) = todo.pop() {
        for (key, value) in table {
            if let toml::Value::Table(inner) = value {
                let path = if path.is_empty() { key } else { format!("{path}.{key}") };
                sections.push(format!("[{path}]"));
                todo.push((path, inner));
            }
        }
    }
    assert_eq!(sections.len(), 17, "{sections:?}");
    for section in sections {
        let error = Config::from_toml(&format!("{section}\nno_such_key = 1")).expect_err(&section).to_string();
        assert!(error.contains("no_such_key"), "{section}: {error}");
    }
}

#[test]
fn wrong_types_and_broken_text_are_refused() {
    for text in ["seed = \"one\"", "[orb]\nfeatures = -1", "[panoptic]\nrule = \"both\"", "[orb", "tracking = 3"] {
        assert!(Config::from_toml(text).is_err(), "{text}");
    }
}

#[test]
fn values_outside_their_range_name_their_key() {
    for (text, key) in [
        ("[sensor]\ndepth_window_px = 4", "sensor.depth_window_px"),
        ("[sensor]\ndepth_window_px = 11", "sensor.depth_window_px"),
        ("[sensor]\nsigma_base_m = 0.0", "sensor.sigma_base_m"),
        ("[orb]\nlevels = 1", "orb.levels"),
        ("[tracking]\nratio = 1.1", "tracking.ratio"),
        ("[panoptic.motion]\nhistory_frames = [0]", "panoptic.motion.history_frames"),
        ("[panoptic.motion]\nhistory_frames = [301]", "panoptic.motion.history_frames"),
        ("[final]\niterations = 0", "final.iterations"),
        ("[final]\nrounds = 101", "final.rounds"),
        ("[final]\ndepth_weights = []", "final.depth_weights"),
        ("[final]\ndepth_weights = [1.0, nan]", "final.depth_weights"),
        ("[final]\ndepth_slack = -0.1", "final.depth_slack"),
        ("[final]\nmax_frames = 10000001", "final.max_frames"),
        ("[final]\nmax_matches = 65536", "final.max_matches"),
        ("[final]\nmin_inliers = 5", "final.min_inliers"),
    ] {
        let error = Config::from_toml(text).expect_err(text).to_string();
        assert!(error.contains(key), "{text}: {error}");
    }
}

#[test]
fn a_file_changes_only_its_keys() {
    let changed = Config::from_toml("[panoptic.motion]\nborder_px = 12").unwrap();
    let mut expected = Config::default();
    expected.panoptic.motion.border_px = 12;
    assert_eq!(changed, expected);
}

#[test]
fn presets_are_the_rows_of_the_ablation() {
    let switches = PRESETS.map(|name| {
        let p = Config::preset(name).unwrap().panoptic;
        (name, p.people, p.things, p.unknown, p.rule)
    });
    assert_eq!(
        switches,
        [
            ("full", true, true, true, Rule::Geometric),
            ("none", false, false, false, Rule::Geometric),
            ("people", true, false, false, Rule::Geometric),
            ("people+things", true, true, false, Rule::Geometric),
            ("people+unknown", true, false, true, Rule::Geometric),
            ("paper", true, true, true, Rule::Paper),
        ]
    );
    for name in PRESETS {
        let preset = Config::preset(name).unwrap();
        assert_eq!(Config::from_toml(&preset.to_toml()).unwrap(), preset, "a written preset is read back");
    }
}
