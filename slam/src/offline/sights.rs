//! What frames saw of the map, kept until the end of a run.

use std::collections::{BTreeMap, VecDeque};

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, MapPointId};
use slam_optimize::Measurement;

use crate::context::Context;
use crate::tracking::TrackedFrame;

/// Columns and rows of the cells that a frame's matches are spread over.
const GRID: [u32; 2] = [8, 6];
/// Merges that are remembered before all matches are brought up to date: some 3 MiB.
const MAX_MERGES: usize = 1 << 16;
/// Room for so many matches at least is asked for at once: 2 MiB.
const MIN_ROOM: usize = 1 << 17;
/// Low bits of the depth that hold the octave: there are at most 16, and 2^-19 of a depth is far below its noise.
const OCTAVE_BITS: u32 = 0xf;

/// One match of a frame, in 16 bytes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Sight {
    point: MapPointId,
    /// Without lens distortion.
    pixel: [f32; 2],
    /// Bits of the depth in metres (0 = none), the lowest ones replaced by the octave.
    depth_and_octave: u32,
}

impl Sight {
    fn of(frame: &TrackedFrame, keypoint: usize, point: MapPointId) -> Self {
        let obs = &frame.obs;
        let depth = (obs.depth_m[keypoint] as f32).to_bits();
        let depth_and_octave = depth & !OCTAVE_BITS | u32::from(obs.octave[keypoint]) & OCTAVE_BITS;
        Self { point, pixel: obs.pixel[keypoint].map(|v| v as f32), depth_and_octave }
    }

    fn measurement(&self, ctx: &Context) -> Measurement {
        let depth = f64::from(f32::from_bits(self.depth_and_octave & !OCTAVE_BITS));
        let octave = (self.depth_and_octave & OCTAVE_BITS) as u8;
        ctx.measure(self.pixel.map(f64::from), octave, Some(depth).filter(|z| *z > 0.0))
    }
}

/// The matches of the newest frames.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Sights {
    /// Frames that are forgotten.
    forgotten: usize,
    /// Matches of each frame after those.
    counts: VecDeque<u16>,
    /// The matches, frame after frame.
    sights: VecDeque<Sight>,
    /// What merged points became.
    merged: BTreeMap<MapPointId, MapPointId>,
}

impl Sights {
    /// Keeps matches of the next frame, none if it was lost, and forgets the oldest frame when there are too many.
    pub fn remember(&mut self, ctx: &Context, frame: Option<&TrackedFrame>) {
        let limits = &ctx.config.r#final;
        let chosen = frame.map(|frame| (frame, choose(ctx, frame, limits.max_matches)));
        let count = chosen.as_ref().map_or(0, |(_, chosen)| chosen.len());
        self.counts.push_back(count as u16);
        if self.sights.len() + count > self.sights.capacity() {
            // A quarter at a time, not twice as much: this is the largest list of a long run.
            self.sights.reserve_exact(usize::max(count, usize::max(MIN_ROOM, self.sights.len() / 4)));
        }
        if let Some((frame, chosen)) = &chosen {
            self.sights.extend(chosen.iter().map(|(keypoint, point)| Sight::of(frame, *keypoint, *point)));
        }
        while self.counts.len() > limits.max_frames {
            let oldest = self.counts.pop_front().unwrap_or_default();
            self.sights.drain(..usize::from(oldest));
            self.forgotten += 1;
        }
    }

    /// Follows points that were merged into others.
    pub fn follow(&mut self, merges: BTreeMap<MapPointId, MapPointId>) {
        if self.sights.is_empty() {
            return;
        }
        self.merged.extend(merges);
        if self.merged.len() > MAX_MERGES {
            let merged = std::mem::take(&mut self.merged);
            self.sights.iter_mut().for_each(|sight| sight.point = current(&merged, sight.point));
        }
    }

    /// Per frame of the run, the places of its matches among all; none where it is forgotten.
    pub(super) fn places(&self) -> Vec<std::ops::Range<usize>> {
        let mut end = 0;
        let of_frame = |count: &u16| {
            let start = end;
            end += usize::from(*count);
            start..end
        };
        let known: Vec<_> = self.counts.iter().map(of_frame).collect();
        std::iter::repeat_n(0..0, self.forgotten).chain(known).collect()
    }

    /// Points, as they are called now, and where they were seen.
    pub(super) fn at<'a>(
        &'a self,
        ctx: &'a Context,
        places: std::ops::Range<usize>,
    ) -> impl Iterator<Item = (MapPointId, Measurement)> + 'a {
        self.sights.range(places).map(|sight| (current(&self.merged, sight.point), sight.measurement(ctx)))
    }
}

fn current(merged: &BTreeMap<MapPointId, MapPointId>, mut id: MapPointId) -> MapPointId {
    while let Some(next) = merged.get(&id) {
        id = *next;
    }
    id
}

/// At most so many matches: from every cell of the picture in turn the best one, which has depth and lies on a fine level.
fn choose(ctx: &Context, frame: &TrackedFrame, max: usize) -> Buffer<(usize, MapPointId)> {
    let mut matches = ctx.buffers.collect(frame.matches());
    if matches.len() <= max {
        return matches;
    }
    let obs = &frame.obs;
    let size = [ctx.camera.width, ctx.camera.height];
    let cell = |i: usize| {
        let at = |axis: usize| {
            let share = obs.raw_pixel[i][axis] * f64::from(GRID[axis]) / f64::from(size[axis]);
            // Floats are clipped by the conversion.
            (share as u32).min(GRID[axis] - 1)
        };
        at(1) * GRID[0] + at(0)
    };
    let worth = |i: usize| (obs.depth(i).is_none(), obs.octave[i], i as u32);
    let mut ranked = ctx.buffers.collect(matches.iter().map(|(i, _)| (cell(*i), worth(*i))));
    ranked.sort_unstable();
    let (mut rank, mut last) = (0_u32, u32::MAX);
    for (cell, _) in &mut ranked {
        rank = if *cell == last { rank + 1 } else { 0 };
        last = *cell;
        *cell = rank;
    }
    ranked.sort_unstable();
    let mut kept = ctx.buffers.collect(ranked.iter().take(max).map(|(_, (_, _, i))| *i as usize));
    kept.sort_unstable();
    matches.retain(|(i, _)| kept.binary_search(i).is_ok());
    matches
}
