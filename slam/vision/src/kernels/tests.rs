//! Each kernel against a naive computation, and both compiled versions against each other.

use proptest::prelude::*;
use slam_math::Rng;

use super::fast::CIRCLE;
use super::*;

const BOTH: [fn() -> Kernels; 2] = [Kernels::scalar, Kernels::detect];

/// Noise of the given contrast over blocks of 8 x 8 equal pixels: corners and flat parts.
fn picture(width: usize, height: usize, contrast: usize, seed: u64) -> Vec<u8> {
    let pixel = |y: usize, x: usize| {
        let block = Rng::at(seed, y as u32 / 8, x as u32 / 8, 0).below(256 - contrast);
        (block + Rng::at(seed, y as u32, x as u32, 1).below(contrast)) as u8
    };
    (0..height).flat_map(|y| (0..width).map(move |x| pixel(y, x))).collect()
}

/// The definition: largest threshold at which 9 consecutive circle pixels are all brighter or all darker.
fn naive_score(image: &[u8], width: usize, x: usize, y: usize, threshold: u8) -> u8 {
    let center = i32::from(image[y * width + x]);
    let ring =
        CIRCLE.map(|(dx, dy)| i32::from(image[y.wrapping_add_signed(dy) * width + x.wrapping_add_signed(dx)]) - center);
    let is_corner = |t: i32| {
        (0..16).any(|start| {
            let arc = |k: usize| ring[(start + k) % 16];
            (0..9).all(|k| arc(k) > t) || (0..9).all(|k| arc(k) < -t)
        })
    };
    (i32::from(threshold)..255).rev().find(|&t| is_corner(t)).unwrap_or(0) as u8
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn fast_equals_the_textbook(
        width in 7usize..120, height in 7usize..20, contrast in 1usize..256, threshold in 1u8..60, seed: u64,
    ) {
        let image = picture(width, height, contrast, seed);
        let mut expected = vec![0; image.len()];
        for y in 3..height - 3 {
            for x in 3..width - 3 {
                expected[y * width + x] = naive_score(&image, width, x, y, threshold);
            }
        }
        for kernels in BOTH {
            let mut scores = vec![0; image.len()];
            kernels().fast_scores(&image, width, (3, width - 3), (3, height - 3), threshold, &mut scores);
            prop_assert_eq!(&scores, &expected);
        }
    }

    #[test]
    fn suppression_equals_the_definition(width in 2usize..100, levels in 1usize..6, seed: u64) {
        let mut rng = Rng::at(seed, 0, 0, 0);
        let scores: Vec<u8> = (0..3 * width).map(|_| rng.below(levels) as u8).collect();
        let expected: Vec<u8> = (0..width).map(|x| {
            let at = width + x;
            let inside = x > 0 && x + 1 < width;
            let earlier = || [at - width - 1, at - width, at - width + 1, at - 1].iter().all(|&n| scores[at] > scores[n]);
            let later = || [at + width - 1, at + width, at + width + 1, at + 1].iter().all(|&n| scores[at] >= scores[n]);
            if inside && earlier() && later() { scores[at] } else { 0 }
        }).collect();
        for kernels in BOTH {
            let mut out = vec![9; width];
            kernels().suppress_row(&scores[..width], &scores[width..2 * width], &scores[2 * width..], &mut out);
            prop_assert_eq!(&out, &expected);
        }
    }

    #[test]
    fn blur_is_a_gaussian(width in 1usize..80, height in 1usize..20, contrast in 1usize..256, seed: u64) {
        let image = picture(width, height, contrast, seed);
        let results = BOTH.map(|kernels| {
            let (mut padded, mut out) = (vec![1; 3], vec![0; image.len()]);
            kernels().blur(&image, width, &mut padded, &mut out);
            out
        });
        prop_assert_eq!(&results[0], &results[1]);
        // Mirrored without repeating the border pixel; narrow images are mirrored again.
        let mirror = |at: i64, len: i64| {
            let mut at = at;
            while len > 1 && !(0..len).contains(&at) {
                at = if at < 0 { -at } else { 2 * len - 2 - at };
            }
            if len == 1 { 0 } else { at as usize }
        };
        let weights: Vec<f64> = (-3..=3).map(|k| slam_math::float::exp(-f64::from(k * k) / 8.0)).collect();
        let total: f64 = weights.iter().sum();
        for y in 0..height {
            for x in 0..width {
                let mut mean = 0.0;
                for (dy, wy) in weights.iter().enumerate() {
                    for (dx, wx) in weights.iter().enumerate() {
                        let sx = mirror(x as i64 + dx as i64 - 3, width as i64);
                        let sy = mirror(y as i64 + dy as i64 - 3, height as i64);
                        mean += wx * wy / (total * total) * f64::from(image[sy * width + sx]);
                    }
                }
                let found = f64::from(results[0][y * width + x]);
                prop_assert!((found - mean).abs() < 2.5, "{x} {y}: {found} instead of {mean}");
            }
        }
    }

    #[test]
    fn resize_interpolates_between_pixel_centres(
        width in 16usize..90, shrink in 1.0..2.0, weight_below in 0u32..=2048, seed: u64,
    ) {
        let shrink: f64 = shrink;
        let target = (width as f64 / shrink).ceil() as usize;
        let (above, below) = (picture(width, 1, 200, seed), picture(width, 1, 200, seed ^ 1));
        let mut blocks = Vec::new();
        ColumnBlock::line(width, target, &mut blocks);
        let results = BOTH.map(|kernels| {
            let mut rows = [vec![[0; 8]; blocks.len()], vec![[0; 8]; blocks.len()]];
            kernels().shrink_row(&above, &blocks, &mut rows[0]);
            kernels().shrink_row(&below, &blocks, &mut rows[1]);
            let mut out = vec![0; target];
            kernels().blend_rows(rows[0].as_flattened(), rows[1].as_flattened(), weight_below, &mut out);
            out
        });
        prop_assert_eq!(&results[0], &results[1]);
        let down = f64::from(weight_below) / 2048.0;
        for (x, &found) in results[0].iter().enumerate() {
            let at = ((x as f64 + 0.5) * width as f64 / target as f64 - 0.5).clamp(0.0, (width - 1) as f64);
            let first = (at as usize).min(width - 2);
            let across = at - first as f64;
            let row = |row: &[u8]| f64::from(row[first]) * (1.0 - across) + f64::from(row[first + 1]) * across;
            let expected = row(&above) * (1.0 - down) + row(&below) * down;
            prop_assert!((f64::from(found) - expected).abs() < 0.65, "{x}: {found} instead of {expected}");
        }
    }

    #[test]
    fn gray_equals_the_formula(pixels: Vec<[u8; 3]>) {
        let expected: Vec<u8> = pixels
            .iter()
            .map(|&[r, g, b]| (0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)).round() as u8)
            .collect();
        let results = BOTH.map(|kernels| {
            let mut out = vec![0; pixels.len()];
            kernels().gray(pixels.as_flattened(), &mut out);
            out
        });
        prop_assert_eq!(&results[0], &results[1]);
        for (found, expected) in results[0].iter().zip(expected) {
            prop_assert!(found.abs_diff(expected) <= 1);
        }
    }

    #[test]
    fn patches_equal_the_definition(width in 39usize..70, angle in -4.0..4.0, contrast in 1usize..256, seed: u64) {
        let image = picture(width, 39, contrast, seed);
        let x = 19 + seed as usize % (width - 38);
        let (centers, turns) = ([19 * width + x], [[slam_math::float::cos(angle) as f32, slam_math::float::sin(angle) as f32]]);
        let mut expected = Moments::default();
        for (dx, dy) in (-15..=15).flat_map(|y| (-15..=15).map(move |x| (x, y))).filter(|(x, y)| x * x + y * y <= 240) {
            let value = i32::from(image[(19 + dy) as usize * width + (x as i32 + dx) as usize]);
            expected = Moments { x: expected.x + dx * value, y: expected.y + dy * value };
        }
        let [cos, sin] = turns[0];
        let sample = |px: i8, py: i8| {
            let (px, py) = (f32::from(px), f32::from(py));
            let dx = (px * cos - py * sin).round_ties_even() as isize;
            let dy = (px * sin + py * cos).round_ties_even() as isize;
            image[19usize.wrapping_add_signed(dy) * width + x.wrapping_add_signed(dx)]
        };
        let mut descriptor = [0u64; 4];
        for (i, &[x0, y0, x1, y1]) in crate::orb::PAIRS.iter().enumerate() {
            descriptor[i / 64] |= u64::from(sample(x0, y0) < sample(x1, y1)) << (i % 64);
        }
        for kernels in BOTH {
            let (mut moments, mut found) = ([Moments::default()], [[0; 4]]);
            kernels().moments(&image, width, &centers, &mut moments);
            prop_assert_eq!(moments[0], expected);
            kernels().describe(&image, width, &centers, &turns, &mut found);
            prop_assert_eq!(found[0], descriptor);
        }
    }
}
