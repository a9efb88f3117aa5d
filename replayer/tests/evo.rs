//! Errors equal those of evo 1.38.1 on the same files. `tests/python/compare_evo.py --golden` writes the files and evo's
//! numbers; run it to compare many more cases.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::Path;

use replayer::eval::{Alignment, DeltaUnit, EvalOptions, RpeOptions, Statistics, Trajectory, evaluate};
use serde_json::Value;

const TOLERANCE: f64 = 1e-6;

/// `1f`, `0.37m`, with `all` behind.
fn rpe(key: &str) -> RpeOptions {
    let (delta, unit) = key.split_at(key.find(['m', 'f']).unwrap());
    let unit_of = if unit.starts_with('m') { DeltaUnit::Metres } else { DeltaUnit::Frames };
    RpeOptions { all_pairs: unit.contains("all"), ..RpeOptions::new(delta.parse().unwrap(), unit_of) }
}

fn assert_equal(name: &str, evo: &Value, ours: Option<&Statistics>) -> usize {
    let Some(ours) = ours else {
        assert!(evo.is_null(), "{name}: no pairs here, evo has {evo}");
        return 0;
    };
    let ours: BTreeMap<String, f64> = serde_json::from_value(serde_json::to_value(ours).unwrap()).unwrap();
    for (statistic, value) in evo.as_object().unwrap() {
        let difference = (ours[statistic] - value.as_f64().unwrap()).abs();
        assert!(difference <= TOLERANCE, "{name} {statistic}: evo {value}, ours {}", ours[statistic]);
    }
    evo.as_object().unwrap().len()
}

#[test]
fn errors_equal_those_of_evo() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/evo");
    let read = |name: &str| Trajectory::read_tum(&folder.join(name)).unwrap();
    let (truth, estimate) = (read("truth.txt"), read("estimate.txt"));
    let golden = std::fs::read(folder.join("evo-1.38.1.json")).unwrap();
    let golden: BTreeMap<Alignment, BTreeMap<String, Value>> = serde_json::from_slice(&golden).unwrap();
    let mut compared = 0;
    for (alignment, errors) in golden {
        for (key, evo) in &errors {
            let words: Vec<&str> = key.split(' ').collect();
            let options: Vec<RpeOptions> = if words[0] == "rpe" { vec![rpe(&key[4..])] } else { Vec::new() };
            let options = EvalOptions { alignment, rpe: options, ..EvalOptions::default() };
            let ours = evaluate(&truth, &estimate, None, &options).unwrap();
            let name = format!("{alignment} {key}");
            compared += match words.as_slice() {
                ["pairs"] => usize::from(evo == &Value::from(ours.pairs)),
                ["ape", "m"] => assert_equal(&name, evo, Some(&ours.ate_m)),
                ["ape", "deg"] => assert_equal(&name, evo, Some(&ours.ate_rotation_deg)),
                [.., "m"] => assert_equal(&name, evo, ours.rpe[0].translation_m.as_ref()),
                _ => assert_equal(&name, evo, ours.rpe[0].rotation_deg.as_ref()),
            };
        }
    }
    // 3 alignments; 1 count; APE and 4 deltas consecutive and all; metres and degrees; 7 statistics.
    assert_eq!(compared, 3 * (1 + (1 + 4 * 2) * 2 * 7));
}
