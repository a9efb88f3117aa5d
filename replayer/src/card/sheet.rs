//! A contact sheet: pictures at even distances, their depth below, their labels below that.

use std::collections::BTreeMap;

use schemas::{Stamp, pairing};

use crate::export::{Canvas, ExportError, Source, category_color, depth_color};
use crate::log::{EncodedImage, color_pixels};

const COLUMNS: usize = 8;
const CELL_WIDTH: usize = 240;
const GAP: usize = 4;
const PAPER: [u8; 3] = [255; 3];

/// What is kept of a log for its sheet.
#[derive(Default)]
pub(super) struct Sheet {
    /// Stamps of the pictures and their columns.
    columns: BTreeMap<Stamp, usize>,
    /// Stamps of the depth images and their columns.
    depth_columns: BTreeMap<Stamp, usize>,
    cell_height: usize,
    /// Colour, depth, labels over grey: each by column.
    rows: [BTreeMap<usize, Canvas>; 3],
}

impl Sheet {
    pub fn new(source: &Source<'_>) -> Self {
        let frames = &source.frames;
        let count = COLUMNS.min(frames.len());
        // The middle of each of `count` equal parts.
        let at = |column: usize| frames[(2 * column + 1) * frames.len() / (2 * count)];
        let columns: BTreeMap<Stamp, usize> = (0..count).map(|column| (at(column), column)).collect();
        let pairs = pairing::associate(frames, &source.depths, source.tolerance_ns);
        let depth = |(frame, depth): &(usize, usize)| Some((source.depths[*depth], *columns.get(&frames[*frame])?));
        let depth_columns = pairs.iter().filter_map(depth).collect();
        let cell_height = (CELL_WIDTH * source.camera.height as usize / source.camera.width as usize).max(1);
        Self { columns, depth_columns, cell_height, ..Self::default() }
    }

    pub fn color(&mut self, stamp: Stamp, image: &EncodedImage, source: &Source<'_>) -> Result<(), ExportError> {
        let Some(column) = self.columns.get(&stamp).copied() else { return Ok(()) };
        let size = (source.camera.width as usize, source.camera.height as usize);
        let data = color_pixels(&image.format, &image.bytes, size);
        let data = data.map_err(|reason| ExportError::Picture { stamp, reason })?;
        self.keep(0, column, &Canvas { width: size.0, height: size.1, data });
        Ok(())
    }

    pub fn depth(&mut self, stamp: Stamp, units: &[u16], source: &Source<'_>) {
        let Some(column) = self.depth_columns.get(&stamp).copied() else { return };
        let data = units.iter().flat_map(|unit| depth_color(f64::from(*unit) / source.units_per_metre)).collect();
        self.keep(
            1,
            column,
            &Canvas { width: source.camera.width as usize, height: source.camera.height as usize, data },
        );
    }

    pub fn mask(&mut self, stamp: Stamp, class: &[u16], source: &Source<'_>) {
        let Some(column) = self.columns.get(&stamp).copied() else { return };
        let data = class.iter().flat_map(|id| category_color(*id)).collect();
        self.keep(
            2,
            column,
            &Canvas { width: source.camera.width as usize, height: source.camera.height as usize, data },
        );
    }

    /// Shrinks at once: a sheet's memory is that of its cells.
    fn keep(&mut self, row: usize, column: usize, picture: &Canvas) {
        let mut cell = Canvas::new(CELL_WIDTH, self.cell_height, PAPER);
        cell.draw(picture, 0, 0, CELL_WIDTH, self.cell_height);
        self.rows[row].insert(column, cell);
    }

    /// The sheet as a PNG file; rows without a picture are left out.
    pub fn draw(mut self) -> Result<Vec<u8>, ExportError> {
        self.mix_labels();
        let rows: Vec<&BTreeMap<usize, Canvas>> = self.rows.iter().filter(|row| !row.is_empty()).collect();
        let columns = self.columns.len().max(1);
        let (width, height) = (columns * (CELL_WIDTH + GAP) + GAP, rows.len().max(1) * (self.cell_height + GAP) + GAP);
        let mut sheet = Canvas::new(width, height, PAPER);
        for (row, cells) in rows.iter().enumerate() {
            for (column, cell) in *cells {
                let (x, y) = (GAP + column * (CELL_WIDTH + GAP), GAP + row * (self.cell_height + GAP));
                sheet.draw(cell, x, y, CELL_WIDTH, self.cell_height);
            }
        }
        sheet.to_png()
    }

    /// Labels stand over the grey picture.
    fn mix_labels(&mut self) {
        let [color, _, labels] = &mut self.rows;
        for (column, label) in labels {
            let Some(picture) = color.get(column) else { continue };
            for (to, from) in label.data.chunks_exact_mut(3).zip(picture.data.chunks_exact(3)) {
                let gray = (u32::from(from[0]) * 2 + u32::from(from[1]) * 5 + u32::from(from[2])) / 8;
                to.iter_mut().for_each(|channel| *channel = ((gray + u32::from(*channel)) / 2) as u8);
            }
        }
    }
}
