//! Background that loses its label: what the network is no longer sure of is known by its place.

use slam::Config;
use slam::report::Verdict;

use crate::scene::{Board, CHAIR, Film, PERSON, SHELF, Shown};

/// Between the left rim and the middle of the picture, on the table.
const ON_TABLE: [f64; 4] = [60.0, 90.0, 125.0, 150.0];

/// A still surface on the left.
fn table(label: Option<(u16, u16)>) -> Board {
    Board::new(4, label).at([-0.45, 0.0, 2.0])
}

/// Slides down beside the table, at its distance and touching it, claimed by no segment.
fn slider(frame: u32) -> Board {
    Board::new(2, None).at([0.35, -0.5 + 0.04 * f64::from(frame), 2.0])
}

fn on_slider(shown: &Shown, frame: u32) -> Vec<Verdict> {
    let y = 119.5 + 131.25 * (-0.5 + 0.04 * f64::from(frame));
    shown.verdicts([185.0, y - 25.0, 225.0, y + 25.0])
}

/// A film in which the table has its label for ten frames while the mover slides beside it.
fn begun() -> Film {
    let mut film = Film::new(&Config::default());
    (0..10).for_each(|frame| drop(film.show(&[table(Some((5, SHELF))), slider(frame)])));
    film
}

#[test]
fn a_table_that_loses_its_label_beside_a_mover_stays_in_use_and_the_mover_goes() {
    for label in [None, Some((6, CHAIR))] {
        let mut film = begun();
        for frame in 10..24 {
            let shown = film.show(&[table(label), slider(frame)]);
            assert_eq!(shown.verdicts(ON_TABLE), [Verdict::Static], "frame {frame}, {label:?}");
            assert_eq!(on_slider(&shown, frame), [Verdict::UnknownDynamic], "frame {frame}, {label:?}");
        }
    }
}

#[test]
fn a_table_that_never_had_a_label_goes_with_the_mover_that_it_is_joined_with() {
    let mut film = Film::new(&Config::default());
    let shown: Vec<Shown> = (0..14).map(|frame| film.show(&[table(None), slider(frame)])).collect();
    assert_eq!(shown[13].verdicts(ON_TABLE), [Verdict::UnknownDynamic], "nothing tells the two apart");
}

#[test]
fn what_comes_to_stand_before_the_table_is_not_the_table() {
    let mut film = begun();
    for frame in 10..16 {
        let before = Board { half: [0.4, 0.4], ..Board::new(7, None) }.at([-0.4, 0.0, 1.6]);
        let shown = film.show(&[table(None), slider(frame), before]);
        assert!(!shown.verdicts([70.0, 100.0, 110.0, 140.0]).contains(&Verdict::Static), "frame {frame}");
    }
}

#[test]
fn a_person_on_the_table_is_a_person() {
    let mut film = begun();
    let shown = film.show(&[table(Some((9, PERSON))), slider(10)]);
    assert_eq!(shown.verdicts(ON_TABLE), [Verdict::Person]);
}

#[test]
fn without_depth_background_is_remembered_for_a_while_and_is_never_a_mover() {
    let mut film = Film::new(&Config::default());
    film.unmeasured = Some(4);
    (0..10).for_each(|_| drop(film.show(&[table(Some((5, SHELF)))])));
    let verdicts: Vec<_> = (0..40).map(|_| film.show(&[table(None)]).verdicts(ON_TABLE)).collect();
    assert!(verdicts[..28].iter().all(|v| *v == [Verdict::Static]), "{verdicts:?}");
    assert!(verdicts[32..].iter().all(|v| *v == [Verdict::UnknownNew]), "{verdicts:?}");
}
