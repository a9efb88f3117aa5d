//! The geometric rule on little scenes: what is let in, what is taken out, and when.

use slam::Config;
use slam::report::RegionState::{Dynamic, New, Person, Static};
use slam::report::{KeypointClass, Verdict};

use crate::scene::{Board, CHAIR, Film, PERSON, SHELF, SUITCASE, Shown};

fn film() -> Film {
    Film::new(&Config::default())
}

fn chair() -> Board {
    Board::new(1, Some((5, CHAIR)))
}

fn unknown() -> Board {
    Board::new(2, None)
}

/// A film in which the board stands still until it is confirmed.
fn confirmed(board: Board) -> Film {
    let mut film = film();
    assert_eq!(film.show_for(20, &[board]).states(), [Static]);
    film
}

#[test]
fn a_still_thing_is_new_until_it_is_confirmed() {
    let mut film = film();
    // The youngest comparison is 4 frames old, and 3 frames must agree.
    for frame in 0..9 {
        let shown = film.show(&[chair()]);
        let (state, verdict) = if frame < 6 { (New, Verdict::ThingNew) } else { (Static, Verdict::Static) };
        assert_eq!(shown.states(), [state], "frame {frame}");
        assert_eq!(shown.in_the_middle(), [verdict], "frame {frame}");
        assert_eq!(shown.at_the_rim(), [Verdict::Static], "the wall is used from the first frame on");
    }
}

#[test]
fn a_still_thing_is_confirmed_while_the_camera_moves() {
    let mut film = film();
    for frame in 0..25u32 {
        film.camera_m = [0.01 * f64::from(frame), 0.0, 0.005 * f64::from(frame)];
        film.show(&[chair()]);
    }
    assert_eq!(film.show(&[chair()]).states(), [Static]);
}

#[test]
fn a_sliding_unknown_area_is_dynamic_and_comes_back_when_it_stands_still() {
    let mut film = film();
    let at = |frame: i32| unknown().at([-0.6 + 0.05 * f64::from(frame), 0.0, 2.0]);
    let states: Vec<_> = (0..=12).map(|frame| film.show(&[at(frame)]).states()).collect();
    assert_eq!(states[3], [New]);
    assert!(states[4..].iter().all(|s| *s == [Dynamic]), "{states:?}");
    let there = at(12);
    // As long as a frame of the 30 before saw it elsewhere, it moves; then 30 frames must agree.
    let mut back = None;
    for frame in 0..80 {
        let shown = film.show(&[there]);
        if shown.states() == [Static] {
            back = Some(frame);
            break;
        }
        assert_eq!(shown.states(), [Dynamic]);
    }
    let back = back.expect("re-admitted");
    assert!((30..=62).contains(&back), "after {back} frames");
    // Its place stays suspect for some frames more.
    assert_eq!(film.show_for(6, &[there]).in_the_middle(), [Verdict::Static]);
}

#[test]
fn an_approaching_unknown_area_is_dynamic() {
    let mut film = film();
    let states: Vec<_> =
        (0..20).map(|frame| film.show(&[unknown().at([0.0, 0.0, 2.5 - 0.05 * f64::from(frame)])]).states()).collect();
    assert!(states[13..].iter().all(|s| *s == [Dynamic]), "{states:?}");
    assert!(states.iter().all(|s| *s != [Static]), "{states:?}");
}

#[test]
fn a_receding_unknown_area_is_dynamic() {
    let mut film = film();
    let states: Vec<_> =
        (0..20).map(|frame| film.show(&[unknown().at([0.2, 0.1, 1.5 + 0.05 * f64::from(frame)])]).states()).collect();
    assert!(states[13..].iter().all(|s| *s == [Dynamic]), "its keypoints are elsewhere: {states:?}");
}

#[test]
fn a_confirmed_thing_that_starts_to_move_is_taken_out() {
    let mut film = confirmed(chair());
    let shown: Vec<Shown> = (1..9).map(|i| film.show(&[chair().at([0.05 * f64::from(i), 0.0, 2.0])])).collect();
    let taken_out = shown.iter().position(|s| s.states() == [Dynamic]).expect("taken out");
    let m = &film.ctx.config.panoptic.motion;
    assert!(taken_out as u32 <= m.suspect_frames + m.history_frames[0], "after {taken_out} frames");
    let last = shown.last().unwrap();
    assert_eq!(last.verdicts([160.0, 90.0, 200.0, 150.0]), [Verdict::ThingDynamic]);
    assert!(shown[taken_out..].iter().all(|s| s.states() == [Dynamic]));
}

#[test]
fn a_single_frame_of_evidence_takes_nothing_out() {
    let mut film = confirmed(chair());
    // One frame with a wrong depth, as if the chair had jumped.
    film.show(&[chair().at([0.0, 0.0, 1.2])]);
    assert_eq!(film.show(&[chair()]).states(), [Static]);
    assert_eq!(film.show_for(10, &[chair()]).states(), [Static]);
}

#[test]
fn a_segment_dropped_for_a_frame_keeps_its_state() {
    let mut film = confirmed(chair());
    let dropped = film.show(&[Board { label: None, ..chair() }]);
    assert_eq!(dropped.states(), [Static]);
    assert_eq!(dropped.in_the_middle(), [Verdict::Static]);
    assert_eq!(film.show(&[chair()]).states(), [Static]);
}

#[test]
fn a_segment_split_in_two_keeps_its_state() {
    let mut film = confirmed(chair());
    let half = |x: f64, id: u16| Board { half: [0.2, 0.4], label: Some((id, CHAIR)), ..chair() }.at([x, 0.0, 2.0]);
    let split = film.show(&[half(-0.2, 5), half(0.2, 6)]);
    assert_eq!(split.states(), [Static, Static]);
    assert_eq!(film.show(&[chair()]).states(), [Static]);
}

#[test]
fn a_renamed_segment_keeps_its_state() {
    let mut film = confirmed(chair());
    assert_eq!(film.show(&[Board { label: Some((9, SUITCASE)), ..chair() }]).states(), [Static]);
    let mut film = self::film();
    let sliding = |frame: i32, label| Board { label, ..unknown() }.at([-0.6 + 0.05 * f64::from(frame), 0.0, 2.0]);
    (0..8).for_each(|frame| drop(film.show(&[sliding(frame, None)])));
    let renamed = film.show(&[sliding(8, Some((9, SUITCASE)))]);
    assert_eq!(renamed.states(), [Dynamic], "a mover does not get in under another name");
}

#[test]
fn a_thing_put_into_free_space_is_dynamic_at_once() {
    let mut film = confirmed(chair());
    film.show_for(11, &[]);
    let shown = film.show(&[chair()]);
    assert_eq!(shown.states(), [Dynamic]);
    assert_eq!(shown.in_the_middle(), [Verdict::ThingDynamic]);
}

#[test]
fn a_person_missed_in_a_frame_is_not_let_in() {
    let person = Board::new(3, Some((5, PERSON)));
    let mut film = film();
    let seen = film.show_for(3, &[person]);
    assert_eq!(seen.states(), [Person]);
    assert_eq!(seen.in_the_middle(), [Verdict::Person]);
    let unclaimed = film.show(&[Board { label: None, ..person }]);
    assert_eq!(unclaimed.in_the_middle(), [Verdict::UnknownNew]);
    assert_eq!(film.show(&[person]).in_the_middle(), [Verdict::Person]);
    let as_thing = film.show(&[Board { label: Some((7, SUITCASE)), ..person }]);
    assert_eq!(as_thing.in_the_middle(), [Verdict::ThingNew]);
    film.show(&[person]);
    let as_background = film.show(&[Board { label: Some((7, SHELF)), ..person }]);
    assert_eq!(as_background.in_the_middle(), [Verdict::Border], "the place stays suspect for some frames");
}

#[test]
fn keypoints_beside_a_mover_are_border() {
    let person = Board::new(3, Some((5, PERSON)));
    let shown = film().show(&[person]);
    // The board spans x = 107..212. Its margin is 8 px on the finest octave, rounded up to cells.
    let ends = [107.0, 212.0];
    let (mut inside_margin, mut outside) = (0, 0);
    for (pixel, verdict) in shown.obs.raw_pixel.iter().zip(&shown.filter.verdict) {
        let beside = pixel[1] > 80.0 && pixel[1] < 160.0;
        let away = if pixel[0] < ends[0] { ends[0] - pixel[0] } else { pixel[0] - ends[1] };
        if beside && away > 1.0 && away < 7.0 {
            assert_eq!(*verdict, Verdict::Border, "{pixel:?}");
            inside_margin += 1;
        } else if away > 14.0 {
            assert_eq!(*verdict, Verdict::Static, "{pixel:?}");
            outside += 1;
        }
    }
    assert!(inside_margin > 5 && outside > 100, "{inside_margin} {outside}");
}

#[test]
fn background_in_formerly_free_space_is_taken_out() {
    let shelf = |x: f64| Board::new(4, Some((5, SHELF))).at([x, 0.0, 2.0]);
    let mut film = film();
    film.show_for(6, &[]);
    // Labelled as Stuff, but a moment ago the wall was seen through it.
    assert_eq!(film.show(&[shelf(0.0)]).in_the_middle(), [Verdict::FreeSpace]);
}

#[test]
fn switches_turn_single_tests_off() {
    let boards = [
        Board { half: [0.2, 0.4], ..Board::new(3, Some((6, PERSON))) }.at([-0.8, 0.0, 2.0]),
        Board { half: [0.2, 0.4], ..chair() }.at([0.0, 0.0, 2.0]),
        Board { half: [0.2, 0.4], ..unknown() }.at([0.8, 0.0, 2.0]),
    ];
    let at = |x: f64| [x - 10.0, 90.0, x + 10.0, 150.0];
    for name in ["full", "none", "people", "people+things", "people+unknown"] {
        let config = Config::preset(name).unwrap();
        let p = config.panoptic.clone();
        let shown = Film::new(&config).show(&boards);
        let expect = |on: bool, verdict: Verdict| [if on { verdict } else { Verdict::Static }];
        assert_eq!(shown.verdicts(at(54.5)), expect(p.people, Verdict::Person), "{name}");
        assert_eq!(shown.verdicts(at(159.5)), expect(p.things, Verdict::ThingNew), "{name}");
        assert_eq!(shown.verdicts(at(264.5)), expect(p.unknown, Verdict::UnknownNew), "{name}");
    }
}

#[test]
fn a_mover_stays_in_use_where_its_test_is_off() {
    let mut film = Film::new(&Config::preset("people").unwrap());
    for frame in 0..10 {
        let shown = film.show(&[unknown().at([-0.3 + 0.05 * f64::from(frame), 0.0, 2.0])]);
        assert!(shown.filter.verdict.iter().all(|v| *v == Verdict::Static), "frame {frame}");
    }
}

#[test]
fn without_a_mask_everything_is_background() {
    let mut film = film();
    film.with_mask = false;
    let shown = film.show_for(6, &[chair(), Board::new(3, Some((6, PERSON))).at([0.8, 0.0, 1.5])]);
    assert!(shown.filter.regions.list.is_empty());
    assert!(shown.filter.class.iter().all(|c| *c == KeypointClass::Stuff));
    assert!(shown.filter.verdict.iter().all(|v| *v == Verdict::Static));
    assert!(shown.obs.len() > 200);
}
