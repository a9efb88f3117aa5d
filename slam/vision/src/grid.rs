//! Fast look-up of keypoints near a pixel.

use crate::Bounds;

/// Cells along x and y; a cell of a 640 x 480 image is then 10 x 10 pixels.
const COLUMNS: usize = 64;
const ROWS: usize = 48;

/// Keypoints sorted into 64 x 48 cells over the undistorted image.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
pub struct KeypointGrid {
    bounds: Bounds,
    /// Cell `c` (row-major) owns `indices[starts[c]..starts[c + 1]]`.
    starts: Vec<u32>,
    indices: Vec<u32>,
    /// Pixels of `indices`, in the same order.
    pixels: Vec<[f64; 2]>,
}

impl KeypointGrid {
    /// Sorts undistorted pixels into the cells. Points outside the bounds are kept in the border cells, so every finite
    /// point can be found; a point that is not finite is never found.
    #[must_use]
    pub fn build(pixels: &[[f64; 2]], bounds: Bounds) -> Self {
        let mut grid = Self {
            bounds,
            starts: vec![0; COLUMNS * ROWS + 1],
            indices: Vec::with_capacity(pixels.len()),
            pixels: Vec::with_capacity(pixels.len()),
        };
        let mut by_cell: Vec<(u32, u32)> = Vec::with_capacity(pixels.len());
        for (index, pixel) in pixels.iter().enumerate().filter(|(_, pixel)| pixel.iter().all(|v| v.is_finite())) {
            let cell = grid.row(pixel[1]) * COLUMNS + grid.column(pixel[0]);
            grid.starts[cell + 1] += 1;
            by_cell.push((cell as u32, index as u32));
        }
        for cell in 0..COLUMNS * ROWS {
            grid.starts[cell + 1] += grid.starts[cell];
        }
        by_cell.sort_unstable();
        for (_, index) in by_cell {
            grid.indices.push(index);
            grid.pixels.push(pixels[index as usize]);
        }
        grid
    }

    /// Replaces `found` by the indices of keypoints with `|dx| < radius` and `|dy| < radius` around `center`
    /// (undistorted pixels) whose octave lies in `octave_min..=octave_max`, row of cells by row of cells: ascending
    /// within a cell, not as a whole.
    ///
    /// `octaves` holds the octave of every keypoint given to [`KeypointGrid::build`], in that order.
    pub fn query(
        &self,
        center: [f64; 2],
        radius: f64,
        octave_min: u8,
        octave_max: u8,
        octaves: &[u8],
        found: &mut Vec<u32>,
    ) {
        found.clear();
        if !(radius > 0.0 && center.iter().all(|v| v.is_finite())) {
            return;
        }
        let (first_column, last_column) = (self.column(center[0] - radius), self.column(center[0] + radius));
        let mut count = 0;
        for row in self.row(center[1] - radius)..=self.row(center[1] + radius) {
            let cells = row * COLUMNS + first_column..row * COLUMNS + last_column + 1;
            // Neighbouring cells of a row lie side by side, so one range covers them all.
            let range = self.starts[cells.start] as usize..self.starts[cells.end] as usize;
            found.resize(count + range.len(), 0);
            for (&index, pixel) in self.indices[range.clone()].iter().zip(&self.pixels[range]) {
                let near = ((pixel[0] - center[0]).abs() < radius) & ((pixel[1] - center[1]).abs() < radius);
                let octave = octaves[index as usize];
                // Written always and kept only when it counts: no branch that the CPU would guess wrong.
                found[count] = index;
                count += usize::from(near & (octave >= octave_min) & (octave <= octave_max));
            }
        }
        found.truncate(count);
    }

    /// Whether this is a grid over `n` keypoints. One that [`build`](Self::build) made always is; one from a file need not.
    #[must_use]
    pub fn is_of(&self, n: usize) -> bool {
        self.starts.len() == COLUMNS * ROWS + 1
            && self.starts.is_sorted()
            && self.starts.last().is_some_and(|end| *end as usize == self.indices.len())
            && self.pixels.len() == self.indices.len()
            && self.indices.iter().all(|index| (*index as usize) < n)
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
