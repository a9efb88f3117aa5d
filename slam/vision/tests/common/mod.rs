//! Pictures for tests and benchmarks.
#![allow(dead_code, unreachable_pub, reason = "each test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "a failing helper fails its test")]

use std::path::Path;

use slam_math::Rng;
use slam_vision::{Descriptor, GrayImage, Image, gray_from_rgb};

/// A seeded pile of grey rectangles with a little noise: corners at every scale.
pub fn collage(width: usize, height: usize) -> GrayImage {
    let mut rng = Rng::at(1, 0, 0, 0);
    let mut image = Image::new(width, height, 128u8);
    for _ in 0..width * height / 200 {
        let (x, y) = (rng.below(width), rng.below(height));
        let (columns, rows, gray) = (4 + rng.below(40), 4 + rng.below(40), rng.below(248) as u8);
        for row in image.data.chunks_exact_mut(width).skip(y).take(rows) {
            row[x..(x + columns).min(width)].fill(gray);
        }
    }
    for pixel in &mut image.data {
        *pixel += rng.below(8) as u8;
    }
    image
}

/// Pixels without any structure.
pub fn noise(width: usize, height: usize, seed: u64) -> GrayImage {
    let mut rng = Rng::at(seed, 0, 0, 0);
    let data = (0..width * height).map(|_| rng.below(256) as u8).collect();
    Image::from_vec(width, height, data).unwrap()
}

/// Independent random descriptors.
pub fn descriptors(count: usize, seed: u64) -> Vec<Descriptor> {
    let mut rng = Rng::at(seed, 0, 0, 0);
    (0..count).map(|_| std::array::from_fn(|_| rng.next_u64())).collect()
}

/// The colour frames (640 x 480) of a recording from `start` on, every `step`th; empty with a message when the shared
/// recordings are absent.
pub fn recorded_frames(name: &str, start: usize, step: usize) -> Vec<GrayImage> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name).join("rgb");
    let Ok(entries) = std::fs::read_dir(&folder) else {
        eprintln!("skipped: no recording at {}", folder.display());
        return Vec::new();
    };
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let decode = |file: &std::path::PathBuf| {
        let bytes = std::fs::read(file).unwrap();
        let mut decoder = zune_jpeg::JpegDecoder::new(zune_core::bytestream::ZCursor::new(&bytes));
        let rgb = decoder.decode().unwrap();
        let (width, height) = decoder.dimensions().unwrap();
        gray_from_rgb(&rgb, width, height).unwrap()
    };
    files.iter().skip(start).step_by(step).map(decode).collect()
}
