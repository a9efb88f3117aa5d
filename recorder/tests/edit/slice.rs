//! Pieces of a log.

use crate::support::{Content, FRAMES, picture_stamp, write_log};
use recorder::edit::{Cut, EditError, EditOptions, EditSummary, slice};
use recorder::recover::recover;
use schemas::{Stamp, topics};
use std::collections::BTreeMap;
use std::path::Path;

fn sliced(source: &Path, out: &Path, cut: &Cut, margin_ns: u64) -> Result<EditSummary, EditError> {
    let options = EditOptions::new("slice", BTreeMap::new());
    slice(source, out, (cut, margin_ns), &|_| true, &options, &mut |_, _| {})
}

#[test]
fn frames_go_whole_and_signals_reach_beyond() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a);
    sliced(&a, &b, &Cut::Frames(4..7), 50_000_000).unwrap();
    let content = Content::read(&b);
    let stamps = |topic: &str| content.on(topic).map(|m| m.2).collect::<Vec<_>>();
    let pictures: Vec<i64> = (4..7).map(|frame| picture_stamp(frame).0).collect();
    for topic in [topics::COLOR, topics::COLOR_INFO, "/segmentation/panoptic/class", "/segmentation/panoptic/segments"]
    {
        assert_eq!(stamps(topic), pictures, "{topic}");
    }
    // The last depth image comes after the last picture, and belongs to it.
    let depths: Vec<i64> = pictures.iter().map(|stamp| stamp + 1).collect();
    assert_eq!((stamps(topics::DEPTH), stamps(topics::DEPTH_INFO)), (depths.clone(), depths));
    // Categories stand before the first mask, with their own stamp.
    assert_eq!(stamps("/segmentation/panoptic/categories"), [picture_stamp(0).0]);
    let truth = stamps(topics::GROUND_TRUTH);
    let reach = (truth[0] - pictures[0], truth[truth.len() - 1] - pictures[2]);
    assert!(
        (-50_000_000..=-40_000_000).contains(&reach.0) && (40_000_000..=50_000_000).contains(&reach.1),
        "{reach:?}"
    );
    // Numbers count from 0, so that no reader takes the cut for a loss.
    assert_eq!(content.on(topics::COLOR).map(|m| m.1).collect::<Vec<_>>(), [0, 1, 2]);
    assert!(!recover(&b, &folder.path().join("c"), false).unwrap().lossy);
    let record = content.record("pslam/provenance/1").unwrap();
    assert_eq!(record[&format!("topic/{}", topics::COLOR)], "kept 3, changed 0, dropped 9, added 0");
}

#[test]
fn time_is_from_a_moment_to_before_another() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a", "b", "c"].map(|name| folder.path().join(name));
    write_log(&a);
    sliced(&a, &b, &Cut::Time(Some(picture_stamp(4)), Some(picture_stamp(7))), 0).unwrap();
    sliced(&a, &c, &Cut::Frames(4..7), 0).unwrap();
    let [by_time, by_frames] = [&b, &c].map(|path| Content::read(path));
    let frames =
        |content: &Content| content.on(topics::COLOR).chain(content.on(topics::DEPTH)).cloned().collect::<Vec<_>>();
    assert_eq!(frames(&by_time), frames(&by_frames));
    // Everything.
    let d = folder.path().join("d");
    sliced(&a, &d, &Cut::Time(None, None), 0).unwrap();
    assert_eq!(Content::read(&d).without_provenance(), Content::read(&a));
}

#[test]
fn nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    write_log(&a);
    let late = Stamp(picture_stamp(FRAMES).0 + 1_000_000_000);
    for cut in [Cut::Frames(12..20), Cut::Time(Some(late), None), Cut::Time(Some(Stamp(5)), Some(Stamp(5)))] {
        let error = sliced(&a, &b, &cut, 0).unwrap_err();
        assert!(matches!(error, EditError::Refused(_)), "{cut:?}: {error}");
    }
    assert!(!b.exists());
    // Beyond the end is what is there.
    sliced(&a, &b, &Cut::Frames(10..20), 0).unwrap();
    assert_eq!(Content::read(&b).on(topics::COLOR).count(), 2);
}

/// Another program wrote its calibration once; it stays with the pictures.
#[test]
fn a_calibration_from_before_the_cut_is_carried() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    {
        use recorder::LogWriter;
        use schemas::msg::{CameraInfo, CompressedImage, Header};
        let mut log = LogWriter::create(&a, &recorder::LogOptions::default()).unwrap();
        for frame in 0..6 {
            let stamp = picture_stamp(frame);
            let header = Header::new(stamp, topics::frame::CAMERA).unwrap();
            if frame == 0 {
                let info = CameraInfo { header: header.clone(), ..CameraInfo::default() };
                log.write(topics::COLOR_INFO, stamp, &info).unwrap();
            }
            let picture = CompressedImage { header, format: "png".to_owned(), data: vec![0; 9].into() };
            log.write(topics::COLOR, stamp, &picture).unwrap();
        }
        log.finish().unwrap();
    }
    sliced(&a, &b, &Cut::Frames(3..5), 0).unwrap();
    let content = Content::read(&b);
    let stamps = content.messages.iter().map(|m| (m.0.as_str(), m.2)).collect::<Vec<_>>();
    let wanted = [
        (topics::COLOR_INFO, picture_stamp(0).0),
        (topics::COLOR, picture_stamp(3).0),
        (topics::COLOR, picture_stamp(4).0),
    ];
    assert_eq!(stamps, wanted);
}
