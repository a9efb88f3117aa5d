//! Direction and descriptor of the patch around a keypoint.

use crate::Descriptor;
use crate::orb::PAIRS;

/// Distance that a keypoint must keep from the border: the farthest pattern point, (-13, -13), turned onto an axis lies
/// 18.4 pixels away.
pub(crate) const PATCH_MARGIN: usize = 19;

/// Radius of the disc that gives a keypoint its direction.
const RADIUS: i32 = 15;

/// Columns of the disc, filled up to a whole number of vector registers.
const LANES: usize = 32;

/// First moments of the brightness over a disc, about its centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Moments {
    /// Sum of x times brightness.
    pub x: i32,
    /// Sum of y times brightness.
    pub y: i32,
}

/// 255 inside the disc, 0 outside: row y + 15, column x + 15. Inside is x^2 + y^2 <= 15.5^2, the disc of pixel centres
/// that touches all four sides in more than a point.
const DISC: [[u8; LANES]; 2 * RADIUS as usize + 1] = {
    let mut disc = [[0; LANES]; 2 * RADIUS as usize + 1];
    let mut y = -RADIUS;
    while y <= RADIUS {
        let mut x = -RADIUS;
        while x <= RADIUS {
            if 4 * (x * x + y * y) <= 31 * 31 {
                disc[(y + RADIUS) as usize][(x + RADIUS) as usize] = 255;
            }
            x += 1;
        }
        y += 1;
    }
    disc
};

#[inline(always)]
pub(super) fn moments(image: &[u8], width: usize, centers: &[usize], out: &mut [Moments]) {
    for (out, &center) in out.iter_mut().zip(centers) {
        let corner = center - RADIUS as usize * (width + 1);
        // Per column: sum of brightness (at most 31 * 255) and of y times brightness (within 120 * 255 of 0), so
        // 16 bits are enough.
        let (mut sum, mut weighted) = ([0i16; LANES], [0i16; LANES]);
        for (row, mask) in DISC.iter().enumerate() {
            let y = row as i16 - RADIUS as i16;
            let pixels = &image[corner + row * width..][..LANES];
            for lane in 0..LANES {
                let value = i16::from(pixels[lane] & mask[lane]);
                sum[lane] += value;
                weighted[lane] += y * value;
            }
        }
        *out = Moments {
            x: sum.iter().zip(-RADIUS..).map(|(&sum, x)| i32::from(sum) * x).sum(),
            y: weighted.iter().map(|&y| i32::from(y)).sum(),
        };
    }
}

/// Pattern coordinates: x and y of the first points, then of the second points.
const PATTERN: [[f32; 256]; 4] = {
    let mut pattern = [[0.0; 256]; 4];
    let mut i = 0;
    while i < 256 {
        let mut k = 0;
        while k < 4 {
            pattern[k][i] = PAIRS[i][k] as f32;
            k += 1;
        }
        i += 1;
    }
    pattern
};

#[inline(always)]
pub(super) fn describe(blurred: &[u8], width: usize, centers: &[usize], turns: &[[f32; 2]], out: &mut [Descriptor]) {
    for ((descriptor, &center), &turn) in out.iter_mut().zip(centers).zip(turns) {
        let first = sample(blurred, width, center, turn, &PATTERN[0], &PATTERN[1]);
        let second = sample(blurred, width, center, turn, &PATTERN[2], &PATTERN[3]);
        for (word, (first, second)) in descriptor.iter_mut().zip(first.chunks_exact(64).zip(second.chunks_exact(64))) {
            *word = first.iter().zip(second).rev().fold(0, |bits, (a, b)| bits << 1 | u64::from(a < b));
        }
    }
}

/// Brightness at 256 pattern points turned by (cosine, sine), coordinates rounded half to even.
#[inline(always)]
fn sample(
    image: &[u8],
    width: usize,
    center: usize,
    [cos, sin]: [f32; 2],
    xs: &[f32; 256],
    ys: &[f32; 256],
) -> [u8; 256] {
    let mut offsets = [0; 256];
    for i in 0..256 {
        let x = round(xs[i] * cos - ys[i] * sin);
        let y = round(xs[i] * sin + ys[i] * cos);
        offsets[i] = y * width as i32 + x;
    }
    let mut values = [0; 256];
    for i in 0..256 {
        values[i] = image[center.wrapping_add_signed(offsets[i] as isize)];
    }
    values
}

/// Nearest integer, half to even, for small numbers: at 1.5 * 2^23 the last bit of an f32 is worth 1.
#[inline(always)]
fn round(value: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    (value + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}
