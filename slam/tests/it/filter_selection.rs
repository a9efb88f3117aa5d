//! Which keypoints each selection lets tracking use.

use slam::Config;
use slam::panoptic::FrameFilter;
use slam::report::{Selection, Verdict};

use crate::support::{context, on_background};

/// A frame with one keypoint of each verdict.
fn frame() -> FrameFilter {
    FrameFilter { verdict: Verdict::ALL.to_vec().into(), ..on_background(Verdict::ALL.len()) }
}

fn admitted(selection: Selection) -> Vec<Verdict> {
    let frame = frame();
    let admitted = frame.admitted(&context(&Config::default()), selection);
    frame.verdict.iter().zip(&admitted).filter(|(_, admitted)| **admitted).map(|(verdict, _)| *verdict).collect()
}

#[test]
fn each_selection_admits_more_than_the_one_before_and_the_last_believes_no_label() {
    assert_eq!(admitted(Selection::Static), [Verdict::Static]);
    assert_eq!(admitted(Selection::WithUnconfirmed), [Verdict::Static, Verdict::ThingNew, Verdict::UnknownNew]);
    let with_borders = [Verdict::Static, Verdict::ThingNew, Verdict::UnknownNew, Verdict::Border];
    let is_in_order = |list: &[Verdict]| Verdict::ALL.into_iter().filter(|v| list.contains(v)).collect::<Vec<_>>();
    assert_eq!(admitted(Selection::WithBorders), is_in_order(&with_borders));
    let but_people: Vec<Verdict> = Verdict::ALL.into_iter().filter(|v| *v != Verdict::Person).collect();
    assert_eq!(admitted(Selection::AllButPeople), but_people);
    assert_eq!(admitted(Selection::Everything), Verdict::ALL);
    for pair in Selection::ALL.windows(2) {
        let (narrow, wide) = (admitted(pair[0]), admitted(pair[1]));
        assert!(narrow.len() < wide.len() && narrow.iter().all(|v| wide.contains(v)), "{pair:?}");
    }
}
