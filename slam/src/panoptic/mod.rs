//! Which keypoints belong to the static world? The paper's section III-B, and a geometric rule that works where its
//! epipolar test does not.
//!
//! Per frame, in this order:
//! 1. [`PanopticFilter::label`]: keypoint classes, regions of the picture, their association with the last frame, and
//!    verdicts from what is known so far;
//! 2. tracking finds a first pose with the keypoints that are static by those verdicts;
//! 3. [`PanopticFilter::judge`]: evidence of motion under that pose, region states, final verdicts;
//! 4. [`PanopticFilter::remember`]: the frame becomes history.

mod association;
mod consensus;
mod epipolar;
mod evidence;
mod ground;
mod rays;
mod regions;
mod verdict;

use std::collections::VecDeque;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, FrameId, Se3, Sim3};
use smallvec::SmallVec;

pub use association::CellMemory;
pub use consensus::{Consensus, Matched, consensus};
pub use epipolar::Epipolar;
pub use evidence::Evidence;
pub use regions::{CELL_PX, NO_REGION, Region, RegionKind, Regions};

use crate::config::Rule;
use crate::context::Context;
use crate::input::{DepthImage, FrameInput, PanopticMask, Sensor};
use crate::map::moved_pose;
use crate::observation::Observation;
use crate::report::{KeypointClass, RegionState, Selection, Verdict};

/// A short list, one entry an older frame; longer ones than usual take memory of their own.
type Few<T> = SmallVec<[T; 8]>;

/// An older frame that the current one is compared with.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Remembered {
    /// Which frame.
    pub id: FrameId,
    /// Its pose when it was tracked.
    pub camera_from_world: Se3,
    /// Its depth.
    pub depth: Option<Arc<DepthImage>>,
    /// Its keypoints.
    pub obs: Arc<Observation>,
    /// Class of each keypoint.
    pub class: Buffer<KeypointClass>,
    /// Region track of each keypoint.
    pub track: Buffer<Option<u32>>,
    /// Cells that were background by their label, apart from movers.
    pub ground: Buffer<bool>,
}

/// A region followed over frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Track {
    /// Its number, in order of appearance.
    pub id: u32,
    /// What is known about its motion.
    pub state: RegionState,
    /// Frames since it appeared.
    pub age: u32,
    /// Consecutive frames with evidence that it is static.
    pub static_streak: u32,
    /// Consecutive frames with evidence that it moves.
    pub dynamic_streak: u32,
    /// The same where only keypoints say so.
    pub moved_streak: u32,
    /// The same where its matched map points disagree with the background.
    pub disagreed_streak: u32,
}

/// What tracking knows about a frame that is to be judged.
#[derive(Debug, Clone, Copy)]
pub struct Tracked<'a> {
    /// The pose.
    pub camera_from_world: &'a Se3,
    /// Standard deviation of its position, metres.
    pub position_sigma_m: f64,
    /// Standard deviation of its orientation, radians.
    pub rotation_sigma_rad: f64,
    /// Median depth of the map points in sight; without depth images motion is judged by it.
    pub scene_depth: Option<f64>,
    /// Keypoints matched with a map point that fits.
    pub matched: &'a [bool],
    /// Keypoints on which a map point lies that has stood still for long, whether it is matched or only looked up.
    pub vouched: &'a [bool],
    /// Regions that disagree with the background; empty when nobody could be asked.
    pub disagrees: &'a [bool],
}

/// Everything the filter knows and decides about one frame.
#[derive(Debug, Clone)]
pub struct FrameFilter {
    /// What each keypoint lies on.
    pub class: Buffer<KeypointClass>,
    /// Region of each keypoint, an index into `regions.list`.
    pub region: Buffer<Option<usize>>,
    /// The decision about each keypoint. Only `verdict.rs` writes it, from everything else that stands here.
    pub verdict: Buffer<Verdict>,
    /// Residual under the static hypothesis in sigmas; NaN when not tested.
    pub motion_sigmas: Buffer<f64>,
    /// Regions of the picture.
    pub regions: Regions,
    /// Track of each region.
    pub tracks: Buffer<Track>,
    /// Evidence of each region.
    pub evidence: Buffer<Evidence>,
    /// The same counts for keypoints on Stuff: what false matches and a poor pose make of things that stand still.
    pub stuff: Evidence,
    /// Cells of a region whose surface is background all the same: it was there a moment ago.
    pub ground: Buffer<bool>,
    /// The same for keypoints.
    pub keypoint_ground: Buffer<bool>,
    /// What each cell is or was a moment ago.
    pub memory: Buffer<CellMemory>,
    /// Two-view geometry with the last frame.
    pub epipolar: Option<Epipolar>,
    /// Distance of each keypoint to the epipolar line of its match; NaN without match or geometry.
    pub epipolar_px: Buffer<f64>,
    /// Keypoints whose surface stands in formerly free space; empty before the frame is judged.
    pub in_free_space: Buffer<bool>,
    /// Keypoints on which a map point lies that has stood still for long; empty before the frame is judged.
    pub vouched: Buffer<bool>,
    /// Regions whose matches disagree with the background; empty when nobody could be asked.
    pub disagrees: Buffer<bool>,
}

impl FrameFilter {
    /// What is known about the region at a pixel (as recorded); `None` on background and outside the picture.
    #[must_use]
    pub fn state_at(&self, raw_pixel: [f64; 2]) -> Option<RegionState> {
        self.state_of(self.regions.cell_at(raw_pixel)?)
    }

    /// Keypoints that a selection admits.
    #[must_use]
    pub fn admitted(&self, ctx: &Context, selection: Selection) -> Buffer<bool> {
        let admits = |v: &Verdict| match selection {
            Selection::Static => *v == Verdict::Static,
            Selection::WithUnconfirmed => matches!(v, Verdict::Static | Verdict::ThingNew | Verdict::UnknownNew),
            Selection::WithBorders => {
                matches!(v, Verdict::Static | Verdict::ThingNew | Verdict::UnknownNew | Verdict::Border)
            }
            Selection::AllButPeople => *v != Verdict::Person,
            Selection::Everything => true,
        };
        ctx.buffers.collect(self.verdict.iter().map(admits))
    }

    /// Whether a keypoint lies on a region that is taken to move.
    #[must_use]
    pub fn is_condemned(&self, i: usize) -> bool {
        matches!(self.verdict[i], Verdict::ThingDynamic | Verdict::UnknownDynamic)
    }

    /// Whether a map point lies on a keypoint that has stood still for long, as far as it is known.
    #[must_use]
    pub fn is_vouched(&self, i: usize) -> bool {
        holds(&self.vouched, i)
    }

    /// Whether a region's matches disagree with the background, as far as it is known.
    #[must_use]
    pub fn disagrees_at(&self, region: usize) -> bool {
        holds(&self.disagrees, region)
    }

    /// Whether a keypoint lies on a region that nothing is known about yet.
    #[must_use]
    pub fn is_unconfirmed(&self, i: usize) -> bool {
        matches!(self.verdict[i], Verdict::ThingNew | Verdict::UnknownNew)
    }
}

/// A fact that is not known yet does not hold.
fn holds(facts: &[bool], i: usize) -> bool {
    facts.get(i).is_some_and(|fact| *fact)
}

/// The filter's memory.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct PanopticFilter {
    history: VecDeque<Remembered>,
    /// Single frames from before, in which it is looked up where background stood.
    anchors: VecDeque<Remembered>,
    last: Option<LastRegions>,
    next_track: u32,
    /// Frames in a row without a pose, in which no motion could be judged.
    blind_frames: u32,
    /// Whether any frame came with a mask.
    had_mask: bool,
}

/// Regions of the last frame, for association.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct LastRegions {
    regions: Regions,
    tracks: Buffer<Track>,
    memory: Buffer<CellMemory>,
}

impl PanopticFilter {
    /// Step 1: classes, regions, association, verdicts from what is known so far.
    #[must_use]
    pub fn label(&mut self, ctx: &Context, input: &FrameInput, obs: &Observation) -> FrameFilter {
        let unlabelled = self.without_its_mask(ctx, input);
        let input = unlabelled.as_ref().unwrap_or(input);
        let regions = Regions::new(ctx, input);
        let before = self.last.as_ref().map_or(&[][..], |last| &last.memory);
        let ground = ground::expected(ctx, before, &regions);
        let tracks = self.associate(ctx, &regions, &ground);
        let (class, region) = verdict::classify(ctx, input, obs, &regions);
        let (n, buffers) = (obs.len(), &ctx.buffers);
        let mut frame = FrameFilter {
            class,
            region,
            verdict: buffers.empty(),
            motion_sigmas: buffers.filled(n, f64::NAN),
            evidence: buffers.filled(regions.list.len(), Evidence::default()),
            stuff: Evidence::default(),
            regions,
            tracks,
            ground,
            keypoint_ground: buffers.empty(),
            memory: buffers.empty(),
            epipolar: None,
            epipolar_px: buffers.filled(n, f64::NAN),
            in_free_space: buffers.empty(),
            vouched: buffers.empty(),
            disagrees: buffers.empty(),
        };
        frame.memory = self.remembered(ctx, &frame);
        frame.keypoint_ground = buffers.collect((0..n).map(|i| frame.on_ground(obs.raw_pixel[i])));
        if ctx.config.panoptic.rule == Rule::Paper
            && let Some(last) = self.history.back()
        {
            epipolar::measure(ctx, input.id, last, obs, &mut frame);
        }
        verdict::decide(ctx, obs, &mut frame);
        frame
    }

    /// A frame whose mask is missing, though frames before it had theirs, as one in which no segment claims anything: what was
    /// background is known by its place, the rest has to show that it stands still. Where labels never were, or without depth,
    /// nothing tells, and everything is background.
    fn without_its_mask(&mut self, ctx: &Context, input: &FrameInput) -> Option<FrameInput> {
        if input.panoptic.is_some() {
            self.had_mask = true;
            return None;
        }
        let p = &ctx.config.panoptic;
        let is_judged = p.rule == Rule::Geometric && p.unknown && input.depth.is_some() && ctx.sensor == Sensor::Rgbd;
        (self.had_mask && is_judged).then(|| {
            let (width, height) = (input.gray.width, input.gray.height);
            let mask = PanopticMask { width, height, ids: vec![0; width * height], segments: Vec::new() };
            FrameInput { panoptic: Some(Arc::new(mask)), ..input.clone() }
        })
    }

    /// Step 3: facts under the camera pose, region states by them, and the verdicts once more, now by all that is known.
    pub fn judge(
        &self,
        ctx: &Context,
        input: &FrameInput,
        obs: &Observation,
        tracked: &Tracked<'_>,
        frame: &mut FrameFilter,
    ) {
        if ctx.config.panoptic.rule == Rule::Paper {
            return;
        }
        frame.vouched = ctx.buffers.collect(tracked.vouched.iter().copied());
        frame.disagrees = ctx.buffers.collect(tracked.disagrees.iter().copied());
        let (depth, anchors) = (input.depth.as_deref(), self.anchors.iter().rev().collect());
        let now = evidence::Now { id: input.id, depth, obs, tracked, anchors };
        if let Some(last) = self.history.back() {
            epipolar::from_motion(ctx, tracked.camera_from_world, last, obs, frame);
        }
        let older = self.compared_with(ctx, input.id);
        evidence::gather(ctx, &now, &older, frame);
        verdict::update_tracks(ctx, tracked, frame);
        frame.memory = self.remembered(ctx, frame);
        verdict::decide(ctx, obs, frame);
    }

    /// Step 4: the frame becomes history. Without a pose it can't be compared with, so history ends there.
    pub fn remember(
        &mut self,
        ctx: &Context,
        input: &FrameInput,
        obs: &Arc<Observation>,
        pose: Option<&Se3>,
        frame: &FrameFilter,
    ) {
        self.last = Some(LastRegions {
            regions: frame.regions.without(&frame.ground),
            tracks: frame.tracks.clone(),
            memory: frame.memory.clone(),
        });
        let Some(pose) = pose else {
            self.history.clear();
            self.anchors.clear();
            self.go_blind(ctx);
            return;
        };
        self.blind_frames = 0;
        let track = ctx.buffers.collect(frame.region.iter().map(|r| r.map(|r| frame.tracks[r].id)));
        self.history.push_back(Remembered {
            id: input.id,
            camera_from_world: *pose,
            depth: input.depth.clone(),
            obs: obs.clone(),
            class: frame.class.clone(),
            track,
            ground: ground::labelled(ctx, frame),
        });
        self.drop_anchor();
        let oldest = ctx.config.panoptic.motion.history_frames.iter().copied().max().unwrap_or(1) as usize;
        while self.history.len() > oldest {
            self.history.pop_front();
        }
    }

    /// What nothing can confirm any more is forgotten: after as many frames as a mover needs to come back, everything but
    /// people is new again.
    fn go_blind(&mut self, ctx: &Context) {
        self.blind_frames += 1;
        let Some(last) = self.last.as_mut().filter(|_| self.blind_frames >= ctx.config.panoptic.motion.readmit_frames)
        else {
            return;
        };
        for track in last.tracks.iter_mut().filter(|track| track.state != RegionState::Person) {
            *track = Track { id: track.id, age: track.age, ..Track::new(track.id, RegionState::New) };
        }
        last.memory.fill(CellMemory::default());
    }

    /// The world has got a new frame: moves the remembered poses into it.
    pub fn move_world(&mut self, new_from_old: &Sim3) {
        for remembered in self.history.iter_mut().chain(&mut self.anchors) {
            remembered.camera_from_world = moved_pose(&remembered.camera_from_world, new_from_old);
        }
    }

    /// The remembered frames of the configured ages, youngest first.
    fn compared_with(&self, ctx: &Context, now: FrameId) -> Few<&Remembered> {
        let mut ages: Few<u32> = ctx.config.panoptic.motion.history_frames.iter().copied().collect();
        ages.sort_unstable();
        let with_age = |age: u32| self.history.iter().rev().find(|r| now.0 - r.id.0 == age);
        ages.into_iter().filter_map(with_age).collect()
    }
}
