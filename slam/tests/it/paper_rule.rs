//! The paper's rule: epipolar distance per keypoint.

use slam::Config;
use slam::report::Verdict;

use crate::scene::{Board, CHAIR, Film, PERSON, SHELF, Shown};

fn film() -> Film {
    Film::new(&Config::preset("paper").unwrap())
}

/// Background at several depths: on one plane there is no fundamental matrix.
fn background() -> [Board; 3] {
    let shelf = |object: u32, x: f64, y: f64, z: f64| Board {
        half: [0.3, 0.3],
        ..Board::new(object, Some((50 + object as u16, SHELF))).at([x, y, z])
    };
    [shelf(11, -0.9, -0.6, 2.4), shelf(12, 0.8, -0.55, 1.8), shelf(13, -0.7, 0.6, 2.0)]
}

fn with(board: Board) -> Vec<Board> {
    let mut boards = background().to_vec();
    boards.push(board);
    boards
}

/// Two frames: the camera goes right by 4 cm, the board goes down by `down` metres.
fn two_frames(board: Board, down: f64) -> [Shown; 2] {
    let mut film = film();
    let first = film.show(&with(board));
    film.camera_m = [0.04, 0.0, 0.01];
    let c = board.centre;
    let second = film.show(&with(board.at([c[0], c[1] + down, c[2]])));
    [first, second]
}

#[test]
fn new_things_are_filtered_and_then_judged() {
    let chair = Board::new(1, Some((5, CHAIR)));
    let [first, second] = two_frames(chair, 0.0);
    assert!(first.filter.epipolar.is_none());
    let epipolar = second.filter.epipolar.expect("enough background matches");
    assert!(epipolar.inliers >= 41 && !epipolar.degenerate, "{epipolar:?}");
    assert_eq!(second.in_the_middle(), [Verdict::Static]);
    let [_, second] = two_frames(chair, 0.03);
    assert_eq!(second.in_the_middle(), [Verdict::ThingDynamic]);
    assert_eq!(second.at_the_rim(), [Verdict::Static]);
}

#[test]
fn a_thing_that_appears_is_new_for_one_frame() {
    let mut film = film();
    film.show(&background());
    film.camera_m = [0.04, 0.0, 0.01];
    let chair = Board::new(1, Some((5, CHAIR)));
    assert_eq!(film.show(&with(chair)).in_the_middle(), [Verdict::ThingNew]);
    film.camera_m = [0.08, 0.0, 0.02];
    assert_eq!(film.show(&with(chair)).in_the_middle(), [Verdict::Static]);
}

#[test]
fn unknown_keypoints_need_a_match() {
    let board = Board::new(2, None);
    let [_, second] = two_frames(board, 0.0);
    assert_eq!(second.in_the_middle(), [Verdict::Static]);
    let [_, second] = two_frames(board, 0.03);
    assert_eq!(second.in_the_middle(), [Verdict::UnknownDynamic]);
    let mut film = film();
    film.show(&background());
    film.camera_m = [0.04, 0.0, 0.01];
    assert_eq!(film.show(&with(board)).in_the_middle(), [Verdict::UnknownNew]);
}

#[test]
fn the_epipolar_distance_decides_at_its_threshold() {
    let chair = Board::new(1, Some((5, CHAIR)));
    // 262.5 px x down / 2 m, a little less as the camera looks along the line at an angle.
    for (pixels, verdict) in [(0.05, Verdict::Static), (0.2, Verdict::ThingDynamic)] {
        let [_, second] = two_frames(chair, pixels * 2.0 / 262.5);
        assert_eq!(second.in_the_middle(), [verdict], "{pixels} px off the line");
    }
}

#[test]
fn people_are_filtered_without_geometry_and_there_is_no_border() {
    let first = film().show(&[Board::new(3, Some((5, PERSON)))]);
    assert_eq!(first.in_the_middle(), [Verdict::Person]);
    assert!(!first.filter.verdict.contains(&Verdict::Border));
    assert!(!first.filter.verdict.contains(&Verdict::FreeSpace));
}
