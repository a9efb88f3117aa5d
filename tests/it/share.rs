//! `pslam export`, `import` and `card` as commands; recordings with native depth.

use crate::support::{pslam, pslam_exits, small_world, text, write_log};
use replayer::log::{DecodedFrame, Log, decode};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn frames(log: &Path) -> Vec<DecodedFrame> {
    let log = Log::open(log).unwrap();
    let camera = log.camera().unwrap();
    let stream = log.timeline(None).unwrap().stream(0..usize::MAX).unwrap();
    stream.map(|raw| decode(&raw.unwrap(), &camera).unwrap()).collect()
}

#[test]
fn native_depth_is_registered_as_a_replay_does_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let arguments = [
        "record",
        "--source",
        "synthetic",
        "--color",
        "160x120@30",
        "--depth",
        "160x120@30",
        "--imu",
        "--duration",
        "2",
        "-o",
    ];
    let log = at("live.mcap");
    let recorded = pslam(&[&arguments[..], &[text(&log)]].concat());
    assert!(matches!(recorded.status.code(), Some(0 | 1)), "{recorded:?}"); // a loaded machine may lose pictures
    for format in ["tum", "png"] {
        let (out, back) = (at(format), at(&format!("{format}.mcap")));
        let mut report: Value =
            serde_json::from_str(&pslam_exits(0, &["export", format, text(&log), "-o", text(&out), "--json"])).unwrap();
        // The name of the form is for what is printed.
        report.as_object_mut().unwrap().remove("schema");
        assert!(report["notes"].to_string().contains("registered to colour"), "{report}");
        assert!(report["left_out"]["/camera/gyro/sample"].as_u64().unwrap() > 0, "{report}");
        let said: Value = serde_json::from_str(&fs::read_to_string(out.join("export.json")).unwrap()).unwrap();
        assert_eq!(said, report, "the folder tells the same");
        pslam_exits(0, &["import", format, text(&out), "-o", text(&back)]);
        let (before, after) = (frames(&log), frames(&back));
        assert!(before.len() > 5 && before.iter().any(|frame| frame.depth.is_some()));
        assert!(before == after, "{format}: the same pictures and depth at the same stamps");
    }
}

#[test]
fn the_commands_refuse_with_the_documented_codes() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let log = at("a.mcap");
    write_log(&small_world(3), &log, &mut |_| {});
    pslam_exits(0, &["export", "png", text(&log), "-o", text(&at("png"))]);
    for arguments in [
        &["export", "png", text(&log), "-o", text(&at("png"))][..],
        &["export", "rosbag2", text(&log), "-o", text(&at("x")), "--frames", "0..2"],
        &["export", "tum", text(&log), "-o", text(&at("x")), "--depth-scale", "0"],
        &["export", "tum", text(&log), "-o", text(&at("x")), "--frames", "7..9"],
        &["card", text(&log), "-o", text(&at("x")), "--date", "tomorrow"],
        &["card", text(&log), text(&log), "-o", text(&at("x"))],
    ] {
        pslam_exits(2, arguments);
        assert!(!at("x").exists(), "{arguments:?}");
    }
    pslam_exits(3, &["export", "png", text(&at("none.mcap")), "-o", text(&at("x"))]);
    pslam_exits(3, &["import", "png", text(folder.path()), "-o", text(&at("x.mcap"))]);
    let bytes = fs::read(&log).unwrap();
    fs::write(at("cut.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    pslam_exits(3, &["card", text(&at("cut.mcap")), "-o", text(&at("x"))]);
    pslam_exits(0, &["card", text(&log), "-o", text(&at("card")), "--logs-by", "link"]);
    let told = pslam_exits(0, &["card", text(&log), "-o", text(&at("card")), "--force", "--json"]);
    let told: Value = serde_json::from_str(&told).unwrap();
    assert!(told["to_fill_in"].as_array().unwrap().len() >= 4, "licence, authors, address, consent: {told}");
}
