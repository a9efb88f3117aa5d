//! Depth and label of a keypoint.

use slam::config::SensorConfig;
use slam::observation::Observation;
use slam::{Config, FrameInput};
use slam_math::Buffers;

use crate::support::{HEIGHT, WIDTH, blank, camera, depth, features, mask};

/// Depth read at a pixel of a picture that `units` paints.
fn read(pixel: [f32; 2], sensor: &SensorConfig, units: impl Fn(usize, usize) -> u16) -> Option<f64> {
    let picture = (0..WIDTH * HEIGHT).map(|i| units(i % WIDTH, i / WIDTH)).collect();
    let input = FrameInput { depth: Some(depth(picture)), ..blank(0, 0) };
    Observation::new(features(&[pixel]), &input, &camera(), sensor, &Buffers::default()).depth(0)
}

fn sensor() -> SensorConfig {
    Config::default().sensor
}

#[test]
fn depth_is_the_median_of_the_window() {
    // Rows differ by 10 mm: the middle row is the median. Halves round up.
    let rows = |_: usize, y: usize| 1100 + 10 * y as u16;
    assert_eq!(read([100.0, 100.0], &sensor(), rows), Some(2.1));
    assert_eq!(read([100.0, 100.4], &sensor(), rows), Some(2.1));
    assert_eq!(read([100.0, 100.5], &sensor(), rows), Some(2.11));
}

#[test]
fn a_depth_step_in_the_window_gives_none() {
    let step = |x: usize, _: usize| if x < 102 { 2000 } else { 3000 };
    for (x, expected) in [(99.0, Some(2.0)), (100.0, None), (101.0, None), (103.0, None), (104.0, Some(3.0))] {
        assert_eq!(read([x, 100.0], &sensor(), step), expected, "at {x}");
    }
    let single = |x: usize, y: usize| if (x, y) == (101, 101) { 500 } else { 2000 };
    assert_eq!(read([100.0, 100.0], &sensor(), single), None, "one pixel of another surface");
}

#[test]
fn half_of_the_window_must_be_measured() {
    let holes = |filled: usize| move |x: usize, y: usize| if y < 98 + filled && x < 110 { 2000 } else { 0 };
    assert_eq!(read([100.0, 100.0], &sensor(), holes(3)), Some(2.0));
    assert_eq!(read([100.0, 100.0], &sensor(), holes(2)), None);
    assert_eq!(read([0.0, 0.0], &sensor(), |_, _| 2000), None, "9 of 25 pixels are inside at a corner");
}

#[test]
fn only_trusted_depths_count() {
    let sensor = sensor();
    for (units, expected) in [(0, None), (199, None), (200, Some(0.2)), (10_000, Some(10.0)), (10_001, None)] {
        assert_eq!(read([100.0, 100.0], &sensor, |_, _| units), expected);
    }
}

#[test]
fn nothing_is_nan_whatever_the_scale() {
    for scale in [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e-300, 1e300] {
        let mut picture = depth(vec![2000; WIDTH * HEIGHT]);
        std::sync::Arc::make_mut(&mut picture).metres_per_unit = scale;
        let input = FrameInput { depth: Some(picture), ..blank(0, 0) };
        let obs = Observation::new(
            features(&[[50.0, 50.0], [160.0, 120.0]]),
            &input,
            &camera(),
            &sensor(),
            &Buffers::default(),
        );
        assert_eq!(obs.depth_m[..], [0.0; 2], "scale {scale}");
    }
}

#[test]
fn labels_are_those_of_the_nearest_pixel() {
    let ids = (0..WIDTH * HEIGHT).map(|i| if i % WIDTH < 100 { 3 } else { 9 }).collect();
    let input = FrameInput { panoptic: Some(mask(ids, &[(3, 199), (9, 1)])), ..blank(0, 0) };
    let pixels = features(&[[99.4, 50.0], [99.5, 50.0], [319.6, 10.0]]);
    let obs = Observation::new(pixels.clone(), &input, &camera(), &sensor(), &Buffers::default());
    assert_eq!(obs.label[..], [3, 9, 0], "0 outside the picture");
    assert_eq!(Observation::new(pixels, &blank(0, 0), &camera(), &sensor(), &Buffers::default()).label[..], [0; 3]);
}

#[test]
fn no_keypoints_is_a_valid_observation() {
    let obs = Observation::new(features(&[]), &blank(0, 0), &camera(), &sensor(), &Buffers::default());
    assert!(obs.is_empty());
    assert_eq!(obs.len(), 0);
}
