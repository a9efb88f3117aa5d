//! Search and rotation check on keypoints made by hand.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use slam::matching::{Limits, Match, Query, consistent_rotation, project, search};
use slam::observation::Observation;
use slam_math::{Buffers, Rng, Se3};
use slam_vision::{Descriptor, KeypointGrid};

use crate::support::{camera, descriptor, observation};

const LIMITS: Limits = Limits { hamming: 60, ratio: 0.8 };

/// `base` with the `n` lowest bits changed.
fn off_by(base: Descriptor, n: u32) -> Descriptor {
    [base[0] ^ ((1u64 << n) - 1), base[1], base[2], base[3]]
}

fn query(key: u32, pixel: [f64; 2], descriptor: Descriptor) -> Query<u32> {
    Query { key, pixel, radius: 20.0, octaves: [0, 7], depth_m: None, descriptor }
}

fn found(obs: &Observation, queries: &[Query<u32>]) -> Vec<(u32, u32, u32)> {
    search(obs, queries, LIMITS, &Buffers::default(), |_| true).iter().map(|m| (m.key, m.index, m.distance)).collect()
}

#[test]
fn the_nearest_descriptor_within_the_window_wins() {
    let wanted = descriptor(1, 0);
    let obs = observation(
        &[[100.0, 100.0], [110.0, 100.0], [150.0, 100.0]],
        &[off_by(wanted, 30), off_by(wanted, 10), wanted],
    );
    assert_eq!(found(&obs, &[query(5, [102.0, 100.0], wanted)]), [(5, 1, 10)]);
    assert_eq!(found(&obs, &[query(5, [250.0, 100.0], wanted)]), []);
    assert_eq!(found(&obs, &[query(5, [102.0, 100.0], descriptor(1, 9))]), [], "too far in Hamming distance");
    let only_first = search(&obs, &[query(5, [102.0, 100.0], wanted)], LIMITS, &Buffers::default(), |i| i == 0);
    assert_eq!(only_first.iter().map(|m| m.index).collect::<Vec<_>>(), [0]);
}

#[test]
fn rivals_on_the_same_level_are_ambiguous() {
    let wanted = descriptor(1, 0);
    let mut obs = observation(&[[100.0, 100.0], [110.0, 100.0]], &[off_by(wanted, 20), off_by(wanted, 22)]);
    let queries = [query(1, [105.0, 100.0], wanted)];
    assert_eq!(found(&obs, &queries), []);
    let without_ratio = search(&obs, &queries, Limits { ratio: 1.0, ..LIMITS }, &Buffers::default(), |_| true);
    assert_eq!(without_ratio[..], [Match { key: 1, index: 0, distance: 20 }]);
    obs.octave[1] = 1;
    obs.grid = KeypointGrid::build(&obs.pixel, &obs.octave, camera().undistorted_bounds(), &Buffers::default());
    assert_eq!(found(&obs, &queries), [(1, 0, 20)], "the same corner on two levels is no rival");
    let coarse = Query { octaves: [1, 1], ..queries[0].clone() };
    assert_eq!(found(&obs, &[coarse]), [(1, 1, 22)]);
}

#[test]
fn measured_depth_must_agree_and_missing_depth_passes() {
    let wanted = descriptor(1, 0);
    let mut obs = observation(&[[100.0, 100.0]], &[wanted]);
    let at = |expected: f64| Query { depth_m: Some((expected, 0.1)), ..query(1, [100.0, 100.0], wanted) };
    assert_eq!(found(&obs, &[at(2.05)]).len(), 1);
    assert_eq!(found(&obs, &[at(2.15)]).len(), 0);
    obs.depth_m[0] = 0.0;
    assert_eq!(found(&obs, &[at(2.15)]).len(), 1);
}

#[test]
fn a_keypoint_goes_to_the_nearest_query_then_to_the_smallest_key() {
    let wanted = descriptor(1, 0);
    let obs = observation(&[[100.0, 100.0]], &[wanted]);
    let [far, near] = [query(1, [100.0, 100.0], off_by(wanted, 9)), query(2, [100.0, 100.0], off_by(wanted, 3))];
    assert_eq!(found(&obs, &[far.clone(), near.clone()]), [(2, 0, 3)]);
    let twin = Query { key: 0, ..near.clone() };
    assert_eq!(found(&obs, &[near, twin, far]), [(0, 0, 3)]);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_order_of_queries_does_not_matter(seed in 0..1000u32) {
        let mut rng = Rng::at(1, seed, 0, 0);
        let pixels: Vec<[f64; 2]> = (0..60).map(|_| [rng.uniform() * 320.0, rng.uniform() * 240.0]).collect();
        // Few different descriptors: contests and ties.
        let look = |rng: &mut Rng| off_by(descriptor(1, rng.below(3) as u32), rng.below(20) as u32);
        let descriptors: Vec<Descriptor> = pixels.iter().map(|_| look(&mut rng)).collect();
        let obs = observation(&pixels, &descriptors);
        let mut queries: Vec<Query<u32>> = (0..80)
            .map(|key| query(key, [rng.uniform() * 320.0, rng.uniform() * 240.0], look(&mut rng)))
            .collect();
        let straight = found(&obs, &queries);
        queries.reverse();
        prop_assert_eq!(&found(&obs, &queries), &straight);
        for i in (1..queries.len()).rev() {
            queries.swap(i, rng.below(i + 1));
        }
        prop_assert_eq!(&found(&obs, &queries), &straight);
        prop_assert!(straight.is_sorted_by(|a, b| a.1 < b.1), "each keypoint once");
        let mut keys: Vec<u32> = straight.iter().map(|m| m.0).collect();
        keys.sort_unstable();
        prop_assert!(keys.is_sorted_by(|a, b| a < b), "each query once");
    }
}

#[test]
fn matches_that_turned_differently_are_dropped() {
    let matches: Vec<Match<u32>> = (0..40).map(|i| Match { key: i, index: i, distance: 1 }).collect();
    // Thirty turned by 0.3 rad (some written as a full turn more or less), two by 2 rad, eight each differently.
    let turn = |m: &Match<u32>| match m.key {
        0..=9 => 0.3f32,
        10..=19 => 0.3 + std::f32::consts::TAU,
        20..=29 => 0.3 - std::f32::consts::TAU,
        30..=31 => 2.0,
        i => 2.5 + 0.3 * (i - 32) as f32,
    };
    let kept = consistent_rotation(matches.into(), turn);
    assert_eq!(kept.iter().map(|m| m.key).collect::<Vec<_>>(), (0..30).collect::<Vec<_>>());
    assert!(consistent_rotation(Vec::<Match<u32>>::new().into(), |_| 0.0).is_empty());
    let nan = consistent_rotation(vec![Match { key: 0, index: 0, distance: 0 }].into(), |_| f32::NAN);
    assert_eq!(nan.len(), 1, "NaN falls into some bin");
}

#[test]
fn projection_is_none_outside_the_picture_and_behind_the_camera() {
    let (camera, here) = (camera(), Se3::identity());
    let ([x, y], z) = project(&camera, &here, &nalgebra::Vector3::new(0.0, 0.0, 2.0)).unwrap();
    assert_eq!((x, y, z), (camera.cx, camera.cy, 2.0));
    for p in [[0.0, 0.0, -2.0], [0.0, 0.0, 0.0], [9.0, 0.0, 1.0], [f64::NAN, 0.0, 1.0], [0.0, 0.0, f64::NAN]] {
        assert_eq!(project(&camera, &here, &p.into()), None, "{p:?}");
    }
}
