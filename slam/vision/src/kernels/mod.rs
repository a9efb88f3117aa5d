//! The loops that touch every pixel or descriptor, each written once (but one) and compiled twice: for any x86-64 CPU and
//! for CPUs with AVX2 and popcnt. They compute with integers, which are exact; the one float step, turning the pattern of a
//! descriptor, is plain products and sums, which the compiler never fuses. So both versions give the same bits.

mod bits;
mod fast;
mod filter;
mod patch;
#[cfg(test)]
mod tests;

pub(crate) use filter::{Bilinear, ColumnBlock, REACH};
pub(crate) use patch::{Moments, PATCH_MARGIN};

use crate::{Descriptor, Nearest};

/// Which compiled version of the kernels runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernels {
    wide: bool,
}

impl Kernels {
    /// The fastest version this CPU can run.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        let wide = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt");
        #[cfg(not(target_arch = "x86_64"))]
        let wide = false;
        Self { wide }
    }

    /// The version that runs everywhere.
    #[must_use]
    pub fn scalar() -> Self {
        Self { wide: false }
    }
}

/// Gives each kernel a method of [`Kernels`] that calls the version to run.
macro_rules! dispatch {
    ($($(#[$doc:meta])* fn $name:ident($($arg:ident: $ty:ty),* $(,)?) $(-> $out:ty)? = $body:path;)*) => {
        impl Kernels {
            $(
                $(#[$doc])*
                pub(crate) fn $name(self, $($arg: $ty),*) $(-> $out)? {
                    #[cfg(target_arch = "x86_64")]
                    if self.wide {
                        #[target_feature(enable = "avx2,popcnt")]
                        fn wide($($arg: $ty),*) $(-> $out)? {
                            $body($($arg),*)
                        }
                        // SAFETY: `wide` is only ever set by `detect`, which found both features on this CPU.
                        return unsafe { wide($($arg),*) };
                    }
                    $body($($arg),*)
                }
            )*
        }
    };
}

dispatch! {
    /// Brightness of interleaved RGB pixels; `rgb` holds three bytes for each of `gray`.
    fn gray(rgb: &[u8], gray: &mut [u8]) = filter::gray;
    /// Two rows of an image that has been shrunk along x, blended to a row of pixels.
    fn blend_rows(above: &[u32], below: &[u32], weight_below: u32, out: &mut [u8]) = filter::blend_rows;
    /// 7 x 7 Gaussian blur with standard deviation 2 of a `width`-wide image; `padded` is scratch.
    fn blur(image: &[u8], width: usize, padded: &mut Vec<u8>, out: &mut [u8]) = filter::blur;
    /// FAST-9 scores of a rectangle.
    fn fast_scores(image: &[u8], width: usize, columns: (usize, usize), rows: (usize, usize), threshold: u8, scores: &mut [u8])
        = fast::scores;
    /// Non-maximum suppression of one row of scores.
    fn suppress_row(above: &[u8], row: &[u8], below: &[u8], out: &mut [u8]) = fast::suppress_row;
    /// Intensity moments of the patches around `centers` (positions in `image`).
    fn moments(image: &[u8], width: usize, centers: &[usize], out: &mut [Moments]) = patch::moments;
    /// Descriptors of the patches around `centers`, turned by the given (cosine, sine).
    fn describe(blurred: &[u8], width: usize, centers: &[usize], turns: &[[f32; 2]], out: &mut [Descriptor])
        = patch::describe;
    /// Distances of one descriptor to many.
    fn hamming_many(query: &Descriptor, descriptors: &[Descriptor], distances: &mut [u32]) = bits::hamming_many;
    /// The two descriptors nearest to one, among some of many.
    fn nearest_two(query: &Descriptor, descriptors: &[Descriptor], indices: &[u32]) -> [Nearest; 2]
        = bits::nearest_two;
}

impl Kernels {
    /// A row of an image shrunk along x. The compiler does not find the byte shuffle that this is made for, so here the
    /// wide version is written by hand.
    pub(crate) fn shrink_row(self, row: &[u8], blocks: &[ColumnBlock], out: &mut [[u32; 8]]) {
        #[cfg(target_arch = "x86_64")]
        if self.wide {
            // SAFETY: `wide` is only ever set by `detect`, which found AVX2 on this CPU.
            return unsafe { filter::shrink_row_avx2(row, blocks, out) };
        }
        filter::shrink_row(row, blocks, out);
    }
}
