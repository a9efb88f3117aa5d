//! Which keypoints tracking may use when few are static.

use slam::Config;
use slam::panoptic::{Evidence, FrameFilter, Regions};
use slam::report::{KeypointClass, Selection, Verdict};
use slam_math::Buffer;

use crate::support::context;

fn frame(verdicts: &[(usize, Verdict)]) -> FrameFilter {
    let verdict: Vec<Verdict> = verdicts.iter().flat_map(|(n, v)| vec![*v; *n]).collect();
    let n = verdict.len();
    FrameFilter {
        class: vec![KeypointClass::Stuff; n].into(),
        region: vec![None; n].into(),
        verdict: verdict.into(),
        motion_sigmas: vec![f64::NAN; n].into(),
        regions: Regions::default(),
        tracks: Buffer::default(),
        evidence: Buffer::default(),
        stuff: Evidence::default(),
        ground: Buffer::default(),
        keypoint_ground: vec![false; n].into(),
        memory: Buffer::default(),
        epipolar: None,
        epipolar_px: vec![f64::NAN; n].into(),
    }
}

/// What is chosen of `statics` static keypoints and 60 of each other verdict, with the default limit of 150.
fn chosen(statics: usize, of_others: usize) -> (Selection, Vec<Verdict>) {
    let config = Config::default();
    assert_eq!(config.tracking.min_static_keypoints, 150);
    let all: Vec<(usize, Verdict)> =
        Verdict::ALL.iter().map(|v| (if *v == Verdict::Static { statics } else { of_others }, *v)).collect();
    let frame = frame(&all);
    let (selection, usable) = frame.select(&context(&config));
    let mut used: Vec<Verdict> = frame.verdict.iter().zip(&usable).filter(|(_, u)| **u).map(|(v, _)| *v).collect();
    used.dedup();
    (selection, used)
}

#[test]
fn static_keypoints_alone_when_they_are_enough() {
    assert_eq!(chosen(150, 60), (Selection::Static, vec![Verdict::Static]));
}

#[test]
fn unconfirmed_ones_next() {
    let with = vec![Verdict::Static, Verdict::ThingNew, Verdict::UnknownNew];
    assert_eq!(chosen(149, 60), (Selection::WithUnconfirmed, with.clone()));
    assert_eq!(chosen(30, 60), (Selection::WithUnconfirmed, with));
}

#[test]
fn all_but_people_and_movers_last() {
    let last = vec![Verdict::Static, Verdict::ThingNew, Verdict::UnknownNew, Verdict::Border, Verdict::FreeSpace];
    assert_eq!(chosen(29, 60), (Selection::AllButMovers, last.clone()));
    assert_eq!(chosen(1, 1), (Selection::AllButMovers, last), "also when even those are few");
    assert_eq!(chosen(0, 0), (Selection::AllButMovers, vec![]));
}
