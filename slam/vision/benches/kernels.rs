//! Times of the vision kernels on one core: `cargo bench -p slam-vision`.
//!
//! The picture is a seeded collage of rectangles with noise: corners on every level, no recording needed.

use divan::{Bencher, black_box};
use slam_math::Rng;
use slam_vision::{
    Bounds, Descriptor, GrayImage, Image, Kernels, KeypointGrid, OrbConfig, OrbExtractor, PlaceIndex, Workspace,
    gray_from_rgb, hamming, hamming_at, hamming_many,
};

fn main() {
    divan::main();
}

fn collage() -> GrayImage {
    let mut rng = Rng::at(1, 0, 0, 0);
    let mut image = Image::new(640, 480, 128u8);
    for _ in 0..1500 {
        let (x, y) = (rng.below(640) as usize, rng.below(480) as usize);
        let (width, height, gray) = (4 + rng.below(40) as usize, 4 + rng.below(40) as usize, rng.below(256) as u8);
        for row in image.data.chunks_exact_mut(640).skip(y).take(height) {
            row[x..(x + width).min(640)].fill(gray);
        }
    }
    for pixel in &mut image.data {
        *pixel = pixel.saturating_add(rng.below(8) as u8);
    }
    image
}

fn descriptors(count: usize, seed: u64) -> Vec<Descriptor> {
    let mut rng = Rng::at(seed, 0, 0, 0);
    (0..count).map(|_| std::array::from_fn(|_| rng.next_u64())).collect()
}

#[divan::bench(args = [true, false])]
fn extract_640x480_1000_features(bencher: Bencher<'_, '_>, wide: bool) {
    let kernels = if wide { Kernels::detect() } else { Kernels::scalar() };
    let extractor = OrbExtractor::with_kernels(&OrbConfig::default(), kernels).unwrap();
    let (image, mut workspace) = (collage(), Workspace::default());
    bencher.bench_local(|| extractor.extract_with(black_box(&image), &mut workspace));
}

#[divan::bench]
fn gray_640x480(bencher: Bencher<'_, '_>) {
    let rgb: Vec<u8> = collage().data.iter().flat_map(|&v| [v, v / 2, 255 - v]).collect();
    bencher.bench_local(|| gray_from_rgb(black_box(&rgb), 640, 480));
}

#[divan::bench]
fn hamming_1000x1000_one_by_one(bencher: Bencher<'_, '_>) {
    let (a, b) = (descriptors(1000, 1), descriptors(1000, 2));
    bencher.bench_local(|| a.iter().flat_map(|a| b.iter().map(move |b| hamming(a, b))).min());
}

#[divan::bench]
fn hamming_1000x1000_many(bencher: Bencher<'_, '_>) {
    let (a, b, mut out) = (descriptors(1000, 1), descriptors(1000, 2), Vec::new());
    bencher.bench_local(|| a.iter().for_each(|a| hamming_many(a, black_box(&b), &mut out)));
}

#[divan::bench]
fn grid_query_and_match_1000(bencher: Bencher<'_, '_>) {
    let mut rng = Rng::at(3, 0, 0, 0);
    let pixels: Vec<[f64; 2]> = (0..1000).map(|_| [rng.uniform() * 640.0, rng.uniform() * 480.0]).collect();
    let (octaves, words) = (vec![0; 1000], descriptors(1000, 4));
    let grid = KeypointGrid::build(&pixels, Bounds { min: [0.0; 2], max: [640.0, 480.0] });
    let (mut near, mut distances) = (Vec::new(), Vec::new());
    bencher.bench_local(|| {
        for (pixel, word) in pixels.iter().zip(&words) {
            grid.query(*pixel, 15.0, 0, 1, &octaves, &mut near);
            hamming_at(word, &words, &near, &mut distances);
        }
    });
}

#[divan::bench]
fn place_query_among_300_keyframes(bencher: Bencher<'_, '_>) {
    let mut index = PlaceIndex::new();
    for id in 0..300 {
        index.add(id, &descriptors(1000, 100 + u64::from(id)));
    }
    let query = descriptors(1000, 250);
    bencher.bench_local(|| index.query(black_box(&query), 5));
}
