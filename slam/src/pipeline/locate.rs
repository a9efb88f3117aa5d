//! Where is the camera? The tracking part of a frame.

use super::Work;
use super::step::Step;
use slam_math::MapPointId;

use crate::config::Rule;
use crate::context::Context;
use crate::input::FrameInput;
use crate::map::MapEdit;
use crate::observation::round_to_pixel;
use crate::panoptic::FrameFilter;
use crate::report::{KeypointClass, RegionState};
use crate::tracking::{LocalMap, refine_pose, relocalize, track_local_map, track_motion_model, track_reference};

impl Step<'_> {
    /// The usual frame: prediction, judgement, local map.
    pub(super) fn track(&mut self, filter: &mut FrameFilter) -> bool {
        let found = self.predict();
        self.observer.done(Work::Predict);
        if found < self.ctx.config.tracking.min_step_inliers {
            return false;
        }
        self.settle_on_stuff(filter);
        self.judge(filter);
        self.track_local()
    }

    /// Lets Stuff alone decide about the pose under which motion is judged, where there is enough of it (as in the paper,
    /// whose F comes from Stuff): an object that stood still and starts to move must not take the camera along.
    /// Only where motion is judged by it: a configuration without filters knows no labels, and the paper's has F.
    fn settle_on_stuff(&mut self, filter: &FrameFilter) {
        let p = &self.ctx.config.panoptic;
        if p.rule == Rule::Paper || !(p.things || p.unknown) {
            return;
        }
        let mut stuff = self.frame.clone();
        for (point, class) in stuff.points.iter_mut().zip(&filter.class) {
            *point = point.filter(|_| *class == KeypointClass::Stuff);
        }
        let needed = self.ctx.config.tracking.min_inliers;
        if stuff.match_count() >= needed && refine_pose(&self.ctx, &self.slam.map, &mut stuff) >= needed {
            self.frame.camera_from_world = stuff.camera_from_world;
        }
    }

    fn predict(&mut self) -> u32 {
        let Some(last) = self.slam.tracker.last.take() else { return 0 };
        let (ctx, map, min) = (&self.ctx, &self.slam.map, self.ctx.config.tracking.min_step_inliers);
        let mut inliers = 0;
        if let Some(velocity) = self.slam.tracker.velocity {
            let predicted = velocity * last.camera_from_world;
            (self.counts.motion_matches, inliers) = track_motion_model(ctx, map, &last, &predicted, &mut self.frame);
        }
        if inliers < min
            && let Some(keyframe) = map.keyframe(last.reference)
        {
            self.frame.camera_from_world = last.camera_from_world;
            (self.counts.motion_matches, inliers) = track_reference(ctx, map, keyframe, &mut self.frame);
        }
        self.slam.tracker.last = Some(last);
        inliers
    }

    /// Final verdicts under the predicted pose; matches of keypoints that turned out to move are dropped.
    fn judge(&mut self, filter: &mut FrameFilter) {
        let (pose, obs) = (self.frame.camera_from_world, self.frame.obs.clone());
        let scene_depth = self.frame.median_depth(&self.slam.map, &self.ctx.buffers);
        self.slam.filter.judge(&self.ctx, self.input, &obs, &pose, scene_depth, filter);
        self.select(filter);
        for (point, usable) in self.frame.points.iter_mut().zip(&self.frame.usable) {
            if !usable {
                *point = None;
            }
        }
        self.observer.done(Work::Judge);
    }

    fn track_local(&mut self) -> bool {
        let mut local = LocalMap::around(&self.ctx, &self.slam.map, &self.frame);
        (self.counts.local_matches, self.counts.inliers) =
            track_local_map(&self.ctx, &self.slam.map, &mut local, &mut self.frame);
        self.counts.local_points = local.points.len() as u32;
        let t = &self.ctx.config.tracking;
        let recent =
            self.slam.tracker.relocalized_at.is_some_and(|at| self.frame.id.0 - at.0 < t.recent_relocalization_frames);
        let needed = if recent { t.min_inliers_after_relocalization } else { t.min_inliers };
        let ok = self.counts.inliers >= needed;
        if ok {
            let reference = local.reference.unwrap_or(self.frame.reference);
            self.frame.refer_to(reference, &self.slam.map);
            self.count_sights(local);
        }
        self.observer.done(Work::LocalMap);
        ok
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
        let usable = self.frame.usable.iter().filter(|u| **u).count() as u32;
        self.slam.tracker.lost_usable_frames += u32::from(usable >= r.min_keypoints);
        let (ctx, input) = (&self.ctx, self.input);
        let expected = |local: &LocalMap| {
            let should_show =
                |(_, pixel, z): &&(MapPointId, [f64; 2], f64)| should_show(ctx, input, filter, *pixel, *z);
            local.in_view.iter().filter(should_show).count()
        };
        let found = relocalize(ctx, &self.slam.map, &self.slam.places, &mut self.frame, |_| true, expected);
        self.observer.done(Work::Predict);
        if let Some(found) = found {
            self.judge(filter);
            if !self.track_local() {
                return false;
            }
            self.slam.tracker.active = found.map;
            self.slam.tracker.relocalized_at = Some(self.frame.id);
            let lost = self.slam.tracker.lost_frames;
            self.event(true, format!("found again at {} after {lost} lost frames", found.keyframe));
            return true;
        }
        if self.slam.tracker.lost_usable_frames > r.frames_before_new_map {
            return self.initialize(filter);
        }
        false
    }
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
    let m = &ctx.config.panoptic.motion;
    let margin = m.free_space_m + m.free_space_sigmas * ctx.depth_sigma(z);
    depth.metres(round_to_pixel(raw[0]), round_to_pixel(raw[1])).is_some_and(|measured| measured >= z - margin)
}
