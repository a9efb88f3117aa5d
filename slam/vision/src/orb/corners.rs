//! Corners of one pyramid level.

use super::OrbConfig;
use crate::kernels::PATCH_MARGIN;
use crate::{GrayImage, Kernels};

/// A corner in pixels of its level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corner {
    pub x: u32,
    pub y: u32,
    pub score: u8,
}

/// Fills `scores` (a value a pixel of `level`) with the FAST score of every corner, 0 elsewhere. Each cell of about
/// `cell_px` pixels uses the high threshold, or the low one where that finds nothing. The level must be larger than
/// two margins. `columns` is scratch.
pub(super) fn score(
    kernels: Kernels,
    level: &GrayImage,
    config: &OrbConfig,
    scores: &mut Vec<u8>,
    columns: &mut Vec<(usize, usize)>,
) {
    let width = level.width;
    scores.clear();
    scores.resize(level.data.len(), 0);
    columns.clear();
    columns.extend(cells(width, config.cell_px));
    for rows in cells(level.height, config.cell_px) {
        let inside = (PATCH_MARGIN, width - PATCH_MARGIN);
        kernels.fast_scores(&level.data, width, inside, rows, config.fast_threshold, scores);
        for &cell in &*columns {
            let mut lines = scores[rows.0 * width..rows.1 * width].chunks_exact(width);
            if lines.all(|line| is_zero(&line[cell.0..cell.1])) {
                kernels.fast_scores(&level.data, width, cell, rows, config.fast_threshold_min, scores);
            }
        }
    }
}

/// Half-open ranges of equal size (but the last) that cover `len` pixels without the margins.
fn cells(len: usize, wanted: usize) -> impl Iterator<Item = (usize, usize)> {
    let inside = len - 2 * PATCH_MARGIN;
    let size = inside.div_ceil((inside / wanted).max(1));
    let end = len - PATCH_MARGIN;
    (PATCH_MARGIN..end).step_by(size).map(move |start| (start, (start + size).min(end)))
}

/// Replaces `corners` by the pixels whose score exceeds that of all eight neighbours, in row-major order. Of equal
/// neighbours the first in row-major order wins. `peaks` is scratch.
pub(super) fn local_maxima(
    kernels: Kernels,
    scores: &[u8],
    level: &GrayImage,
    peaks: &mut Vec<u8>,
    corners: &mut Vec<Corner>,
) {
    const WORD: usize = 8;
    let width = level.width;
    corners.clear();
    // Whole words, so that empty stretches can be skipped eight pixels at a time.
    peaks.clear();
    peaks.resize(width.next_multiple_of(WORD), 0);
    for y in PATCH_MARGIN..level.height - PATCH_MARGIN {
        let row = |y: usize| &scores[y * width..][..width];
        kernels.suppress_row(row(y - 1), row(y), row(y + 1), &mut peaks[..width]);
        let (words, _) = peaks.as_chunks::<WORD>();
        for (k, word) in words.iter().enumerate().filter(|(_, word)| u64::from_ne_bytes(**word) != 0) {
            for (lane, &score) in word.iter().enumerate().filter(|&(_, &score)| score > 0) {
                corners.push(Corner { x: (k * WORD + lane) as u32, y: y as u32, score });
            }
        }
    }
}

fn is_zero(values: &[u8]) -> bool {
    values.iter().fold(0, |any, value| any | value) == 0
}
