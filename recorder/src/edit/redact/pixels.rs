//! What becomes of redacted pixels. Others stay as they are, and nothing of them depends on what is redacted.

use super::area::Cover;
use serde::Serialize;

/// How colour is redacted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// One grey: nothing is left.
    Fill,
    /// Blocks of one colour each, the mean of the redacted pixels in it.
    Pixelate {
        /// Side of a block, pixels.
        block_px: u32,
    },
    /// The same means, with colours running smoothly from one block's middle to the next: nothing but the means goes in, so
    /// that no sharpening gets more out.
    Blur {
        /// Side of a block, pixels.
        block_px: u32,
    },
}

/// The grey of [`Method::Fill`].
const GREY: u8 = 128;

/// Redacts an 8-bit picture with `channels` values a pixel, rows joined.
pub fn redact_color(pixels: &mut [u8], channels: usize, cover: &Cover, method: Method) {
    match method {
        Method::Fill => each(pixels, channels, cover, &mut |_, _, values| values.fill(GREY)),
        Method::Pixelate { block_px } => {
            let means = Means::new(pixels, channels, cover, block_px as usize);
            each(pixels, channels, cover, &mut |x, y, values| means.block(x, y, values));
        }
        Method::Blur { block_px } => {
            let means = Means::new(pixels, channels, cover, block_px as usize);
            each(pixels, channels, cover, &mut |x, y, values| means.between(x, y, values));
        }
    }
}

fn each(pixels: &mut [u8], channels: usize, cover: &Cover, change: &mut dyn FnMut(usize, usize, &mut [u8])) {
    for (index, values) in pixels.chunks_exact_mut(channels).enumerate().filter(|(index, _)| cover.has(*index)) {
        change(index % cover.width, index / cover.width, values);
    }
}

/// Mean colour of the redacted pixels of each block.
struct Means {
    block: usize,
    columns: usize,
    channels: usize,
    /// None where nothing is redacted.
    colors: Vec<Option<Vec<u8>>>,
}

impl Means {
    fn new(pixels: &[u8], channels: usize, cover: &Cover, block: usize) -> Self {
        let (columns, rows) = (cover.width.div_ceil(block), cover.height.div_ceil(block));
        let mut sums = vec![(vec![0_u64; channels], 0_u64); columns * rows];
        for (index, values) in pixels.chunks_exact(channels).enumerate().filter(|(index, _)| cover.has(*index)) {
            let (x, y) = (index % cover.width, index / cover.width);
            let (sum, count) = &mut sums[y / block * columns + x / block];
            sum.iter_mut().zip(values).for_each(|(sum, value)| *sum += u64::from(*value));
            *count += 1;
        }
        let mean = |(sum, count): (Vec<u64>, u64)| {
            (count > 0).then(|| sum.iter().map(|sum| ((sum + count / 2) / count) as u8).collect())
        };
        Self { block, columns, channels, colors: sums.into_iter().map(mean).collect() }
    }

    fn block(&self, x: usize, y: usize, values: &mut [u8]) {
        if let Some(Some(color)) = self.colors.get(y / self.block * self.columns + x / self.block) {
            values.copy_from_slice(color);
        }
    }

    /// Between the middles of the four nearest blocks, weighted by nearness; blocks without a colour count for nothing.
    fn between(&self, x: usize, y: usize, values: &mut [u8]) {
        let (left, right_weight) = self.nearest(x);
        let (upper, lower_weight) = self.nearest(y);
        let full = 2 * self.block as i64;
        let (mut sums, mut weights) = (vec![0_i64; self.channels], 0);
        for (column, horizontal) in [(left, full - right_weight), (left + 1, right_weight)] {
            for (row, vertical) in [(upper, full - lower_weight), (upper + 1, lower_weight)] {
                let inside = column >= 0 && row >= 0 && (column as usize) < self.columns;
                let at = if inside { row as usize * self.columns + column as usize } else { usize::MAX };
                let Some(Some(color)) = self.colors.get(at) else { continue };
                sums.iter_mut().zip(color).for_each(|(sum, value)| *sum += horizontal * vertical * i64::from(*value));
                weights += horizontal * vertical;
            }
        }
        match weights {
            0 => self.block(x, y, values),
            _ => values.iter_mut().zip(sums).for_each(|(value, sum)| *value = ((sum + weights / 2) / weights) as u8),
        }
    }

    /// The block whose middle is before a place, and how near the next one's is, in half pixels of `2 * block`.
    fn nearest(&self, at: usize) -> (i64, i64) {
        let block = self.block as i64;
        let from_middle = 2 * at as i64 + 1 - block;
        (from_middle.div_euclid(2 * block), from_middle.rem_euclid(2 * block))
    }
}

/// Takes measurements away.
pub fn redact_depth(pixels: &mut [u16], is_covered: &dyn Fn(usize) -> bool) {
    pixels.iter_mut().enumerate().filter(|(index, _)| is_covered(*index)).for_each(|(_, value)| *value = 0);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> Vec<u8> {
        (0..width * height * 3).map(|i| (i * 37 % 251) as u8).collect()
    }

    fn middle(size: (usize, usize)) -> Cover {
        let inside = |i: usize| (20..50).contains(&(i % size.0)) && (10..40).contains(&(i / size.0));
        let pixels: Vec<u16> = (0..size.0 * size.1).map(|i| u16::from(inside(i))).collect();
        Cover::of(size, &[(super::super::area::Area::new(&pixels, size.0, &|v| v == 1), 0)])
    }

    /// Two pictures with the same block means and nothing else in common become the same; pixels outside stay.
    #[test]
    fn only_block_means_are_left() {
        let size = (64, 48);
        let cover = middle(size);
        for method in [Method::Fill, Method::Pixelate { block_px: 16 }, Method::Blur { block_px: 16 }] {
            let original = picture(size.0, size.1);
            let mut shuffled = original.clone();
            // Neighbours in a block change places.
            for index in (0..size.0 * size.1).step_by(2).filter(|i| cover.has(*i) && cover.has(i + 1)) {
                (0..3).for_each(|channel| shuffled.swap(3 * index + channel, 3 * index + 3 + channel));
            }
            assert_ne!(original, shuffled);
            let [mut a, mut b] = [original.clone(), shuffled];
            redact_color(&mut a, 3, &cover, method);
            redact_color(&mut b, 3, &cover, method);
            assert_eq!(a, b, "{method:?}");
            for index in (0..size.0 * size.1).filter(|index| !cover.has(*index)) {
                assert_eq!(a[3 * index..3 * index + 3], original[3 * index..3 * index + 3]);
            }
        }
    }

    #[test]
    fn blur_of_one_colour_is_that_colour() {
        let size = (64, 48);
        let mut pixels = vec![77; 64 * 48 * 3];
        redact_color(&mut pixels, 3, &middle(size), Method::Blur { block_px: 16 });
        assert!(pixels.iter().all(|value| *value == 77));
    }

    #[test]
    fn depth_is_taken_away() {
        let mut depth = vec![5; 6];
        redact_depth(&mut depth, &|index| index > 3);
        assert_eq!(depth, [5, 5, 5, 5, 0, 0]);
    }
}
