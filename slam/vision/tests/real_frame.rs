//! Recorded frames (skipped when the shared recordings are absent).

mod common;

use common::recorded_frames;
use slam_vision::{Kernels, OrbConfig, OrbExtractor, PlaceIndex, Workspace};

#[test]
fn a_recorded_frame_gives_a_thousand_spread_features() {
    let frames = recorded_frames("kitchen_static", 0, 1_000_000);
    let Some(gray) = frames.first() else { return };
    let features = OrbExtractor::new(&OrbConfig::default()).unwrap().extract(gray);
    assert!((950..=1000).contains(&features.len()), "{} features", features.len());

    // Corners are where texture is, but a kitchen has some nearly everywhere.
    let mut filled = [false; 8 * 6];
    for [x, y] in &features.pixel {
        filled[*x as usize * 8 / gray.width + (*y as usize * 6 / gray.height) * 8] = true;
    }
    let filled = filled.iter().filter(|&&block| block).count();
    assert!(filled >= 36, "{filled} of 48 blocks have features");
    for octave in 0..8 {
        assert!(features.octave.contains(&octave), "no features at octave {octave}");
    }

    let scalar = OrbExtractor::with_kernels(&OrbConfig::default(), Kernels::scalar()).unwrap();
    assert_eq!(scalar.extract(gray), features);
}

#[test]
fn the_place_index_finds_the_neighbours_of_a_recorded_frame() {
    let extractor = OrbExtractor::new(&OrbConfig::default()).unwrap();
    let mut workspace = Workspace::default();
    let mut index = PlaceIndex::new();
    for (id, gray) in recorded_frames("kitchen_static", 0, 10).iter().enumerate() {
        let descriptors = extractor.extract_with(gray, None, &mut workspace).descriptor;
        index.add(id as u32, &(0..).zip(descriptors.iter().copied()).collect::<Vec<_>>());
    }
    let queries = recorded_frames("kitchen_static", 5, 30);
    let mut misses = 0;
    for (k, gray) in queries.iter().enumerate() {
        let found = index.query(&extractor.extract_with(gray, None, &mut workspace).descriptor, 3, |_, _| true);
        // Frame 5 + 30 k lies half-way between stored frames 3 k and 3 k + 1.
        let (id, votes) = found[0];
        eprintln!("query {k}: {found:?}");
        misses += usize::from(id.abs_diff(3 * k as u32) > 2 || votes < 50);
    }
    assert!(misses * 10 <= queries.len(), "{misses} of {} queries led elsewhere", queries.len());
}
