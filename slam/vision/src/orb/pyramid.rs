//! The image at ever coarser resolutions.

use crate::kernels::{Bilinear, ColumnBlock, REACH};
use crate::{GrayImage, Kernels};

/// Levels 1 and up; level 0 is the image itself.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pyramid {
    levels: Vec<GrayImage>,
    columns: Vec<ColumnBlock>,
    /// Two neighbouring rows of the source, shrunk along x: row y in slot y % 2.
    shrunk: [Vec<[u32; 8]>; 2],
}

impl Pyramid {
    /// A level that was computed for this picture; level 0 is the picture itself.
    pub fn computed<'a>(&'a self, base: &'a GrayImage, octave: usize) -> &'a GrayImage {
        if octave == 0 { base } else { &self.levels[octave - 1] }
    }

    /// Computes level `octave` (at least 1) from the level before it, which must have been asked for already. Levels
    /// smaller than [`REACH`] pixels, too small for any patch, come out empty.
    pub fn level(&mut self, kernels: Kernels, base: &GrayImage, octave: usize, scale: f64) -> &GrayImage {
        if self.levels.len() < octave {
            self.levels.push(GrayImage::default());
        }
        let (before, rest) = self.levels.split_at_mut(octave - 1);
        let source = before.last().unwrap_or(base);
        let target = &mut rest[0];
        let size = |base: usize| (base as f64 / scale).round_ties_even() as usize;
        target.reshape(size(base.width), size(base.height), 0);
        if source.width < REACH || source.height < 2 || target.data.is_empty() {
            target.reshape(0, 0, 0);
            return target;
        }
        ColumnBlock::line(source.width, target.width, &mut self.columns);
        self.shrunk.iter_mut().for_each(|row| row.resize(self.columns.len(), [0; 8]));
        let mut ready = 0;
        let rows = Bilinear::line(source.height, target.height);
        for (row, out) in rows.zip(target.data.chunks_exact_mut(target.width)) {
            let first = row.first as usize;
            for y in usize::max(first, ready)..first + 2 {
                kernels.shrink_row(source.row(y), &self.columns, &mut self.shrunk[y % 2]);
            }
            ready = first + 2;
            let [above, below] = [first, first + 1].map(|y| self.shrunk[y % 2].as_flattened());
            kernels.blend_rows(above, below, row.weight_next, out);
        }
        target
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_shrink_by_the_factor_and_keep_the_mean() {
        let ramp: Vec<u8> = (0..640 * 480).map(|i| (i % 640 * 255 / 639) as u8).collect();
        let base = GrayImage::from_vec(640, 480, ramp).unwrap();
        let sizes = [(533, 400), (444, 333), (370, 278), (309, 231), (257, 193), (214, 161), (179, 134)];
        let (mut pyramid, mut scale) = (Pyramid::default(), 1.0);
        for (octave, size) in (1..).zip(sizes) {
            scale *= 1.2;
            let level = pyramid.level(Kernels::detect(), &base, octave, scale);
            assert_eq!((level.width, level.height), size);
            let row = level.row(size.1 / 2);
            assert!(row.is_sorted() && row[0] < 2 && row[size.0 - 1] > 253, "octave {octave}: a ramp stays a ramp");
        }
    }

    #[test]
    fn a_line_of_pixels_shrinks_to_nothing() {
        for base in [GrayImage::new(70, 1, 9), GrayImage::new(15, 40, 9)] {
            let mut pyramid = Pyramid::default();
            assert!(pyramid.level(Kernels::detect(), &base, 1, 1.2).data.is_empty());
            assert!(pyramid.level(Kernels::detect(), &base, 2, 1.44).data.is_empty());
        }
    }
}
