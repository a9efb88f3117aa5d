//! Short-term association: which region of the last frame is this one? And the memory of where movers just were.

use super::{NO_REGION, PanopticFilter, Region, RegionKind, Regions, Track};
use crate::config::{MotionConfig, Rule};
use crate::context::Context;
use crate::report::RegionState;

/// Frames for which a place stays suspect after a person or mover left it: people are missed in single frames.
const HEAT_FRAMES: u8 = 5;

impl PanopticFilter {
    /// Gives each region its track: the overlapping one of the last frame with the best intersection over union of
    /// masks, one to one, of the same kind and category; under the geometric rule what is left may change its label (a
    /// mover is often mislabelled for some frames). The rest starts new tracks.
    pub(super) fn associate(&mut self, ctx: &Context, regions: &Regions) -> Vec<Track> {
        let mut tracks: Vec<Option<Track>> = vec![None; regions.list.len()];
        if let Some(last) = &self.last {
            if last.regions.cell.len() == regions.cell.len() {
                let mut taken = vec![false; last.regions.list.len()];
                for (before, now) in ranked_pairs(ctx, &last.regions, regions) {
                    if !taken[before] && tracks[now].is_none() {
                        taken[before] = true;
                        tracks[now] = Some(inherit(&last.tracks[before], &regions.list[now]));
                    }
                }
            }
        }
        let new_track = |region: &Region, id| Track {
            id,
            state: region.first_state(),
            age: 0,
            static_streak: 0,
            dynamic_streak: 0,
        };
        let mut next = self.next_track;
        let start = |(track, region): (Option<Track>, &Region)| {
            track.unwrap_or_else(|| {
                next += 1;
                new_track(region, next - 1)
            })
        };
        let tracks = tracks.into_iter().zip(&regions.list).map(start).collect();
        self.next_track = next;
        tracks
    }

    /// Cells that are people or movers, or were a moment ago: frames until they are forgotten.
    pub(super) fn heat(&self, ctx: &Context, regions: &Regions, tracks: &[Track]) -> Vec<u8> {
        let before = self.last.as_ref().filter(|last| last.heat.len() == regions.cell.len());
        let filters = &ctx.config.panoptic;
        let hot = |region: u16| match tracks.get(usize::from(region)).map(|t| t.state) {
            Some(RegionState::Person) => filters.people,
            Some(RegionState::Dynamic) => match regions.list[usize::from(region)].kind {
                RegionKind::Unknown => filters.unknown,
                _ => filters.things,
            },
            _ => false,
        };
        let cooled = |cell: usize| before.map_or(0, |last| last.heat[cell].saturating_sub(1));
        regions.cell.iter().enumerate().map(|(cell, r)| if hot(*r) { HEAT_FRAMES } else { cooled(cell) }).collect()
    }
}

/// Pairs `(before, now)` that may be one object: same label first, then by falling overlap, then by index.
fn ranked_pairs(ctx: &Context, last: &Regions, regions: &Regions) -> Vec<(usize, usize)> {
    let columns = regions.list.len();
    let mut shared = vec![0u32; last.list.len() * columns];
    for (before, now) in last.cell.iter().zip(&regions.cell) {
        if *before != NO_REGION && *now != NO_REGION {
            shared[usize::from(*before) * columns + usize::from(*now)] += 1;
        }
    }
    let mut pairs = Vec::new();
    for (i, both) in shared.into_iter().enumerate().filter(|(_, n)| *n > 0) {
        let (a, b) = (&last.list[i / columns], &regions.list[i % columns]);
        let iou = f64::from(both) / f64::from(a.cells + b.cells - both);
        let same = a.kind == b.kind && a.category == b.category;
        let people = a.kind == RegionKind::Person || b.kind == RegionKind::Person;
        let may_change = ctx.config.panoptic.rule == Rule::Geometric && !people;
        if iou > ctx.config.panoptic.association.min_iou && (same || may_change) {
            pairs.push((!same, iou, i / columns, i % columns));
        }
    }
    pairs.sort_by(|a, b| a.0.cmp(&b.0).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)).then(a.3.cmp(&b.3)));
    pairs.into_iter().map(|(_, _, before, now)| (before, now)).collect()
}

fn inherit(before: &Track, region: &Region) -> Track {
    let mut track = Track { age: before.age + 1, ..*before };
    if region.kind == RegionKind::Person {
        track.state = RegionState::Person;
    }
    track
}

/// What a frame says about a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Vote {
    /// It moves.
    Dynamic,
    /// It stands still.
    Static,
    /// Nothing to say.
    Silent,
}

impl Track {
    /// Hysteresis: a vote alone moves no confirmed region, and a mover has to stand still for long to come back.
    pub(super) fn update(&mut self, config: &MotionConfig, vote: Vote) {
        if self.state == RegionState::Person {
            return;
        }
        match vote {
            Vote::Dynamic => (self.dynamic_streak, self.static_streak) = (self.dynamic_streak + 1, 0),
            Vote::Static => (self.dynamic_streak, self.static_streak) = (0, self.static_streak + 1),
            Vote::Silent => {}
        }
        self.state = match self.state {
            RegionState::New if self.dynamic_streak > 0 => RegionState::Dynamic,
            RegionState::New if self.static_streak >= config.confirm_frames => RegionState::Static,
            RegionState::Static if self.dynamic_streak >= config.suspect_frames => RegionState::Dynamic,
            RegionState::Dynamic if self.static_streak >= config.readmit_frames => RegionState::Static,
            state => state,
        };
    }
}
