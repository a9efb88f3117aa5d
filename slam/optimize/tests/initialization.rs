//! The start of a monocular map from two views.

mod scene;

use nalgebra::{Vector3, Vector6};
use proptest::prelude::*;
use scene::{CAMERA, point};
use slam_math::{Rng, Se3};
use slam_optimize::{TwoViewFailure, TwoViewModel, TwoViewOptions, TwoViewReconstruction, two_view_reconstruction};

type Pixels = Vec<[f64; 2]>;

/// Matches of points in the first camera's frame, a fifth of them wrong, half a pixel of noise.
fn matches(rng: &mut Rng, motion: &Se3, points: &[Vector3<f64>]) -> (Pixels, Pixels) {
    let noisy = |pixel: [f64; 2], rng: &mut Rng| pixel.map(|v| v + 0.5 * rng.normal());
    let pair = |(i, x): (usize, &Vector3<f64>)| {
        let second = CAMERA.project(&motion.transform(x)).expect("in front");
        let wrong = [640.0 * rng.uniform(), 480.0 * rng.uniform()];
        (noisy(CAMERA.project(x).expect("in front"), rng), noisy(if i % 5 == 0 { wrong } else { second }, rng))
    };
    points.iter().enumerate().map(pair).unzip()
}

fn solve(first: &Pixels, second: &Pixels) -> Result<TwoViewReconstruction, TwoViewFailure> {
    two_view_reconstruction(&mut Rng::at(7, 0, 0, 0), &CAMERA, first, second, &TwoViewOptions::default())
}

/// A tilted plane with a picture on it.
fn plane(rng: &mut Rng) -> Vector3<f64> {
    let [x, y] = [2.5 * (rng.uniform() - 0.5), 2.0 * (rng.uniform() - 0.5)];
    Vector3::new(x, y, 3.0 + 0.5 * x - 0.3 * y)
}

/// Rotation error and angle between the translations, radians.
fn errors(found: &Se3, truth: &Se3) -> (f64, f64) {
    let turn = Se3 { rotation: found.rotation * truth.rotation.transpose(), translation: Vector3::zeros() };
    let cross = found.translation.cross(&truth.translation.normalize());
    assert!(found.translation.dot(&truth.translation) > 0.0);
    (turn.angle(), cross.norm())
}

#[test]
fn motion_and_points_come_back_up_to_scale() {
    let mut ambiguous = 0;
    for (seed, flat) in (0..20).flat_map(|seed| [(seed, false), (seed, true)]) {
        let mut rng = Rng::at(seed, 1, 0, 0);
        let sideways = Vector6::new(0.5, 0.1, 0.1, 0.0, -0.08, 0.02);
        let motion = Se3::exp(&(sideways + Vector6::from_fn(|_, _| 0.02 * rng.normal())));
        let points: Vec<_> = (0..300).map(|_| if flat { plane(&mut rng) } else { point(&mut rng) }).collect();
        let (first, second) = matches(&mut rng, &motion, &points);
        let found = match solve(&first, &second) {
            // A plane's two motions may both put most of it in front (Faugeras and Lustman 1988).
            Err(TwoViewFailure::Ambiguous { .. }) if flat => {
                ambiguous += 1;
                continue;
            }
            found => found.unwrap(),
        };
        assert_eq!(found.model, if flat { TwoViewModel::Homography } else { TwoViewModel::Fundamental });
        assert!((found.second_from_first.translation.norm() - 1.0).abs() < 1e-12);
        let (turn, direction) = errors(&found.second_from_first, &motion);
        assert!(turn < 0.01 && direction < 0.06, "seed {seed}, flat {flat}: {turn} {direction}");
        assert!(found.points > 200 && found.parallax_rad > 0.05, "{} {}", found.points, found.parallax_rad);
        let unit = motion.translation.norm();
        let error = |(found, truth): (&Option<Vector3<f64>>, &Vector3<f64>)| {
            found.map(|found| (found * unit - truth).norm() / truth.norm())
        };
        let mut relative: Vec<f64> = found.points_in_first.iter().zip(&points).filter_map(error).collect();
        let median = slam_math::float::median_in_place(&mut relative).unwrap();
        assert!(median < 0.05, "seed {seed}, flat {flat}: {median}");
    }
    assert!(ambiguous <= 10, "{ambiguous} of 20 planes");
}

#[test]
fn views_that_determine_nothing_are_refused() {
    let mut rng = Rng::at(2, 0, 0, 0);
    let points: Vec<_> = (0..300).map(|_| point(&mut rng)).collect();
    let mut refused = |motion: Vector6<f64>| {
        let (first, second) = matches(&mut rng, &Se3::exp(&motion), &points);
        solve(&first, &second).expect_err("the views determine nothing")
    };
    let low = |failure: TwoViewFailure| {
        matches!(failure, TwoViewFailure::TooFewPoints { .. } | TwoViewFailure::LowParallax { .. })
    };
    assert!(low(refused(Vector6::zeros())));
    assert!(low(refused(Vector6::new(0.0, 0.0, 0.0, 0.05, -0.1, 0.02))));
    assert!(low(refused(Vector6::new(0.005, 0.0, 0.0, 0.0, 0.0, 0.0))));
    let [a, b]: [Pixels; 2] =
        std::array::from_fn(|_| (0..300).map(|_| [640.0 * rng.uniform(), 480.0 * rng.uniform()]).collect());
    assert!(solve(&a, &b).is_err());
    assert_eq!(solve(&a, &b[..9].to_vec()), Err(TwoViewFailure::Unpaired { first: 300, second: 9 }));
    let few = solve(&a[..9].to_vec(), &b[..9].to_vec());
    assert_eq!(few, Err(TwoViewFailure::TooFewMatches { matches: 9, needed: 50 }));
    let nan = vec![[f64::NAN; 2]; 300];
    assert_eq!(solve(&a, &nan), Err(TwoViewFailure::TooFewMatches { matches: 0, needed: 50 }));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn any_matches_are_survived(pixels in proptest::collection::vec(any::<[f64; 4]>(), 50..80)) {
        let (first, second) = pixels.iter().map(|p| ([p[0], p[1]], [p[2], p[3]])).unzip();
        let _ = solve(&first, &second);
    }
}
