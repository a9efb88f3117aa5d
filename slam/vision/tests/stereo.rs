//! Disparities of made-up pairs whose disparity is known.

#![allow(clippy::unwrap_used, missing_docs)] // a test may panic, and has no readers of its documentation

use slam_math::Rng;
use slam_vision::{GrayImage, OrbConfig, OrbExtractor, StereoOptions, Workspace};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

const OPTIONS: StereoOptions =
    StereoOptions { hamming: 75, row_px: 2.0, window_px: 5, slide_px: 5, outlier_factor: 2.1, max_disparity_px: 200.0 };

/// A wall of grey values that can be read between its lattice points.
fn wall(x: f64, y: f64) -> f64 {
    let (x, y) = (x / 4.0 + 100.0, y / 4.0 + 100.0);
    let at = |i: f64, j: f64| Rng::at(3, i as u32, j as u32, 0).uniform().abs() * 255.0;
    let (x0, y0) = (x.floor(), y.floor());
    let (u, v) = (x - x0, y - y0);
    let line = |j: f64| at(x0, j) * (1.0 - u) + at(x0 + 1.0, j) * u;
    line(y0) * (1.0 - v) + line(y0 + 1.0) * v
}

/// The wall as a camera sees it whose picture is shifted by `shift(y)` pixels.
fn picture(shift: impl Fn(usize) -> f64) -> GrayImage {
    let pixel = |i: usize| wall((i % WIDTH) as f64 + shift(i / WIDTH), (i / WIDTH) as f64).clamp(0.0, 255.0) as u8;
    GrayImage::from_vec(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(pixel).collect()).unwrap()
}

fn disparities(left: &GrayImage, right: &GrayImage) -> Vec<([f32; 2], Option<f64>)> {
    let extractor = OrbExtractor::new(&OrbConfig::default()).unwrap();
    let (features, found) = extractor.extract_pair(left, right, None, &OPTIONS, &mut Workspace::default());
    features.pixel.iter().copied().zip(found.iter().copied()).collect()
}

#[test]
fn the_shift_is_found_to_a_fraction_of_a_pixel() {
    for shift in [0.4, 12.3, 57.75] {
        let found = disparities(&picture(|_| 0.0), &picture(|_| shift));
        let sure: Vec<f64> = found.iter().filter_map(|(_, d)| *d).collect();
        let near = sure.iter().filter(|d| (*d - shift).abs() < 0.5).count();
        assert!(sure.len() * 2 > found.len(), "{} of {} at {shift}", sure.len(), found.len());
        assert!(near * 100 >= sure.len() * 95, "{near} of {} near {shift}", sure.len());
    }
}

#[test]
fn two_walls_have_their_own_disparities() {
    let shift = |y: usize| if y < HEIGHT / 2 { 8.0 } else { 30.0 };
    let found = disparities(&picture(|_| 0.0), &picture(shift));
    for (pixel, disparity) in found.into_iter().filter(|(p, _)| (p[1] - 120.0).abs() > 40.0) {
        let expected = shift(pixel[1] as usize);
        if let Some(d) = disparity {
            assert!((d - expected).abs() < 1.0, "{d} at row {}, wanted {expected}", pixel[1]);
        }
    }
}

#[test]
fn what_lies_on_the_wrong_side_or_nowhere_has_no_disparity() {
    // Farther right in the right picture: behind the cameras.
    let behind = disparities(&picture(|_| 0.0), &picture(|_| -20.0));
    assert!(behind.iter().filter(|(_, d)| d.is_some()).count() * 20 < behind.len());
    let black = GrayImage::new(WIDTH, HEIGHT, 0);
    assert!(disparities(&picture(|_| 0.0), &black).iter().all(|(_, d)| d.is_none()));
    assert!(disparities(&black, &black).is_empty());
}
