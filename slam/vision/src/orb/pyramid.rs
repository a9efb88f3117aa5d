//! The image at ever coarser resolutions.

use crate::kernels::Bilinear;
use crate::{GrayImage, Kernels};

/// Levels 1 and up; level 0 is the image itself.
#[derive(Debug, Clone, Default)]
pub(super) struct Pyramid {
    levels: Vec<GrayImage>,
    columns: Vec<Bilinear>,
    rows: Vec<Bilinear>,
    blend: Vec<u32>,
}

impl Pyramid {
    /// Computes level `octave` (at least 1) from the level before it, which must have been asked for already.
    pub fn level(&mut self, kernels: Kernels, base: &GrayImage, octave: usize, scale: f64) -> &GrayImage {
        if self.levels.len() < octave {
            self.levels.push(GrayImage::default());
        }
        let (before, rest) = self.levels.split_at_mut(octave - 1);
        let source = before.last().unwrap_or(base);
        let target = &mut rest[0];
        let size = |base: usize| (base as f64 / scale).round_ties_even() as usize;
        target.reshape(size(base.width), size(base.height), 0);
        if source.width < 2 || source.height < 2 || target.data.is_empty() {
            target.reshape(0, 0, 0);
            return target;
        }
        Bilinear::line(source.width, target.width, &mut self.columns);
        Bilinear::line(source.height, target.height, &mut self.rows);
        self.blend.resize(source.width, 0);
        for (row, out) in self.rows.iter().zip(target.data.chunks_exact_mut(target.width)) {
            let first = row.first as usize;
            let (above, below) = (source.row(first), source.row(first + 1));
            kernels.resize_row(above, below, row.weight_next, &self.columns, &mut self.blend, out);
        }
        target
    }
}
