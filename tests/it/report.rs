//! Pages about runs: whole, the same every time, and honest about what is missing.

use crate::support::{pslam, pslam_exits, small_world, text, write_log};
use std::fs;
use std::path::Path;

/// A log and two runs of it in a folder.
fn runs(folder: &Path) {
    write_log(&small_world(12), &folder.join("a.mcap"), &mut |_| {});
    for (name, preset) in [("full", "full"), ("none", "none")] {
        let (log, run) = (folder.join("a.mcap"), folder.join(name));
        pslam_exits(0, &["replay", text(&log), "-o", text(&run), "--preset", preset]);
    }
}

fn page(folder: &Path, name: &str, more: &[&str]) -> (String, serde_json::Value) {
    let (run, out) = (folder.join("full"), folder.join(name));
    let told = pslam_exits(0, &[&["report", text(&run), "-o", text(&out), "--json"], more].concat());
    (fs::read_to_string(&out).unwrap(), serde_json::from_str(&told).unwrap())
}

#[test]
fn a_page_needs_nothing_else_and_is_the_same_every_time() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    runs(folder);
    let (run, other) = (folder.join("full"), folder.join("none"));
    let (one, told) = page(folder, "one.html", &["--compare", text(&other), "--threads", "1"]);
    let (two, _) = page(folder, "two.html", &["--compare", text(&other), "--threads", "4"]);
    assert_eq!(one, two);
    assert_eq!(told["notices"], serde_json::json!([]));
    let pictures = told["pictures"].as_u64().unwrap() as usize;
    assert!(pictures >= 4 && one.matches("src=\"data:image/jpeg;base64,").count() == pictures, "{told}");
    // Letters of pictures may spell anything; the script names a namespace, which nobody fetches.
    let markup = one.split("<script>").next().unwrap();
    let plain: String =
        markup.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, rest)| rest)).collect();
    for word in ["http:", "https:", "@import", "NaN"] {
        assert!(!plain.contains(word), "{word}");
    }
    // The same numbers as everywhere.
    let evaluation: serde_json::Value = serde_json::from_str(&pslam_exits(0, &["eval", text(&run), "--json"])).unwrap();
    assert_eq!(told["evaluation"]["ate_m"], evaluation["ate_m"]);
    assert!(one.contains(&format!("{:.5}", evaluation["ate_m"]["rmse"].as_f64().unwrap())));
    // What exists is not replaced.
    let out = folder.join("one.html");
    pslam_exits(2, &["report", text(&run), "-o", text(&out)]);
    pslam_exits(0, &["report", text(&run), "-o", text(&out), "--force", "--no-pictures"]);
}

#[test]
fn what_is_missing_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    runs(folder);
    let (run, log) = (folder.join("full"), folder.join("a.mcap"));
    let bench = folder.join("bench.json");
    fs::write(&bench, pslam_exits(0, &["bench", text(&log), "--json"])).unwrap();
    assert!(page(folder, "bench.html", &["--bench", text(&bench)]).0.contains("with the same fingerprint"));

    fs::rename(&log, folder.join("away.mcap")).unwrap();
    let (html, told) = page(folder, "poor.html", &[]);
    assert!(html.contains("No pictures and no verdicts") && html.contains("No errors"), "{told}");
    assert_eq!((told["pictures"].as_u64(), told["notices"].as_array().map(Vec::len)), (Some(0), Some(2)));
    let truth = folder.join("away.mcap");
    let (html, _) = page(folder, "truth.html", &["--truth", text(&truth)]);
    assert!(html.contains("No pictures") && !html.contains("No errors"));
    // What was asked for by name must be there.
    let out = folder.join("never.html");
    for more in [vec![text(&log)], vec!["--truth", "/nonexistent"], vec!["--bench", text(&truth)]] {
        pslam_exits(3, &[&["report", text(&run), "-o", text(&out)], more.as_slice()].concat());
    }
    let records = run.join("records.bin");
    let bytes = fs::read(&records).unwrap();
    fs::write(&records, &bytes[..bytes.len() / 2]).unwrap();
    pslam_exits(3, &["report", text(&run), "-o", text(&out)]);
    fs::remove_file(run.join("run.json")).unwrap();
    let told = pslam(&["report", text(&run), "-o", text(&out)]);
    assert_eq!(told.status.code(), Some(3));
    assert!(String::from_utf8_lossy(&told.stderr).contains("is no run: name the folder"), "{told:?}");
    assert!(!out.exists());
}

#[test]
fn a_run_without_any_pose_has_a_page() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (log, run) = (folder.join("a.mcap"), folder.join("full"));
    // Pictures without texture: nothing to track.
    write_log(&small_world(4), &log, &mut |frame| frame.rgb.fill(90));
    pslam_exits(0, &["replay", text(&log), "-o", text(&run)]);
    let (html, told) = page(folder, "dark.html", &[]);
    assert!(html.contains("No frame has a pose") && html.contains("no frame has a pose"), "{told}");
}
