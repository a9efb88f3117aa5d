//! A live recording with motion capture and labels, cut and redacted: what comes out is a log like any other.

use crate::record::{SMALL, counts, start_sim};
use crate::support::{pslam, pslam_exits, text, write_masks};
use serde_json::Value;
use std::path::Path;

/// Checks a log, replays it and verifies the run; gives the report of the replay.
fn sound_and_replayed(log: &Path, run: &Path) -> Value {
    let checked = pslam_exits(0, &["check", text(log)]);
    assert!(checked.trim_end().ends_with("sound"), "{checked}");
    let asked = ["replay", text(log), "-o", text(run), "--segmentation", "network", "--json"];
    let replayed = serde_json::from_str(&pslam_exits(0, &asked)).unwrap();
    pslam_exits(0, &["verify", text(run)]);
    replayed
}

#[test]
fn a_live_recording_is_cut_and_redacted() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (log, masks, piece, hidden) = (at("a.mcap"), at("masks"), at("piece.mcap"), at("hidden.mcap"));
    write_masks(&masks, (160, 120), 400);
    let (mut sim, address) = start_sim(0);
    let asked = ["--vicon", &address, "--segment", "--masks", text(&masks), "--segment-lag", "30", "--duration", "4"];
    let recorded = pslam(&[&SMALL[..], &asked, &["--reserve", "1M", "-o", text(&log)]].concat());
    sim.kill().unwrap();
    sim.wait().unwrap();
    let count = counts(&log);
    let said = String::from_utf8_lossy(&recorded.stderr);
    assert!(count("/mocap/frames") > 0 && count("/segmentation/network/class") > 20, "{said}");

    // A second and a half from within, with what belongs to it.
    pslam_exits(0, &["slice", text(&log), "--frames", "20..65", "-o", text(&piece)]);
    sound_and_replayed(&piece, &at("piece"));
    let of_piece = counts(&piece);
    assert_eq!(of_piece("/camera/color/image/compressed"), 45);
    let mocap = of_piece("/mocap/frames");
    assert!(mocap > 0 && mocap < count("/mocap/frames"), "{mocap}");

    // The cups go, in colour, native depth and masks; pictures that came without labels are in doubt.
    let redact = ["redact", text(&log), "--layer", "network", "--class", "cup", "--margin", "4", "--json"];
    let asked = [&redact[..], &["--doubtful", "cover", "-o", text(&hidden)]].concat();
    let report: Value = serde_json::from_str(&pslam_exits(0, &asked)).unwrap();
    let pixels: Vec<u64> =
        report["redacted"]["pixels"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect();
    assert!(pixels.len() > 30 && pixels.iter().all(|pixels| *pixels > 0), "a cup stands in every label: {pixels:?}");
    sound_and_replayed(&hidden, &at("hidden"));
    let of_hidden = counts(&hidden);
    for topic in ["/mocap/frames", "/camera/gyro/sample", "/camera/depth/native/image", "/segmentation/network/class"] {
        assert_eq!(of_hidden(topic), count(topic), "{topic}");
    }
    let info = pslam_exits(0, &["info", text(&hidden)]);
    assert!(info.contains("pslam/redaction"), "{info}");
}
