//! Where is the camera? The tracking part of a frame.

use super::Work;
use super::step::Step;
use slam_math::{Buffer, KeyFrameId, MapPointId};

use crate::config::Rule;
use crate::context::Context;
use crate::input::FrameInput;
use crate::map::{Map, MapEdit};
use crate::observation::round_to_pixel;
use crate::panoptic::{FrameFilter, Matched, Tracked, consensus};
use crate::report::{RegionState, Selection};
use crate::tracking::{
    LocalMap, PoseFit, TrackedFrame, look_up, match_local_map, refine_pose, relocalize, track_motion_model,
    track_reference,
};

/// A frame's pose with one selection of keypoints.
struct Attempt {
    selection: Selection,
    frame: TrackedFrame,
    local: LocalMap,
    fit: PoseFit,
    motion_matches: u32,
    local_matches: u32,
    /// Regions that disagree with the background, if it could be asked.
    disagrees: Buffer<bool>,
    /// Standard deviation of the position over the median depth of the matched points.
    sigma_share: f64,
}

impl Step<'_> {
    /// The usual frame: the pose by the keypoints that are trusted, judgement, the pose by those that passed.
    pub(super) fn track(&mut self, filter: &mut FrameFilter) -> bool {
        let best = self.best_attempt(filter);
        self.observer.done(Work::LocalMap);
        best.is_some_and(|attempt| self.settle(attempt, filter))
    }

    /// Widens the selection until the pose is well supported, by matches and by their geometry. When none supports it well, the
    /// one that fixes the position best stands.
    fn best_attempt(&mut self, filter: &FrameFilter) -> Option<Attempt> {
        let mut best: Option<Attempt> = None;
        let mut admitted = 0;
        for selection in Selection::ALL {
            self.frame.usable = filter.admitted(&self.ctx, selection);
            let count = self.frame.usable.iter().filter(|usable| **usable).count();
            if count == admitted && selection != Selection::Static {
                continue;
            }
            admitted = count;
            let Some(attempt) = self.attempt(selection, filter) else { continue };
            let t = &self.ctx.config.tracking;
            if attempt.fit.inliers >= t.good_inliers && attempt.sigma_share <= t.good_sigma_share {
                return Some(attempt);
            }
            let is_better = |best: &Attempt| attempt.sigma_share < best.sigma_share;
            if attempt.fit.inliers >= self.needed_inliers() && best.as_ref().is_none_or(is_better) {
                best = Some(attempt);
            }
        }
        best
    }

    /// Prediction, local map, consensus of the regions. `None` when too little is found.
    fn attempt(&mut self, selection: Selection, filter: &FrameFilter) -> Option<Attempt> {
        let (motion_matches, found) = self.predict(selection, filter);
        self.observer.done(Work::Predict);
        if found < self.ctx.config.tracking.min_step_inliers {
            return None;
        }
        let (ctx, map) = (&self.ctx, &self.slam.map);
        let mut frame = self.frame.clone();
        let mut local = LocalMap::around(ctx, map, &frame);
        let admits = |i: usize, id: MapPointId| admits(ctx, map, selection, filter, i, id);
        let local_matches = match_local_map(ctx, map, &mut local, &mut frame, &admits);
        let (fit, disagrees) = agree_on_pose(ctx, map, filter, &mut frame);
        let depth = frame.median_depth(map, &ctx.buffers)?;
        let sigma_share = fit.position_sigma_m() / depth;
        Some(Attempt { selection, frame, local, fit, motion_matches, local_matches, disagrees, sigma_share })
    }

    fn predict(&mut self, selection: Selection, filter: &FrameFilter) -> (u32, u32) {
        let Some(last) = self.slam.tracker.last.take() else { return (0, 0) };
        let (ctx, map, min) = (&self.ctx, &self.slam.map, self.ctx.config.tracking.min_step_inliers);
        let admits = |i: usize, id: MapPointId| admits(ctx, map, selection, filter, i, id);
        let (mut matches, mut inliers) = (0, 0);
        if let Some(velocity) = self.slam.tracker.velocity {
            let predicted = velocity * last.camera_from_world;
            (matches, inliers) = track_motion_model(ctx, map, &last, &predicted, &mut self.frame, &admits);
        }
        if inliers < min
            && let Some(keyframe) = map.keyframe(last.reference)
        {
            self.frame.camera_from_world = last.camera_from_world;
            (matches, inliers) = track_reference(ctx, map, keyframe, &mut self.frame, &admits);
        }
        self.slam.tracker.last = Some(last);
        (matches, inliers)
    }

    /// Judges the regions under the pose of an attempt and takes the pose over, without what turned out to move.
    fn settle(&mut self, attempt: Attempt, filter: &mut FrameFilter) -> bool {
        let Attempt { selection, frame, local, mut fit, motion_matches, local_matches, disagrees, .. } = attempt;
        self.frame = frame;
        self.selection = selection;
        (self.counts.motion_matches, self.counts.local_matches) = (motion_matches, local_matches);
        self.counts.local_points = local.points.len() as u32;
        let before = self.frame.clone();
        self.judge(filter, &fit, &disagrees, &local);
        if before.points.iter().zip(&self.frame.points).any(|(before, now)| before != now) {
            let again = refine_pose(&self.ctx, &self.slam.map, &mut self.frame);
            if again.inliers >= self.needed_inliers() {
                fit = again;
            } else {
                // The motion that most agrees on is the camera's: a judgement that leaves nothing of it does not stand.
                (self.frame.points, self.frame.camera_from_world) = (before.points, before.camera_from_world);
            }
        }
        self.counts.inliers = fit.inliers;
        let ok = fit.inliers >= self.needed_inliers();
        if ok {
            let reference = local.reference.unwrap_or(self.frame.reference);
            self.frame.refer_to(reference, &self.slam.map);
            self.count_sights(local);
        }
        self.observer.done(Work::LocalMap);
        ok
    }

    /// Final verdicts under the pose; matches of keypoints that turned out to move are dropped. What is usable from here on may
    /// become part of the map: never what is seen to move.
    fn judge(&mut self, filter: &mut FrameFilter, fit: &PoseFit, disagrees: &[bool], local: &LocalMap) {
        let (ctx, map, frame) = (&self.ctx, &self.slam.map, &self.frame);
        let matched = ctx.buffers.collect(frame.points.iter().map(Option::is_some));
        let established = |id: MapPointId| is_established(ctx, map, id);
        // What was taken to move is looked up too: where old points lie, it stands still.
        let is_condemned = |i: usize| frame.points[i].is_none() && filter.is_condemned(i);
        let mut vouched = look_up(ctx, map, local, frame, is_condemned, established);
        for (vouched, point) in vouched.iter_mut().zip(&frame.points) {
            *vouched |= point.is_some_and(established);
        }
        let tracked = Tracked {
            camera_from_world: &frame.camera_from_world,
            position_sigma_m: fit.position_sigma_m(),
            rotation_sigma_rad: fit.rotation_sigma_rad(),
            scene_depth: frame.median_depth(map, &ctx.buffers),
            matched: &matched,
            vouched: &vouched,
            disagrees,
        };
        self.slam.filter.judge(ctx, self.input, &frame.obs, &tracked, filter);
        let admitted = filter.admitted(ctx, self.selection);
        for (point, admitted) in self.frame.points.iter_mut().zip(&admitted) {
            *point = point.filter(|_| *admitted);
        }
        self.frame.usable = filter.admitted(ctx, self.selection.min(Selection::WithUnconfirmed));
        self.observer.done(Work::Judge);
    }

    fn needed_inliers(&self) -> u32 {
        let t = &self.ctx.config.tracking;
        let at = self.slam.tracker.relocalized_at;
        let is_recent = at.is_some_and(|at| self.frame.id.0 - at.0 < t.recent_relocalization_frames);
        if is_recent { t.min_inliers_after_relocalization } else { t.min_inliers }
    }

    fn count_sights(&mut self, local: LocalMap) {
        let found = self.frame.matched_points(&self.ctx.buffers);
        self.edit(|_, editor, _| {
            for (id, ..) in &local.in_view {
                editor.apply(MapEdit::CountSight(*id, found.binary_search(id).is_ok()));
            }
        });
        self.slam.last_local = Some(local);
    }

    /// The track is lost: look for a known place, and start a new map when none is found for long.
    pub(super) fn recover(&mut self, filter: &mut FrameFilter) -> bool {
        let r = &self.ctx.config.relocalization;
        // Nothing but people is sure to move while nobody knows how the camera does.
        self.frame.usable = filter.admitted(&self.ctx, Selection::AllButPeople);
        let usable = self.frame.usable.iter().filter(|u| **u).count() as u32;
        self.slam.tracker.lost_usable_frames += u32::from(usable >= r.min_keypoints);
        let frames_before_new_map = r.frames_before_new_map;
        let found = self.relocalize(filter);
        self.observer.done(Work::Predict);
        if let Some((found, map)) = found {
            let Some(attempt) = self.attempt_here(filter) else { return false };
            if !self.settle(attempt, filter) {
                return false;
            }
            self.slam.tracker.active = map;
            self.slam.tracker.relocalized_at = Some(self.frame.id);
            let lost = self.slam.tracker.lost_frames;
            self.event(true, format!("found again at {found} after {lost} lost frames"));
            return true;
        }
        if self.slam.tracker.lost_usable_frames > frames_before_new_map {
            return self.initialize(filter);
        }
        false
    }

    fn relocalize(&mut self, filter: &FrameFilter) -> Option<(KeyFrameId, slam_math::MapId)> {
        let (ctx, input) = (&self.ctx, self.input);
        let expected = |local: &LocalMap| {
            let should_show =
                |(_, pixel, z): &&(MapPointId, [f64; 2], f64)| should_show(ctx, input, filter, *pixel, *z);
            local.in_view.iter().filter(should_show).count()
        };
        let found = relocalize(ctx, &self.slam.map, &self.slam.places, &mut self.frame, |_| true, expected)?;
        Some((found.keyframe, found.map))
    }

    /// The local map around the pose that the frame has.
    fn attempt_here(&mut self, filter: &FrameFilter) -> Option<Attempt> {
        let (ctx, map, selection) = (&self.ctx, &self.slam.map, Selection::AllButPeople);
        let mut frame = self.frame.clone();
        let mut local = LocalMap::around(ctx, map, &frame);
        let local_matches = match_local_map(ctx, map, &mut local, &mut frame, &|_, _| true);
        let (fit, disagrees) = agree_on_pose(ctx, map, filter, &mut frame);
        let sigma_share = fit.position_sigma_m() / frame.median_depth(map, &ctx.buffers)?;
        Some(Attempt { selection, frame, local, fit, motion_matches: 0, local_matches, disagrees, sigma_share })
    }
}

/// Whether a selection lets a keypoint match a point. On a region that nothing is known about, only points that have stood still
/// for long.
fn admits(ctx: &Context, map: &Map, selection: Selection, filter: &FrameFilter, i: usize, id: MapPointId) -> bool {
    selection != Selection::Static || !filter.is_unconfirmed(i) || is_established(ctx, map, id)
}

fn is_established(ctx: &Context, map: &Map, id: MapPointId) -> bool {
    let t = &ctx.config.tracking;
    let is_old = |point: &crate::map::MapPoint| {
        point.seen_in.len() >= t.established_keyframes as usize && point.found >= t.established_frames
    };
    map.point(id).is_some_and(is_old)
}

/// Optimises the pose on all matches but those of regions that do not move as the background does; tells how it fits, and which
/// regions those are. They are asked before anything is thrown out: a mover with many keypoints would have the background's
/// matches for outliers. Only where motion is judged by geometry: a configuration without filters knows no labels, and the
/// paper's has F.
fn agree_on_pose(ctx: &Context, map: &Map, filter: &FrameFilter, frame: &mut TrackedFrame) -> (PoseFit, Buffer<bool>) {
    let p = &ctx.config.panoptic;
    let asked = (p.rule == Rule::Geometric && (p.things || p.unknown)).then(|| {
        let matched = |(i, id): (usize, MapPointId)| map.point(id).map(|point| (i as u32, point.position));
        let matches: Buffer<Matched> = ctx.buffers.collect(frame.matches().filter_map(matched));
        consensus(ctx, &frame.obs, &matches, &frame.camera_from_world, filter)
    });
    let Some(found) = asked.flatten().filter(|found| found.disagrees.contains(&true)) else {
        return (refine_pose(ctx, map, frame), ctx.buffers.empty());
    };
    let before = frame.clone();
    // What has stood still so far is heard twice: one blurred frame is no reason to do without it.
    let is_left_out = |region: usize| {
        let track = &filter.tracks[region];
        found.disagrees[region] && (track.state != RegionState::Static || track.disagreed_streak > 0)
    };
    let mut any = false;
    for (i, point) in frame.points.iter_mut().enumerate().filter(|(i, _)| !filter.is_background(*i)) {
        if point.is_some() && filter.region[i].is_some_and(is_left_out) {
            (*point, any) = (None, true);
        }
    }
    if any {
        frame.camera_from_world = found.camera_from_world;
    }
    let fit = refine_pose(ctx, map, frame);
    if fit.inliers < ctx.config.tracking.min_inliers {
        *frame = before;
        return (refine_pose(ctx, map, frame), ctx.buffers.empty());
    }
    (fit, found.disagrees)
}

/// Whether a point at this pixel and depth would be seen if it were there: nothing stands before it, and it does not lie on
/// what is filtered.
fn should_show(ctx: &Context, input: &FrameInput, filter: &FrameFilter, pixel: [f64; 2], z: f64) -> bool {
    let raw = ctx.camera.distort(pixel);
    let state = filter.state_at(raw);
    if matches!(state, Some(RegionState::Person | RegionState::Dynamic)) {
        return false;
    }
    let Some(depth) = input.depth.as_deref() else { return true };
    let margin = ctx.free_space_margin(z);
    depth.metres(round_to_pixel(raw[0]), round_to_pixel(raw[1])).is_some_and(|measured| measured >= z - margin)
}

#[cfg(test)]
mod tests;
