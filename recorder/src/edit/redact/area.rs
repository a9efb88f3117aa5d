//! Areas of a picture: kept as runs, grown and joined, then asked pixel by pixel.

use std::io;

/// Columns `first..=last` of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    row: u16,
    first: u16,
    last: u16,
}

/// The pixels of some classes in one mask.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Area {
    runs: Vec<Run>,
    pixels: usize,
}

impl Area {
    /// The pixels of a picture, `width` a row, that `is_inside` accepts.
    pub fn new(pixels: &[u16], width: usize, is_inside: &dyn Fn(u16) -> bool) -> Self {
        let mut area = Self::default();
        for (row, values) in pixels.chunks_exact(width.max(1)).enumerate() {
            let mut column = 0;
            while column < values.len() {
                let value = is_inside(values[column]);
                let len = values[column..].iter().take_while(|other| is_inside(**other) == value).count();
                if value {
                    area.runs.push(Run { row: row as u16, first: column as u16, last: (column + len - 1) as u16 });
                    area.pixels += len;
                }
                column += len;
            }
        }
        area
    }

    /// The squares of `side` pixels in which `is_inside` accepts a pixel; and those beside them, so that what is accepted is
    /// covered with a margin of one side. Coarse, to be kept for each frame of a long log.
    pub fn squares(pixels: &[u16], width: usize, side: usize, is_inside: &dyn Fn(u16) -> bool) -> Self {
        let (columns, rows) = (width.div_ceil(side), pixels.len().div_ceil(width.max(1)).div_ceil(side));
        let mut squares = vec![0; columns * rows];
        for (index, _) in pixels.iter().enumerate().filter(|(_, value)| is_inside(**value)) {
            let (x, y) = (index % width / side, index / width / side);
            for row in y.saturating_sub(1)..=(y + 1).min(rows - 1) {
                let first = row * columns + x.saturating_sub(1);
                squares[first..=row * columns + (x + 1).min(columns - 1)].fill(1);
            }
        }
        Self::new(&squares, columns, &|square| square == 1)
    }

    /// An area of squares, in pixels; what lies beyond a picture's border counts for nothing.
    pub fn unfolded(&self, side: usize) -> Self {
        let part = |run: &Run, row: usize| Run {
            row: (usize::from(run.row) * side + row) as u16,
            first: (usize::from(run.first) * side) as u16,
            last: (usize::from(run.last) * side + side - 1) as u16,
        };
        let runs = self.runs.iter().flat_map(|run| (0..side).map(move |row| part(run, row))).collect();
        Self { runs, pixels: self.pixels * side * side }
    }

    /// Pixels in it.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// Whether it comes within `margin` pixels of the picture's border.
    pub fn touches_border(&self, (width, height): (usize, usize), margin: usize) -> bool {
        self.runs.iter().any(|run| {
            let (first, last, row) = (usize::from(run.first), usize::from(run.last), usize::from(run.row));
            first <= margin || row <= margin || last + margin + 1 >= width || row + margin + 1 >= height
        })
    }

    /// Of its pixels, how many `is_inside` of another picture accepts.
    pub fn pixels_where(&self, pixels: &[u16], width: usize, is_inside: &dyn Fn(u16) -> bool) -> usize {
        let count = |run: &Run| {
            let row = usize::from(run.row) * width;
            let run = pixels.get(row + usize::from(run.first)..=row + usize::from(run.last));
            run.map_or(0, |values| values.iter().filter(|value| is_inside(**value)).count())
        };
        self.runs.iter().map(count).sum()
    }

    /// Small, for keeping one a frame of a long log: about a kilobyte.
    pub fn packed(&self) -> io::Result<Packed> {
        let bytes: Vec<u8> =
            self.runs.iter().flat_map(|run| [run.row, run.first, run.last]).flat_map(u16::to_le_bytes).collect();
        Ok(Packed { bytes: zstd::bulk::compress(&bytes, 1)?, unpacked_bytes: bytes.len(), pixels: self.pixels })
    }
}

/// An area, packed.
#[derive(Debug, Clone, Default)]
pub struct Packed {
    bytes: Vec<u8>,
    unpacked_bytes: usize,
    pixels: usize,
}

impl Packed {
    /// Pixels in it.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// The area again.
    pub fn area(&self) -> io::Result<Area> {
        if self.pixels == 0 {
            return Ok(Area::default());
        }
        let bytes = zstd::bulk::decompress(&self.bytes, self.unpacked_bytes)?;
        let number = |at: &[u8]| u16::from_le_bytes([at[0], at[1]]);
        let run = |run: &[u8]| Run { row: number(run), first: number(&run[2..]), last: number(&run[4..]) };
        Ok(Area { runs: bytes.chunks_exact(6).map(run).collect(), pixels: self.pixels })
    }
}

/// What is redacted of one picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cover {
    pub width: usize,
    pub height: usize,
    inside: Vec<bool>,
}

impl Cover {
    /// Nothing of a picture.
    pub fn none((width, height): (usize, usize)) -> Self {
        Self { width, height, inside: vec![false; width * height] }
    }

    /// All of it.
    pub fn whole((width, height): (usize, usize)) -> Self {
        Self { width, height, inside: vec![true; width * height] }
    }

    /// Areas, each grown by its own radius in pixels (Euclidean), joined.
    pub fn of(size: (usize, usize), grown: &[(Area, usize)]) -> Self {
        let (width, height) = size;
        // How many areas begin less how many end before each pixel of a row: a span costs two numbers.
        let mut steps = vec![0_i32; (width + 1) * height];
        for (area, radius) in grown {
            let reach: Vec<usize> = (0..=*radius).map(|dy| (radius * radius - dy * dy).isqrt()).collect();
            for run in &area.runs {
                let row = usize::from(run.row);
                for other in row.saturating_sub(*radius)..=(row + radius).min(height.saturating_sub(1)) {
                    let reach = reach[other.abs_diff(row)];
                    let first = usize::from(run.first).saturating_sub(reach).min(width);
                    let end = (usize::from(run.last) + reach + 1).min(width);
                    steps[other * (width + 1) + first] += 1;
                    steps[other * (width + 1) + end] -= 1;
                }
            }
        }
        let mut inside = Vec::with_capacity(width * height);
        for row in steps.chunks_exact(width + 1) {
            let mut depth = 0;
            inside.extend(row[..width].iter().map(|step| {
                depth += step;
                depth > 0
            }));
        }
        Self { width, height, inside }
    }

    /// What either redacts.
    pub fn joined(mut self, other: &Self) -> Self {
        self.inside.iter_mut().zip(&other.inside).for_each(|(inside, other)| *inside |= other);
        self
    }

    /// Whether a pixel is redacted, by its index: rows joined.
    pub fn has(&self, pixel: usize) -> bool {
        self.inside.get(pixel).copied().unwrap_or(true)
    }

    /// Redacted pixels.
    pub fn pixels(&self) -> usize {
        self.inside.iter().filter(|inside| **inside).count()
    }

    /// A flag a pixel.
    pub fn flags(&self) -> &[bool] {
        &self.inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(pixels: &[(usize, usize)], (width, height): (usize, usize)) -> Area {
        let mut picture = vec![0; width * height];
        pixels.iter().for_each(|(x, y)| picture[y * width + x] = 1);
        Area::new(&picture, width, &|value| value == 1)
    }

    #[test]
    fn growing_is_the_union_of_discs() {
        let size = (23, 17);
        let (a, b) = ([(0, 0), (1, 0), (2, 0), (11, 8), (22, 16)], [(5, 12), (6, 12)]);
        for (radius_a, radius_b) in [(0, 0), (1, 3), (4, 2), (30, 0)] {
            let cover = Cover::of(size, &[(area(&a, size), radius_a), (area(&b, size), radius_b)]);
            for y in 0..size.1 {
                for x in 0..size.0 {
                    let near = |points: &[(usize, usize)], radius: usize| {
                        points.iter().any(|(u, v)| x.abs_diff(*u).pow(2) + y.abs_diff(*v).pow(2) <= radius * radius)
                    };
                    let wanted = near(&a, radius_a) || near(&b, radius_b);
                    assert_eq!(cover.has(y * size.0 + x), wanted, "{x} {y}, {radius_a} {radius_b}");
                }
            }
        }
    }

    #[test]
    fn squares_cover_what_they_hold_and_one_more_around() {
        let size = (23, 17);
        let mut picture = vec![0; size.0 * size.1];
        [(0, 0), (11, 8), (22, 16)].iter().for_each(|(x, y)| picture[y * size.0 + x] = 1);
        let squares = Area::squares(&picture, size.0, 4, &|value| value == 1);
        let cover = Cover::of(size, &[(squares.unfolded(4), 0)]);
        for y in 0..size.1 {
            for x in 0..size.0 {
                let near = |(u, v): (usize, usize)| (x / 4).abs_diff(u / 4) <= 1 && (y / 4).abs_diff(v / 4) <= 1;
                let wanted = [(0, 0), (11, 8), (22, 16)].into_iter().any(near);
                assert_eq!(cover.has(y * size.0 + x), wanted, "{x} {y}");
            }
        }
    }

    #[test]
    fn packing_keeps_everything() {
        let size = (640, 480);
        let all = area(&(0..600).map(|i| (i, (i * 7) % 480)).collect::<Vec<_>>(), size);
        assert_eq!(all.packed().unwrap().area().unwrap(), all);
        assert_eq!(Area::default().packed().unwrap().area().unwrap(), Area::default());
        assert!(all.touches_border(size, 0) && !area(&[(5, 5)], size).touches_border(size, 4));
        assert!(area(&[(5, 5)], size).touches_border(size, 5));
    }
}
