//! Times of the vision kernels on one core: `cargo bench -p slam-vision`.
//!
//! The picture is a seeded collage of rectangles with noise: corners on every level, no recording needed.
#![allow(clippy::unwrap_used, reason = "the settings are constants")]

#[path = "../tests/common/mod.rs"]
mod common;

use common::{collage, descriptors, recorded_frames};
use divan::{Bencher, black_box};
use slam_math::{Buffers, Rng};
use slam_vision::{
    Bounds, Kernels, KeypointGrid, OrbConfig, OrbExtractor, PlaceIndex, Workspace, gray_from_rgb, hamming,
    hamming_many, nearest_two,
};

fn main() {
    divan::main();
}

#[divan::bench(args = [true, false])]
fn extract_640x480_1000_features(bencher: Bencher<'_, '_>, wide: bool) {
    let kernels = if wide { Kernels::detect() } else { Kernels::scalar() };
    let extractor = OrbExtractor::with_kernels(&OrbConfig::default(), kernels).unwrap();
    let (image, mut workspace) = (collage(640, 480), Workspace::default());
    bencher.bench_local(|| extractor.extract_with(black_box(&image), None, &mut workspace));
}

/// Does nothing when the shared recordings are absent.
#[divan::bench]
fn extract_recorded_640x480(bencher: Bencher<'_, '_>) {
    let extractor = OrbExtractor::new(&OrbConfig::default()).unwrap();
    let mut workspace = Workspace::default();
    if let Some(image) = recorded_frames("kitchen_static", 0, 1_000_000).first() {
        bencher.bench_local(|| extractor.extract_with(black_box(image), None, &mut workspace));
    }
}

/// Real descriptors crowd into few buckets; random ones do not. Does nothing when the shared recordings are absent.
#[divan::bench]
fn place_query_among_all_recorded_keyframes(bencher: Bencher<'_, '_>) {
    let extractor = OrbExtractor::new(&OrbConfig::default()).unwrap();
    let mut index = PlaceIndex::new();
    let mut query = Vec::new();
    for name in ["kitchen_static", "kitchen_moving_box", "kitchen_placing_box", "kitchen_robots_people"] {
        for image in recorded_frames(name, 0, 6) {
            query = extractor.extract(&image).descriptor.to_vec();
            index.add(index.len() as u32, &numbered(&query));
        }
    }
    if !index.is_empty() {
        bencher.bench_local(|| index.query(black_box(&query), 5, |_, _| true));
    }
}

#[divan::bench]
fn gray_640x480(bencher: Bencher<'_, '_>) {
    let rgb: Vec<u8> = collage(640, 480).data.iter().flat_map(|&v| [v, v / 2, 255 - v]).collect();
    bencher.bench_local(|| gray_from_rgb(black_box(&rgb), 640, 480));
}

#[divan::bench]
fn hamming_1000x1000_one_by_one(bencher: Bencher<'_, '_>) {
    let (a, b) = (descriptors(1000, 1), descriptors(1000, 2));
    bencher.bench_local(|| a.iter().flat_map(|a| b.iter().map(move |b| hamming(a, b))).min());
}

#[divan::bench]
fn hamming_1000x1000_many(bencher: Bencher<'_, '_>) {
    let (a, b, mut out) = (descriptors(1000, 1), descriptors(1000, 2), vec![0; 1000]);
    bencher.bench_local(|| a.iter().for_each(|a| hamming_many(a, black_box(&b), &mut out)));
}

#[divan::bench]
fn nearest_two_1000x1000(bencher: Bencher<'_, '_>) {
    let (a, b) = (descriptors(1000, 1), descriptors(1000, 2));
    let all: Vec<u32> = (0..1000).collect();
    bencher.bench_local(|| a.iter().map(|a| nearest_two(a, black_box(&b), &all)[0]).min());
}

#[divan::bench]
fn grid_query_and_match_1000(bencher: Bencher<'_, '_>) {
    let mut rng = Rng::at(3, 0, 0, 0);
    let pixels: Vec<[f64; 2]> = (0..1000).map(|_| [rng.uniform() * 640.0, rng.uniform() * 480.0]).collect();
    let (octaves, words) = (vec![0; 1000], descriptors(1000, 4));
    let grid =
        KeypointGrid::build(&pixels, &octaves, Bounds { min: [0.0; 2], max: [640.0, 480.0] }, &Buffers::default());
    let mut near = Vec::new();
    bencher.bench_local(|| {
        let best = pixels.iter().zip(&words).map(|(pixel, word)| {
            grid.query(*pixel, 15.0, 0, 1, &mut near);
            nearest_two(word, &words, &near)[0]
        });
        best.max()
    });
}

#[divan::bench]
fn place_query_among_300_keyframes(bencher: Bencher<'_, '_>) {
    let mut index = PlaceIndex::new();
    for id in 0..300 {
        index.add(id, &numbered(&descriptors(1000, 100 + u64::from(id))));
    }
    let query = descriptors(1000, 250);
    bencher.bench_local(|| index.query(black_box(&query), 5, |_, _| true));
}

fn numbered(descriptors: &[slam_vision::Descriptor]) -> Vec<(u32, slam_vision::Descriptor)> {
    (0..).zip(descriptors.iter().copied()).collect()
}
