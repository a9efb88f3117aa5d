//! Parts of the picture that may move: Things, people, and connected unknown areas, on a grid of small cells.

use serde::{Deserialize, Serialize};
use slam_math::Buffer;

use crate::context::Context;
use crate::input::{FrameInput, PanopticMask};

/// Side of a cell in pixels.
pub const CELL_PX: usize = 4;
/// Cells of the background.
pub const NO_REGION: u16 = u16::MAX;

/// What a region is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum RegionKind {
    /// A person.
    Person,
    /// A Thing.
    Thing,
    /// Claimed by no segment.
    Unknown,
}

/// One region.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Region {
    /// What it is.
    pub kind: RegionKind,
    /// Segment id in the mask; 0 for unknown areas.
    pub segment: u16,
    /// Category; 0 for unknown areas.
    pub category: u16,
    /// An unknown area of a depth image without a single measurement: nothing can be seen to move there.
    pub blind: bool,
    /// Cells it covers.
    pub cells: u32,
    /// First and last column, first and last row, in cells.
    pub extent: [u16; 4],
}

/// The regions of a picture.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Regions {
    /// Cells per row.
    pub width: usize,
    /// Rows of cells.
    pub height: usize,
    /// Region index per cell, or [`NO_REGION`].
    pub cell: Buffer<u16>,
    /// Segments in id order, then unknown areas in scan order.
    pub list: Buffer<Region>,
}

impl Regions {
    /// Cuts a picture into regions. Without a mask everything is background; [`super::PanopticFilter`] gives one in which nothing is
    /// known to frames that lost theirs.
    #[must_use]
    pub fn new(ctx: &Context, input: &FrameInput) -> Self {
        let (width, height) = (input.gray.width / CELL_PX, input.gray.height / CELL_PX);
        let cell = ctx.buffers.filled(width * height, NO_REGION);
        let mut regions = Self { width, height, cell, list: ctx.buffers.empty() };
        if let Some(mask) = input.panoptic.as_deref() {
            let unknown = regions.add_segments(ctx, mask);
            regions.add_unknown(ctx, input, unknown);
            regions.measure();
        }
        regions
    }

    /// Pixel in the middle of a cell.
    #[must_use]
    pub fn center(&self, cell: usize) -> (i64, i64) {
        let middle = |c: usize| (c * CELL_PX + CELL_PX / 2) as i64;
        (middle(cell % self.width), middle(cell / self.width))
    }

    /// Cell of a pixel.
    #[must_use]
    pub fn cell_at(&self, pixel: [f64; 2]) -> Option<usize> {
        let (x, y) = ((pixel[0] + 0.5).floor(), (pixel[1] + 0.5).floor());
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (x, y) = (x as usize / CELL_PX, y as usize / CELL_PX);
        (x < self.width && y < self.height).then_some(y * self.width + x)
    }

    /// Claims the cells of Things and people; returns which cells no segment claims.
    fn add_segments(&mut self, ctx: &Context, mask: &PanopticMask) -> Buffer<bool> {
        let mut region_of = ctx.buffers.filled(mask.segments.len(), None);
        for (i, segment) in mask.segments.iter().enumerate() {
            let person = ctx.people.contains(&segment.category);
            if person || ctx.is_thing(segment.category) {
                region_of[i] = Some(self.list.len() as u16);
                let kind = if person { RegionKind::Person } else { RegionKind::Thing };
                self.list.push(Region {
                    kind,
                    segment: segment.id,
                    category: segment.category,
                    blind: false,
                    cells: 0,
                    extent: [0; 4],
                });
            }
        }
        let mut unknown = ctx.buffers.filled(self.cell.len(), false);
        for (cell, is_unknown) in unknown.iter_mut().enumerate() {
            let (x, y) = self.center(cell);
            match mask.segments.binary_search_by_key(&mask.at(x, y), |s| s.id) {
                Ok(i) => self.cell[cell] = region_of[i].unwrap_or(NO_REGION),
                Err(_) => *is_unknown = true,
            }
        }
        unknown
    }

    /// Splits unknown cells into connected areas without a depth step inside.
    fn add_unknown(&mut self, ctx: &Context, input: &FrameInput, mut unknown: Buffer<bool>) {
        let share = ctx.config.panoptic.motion.depth_step_share;
        let depth_of = |cell: usize, regions: &Self| {
            let (x, y) = regions.center(cell);
            input.depth.as_deref().and_then(|d| d.metres(x, y)).unwrap_or(0.0)
        };
        let depth: Buffer<f64> = ctx.buffers.collect((0..self.cell.len()).map(|c| depth_of(c, self)));
        // Neighbours in one picture, not one place in two: a slanted surface steps with its depth, which the margin of free space
        // does not know.
        let joined = |a: usize, b: usize| match (depth[a] > 0.0, depth[b] > 0.0) {
            (true, true) => (depth[a] - depth[b]).abs() <= share * depth[a] + ctx.config.panoptic.motion.free_space_m,
            (false, false) => true,
            _ => false,
        };
        // Cells that are reached and whose neighbours are to be looked at; in which order makes no difference.
        let mut reached = ctx.buffers.empty();
        for start in 0..self.cell.len() {
            if !unknown[start] || self.list.len() >= usize::from(NO_REGION) {
                continue;
            }
            let region = self.list.len() as u16;
            let blind = input.depth.is_some() && depth[start] == 0.0;
            let kind = RegionKind::Unknown;
            self.list.push(Region { kind, segment: 0, category: 0, blind, cells: 0, extent: [0; 4] });
            unknown[start] = false;
            reached.push(start);
            while let Some(cell) = reached.pop() {
                self.cell[cell] = region;
                for next in self.neighbours(cell).into_iter().flatten() {
                    if unknown[next] && joined(cell, next) {
                        unknown[next] = false;
                        reached.push(next);
                    }
                }
            }
        }
    }

    /// The regions without some cells.
    #[must_use]
    pub fn without(&self, cells: &[bool]) -> Self {
        let mut rest = self.clone();
        rest.cell.iter_mut().zip(cells).filter(|(_, without)| **without).for_each(|(cell, _)| *cell = NO_REGION);
        rest.measure();
        rest
    }

    fn neighbours(&self, cell: usize) -> [Option<usize>; 4] {
        let (x, y) = (cell % self.width, cell / self.width);
        [
            (x > 0).then(|| cell - 1),
            (x + 1 < self.width).then(|| cell + 1),
            (y > 0).then(|| cell - self.width),
            (y + 1 < self.height).then(|| cell + self.width),
        ]
    }

    fn measure(&mut self) {
        for region in &mut self.list {
            (region.cells, region.extent) = (0, [u16::MAX, 0, u16::MAX, 0]);
        }
        for (cell, region) in self.cell.iter().enumerate().filter(|(_, r)| **r != NO_REGION) {
            let (x, y) = ((cell % self.width) as u16, (cell / self.width) as u16);
            let region = &mut self.list[usize::from(*region)];
            region.cells += 1;
            let [x0, x1, y0, y1] = region.extent;
            region.extent = [x0.min(x), x1.max(x), y0.min(y), y1.max(y)];
        }
        for region in self.list.iter_mut().filter(|r| r.cells == 0) {
            region.extent = [0; 4];
        }
    }
}
