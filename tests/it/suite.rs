//! `pslam suite`: runs, tables, exit codes.

use crate::support::{pslam, pslam_exits, small_world, text, write_log};
use serde_json::Value;
use std::fs;

const SUITE: &str = "\
title = 'Test'
config = [{ name = 'full' }, { name = 'few', keys = { orb = { features = 400 } } }]
[[sequence]]
name = 'room'
log = 'room.mcap'
[[sequence]]
name = 'fewer'
log = 'room.mcap'
degrade = 'drop-tenth'
[[sequence]]
name = 'elsewhere'
log = 'elsewhere.mcap'
[[published]]
system = 'Other'
source = 'table 1'
ate_m = { elsewhere = 0.5 }
[[table]]
title = 'Errors'
value = 'ate_m'
published = ['Other']
";

#[test]
fn a_suite_runs_what_is_there_and_names_what_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("suite.toml"), folder.path().join("out"));
    fs::write(&file, SUITE).unwrap();
    write_log(&small_world(24), &folder.path().join("room.mcap"), &mut |_| {});
    let report: Value =
        serde_json::from_str(&pslam_exits(0, &["suite", text(&file), "-o", text(&out), "--json"])).unwrap();
    let frames = |i: usize| report["sequences"][i]["runs"][0]["frames"].as_u64().unwrap();
    assert_eq!(frames(0), 24);
    assert!(frames(1) < 24, "frames are left out");
    assert!(report["sequences"][0]["runs"][1]["ate_m"].as_f64().unwrap() < 0.05);
    assert!(report["sequences"][2]["missing"].as_str().unwrap().contains("elsewhere.mcap is not there"));
    let tables = fs::read_to_string(out.join("tables.md")).unwrap();
    assert!(tables.contains("| elsewhere") && tables.contains("0.5000") && tables.contains("published, table 1"));
    // The runs are usual ones.
    pslam_exits(0, &["eval", text(&out.join("runs/room/full"))]);
    pslam_exits(2, &["suite", text(&file), "-o", text(&out)]);
}

#[test]
fn nothing_to_run_is_no_success() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    pslam_exits(1, &["suite", "quadruped", "--data", text(folder.path()), "-o", text(&out)]);
    assert!(pslam_exits(0, &["suite", "quadruped", "--print"]).contains("AlienGo"));
    let missing = pslam(&["suite", "no-such-suite.toml", "-o", text(&out)]);
    assert!(String::from_utf8_lossy(&missing.stderr).contains("no-such-suite.toml"));
}

const PERTURBED: &str = "\
title = 'Perturbed'
perturbations = ['mirrored', 'no-masks']
config = [{ name = 'full' }, { name = 'none', preset = 'none' }]
[[sequence]]
name = 'room'
log = 'room.mcap'
[[sequence]]
name = 'elsewhere'
log = 'elsewhere.mcap'
";

#[test]
fn a_perturbed_suite_says_how_far_results_spread() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("suite.toml");
    fs::write(&file, PERTURBED).unwrap();
    write_log(&small_world(24), &folder.path().join("room.mcap"), &mut |_| {});
    let results = ["1", "3"].map(|threads| {
        let out = folder.path().join(threads);
        pslam_exits(0, &["suite", text(&file), "-o", text(&out), "--threads", threads]);
        let report: Value = serde_json::from_slice(&fs::read(out.join("suite.json")).unwrap()).unwrap();
        assert!(!out.join("runs").exists(), "nothing is written but the result");
        (report["sequences"].clone(), report["tables"].clone(), fs::read_to_string(out.join("tables.md")).unwrap())
    });
    let [(sequences, tables, page), (again, _, _)] = results;
    assert_eq!(sequences, again, "threads change nothing");
    let cells = sequences[0]["perturbed"].as_array().unwrap();
    let named = cells.iter().map(|cell| ["config", "perturbation"].map(|key| cell[key].as_str().unwrap()));
    let all = [["full", "mirrored"], ["full", "no-masks"], ["none", "mirrored"], ["none", "no-masks"]];
    assert_eq!(named.collect::<Vec<_>>(), all);
    for cell in cells {
        assert_eq!((cell["outcome"].as_str(), cell["frames"].as_u64()), (Some("judged"), Some(24)), "{cell}");
        assert!(cell["error_m"]["rmse"].as_f64().unwrap() < 0.05, "{cell}");
    }
    assert!(sequences[1]["missing"].as_str().unwrap().contains("elsewhere.mcap is not there"));
    assert_eq!(tables.as_array().unwrap().len(), 3, "one a configuration, and the comparison");
    for words in ["## Perturbed: full", "## Perturbed: none", "| most lost | ", "| room ", "## Where full does worse"] {
        assert!(page.contains(words), "{words}\n{page}");
    }
}

#[test]
fn an_unknown_perturbation_is_refused_with_the_known_ones() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("suite.toml"), folder.path().join("out"));
    fs::write(&file, PERTURBED.replace("no-masks", "upside-down")).unwrap();
    let refused = pslam(&["suite", text(&file), "-o", text(&out)]);
    let message = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(message.contains("upside-down") && message.contains("masks-late") && message.contains("all"), "{message}");
}
