//! Short-term association: which region of the last frame is this one? And the memory of where movers just were.

use serde::{Deserialize, Serialize};
use slam_math::Buffer;

use super::{FrameFilter, NO_REGION, PanopticFilter, Region, RegionKind, Regions, Track};
use crate::config::{PanopticConfig, Rule};
use crate::context::Context;
use crate::report::RegionState;

/// Frames for which a place stays suspect after a person or mover left it: people are missed in single frames.
const HEAT_FRAMES: u8 = 5;
/// Frames for which a place is remembered as confirmed static: real networks drop a segment for some frames.
const CALM_FRAMES: u8 = 10;

/// Frames for which a place without depth is remembered as background when its label goes: nothing else tells.
pub(super) const GROUND_FRAMES: u8 = 30;

/// Frames in which map points that have stood still for long must vouch for a region that was taken to move.
const VOUCHED_FRAMES: u32 = 5;

/// What a cell of the picture was a moment ago.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct CellMemory {
    /// Frames until it is forgotten that a person or mover was here.
    pub heat: u8,
    /// Frames until it is forgotten that a mover was here that is no person.
    pub moved: u8,
    /// Frames until it is forgotten that a confirmed static region was here.
    pub calm: u8,
    /// Frames until it is forgotten that background was here, by its label or by its place.
    pub ground: u8,
}

impl PanopticFilter {
    /// Gives each region its track: the overlapping one of the last frame with the best intersection over union of
    /// masks, one to one, of the same kind and category; under the geometric rule what is left may change its label (a
    /// mover is often mislabelled for some frames). The rest starts new tracks. Cells of `ground` count for nothing.
    pub(super) fn associate(&mut self, ctx: &Context, regions: &Regions, ground: &[bool]) -> Buffer<Track> {
        let regions = &regions.without(ground);
        let mut tracks: Buffer<Option<Track>> = ctx.buffers.filled(regions.list.len(), None);
        if let Some(last) = &self.last
            && last.regions.cell.len() == regions.cell.len()
        {
            let mut taken = ctx.buffers.filled(last.regions.list.len(), false);
            for &Pair { before, now, .. } in &ranked_pairs(ctx, &last.regions, regions) {
                if !taken[before] && tracks[now].is_none() {
                    taken[before] = true;
                    tracks[now] = Some(inherit(&last.tracks[before], &regions.list[now]));
                }
            }
        }
        let covered = self.covered(ctx, regions);
        let mut next = self.next_track;
        let start = |(i, track): (usize, &Option<Track>)| {
            track.unwrap_or_else(|| {
                next += 1;
                let state = first_state(ctx, &regions.list[i], covered[i]);
                Track::new(next - 1, state)
            })
        };
        let tracks = ctx.buffers.collect(tracks.iter().enumerate().map(start));
        self.next_track = next;
        tracks
    }

    /// For each region the cells that were static and those that moved a moment ago.
    fn covered(&self, ctx: &Context, regions: &Regions) -> Buffer<[u32; 2]> {
        let mut covered = ctx.buffers.filled(regions.list.len(), [0; 2]);
        let Some(last) = self.last.as_ref().filter(|last| last.memory.len() == regions.cell.len()) else {
            return covered;
        };
        for (memory, region) in last.memory.iter().zip(&regions.cell).filter(|(_, region)| **region != NO_REGION) {
            let count = &mut covered[usize::from(*region)];
            count[0] += u32::from(memory.calm > 0);
            count[1] += u32::from(memory.moved > 0);
        }
        covered
    }

    /// What each cell is remembered for after this frame's states.
    pub(super) fn remembered(&self, ctx: &Context, frame: &FrameFilter) -> Buffer<CellMemory> {
        let regions = &frame.regions;
        let before = self.last.as_ref().filter(|last| last.memory.len() == regions.cell.len());
        let filters = &ctx.config.panoptic;
        let cell_memory = |(cell, region): (usize, &u16)| {
            let old = before.map_or(CellMemory::default(), |last| last.memory[cell]);
            let [heat, moved, calm, ground] = [old.heat, old.moved, old.calm, old.ground].map(|n| n.saturating_sub(1));
            let faded = CellMemory { heat, moved, calm, ground };
            let track = frame.tracks.get(usize::from(*region)).filter(|_| !frame.ground[cell]);
            let Some(track) = track else {
                let [heat, moved] = if frame.ground[cell] { [0, 0] } else { [heat, moved] };
                let is_blind = regions.list.get(usize::from(*region)).is_some_and(|region| region.blind);
                let ground = if is_blind || heat > 0 { faded.ground } else { GROUND_FRAMES };
                return CellMemory { heat, moved, ground, ..faded };
            };
            let judged = match regions.list[usize::from(*region)].kind {
                RegionKind::Unknown => filters.unknown,
                _ => filters.things,
            };
            match track.state {
                RegionState::Person if filters.people => CellMemory { heat: HEAT_FRAMES, ..CellMemory::default() },
                RegionState::Dynamic if judged => {
                    CellMemory { heat: HEAT_FRAMES, moved: HEAT_FRAMES, ..CellMemory::default() }
                }
                RegionState::Static => CellMemory { calm: CALM_FRAMES, ..faded },
                _ => faded,
            }
        };
        ctx.buffers.collect(regions.cell.iter().enumerate().map(cell_memory))
    }
}

/// Regions of the last frame and of this one that may be one object.
#[derive(Clone, Copy)]
struct Pair {
    renamed: bool,
    iou: f64,
    before: usize,
    now: usize,
}

/// All pairs: same label first, then by falling overlap, then by index.
fn ranked_pairs(ctx: &Context, last: &Regions, regions: &Regions) -> Buffer<Pair> {
    let columns = regions.list.len();
    let mut shared: Buffer<u32> = ctx.buffers.filled(last.list.len() * columns, 0);
    for (before, now) in last.cell.iter().zip(&regions.cell) {
        if *before != NO_REGION && *now != NO_REGION {
            shared[usize::from(*before) * columns + usize::from(*now)] += 1;
        }
    }
    let mut pairs = ctx.buffers.empty();
    for (i, &both) in shared.iter().enumerate().filter(|(_, n)| **n > 0) {
        let (a, b) = (&last.list[i / columns], &regions.list[i % columns]);
        let iou = f64::from(both) / f64::from(a.cells + b.cells - both);
        if a.blind != b.blind {
            continue;
        }
        let same = a.kind == b.kind && a.category == b.category;
        let people = a.kind == RegionKind::Person || b.kind == RegionKind::Person;
        let may_change = ctx.config.panoptic.rule == Rule::Geometric && !people;
        if iou > ctx.config.panoptic.association.min_iou && (same || may_change) {
            pairs.push(Pair { renamed: !same, iou, before: i / columns, now: i % columns });
        }
    }
    let by_index = |pair: &Pair| (pair.before, pair.now);
    pairs.sort_unstable_by(|a, b| {
        let by_overlap = || b.iou.total_cmp(&a.iou);
        a.renamed.cmp(&b.renamed).then_with(by_overlap).then_with(|| by_index(a).cmp(&by_index(b)))
    });
    pairs
}

/// State of a region that starts a new track, `covered` by static and moving cells of the last frame. Real networks
/// split, join and rename segments from frame to frame; what lies where a confirmed region was needs no new
/// confirmation, and what lies where a mover was is not let in under another name. What lies where a person was is new: in a
/// crowd that is everything in turn.
fn first_state(ctx: &Context, region: &Region, covered: [u32; 2]) -> RegionState {
    let [was_static, moved] = covered;
    if region.kind == RegionKind::Person {
        RegionState::Person
    } else if ctx.config.panoptic.rule == Rule::Paper || region.blind {
        RegionState::New
    } else if moved * 4 >= region.cells && moved > 0 {
        RegionState::Dynamic
    } else if was_static * 2 >= region.cells && was_static > 0 {
        RegionState::Static
    } else {
        RegionState::New
    }
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
    /// It stands where free space was.
    Dynamic,
    /// It stands where a surface was, but many of its keypoints are elsewhere.
    Moved,
    /// Its matched map points disagree with the background.
    Disagrees,
    /// It stands still.
    Static,
    /// Map points that have stood still for long lie on it.
    Vouched,
    /// Nothing to say.
    Silent,
}

impl Track {
    /// A track that begins.
    pub(super) fn new(id: u32, state: RegionState) -> Self {
        Self { id, state, age: 0, static_streak: 0, dynamic_streak: 0, moved_streak: 0, disagreed_streak: 0 }
    }

    /// Hysteresis: a vote alone moves no confirmed region, and a mover has to stand still for long to come back.
    pub(super) fn update(&mut self, config: &PanopticConfig, vote: Vote) {
        let (motion, consensus) = (&config.motion, &config.consensus);
        if self.state == RegionState::Person {
            return;
        }
        match vote {
            Vote::Dynamic => (self.dynamic_streak, self.static_streak) = (self.dynamic_streak + 1, 0),
            Vote::Moved => (self.moved_streak, self.static_streak) = (self.moved_streak + 1, 0),
            Vote::Disagrees => (self.disagreed_streak, self.static_streak) = (self.disagreed_streak + 1, 0),
            Vote::Static | Vote::Vouched => {
                (self.dynamic_streak, self.moved_streak, self.disagreed_streak) = (0, 0, 0);
                self.static_streak +=
                    if vote == Vote::Vouched { motion.readmit_frames.div_ceil(VOUCHED_FRAMES) } else { 1 };
            }
            Vote::Silent => {}
        }
        if self.moved_streak >= motion.moved_frames || self.disagreed_streak >= consensus.frames {
            self.state = RegionState::Dynamic;
        }
        self.state = match self.state {
            RegionState::New if self.dynamic_streak > 0 => RegionState::Dynamic,
            RegionState::New if vote == Vote::Vouched => RegionState::Static,
            RegionState::New if self.static_streak >= motion.confirm_frames => RegionState::Static,
            RegionState::Static if self.dynamic_streak >= motion.suspect_frames => RegionState::Dynamic,
            RegionState::Dynamic if self.static_streak >= motion.readmit_frames => RegionState::Static,
            state => state,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    fn track(state: RegionState) -> Track {
        Track::new(0, state)
    }

    /// State after each vote.
    fn states(track: Track, votes: &[Vote]) -> Vec<RegionState> {
        states_by(&Config::default().panoptic, track, votes)
    }

    fn states_by(config: &PanopticConfig, mut track: Track, votes: &[Vote]) -> Vec<RegionState> {
        let update = |vote: &Vote| {
            track.update(config, *vote);
            track.state
        };
        votes.iter().map(update).collect()
    }

    #[test]
    fn confirmation_takes_its_frames_and_silence_does_not_break_it() {
        use RegionState::{Dynamic, New, Static};
        let votes = [Vote::Static, Vote::Silent, Vote::Static, Vote::Static];
        assert_eq!(states(track(New), &votes), [New, New, New, Static]);
        assert_eq!(states(track(New), &[Vote::Static, Vote::Dynamic]), [New, Dynamic]);
    }

    #[test]
    fn a_static_region_needs_votes_in_a_row_to_be_taken_out() {
        use RegionState::{Dynamic, Static};
        let votes = [Vote::Dynamic, Vote::Static, Vote::Dynamic, Vote::Silent, Vote::Dynamic];
        assert_eq!(states(track(Static), &votes), [Static, Static, Static, Static, Dynamic]);
    }

    #[test]
    fn a_mover_comes_back_after_an_unbroken_row_of_static_votes() {
        use RegionState::{Dynamic, Static};
        let mut votes = vec![Vote::Static; 29];
        votes.push(Vote::Dynamic);
        votes.extend([Vote::Static; 30]);
        let all = states(track(Dynamic), &votes);
        assert!(all[..59].iter().all(|s| *s == Dynamic));
        assert_eq!(all[59], Static);
    }

    #[test]
    fn disagreement_in_a_row_moves_any_region_and_silence_does_not_break_it() {
        use RegionState::{Dynamic, New, Static};
        let mut config = Config::default().panoptic;
        config.consensus.frames = 3;
        for state in [New, Static] {
            let votes = [Vote::Disagrees, Vote::Silent, Vote::Disagrees, Vote::Disagrees];
            assert_eq!(states_by(&config, track(state), &votes), [state, state, state, Dynamic]);
        }
        let votes = [Vote::Disagrees, Vote::Disagrees, Vote::Static, Vote::Disagrees, Vote::Disagrees];
        assert!(
            states_by(&config, track(Static), &votes).iter().all(|s| *s == Static),
            "agreement in between breaks it"
        );
    }

    #[test]
    fn a_mover_that_disagrees_begins_anew_to_come_back() {
        let mut votes = vec![Vote::Static; 29];
        votes.push(Vote::Disagrees);
        votes.extend([Vote::Static; 30]);
        let all = states(track(RegionState::Dynamic), &votes);
        assert_eq!(all.iter().position(|s| *s == RegionState::Static), Some(59));
    }

    #[test]
    fn what_is_vouched_for_is_confirmed_at_once_and_comes_back_soon() {
        use RegionState::{Dynamic, New, Static};
        assert_eq!(states(track(New), &[Vote::Vouched]), [Static]);
        let mut slow = Config::default().panoptic;
        slow.motion.confirm_frames = 100;
        assert_eq!(states_by(&slow, track(New), &[Vote::Vouched]), [Static], "however long confirmation takes");
        let come_back = [Vote::Vouched; VOUCHED_FRAMES as usize];
        assert_eq!(states(track(Dynamic), &come_back), [Dynamic, Dynamic, Dynamic, Dynamic, Static]);
        let broken = [Vote::Vouched, Vote::Vouched, Vote::Vouched, Vote::Vouched, Vote::Disagrees, Vote::Vouched];
        assert!(states(track(Dynamic), &broken).iter().all(|s| *s == Dynamic));
        assert_eq!(states(track(RegionState::Person), &[Vote::Vouched]), [RegionState::Person]);
    }

    #[test]
    fn who_is_vouched_for_is_no_longer_under_suspicion() {
        use RegionState::Static;
        for accuses in [Vote::Dynamic, Vote::Disagrees] {
            let config = Config::default().panoptic;
            let enough = if accuses == Vote::Dynamic { config.motion.suspect_frames } else { config.consensus.frames };
            let mut votes = vec![accuses; enough as usize - 1];
            votes.push(Vote::Vouched);
            votes.push(accuses);
            assert!(states(track(Static), &votes).iter().all(|s| *s == Static), "{accuses:?}");
        }
    }

    #[test]
    fn people_stay_people() {
        let votes = [Vote::Static; 40];
        assert!(states(track(RegionState::Person), &votes).iter().all(|s| *s == RegionState::Person));
    }
}
