//! How what tracking knows by the map weighs in a judgement: the majority, points that vouch, regions that disagree.

use slam::Config;
use slam::report::RegionState::{Dynamic, New, Static};
use slam::report::Verdict;

use crate::scene::{Board, CHAIR, Film, Shown, Told};

/// Keypoints on the chair.
const ON_CHAIR: usize = 64;

fn chair() -> Board {
    Board::new(1, Some((5, CHAIR)))
}

fn film() -> Film {
    Film::new(&Config::default())
}

/// A new chair that has just come so far that much of it stands in formerly free space, seen in its fifth frame.
fn jumped(told: Told) -> Shown {
    let mut film = film();
    film.show_for(4, &[chair()]);
    film.show_told(&[chair().at([0.5, 0.0, 2.0])], told)
}

/// A confirmed chair that slides on, with what is told in each frame of its way.
fn sliding(told: Told) -> Shown {
    let mut film = film();
    assert_eq!(film.show_for(20, &[chair()]).states(), [Static]);
    let at = |i: u32| chair().at([0.05 * f64::from(i), 0.0, 2.0]);
    let shown: Vec<Shown> = (1..9).map(|i| film.show_told(&[at(i)], told)).collect();
    shown.into_iter().next_back().unwrap()
}

#[test]
fn a_frame_that_would_condemn_most_of_what_is_matched_condemns_nothing() {
    // The camera's motion is that of most of what is matched; just half is not most.
    let told = |matched_on_background| Told { matched_on_background, matched_on_regions: ON_CHAIR, ..Told::default() };
    assert_eq!(jumped(told(ON_CHAIR)).states(), [Dynamic]);
    assert_eq!(jumped(told(ON_CHAIR - 1)).states(), [New]);
    assert_eq!(sliding(told(ON_CHAIR)).states(), [Dynamic]);
    assert_eq!(sliding(told(ON_CHAIR - 1)).states(), [Static]);
}

#[test]
fn the_majority_is_of_matches_and_not_of_keypoints() {
    // The chair is most of what is there to see in neither case.
    let few = Told { matched_on_background: 3, matched_on_regions: 4, ..Told::default() };
    assert_eq!(jumped(few).states(), [New]);
    let unmatched = Told { matched_on_background: 3, ..Told::default() };
    assert_eq!(jumped(unmatched).states(), [Dynamic]);
}

#[test]
fn three_points_that_have_stood_still_confirm_a_new_region_at_once() {
    let vouched = |vouched| film().show_told(&[chair()], Told { vouched, ..Told::default() });
    assert_eq!(vouched(3).states(), [Static]);
    assert_eq!(vouched(3).in_the_middle(), [Verdict::Static]);
    assert_eq!(vouched(2).states(), [New]);
}

#[test]
fn a_keypoint_that_is_vouched_for_is_used_before_its_region_is_confirmed() {
    let shown = film().show_told(&[chair()], Told { vouched: 2, ..Told::default() });
    assert_eq!(shown.states(), [New]);
    let on_chair = shown.filter.region.iter().zip(&shown.filter.verdict).filter(|(region, _)| region.is_some());
    let used = on_chair.filter(|(_, verdict)| **verdict == Verdict::Static).count();
    assert_eq!(used, 2);
}

#[test]
fn against_many_vouchers_free_space_condemns_nothing() {
    let told = |vouched| Told { vouched, ..Told::default() };
    assert_eq!(sliding(told(7)).states(), [Dynamic]);
    assert_eq!(sliding(told(8)).states(), [Static]);
}

#[test]
fn many_vouchers_free_a_region_that_was_taken_to_move_within_five_frames() {
    let told = |vouched| Told { vouched, ..Told::default() };
    let come_back = |vouched: usize| {
        let mut film = film();
        film.show_for(4, &[chair()]);
        let there = [chair().at([0.5, 0.0, 2.0])];
        // So long that no frame from before it came is compared with any more, and not longer: nothing speaks for it yet.
        assert_eq!(film.show_for(30, &there).states(), [Dynamic]);
        (0..5).map(|_| film.show_told(&there, told(vouched)).states()[0]).collect::<Vec<_>>()
    };
    assert_eq!(come_back(8), [Dynamic, Dynamic, Dynamic, Dynamic, Static]);
    // More than confirm a new region, but not enough.
    assert_eq!(come_back(7), [Dynamic; 5]);
}

#[test]
fn a_region_that_disagrees_is_not_used_and_moves_after_five_frames() {
    let disagrees = Told { disagrees: true, ..Told::default() };
    let mut film = film();
    assert_eq!(film.show_for(20, &[chair()]).states(), [Static]);
    // What has stood still so far is heard twice.
    let left_out = (Static, Verdict::ThingDynamic);
    let frames = [(Static, Verdict::Static), left_out, left_out, left_out, (Dynamic, Verdict::ThingDynamic)];
    for (state, verdict) in frames {
        let shown = film.show_told(&[chair()], disagrees);
        assert_eq!((shown.states(), shown.in_the_middle()), (vec![state], vec![verdict]));
    }
}

#[test]
fn a_new_region_that_disagrees_is_not_used_from_the_first_frame_on() {
    let told = Told { disagrees: true, vouched: ON_CHAIR, ..Told::default() };
    let shown = film().show_told(&[chair()], told);
    assert_eq!((shown.states(), shown.in_the_middle()), (vec![New], vec![Verdict::ThingDynamic]));
    assert_eq!(shown.at_the_rim(), [Verdict::Static]);
}

#[test]
fn one_blurred_frame_takes_nothing_out_that_stood_still() {
    let disagrees = Told { disagrees: true, ..Told::default() };
    let mut film = film();
    film.show_for(20, &[chair()]);
    for _ in 0..4 {
        let shown = film.show_told(&[chair()], disagrees);
        assert_eq!((shown.states(), shown.in_the_middle()), (vec![Static], vec![Verdict::Static]));
        film.show(&[chair()]);
    }
}
