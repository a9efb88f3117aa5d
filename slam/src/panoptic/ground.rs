//! Ground: the background, known by its place instead of by its label.
//!
//! A network that is sure of a table in one picture is not in the next: blur, or a mover before it, and the table is part of a
//! region that moves as most of it does. But where a surface stands that was background a moment ago and kept clear of
//! movers, there is background still. Such cells leave their region: it is judged without them, their keypoints stay in
//! use, and the place is not taken for a mover's. Only depth images can show it.

use nalgebra::Vector3;
use slam_math::Buffer;

use super::association::{CellMemory, GROUND_FRAMES};
use super::evidence::{Now, SAMPLE_STRIDE, Seen, compare};
use super::{CELL_PX, Few, FrameFilter, NO_REGION, PanopticFilter, RegionKind, Regions, Remembered};
use crate::config::Rule;
use crate::context::Context;
use crate::input::Sensor;
use crate::matching::project;
use crate::observation::round_to_pixel;
use crate::report::{KeypointClass, RegionState};

/// Frames between two anchors.
const ANCHOR_FRAMES: u32 = 30;
/// Anchors that are kept: what the last eight seconds showed.
const MAX_ANCHORS: usize = 8;

/// Cells that show background by their label and were not a mover's a moment ago. Ground that is only known by its place
/// does not count: a surface that moves little from frame to frame would stay ground for ever.
pub(super) fn labelled(ctx: &Context, frame: &FrameFilter) -> Buffer<bool> {
    let cells = frame.regions.cell.iter().zip(&frame.memory);
    ctx.buffers.collect(cells.map(|(region, memory)| *region == NO_REGION && memory.heat == 0))
}

/// Cells of a region that were background a moment ago: all that is known without a pose.
pub(super) fn expected(ctx: &Context, memory: &[CellMemory], regions: &Regions) -> Buffer<bool> {
    if ctx.sensor != Sensor::Rgbd || ctx.config.panoptic.rule == Rule::Paper || memory.len() != regions.cell.len() {
        return ctx.buffers.filled(regions.cell.len(), false);
    }
    let is_expected = |(memory, region): (&CellMemory, &u16)| {
        let region = regions.list.get(usize::from(*region));
        region.is_some_and(|region| memory.ground == GROUND_FRAMES || region.blind && memory.ground > 0)
    };
    ctx.buffers.collect(memory.iter().zip(&regions.cell).map(is_expected))
}

/// Of the cells that were expected to be ground, those without depth stay: nothing says otherwise.
pub(super) fn keep_blind(frame: &mut FrameFilter) {
    for (ground, region) in frame.ground.iter_mut().zip(&frame.regions.cell) {
        *ground &= frame.regions.list.get(usize::from(*region)).is_some_and(|region| region.blind);
    }
}

/// Whether background stood at a point in the world: older frames say so (`seen`, what each saw there) or an anchor does, and
/// no older frame saw through it.
pub(super) fn stood_at(ctx: &Context, now: &Now<'_>, in_world: &Vector3<f64>, seen: &[Option<Seen>]) -> bool {
    let was_ground = || seen.contains(&Some(Seen::Same { ground: true }));
    let is_anchored = || now.anchors.iter().any(|anchor| showed(ctx, anchor, in_world));
    !seen.contains(&Some(Seen::Farther)) && (was_ground() || is_anchored())
}

/// Whether an older frame saw background at a point in the world.
fn showed(ctx: &Context, then: &Remembered, in_world: &Vector3<f64>) -> bool {
    let Some((pixel, expected)) = project(&ctx.camera, &then.camera_from_world, in_world) else { return false };
    then.shows_ground(ctx, ctx.camera.distort(pixel).map(round_to_pixel), expected)
}

/// Whether a keypoint in a region lies on ground: its cell does, and so does its own depth if it has one.
pub(super) fn keypoints(ctx: &Context, now: &Now<'_>, older: &[&Remembered], frame: &FrameFilter) -> Buffer<bool> {
    let world_from_camera = now.tracked.camera_from_world.inverse();
    let by_depth = ctx.sensor == Sensor::Rgbd && now.depth.is_some();
    let mut seen = Few::new();
    let one = |i: usize| {
        if !by_depth || !matches!(frame.class[i], KeypointClass::Thing | KeypointClass::Unknown) {
            return false;
        }
        if !frame.on_ground(now.obs.raw_pixel[i]) {
            return false;
        }
        let Some(z) = now.obs.depth(i) else { return true };
        let in_world = world_from_camera.transform(&ctx.camera.unproject(now.obs.pixel[i], z));
        seen.clear();
        seen.extend(older.iter().map(|then| compare(ctx, then, &in_world)));
        stood_at(ctx, now, &in_world, &seen)
    };
    ctx.buffers.collect((0..now.obs.len()).map(one))
}

impl PanopticFilter {
    /// Keeps the youngest frame of history as an anchor when the last one is old.
    pub(super) fn drop_anchor(&mut self) {
        let Some(youngest) = self.history.back() else { return };
        if self.anchors.back().is_none_or(|last| youngest.id.0 >= last.id.0 + ANCHOR_FRAMES) {
            self.anchors.push_back(youngest.clone());
        }
        if self.anchors.len() > MAX_ANCHORS {
            self.anchors.pop_front();
        }
    }
}

impl Remembered {
    /// Whether a pixel (as recorded) showed background at this depth, metres. One sigma and not the margin of free space: ground
    /// stays in use whatever its label, and a mover that leans against a wall must not pass for it.
    pub(super) fn shows_ground(&self, ctx: &Context, [x, y]: [i64; 2], expected: f64) -> bool {
        // Most places are none: the small table is looked up first.
        let measured = || self.depth.as_ref().and_then(|depth| depth.metres(x, y));
        self.is_ground(x, y) && measured().is_some_and(|z| (z - expected).abs() <= ctx.depth_sigma(expected))
    }

    fn is_ground(&self, x: i64, y: i64) -> bool {
        let width = self.depth.as_ref().map_or(0, |depth| depth.width / CELL_PX);
        let (column, row) = (x as usize / CELL_PX, y as usize / CELL_PX);
        x >= 0 && y >= 0 && column < width && self.ground.get(row * width + column).is_some_and(|ground| *ground)
    }
}

impl FrameFilter {
    /// The cells that a sampled one stands for: those up to the next ones.
    pub(super) fn block(&self, sampled: usize) -> impl Iterator<Item = usize> + use<> {
        let (width, height) = (self.regions.width, self.regions.height);
        let (row, column) = (sampled / width, sampled % width);
        let columns = column..(column + SAMPLE_STRIDE).min(width);
        (row..(row + SAMPLE_STRIDE).min(height)).flat_map(move |row| columns.clone().map(move |x| row * width + x))
    }

    /// Whether a cell is not simply background by its label.
    pub(super) fn is_in_doubt(&self, cell: usize) -> bool {
        self.regions.cell[cell] != NO_REGION || self.memory[cell].heat > 0
    }

    /// A surface that was background still is, but for people on it.
    pub(super) fn mark_ground(&mut self, sampled: usize) {
        for cell in self.block(sampled) {
            let kind = self.regions.list.get(usize::from(self.regions.cell[cell])).map(|region| region.kind);
            self.ground[cell] = kind != Some(RegionKind::Person);
        }
    }

    /// Whether a pixel (as recorded) of a region shows ground.
    pub(super) fn on_ground(&self, raw_pixel: [f64; 2]) -> bool {
        self.regions.cell_at(raw_pixel).is_some_and(|cell| self.ground[cell])
    }

    /// State of the region of a cell; `None` on background and on ground.
    pub(super) fn state_of(&self, cell: usize) -> Option<RegionState> {
        let region = if self.ground[cell] { NO_REGION } else { self.regions.cell[cell] };
        self.tracks.get(usize::from(region)).map(|track| track.state)
    }
}
