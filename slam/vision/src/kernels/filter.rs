//! Brightness, bilinear resizing and blur.

/// Weights of the 7-tap Gaussian with standard deviation 2, in 1/256: centre, then outwards.
const GAUSS: [u16; 4] = [56, 49, 33, 18];

/// Bits of a bilinear weight, as in OpenCV's resize of 8-bit images.
const WEIGHT_BITS: u32 = 11;

/// Where a column or row of a resized image lies in its source: between `first` and `first + 1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Bilinear {
    /// Source position to the left or above.
    pub first: u32,
    /// Weight of the next source position, in 1/2048.
    pub weight_next: u32,
}

impl Bilinear {
    /// Source positions for all `target` pixels of a line resized from `source` pixels (at least 2), centres aligned.
    /// Integer throughout: position (x + 1/2) source / target - 1/2.
    pub fn line(source: usize, target: usize) -> impl Iterator<Item = Self> {
        let last = source as i64 - 2;
        let denominator = 2 * target as i64;
        (0..target as i64).map(move |x| {
            let numerator = (2 * x + 1) * source as i64 - target as i64;
            let first = numerator.div_euclid(denominator);
            let rest = numerator.rem_euclid(denominator);
            let weight_next = ((rest << WEIGHT_BITS) + target as i64) / denominator;
            match first {
                ..0 => Self { first: 0, weight_next: 0 },
                first if first > last => Self { first: last as u32, weight_next: 1 << WEIGHT_BITS },
                first => Self { first: first as u32, weight_next: weight_next as u32 },
            }
        })
    }
}

/// Columns of a resized image treated at once.
const COLUMNS: usize = 8;
/// Source pixels that these columns may reach over: an image shrinks by at most a factor of two.
pub(crate) const REACH: usize = 16;

/// Where neighbouring columns of a resized image lie in their source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ColumnBlock {
    /// Source position from which the others count.
    start: usize,
    /// Left and right neighbour of each column, as offsets from `start`.
    offsets: [u8; REACH],
    /// Their weights, in 1/2048.
    weights: [i16; REACH],
}

impl ColumnBlock {
    /// The blocks of a line resized from `source` pixels (at least [`REACH`]) to `target`, no less than half as many.
    /// The last block is filled up with its last column.
    pub fn line(source: usize, target: usize, out: &mut Vec<Self>) {
        out.clear();
        let mut columns = Bilinear::line(source, target).peekable();
        while let Some(first) = columns.peek().copied() {
            let start = (first.first as usize).min(source - REACH);
            let mut block = Self { start, offsets: [0; REACH], weights: [0; REACH] };
            let mut column = first;
            for (offsets, weights) in block.offsets.as_chunks_mut().0.iter_mut().zip(block.weights.as_chunks_mut().0) {
                column = columns.next().unwrap_or(column);
                let left = (column.first as usize - start) as u8;
                *offsets = [left, left + 1];
                *weights = [(1 << WEIGHT_BITS) - column.weight_next as i16, column.weight_next as i16];
            }
            out.push(block);
        }
    }
}

#[inline(always)]
pub(super) fn gray(rgb: &[u8], gray: &mut [u8]) {
    for (gray, rgb) in gray.iter_mut().zip(rgb.chunks_exact(3)) {
        *gray = ((u32::from(rgb[0]) * 4899 + u32::from(rgb[1]) * 9617 + u32::from(rgb[2]) * 1868 + 8192) >> 14) as u8;
    }
}

/// A row of the source at the columns of the target, times 2048.
#[inline(always)]
pub(super) fn shrink_row(row: &[u8], blocks: &[ColumnBlock], out: &mut [[u32; COLUMNS]]) {
    for (block, out) in blocks.iter().zip(out) {
        let pixels = &row[block.start..][..REACH];
        let pairs = block.offsets.as_chunks::<2>().0.iter().zip(block.weights.as_chunks::<2>().0);
        for (out, (offsets, weights)) in out.iter_mut().zip(pairs) {
            let weighed = |k: usize| u32::from(pixels[usize::from(offsets[k])]) * weights[k] as u32;
            *out = weighed(0) + weighed(1);
        }
    }
}

/// [`shrink_row`] where bytes can be shuffled.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
pub(super) fn shrink_row_avx2(row: &[u8], blocks: &[ColumnBlock], out: &mut [[u32; COLUMNS]]) {
    use std::arch::x86_64::{
        __m128i, __m256i, _mm_loadu_si128, _mm_shuffle_epi8, _mm256_cvtepu8_epi16, _mm256_loadu_si256,
        _mm256_madd_epi16, _mm256_storeu_si256,
    };
    for (block, out) in blocks.iter().zip(out) {
        let pixels: &[u8; REACH] = row[block.start..].first_chunk().expect("blocks end within their row");
        // SAFETY: unaligned loads of 16, 16 and 32 bytes from arrays of 16 u8, 16 u8 and 16 i16, and a store of 32 bytes
        // to an array of 8 u32.
        unsafe {
            let pixels = _mm_loadu_si128(pixels.as_ptr().cast::<__m128i>());
            let offsets = _mm_loadu_si128(block.offsets.as_ptr().cast::<__m128i>());
            let weights = _mm256_loadu_si256(block.weights.as_ptr().cast::<__m256i>());
            let pairs = _mm256_cvtepu8_epi16(_mm_shuffle_epi8(pixels, offsets));
            _mm256_storeu_si256(out.as_mut_ptr().cast::<__m256i>(), _mm256_madd_epi16(pairs, weights));
        }
    }
}

/// Blends two rows from [`shrink_row`] to pixels.
#[inline(always)]
pub(super) fn blend_rows(above: &[u32], below: &[u32], weight_below: u32, out: &mut [u8]) {
    for ((out, above), below) in out.iter_mut().zip(above).zip(below) {
        let sum = above * ((1 << WEIGHT_BITS) - weight_below) + below * weight_below;
        *out = ((sum + (1 << (2 * WEIGHT_BITS - 1))) >> (2 * WEIGHT_BITS)) as u8;
    }
}

/// Down the columns first, rounded to 8 bits, then along the row. The rounding in between adds a seventh of the noise
/// of the final rounding, and keeps all sums within 16 bits.
#[inline(always)]
pub(super) fn blur(image: &[u8], width: usize, padded: &mut Vec<u8>, out: &mut [u8]) {
    if width == 0 {
        return;
    }
    let height = image.len() / width;
    padded.clear();
    padded.resize(width + 6, 0);
    for (y, out) in out.chunks_exact_mut(width).enumerate() {
        let row = |k: usize| &image[reflect(y + k, height) * width..][..width];
        weigh([row(0), row(1), row(2), row(3), row(4), row(5), row(6)], &mut padded[3..width + 3]);
        for k in 0..3 {
            padded[k] = padded[3 + reflect(k, width)];
            padded[width + 3 + k] = padded[3 + reflect(width + 3 + k, width)];
        }
        let shifted = |k: usize| &padded[k..k + width];
        let lines = [shifted(0), shifted(1), shifted(2), shifted(3), shifted(4), shifted(5), shifted(6)];
        weigh(lines, out);
    }
}

/// Index at `position - 3` in a line mirrored about its first and last element (which are not repeated).
#[inline(always)]
fn reflect(position: usize, len: usize) -> usize {
    let period = (2 * len - 2).max(1);
    let index = (position + 3 * period - 3) % period;
    index.min(period - index).min(len - 1)
}

/// Weighted mean of seven lines, rounded to nearest.
#[inline(always)]
fn weigh(lines: [&[u8]; 7], out: &mut [u8]) {
    let len = out.len();
    let [a, b, c, d, e, f, g] = lines;
    let [a, b, c, d, e, f, g] = [&a[..len], &b[..len], &c[..len], &d[..len], &e[..len], &f[..len], &g[..len]];
    for (x, out) in out.iter_mut().enumerate() {
        let pair = |left: &[u8], right: &[u8]| u16::from(left[x]) + u16::from(right[x]);
        let sum = GAUSS[0] * u16::from(d[x]) + GAUSS[1] * pair(c, e) + GAUSS[2] * pair(b, f) + GAUSS[3] * pair(a, g);
        *out = ((sum + 128) >> 8) as u8;
    }
}
