//! Camera, keypoint grid, distances and place index.
#![allow(clippy::unwrap_used, reason = "a failing helper fails its test")]

mod common;

use common::descriptors;
use nalgebra::Vector3;
use proptest::prelude::*;
use slam_math::{Buffers, Rng};
use slam_vision::{
    Bounds, Camera, Descriptor, Distortion, KeypointGrid, PlaceIndex, VisionError, gray_from_rgb, hamming,
    hamming_many, nearest_two,
};

fn camera(distortion: Distortion) -> Camera {
    Camera { fx: 535.4, fy: 539.2, cx: 320.1, cy: 247.6, width: 640, height: 480, distortion }
}

/// Freiburg 1's calibration as published with the TUM RGB-D benchmark: strong distortion.
const FREIBURG1: Distortion = Distortion::Radtan { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633 };

#[test]
fn distortion_matches_a_value_worked_out_by_hand() {
    let simple = Camera {
        fx: 100.0,
        fy: 100.0,
        cx: 50.0,
        cy: 50.0,
        width: 100,
        height: 100,
        distortion: Distortion::Radtan { k1: 0.1, k2: 0.0, p1: 0.01, p2: 0.0, k3: 0.0 },
    };
    // x = 0.2, y = 0.1: r2 = 0.05, radial 1.005; x' = 0.201 + 2 p1 x y = 0.2014; y' = 0.1005 + p1 (r2 + 2 y^2) = 0.1012.
    let [x, y] = simple.distort([70.0, 60.0]);
    assert!((x - 70.14).abs() < 1e-10 && (y - 60.12).abs() < 1e-10, "{x} {y}");
}

#[test]
fn undistorted_bounds_hold_every_pixel() {
    for (k1, grows) in [(-0.3, true), (0.05, false)] {
        let lens = camera(Distortion::Radtan { k1, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 });
        let bounds = lens.undistorted_bounds();
        assert_eq!(bounds.min[0] < 0.0 && bounds.max[1] > 480.0, grows);
        for (x, y) in [(0, 0), (320, 0), (640, 480), (0, 240), (640, 0), (100, 480), (320, 240)] {
            assert!(bounds.contains(lens.undistort([f64::from(x), f64::from(y)])));
        }
    }
    assert_eq!(camera(Distortion::None).undistorted_bounds(), Bounds { min: [0.0; 2], max: [640.0, 480.0] });
}

#[test]
fn unusable_cameras_are_refused_by_name() {
    let good = camera(FREIBURG1);
    assert_eq!(good.validate(), Ok(()));
    let radtan = |k3| Distortion::Radtan { k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, k3 };
    let bad = [
        (Camera { fx: 0.0, ..good }, "fx"),
        (Camera { fy: f64::INFINITY, ..good }, "fy"),
        (Camera { cx: f64::NAN, ..good }, "cx"),
        (Camera { width: 0, ..good }, "width"),
        (Camera { distortion: radtan(f64::NAN), ..good }, "k3"),
    ];
    for (camera, field) in bad {
        let Err(VisionError::Camera { name, .. }) = camera.validate() else { panic!("{field} accepted") };
        assert_eq!(name, field);
    }
}

#[test]
fn points_behind_the_camera_have_no_pixel() {
    let ideal = camera(Distortion::None);
    for z in [0.0, -1.0, f64::NAN] {
        assert_eq!(ideal.project(Vector3::new(0.1, 0.1, z)), None);
    }
    assert_eq!(ideal.project(Vector3::new(f64::INFINITY, 0.0, 1.0)), None);
    assert_eq!(ideal.undistort([f64::NAN, 3.0])[1], 3.0);
}

#[test]
fn a_lens_that_folds_back_still_gives_finite_pixels() {
    let folding = camera(Distortion::Radtan { k1: -2.0, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 });
    for x in 0..640 {
        let pixel = folding.undistort([f64::from(x), 0.0]);
        assert!(pixel.iter().all(|v| v.is_finite()), "{pixel:?}");
    }
}

proptest! {
    // Failing cases are printed; files of them belong beside unit tests only.
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn undistort_inverts_distort(x in -20.0..660.0, y in -20.0..500.0, k1 in -0.2..0.3, p1 in -0.01..0.01) {
        for distortion in [FREIBURG1, Distortion::Radtan { k1, k2: 0.05, p1, p2: -p1, k3: 0.0 }, Distortion::None] {
            let lens = camera(distortion);
            let [bx, by] = lens.undistort(lens.distort([x, y]));
            prop_assert!((bx - x).abs() < 1e-8 && (by - y).abs() < 1e-8, "{bx} {by}");
        }
    }

    #[test]
    fn unproject_inverts_project(x in -5.0..5.0, y in -5.0..5.0, z in 0.1..20.0) {
        let ideal = camera(Distortion::None);
        let point = Vector3::new(x, y, z);
        let back = ideal.unproject(ideal.project(point).unwrap(), z);
        prop_assert!((back - point).norm() < 1e-10);
    }

    #[test]
    fn grid_query_equals_brute_force(
        pixels in prop::collection::vec(((-50.0..700.0), (-50.0..550.0), 0u8..8), 0..300),
        center in ((-80.0..720.0), (-80.0..560.0)), radius in -1.0..200.0, octave_min in 0u8..8, span in 0u8..4,
    ) {
        let points: Vec<[f64; 2]> = pixels.iter().map(|&(x, y, _)| [x, y]).collect();
        let octaves: Vec<u8> = pixels.iter().map(|&(.., octave)| octave).collect();
        let grid = KeypointGrid::build(&points, &octaves, Bounds { min: [0.0, 0.0], max: [640.0, 480.0] }, &Buffers::default());
        let mut found = vec![7];
        grid.query([center.0, center.1], radius, octave_min, octave_min + span, &mut found);
        found.sort_unstable();
        let expected: Vec<u32> = (0..points.len())
            .filter(|&i| (points[i][0] - center.0).abs() < radius && (points[i][1] - center.1).abs() < radius)
            .filter(|&i| (octave_min..=octave_min + span).contains(&octaves[i]))
            .map(|i| i as u32)
            .collect();
        prop_assert_eq!(found, expected);
    }

    #[test]
    fn all_distances_agree(a: [u64; 4], others: Vec<[u64; 4]>) {
        let naive = |b: &Descriptor| (0..256).filter(|i| (a[i / 64] ^ b[i / 64]) >> (i % 64) & 1 == 1).count() as u32;
        let expected: Vec<u32> = others.iter().map(naive).collect();
        prop_assert_eq!(&others.iter().map(|b| hamming(&a, b)).collect::<Vec<_>>(), &expected);
        let mut many = vec![3; others.len()];
        hamming_many(&a, &others, &mut many);
        prop_assert_eq!(&many, &expected);
        let indices: Vec<u32> = (0..others.len() as u32).rev().collect();
        let mut ranked: Vec<_> = indices.iter().map(|&i| (expected[i as usize], i)).collect();
        ranked.sort_unstable();
        ranked.resize(2.max(ranked.len()), (u32::MAX, u32::MAX));
        let nearest = nearest_two(&a, &others, &indices).map(|n| (n.distance, n.index));
        prop_assert_eq!(&nearest[..], &ranked[..2]);
    }
}

#[test]
fn extreme_distances() {
    assert_eq!(hamming(&[0; 4], &[u64::MAX; 4]), 256);
    assert_eq!(hamming(&[u64::MAX; 4], &[u64::MAX; 4]), 0);
}

#[test]
fn hostile_numbers_are_never_found_in_the_grid() {
    let points = [[f64::NAN, 1.0], [1.0, f64::INFINITY], [5.0, 5.0]];
    for max in [[640.0, 480.0], [0.0, 0.0], [f64::NAN, 1.0]] {
        let grid = KeypointGrid::build(&points, &[0; 3], Bounds { min: [0.0, 0.0], max }, &Buffers::default());
        let mut found = Vec::new();
        grid.query([4.0, 4.0], f64::INFINITY, 0, 9, &mut found);
        assert_eq!(found, [2]);
        grid.query([f64::NAN, 4.0], 10.0, 0, 9, &mut found);
        assert!(found.is_empty());
        grid.query([4.0, 4.0], f64::NAN, 0, 9, &mut found);
        assert!(found.is_empty());
    }
}

#[test]
fn gray_follows_the_formula_and_checks_the_size() {
    let rgb = [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255, 10, 20, 30];
    assert_eq!(gray_from_rgb(&rgb, 5, 1).unwrap().data, [76, 150, 29, 255, 18]);
    let error = gray_from_rgb(&rgb, 640, 480).unwrap_err();
    assert_eq!(error.to_string(), "an image of 640 x 480 needs 921600 values, the buffer holds 15");
}

/// The descriptors with every bit flipped with probability `flip`, and a share replaced by something else.
fn seen_again(originals: &[Descriptor], flip: f64, replaced: f64, seed: u64) -> Vec<Descriptor> {
    let mut rng = Rng::at(seed, 1, 0, 0);
    let mut again = Vec::new();
    for original in originals {
        let mut noisy = *original;
        let is_replaced = rng.uniform() < replaced;
        for bit in 0..256 {
            if rng.uniform() < if is_replaced { 0.5 } else { flip } {
                noisy[bit / 64] ^= 1 << (bit % 64);
            }
        }
        again.push(noisy);
    }
    again
}

fn numbered(descriptors: &[Descriptor]) -> Vec<(u32, Descriptor)> {
    (0..).zip(descriptors.iter().copied()).collect()
}

#[test]
fn the_place_index_finds_a_keyframe_among_hundreds() {
    let mut index = PlaceIndex::new();
    for id in 0..300 {
        index.add(id, &numbered(&descriptors(800, u64::from(id))));
    }
    for (target, flip, replaced) in [(0, 0.1, 0.5), (137, 0.2, 0.4), (299, 0.15, 0.7)] {
        let query = seen_again(&descriptors(800, u64::from(target)), flip, replaced, 9);
        let found = index.query(&query, 5, |_, _| true);
        assert_eq!(found[0].0, target, "{found:?}");
        assert!(found[0].1 >= 20 && found.get(1).is_none_or(|second| second.1 < 3), "{found:?}");
    }
    assert!(index.query(&descriptors(800, 5000), 5, |_, _| true).iter().all(|&(_, votes)| votes < 3));
    assert_eq!(index.query(&descriptors(800, 7), 0, |_, _| true), []);
}

#[test]
fn the_place_index_forgets_and_does_not_depend_on_history() {
    let (mut direct, mut detour) = (PlaceIndex::new(), PlaceIndex::new());
    let of = |id: u32| descriptors(200, u64::from(id % 7));
    for id in 0..20 {
        direct.add(id, &numbered(&of(id)));
    }
    for id in (0..40).rev() {
        detour.add(id, &numbered(&of(id + 1)));
    }
    for id in 20..40 {
        assert!(detour.remove(id));
        assert!(!detour.remove(id));
    }
    for id in [3, 17, 0, 1, 2, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18, 19] {
        detour.add(id, &numbered(&of(id)));
    }
    assert_eq!((direct.len(), detour.len()), (20, 20));
    for seed in 0..7 {
        let query = seen_again(&descriptors(200, seed), 0.1, 0.2, 3);
        let found = direct.query(&query, 100, |_, _| true);
        assert_eq!(found, detour.query(&query, 100, |_, _| true));
        // Equal keyframes have equal scores and come by id.
        assert_eq!(found[0].0, seed as u32);
        assert!(found.windows(2).all(|w| (w[1].1, w[0].0) < (w[0].1, w[1].0) || w[0].1 > w[1].1));
    }
    for id in 0..20 {
        detour.remove(id);
    }
    assert!(detour.is_empty() && detour.query(&of(0), 5, |_, _| true).is_empty());
    detour.add(1, &[]);
    assert!(detour.query(&of(0), 5, |_, _| true).is_empty() && detour.query(&[], 5, |_, _| true).is_empty());
}

#[test]
fn a_flood_of_equal_descriptors_is_searched_in_part() {
    let mut index = PlaceIndex::new();
    for id in 0..5 {
        index.add(id, &numbered(&[[0; 4]; 1000]));
    }
    let found = index.query(&[[0; 4]; 1000], 5, |_, _| true);
    assert!(found.iter().all(|(_, votes)| *votes <= 8), "{found:?}");
}

#[test]
fn a_keypoint_that_lost_its_vote_has_none() {
    let mut index = PlaceIndex::new();
    let known = descriptors(300, 1);
    index.add(4, &numbered(&known));
    let all = index.query(&known, 5, |_, _| true);
    assert_eq!(all, [(4, 300)]);
    let odd = index.query(&known, 5, |keyframe, keypoint| keyframe == 4 && keypoint % 2 == 1);
    assert_eq!(odd, [(4, 150)]);
    assert_eq!(index.query(&known, 5, |_, _| false), []);
}
