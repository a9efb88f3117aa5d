//! Fast look-up of keypoints near a pixel.

use slam_math::{Buffer, Buffers};

use crate::Bounds;

/// Cells along x and y; a cell of a 640 x 480 image is then 10 x 10 pixels.
const COLUMNS: usize = 64;
const ROWS: usize = 48;

/// Keypoints sorted into 64 x 48 cells over the undistorted image.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct KeypointGrid {
    bounds: Bounds,
    /// Cell `c` (row-major) owns `entries[starts[c]..starts[c + 1]]`.
    starts: Buffer<u32>,
    entries: Buffer<Entry>,
}

/// What a query asks of a keypoint, side by side.
#[derive(Debug, Clone, Copy, serde::Serialize, serde::Deserialize)]
struct Entry {
    pixel: [f64; 2],
    index: u32,
    octave: u8,
}

impl KeypointGrid {
    /// Sorts keypoints, given by their undistorted pixels and octaves, into the cells. Points outside the bounds are kept in
    /// the border cells, so every finite point can be found; a point that is not finite is never found.
    #[must_use]
    pub fn build(pixels: &[[f64; 2]], octaves: &[u8], bounds: Bounds, buffers: &Buffers) -> Self {
        let starts = buffers.filled(COLUMNS * ROWS + 1, 0);
        let mut grid = Self { bounds, starts, entries: buffers.empty() };
        let mut by_cell: Buffer<(u32, u32)> = buffers.empty();
        for (index, pixel) in pixels.iter().enumerate().filter(|(_, pixel)| pixel.iter().all(|v| v.is_finite())) {
            let cell = grid.row(pixel[1]) * COLUMNS + grid.column(pixel[0]);
            grid.starts[cell + 1] += 1;
            by_cell.push((cell as u32, index as u32));
        }
        for cell in 0..COLUMNS * ROWS {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        by_cell.sort_unstable();
        let entry =
            |&(_, index): &(u32, u32)| Entry { pixel: pixels[index as usize], index, octave: octaves[index as usize] };
        grid.entries.extend(by_cell.iter().map(entry));
        grid
    }

    /// Replaces `found` by the indices of keypoints with `|dx| < radius` and `|dy| < radius` around `center`
    /// (undistorted pixels) whose octave lies in `octave_min..=octave_max`, row of cells by row of cells: ascending
    /// within a cell, not as a whole.
    pub fn query(&self, center: [f64; 2], radius: f64, octave_min: u8, octave_max: u8, found: &mut Vec<u32>) {
        found.clear();
        if !(radius > 0.0 && center.iter().all(|v| v.is_finite())) {
            return;
        }
        let (first_column, last_column) = (self.column(center[0] - radius), self.column(center[0] + radius));
        let mut count = 0;
        for row in self.row(center[1] - radius)..=self.row(center[1] + radius) {
            let cells = row * COLUMNS + first_column..row * COLUMNS + last_column + 1;
            // Neighbouring cells of a row lie side by side, so one range covers them all.
            let entries = &self.entries[self.starts[cells.start] as usize..self.starts[cells.end] as usize];
            found.resize(count + entries.len(), 0);
            for Entry { pixel, index, octave } in entries {
                let near = ((pixel[0] - center[0]).abs() < radius) & ((pixel[1] - center[1]).abs() < radius);
                // Written always and kept only when it counts: no branch that the CPU would guess wrong.
                found[count] = *index;
                count += usize::from(near & (*octave >= octave_min) & (*octave <= octave_max));
            }
        }
        found.truncate(count);
    }

    /// Whether this is a grid over `n` keypoints. One that [`build`](Self::build) made always is; one from a file need not.
    #[must_use]
    pub fn is_of(&self, n: usize) -> bool {
        self.starts.len() == COLUMNS * ROWS + 1
            && self.starts.is_sorted()
            && self.starts.last().is_some_and(|end| *end as usize == self.entries.len())
            && self.entries.iter().all(|entry| (entry.index as usize) < n)
    }

    fn column(&self, x: f64) -> usize {
        cell(x, self.bounds.min[0], self.bounds.max[0], COLUMNS)
    }

    fn row(&self, y: f64) -> usize {
        cell(y, self.bounds.min[1], self.bounds.max[1], ROWS)
    }
}

/// Index of the cell at `value`, clamped to `0..count`. Monotone in `value`, which is all that a query relies on.
fn cell(value: f64, min: f64, max: f64, count: usize) -> usize {
    // The cast saturates: below the bounds and NaN (empty bounds) become 0.
    (((value - min) * count as f64 / (max - min)) as usize).min(count - 1)
}
