//! The stages of one frame.

use std::sync::Arc;

use slam_math::{KeyFrameId, MapId, Se3};

use super::{Observer, Slam, Tracker, Work, doubts, record, trajectory};
use crate::context::Context;
use crate::input::FrameInput;
use crate::map::{EditCounts, MapEdit};
use crate::mapping::{Editor, MappingCounts, YoungPoints, create_points_from_depth, insert_keyframe, local_mapping};
use crate::observation::Observation;
use crate::panoptic::{CELL_PX, FrameFilter};
use crate::report::{
    Counts, EpipolarReport, Event, FrameReport, KeypointReport, RegionReport, Selection, TrackingState, Verdict,
};
use crate::tracking::{
    LocalMap, TrackedFrame, keyframe_needed, relocalize, track_local_map, track_motion_model, track_reference,
};

/// One frame on its way through the stages.
pub(super) struct Step<'a> {
    slam: &'a mut Slam,
    ctx: Context,
    input: &'a FrameInput,
    frame: TrackedFrame,
    observer: &'a mut dyn Observer,
    counts: Counts,
    selection: Selection,
    new_keyframe: Option<KeyFrameId>,
    journal: Vec<MapEdit>,
    edits: EditCounts,
    events: Vec<Event>,
}

impl<'a> Step<'a> {
    pub(super) fn new(
        slam: &'a mut Slam,
        input: &'a FrameInput,
        obs: Arc<Observation>,
        observer: &'a mut dyn Observer,
    ) -> Self {
        let (reference, pose) =
            slam.tracker.last.as_ref().map_or((KeyFrameId(0), Se3::identity()), |l| (l.reference, l.camera_from_world));
        let n = obs.len();
        let frame = TrackedFrame {
            id: input.id,
            stamp: input.stamp,
            obs,
            usable: vec![true; n],
            points: vec![None; n],
            camera_from_world: pose,
            reference,
            camera_from_reference: Se3::identity(),
        };
        let ctx = slam.context().clone();
        let (counts, edits) = (Counts::default(), EditCounts::default());
        let (selection, new_keyframe) = (Selection::default(), None);
        Self {
            slam,
            ctx,
            input,
            frame,
            observer,
            counts,
            selection,
            new_keyframe,
            journal: vec![],
            edits,
            events: vec![],
        }
    }

    pub(super) fn run(mut self) -> FrameReport {
        let obs = self.frame.obs.clone();
        let mut filter = self.slam.filter.label(&self.ctx, self.input, &obs);
        self.select(&filter);
        self.observer.done(Work::Label);

        let tracked = match self.slam.tracker.state {
            TrackingState::NotInitialized => self.initialize(&filter),
            TrackingState::Ok => self.track(&mut filter),
            TrackingState::RecentlyLost | TrackingState::Lost => self.recover(&mut filter),
        };
        if tracked {
            self.map_frame(&filter);
        }
        self.observer.done(Work::Mapping);
        self.finish(tracked, &filter)
    }

    fn select(&mut self, filter: &FrameFilter) {
        (self.selection, self.frame.usable) = filter.select(&self.ctx);
    }

    fn edit<R>(&mut self, f: impl FnOnce(&Context, &mut Editor<'_>, &mut YoungPoints) -> R) -> R {
        let mut editor = Editor::new(&mut self.slam.map);
        let result = f(&self.ctx, &mut editor, &mut self.slam.young);
        self.edits.applied += editor.counts.applied;
        self.edits.void += editor.counts.void;
        self.journal.append(&mut editor.journal);
        result
    }

    fn event(&mut self, warning: bool, text: String) {
        self.events.push(Event { warning, text });
    }

    /// Starts a map at this frame.
    fn initialize(&mut self, filter: &FrameFilter) -> bool {
        let with_depth =
            (0..self.frame.obs.len()).filter(|i| self.frame.usable[*i] && self.frame.obs.depth(*i).is_some());
        let n = with_depth.count() as u32;
        self.observer.done(Work::Predict);
        if n < self.ctx.config.tracking.min_init_keypoints {
            return false;
        }
        let map = self.slam.tracker.next_map;
        self.slam.tracker.next_map = MapId(map.0 + 1);
        self.slam.tracker.active = map;
        // Points of the part that was left are off probation: nobody looks at them, and they may be found again.
        self.slam.young = YoungPoints::default();
        self.frame.camera_from_world = Se3::identity();
        self.insert(filter, map);
        self.counts.inliers = self.frame.match_count();
        self.event(map.0 > 0, format!("{map} started with {n} keypoints"));
        true
    }

    /// The usual frame: prediction, judgement, local map.
    fn track(&mut self, filter: &mut FrameFilter) -> bool {
        let found = self.predict();
        self.observer.done(Work::Predict);
        if found < self.ctx.config.tracking.min_step_inliers {
            return false;
        }
        self.judge(filter);
        self.track_local()
    }

    fn predict(&mut self) -> u32 {
        let Some(mut last) = self.slam.tracker.last.take() else { return 0 };
        last.update_from(&self.slam.map);
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
        self.slam.filter.judge(&self.ctx, self.input, &obs, &pose, filter);
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
        let mut found: Vec<_> = self.frame.matches().map(|(_, id)| id).collect();
        found.sort_unstable();
        let in_view: Vec<_> = local.in_view.iter().map(|(id, _, _)| *id).collect();
        self.edit(|_, editor, _| {
            for id in in_view {
                editor.apply(MapEdit::CountSight(id, found.binary_search(&id).is_ok()));
            }
        });
        self.slam.last_local = Some(local);
    }

    /// The track is lost: look for a known place, and start a new map when none is found for long.
    fn recover(&mut self, filter: &mut FrameFilter) -> bool {
        let r = &self.ctx.config.relocalization;
        let usable = self.frame.usable.iter().filter(|u| **u).count() as u32;
        self.slam.tracker.lost_usable_frames += u32::from(usable >= r.min_keypoints);
        let found = relocalize(&self.ctx, &self.slam.map, &self.slam.places, &mut self.frame, |_| true);
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

    fn insert(&mut self, filter: &FrameFilter, map: MapId) -> (KeyFrameId, u32) {
        let frame = self.frame.clone();
        let class = filter.class.clone();
        let (id, created) = self.edit(|ctx, editor, young| {
            let id = insert_keyframe(editor, &frame, map);
            let matched: Vec<_> = frame.matches().map(|(_, id)| id).collect();
            for point in matched {
                editor.refresh(ctx, point);
            }
            let created = create_points_from_depth(ctx, editor, young, id, &class);
            editor.apply(MapEdit::Connect(id));
            (id, created)
        });
        if let Some(keyframe) = self.slam.map.keyframe(id) {
            self.frame.points = keyframe.points.clone();
            let usable = (0..frame.obs.len()).filter(|i| frame.usable[*i]);
            let descriptors: Vec<_> = usable.map(|i| frame.obs.descriptor[i]).collect();
            self.slam.places.add(id.0, &descriptors);
        }
        self.frame.refer_to(id, &self.slam.map);
        self.slam.tracker.last_keyframe = self.frame.id;
        self.new_keyframe = Some(id);
        self.counts.points_created += created;
        (id, created)
    }

    /// Map upkeep after a tracked frame, and a keyframe with local mapping when one is due.
    fn map_frame(&mut self, filter: &FrameFilter) {
        if let Some(local) = self.slam.last_local.take() {
            let (input, frame) = (self.input, self.frame.clone());
            self.counts.points_culled +=
                self.edit(|ctx, editor, _| doubts::doubt_points(ctx, editor, input, filter, &frame, &local));
        }
        if self.new_keyframe.is_some() {
            return;
        }
        let (map, last_keyframe) = (&self.slam.map, self.slam.tracker.last_keyframe);
        if keyframe_needed(&self.ctx, map, &self.frame, self.counts.inliers, last_keyframe).is_none() {
            return;
        }
        let (id, _) = self.insert(filter, self.slam.tracker.active);
        let done: MappingCounts = self.edit(|ctx, editor, young| local_mapping(ctx, editor, young, id));
        self.counts.points_created += done.triangulated;
        self.counts.points_culled += done.culled;
        self.counts.points_fused += done.fused;
        self.counts.ba_outliers += done.ba_outliers;
        self.forget_culled_keyframes();
        // Bundle adjustment has moved the keyframe this frame is.
        self.frame.update_from(&self.slam.map);
        self.join_maps(id);
    }

    fn forget_culled_keyframes(&mut self) {
        for edit in &self.journal {
            if let MapEdit::CullKeyFrame(id) = edit
                && self.slam.map.keyframe(*id).is_none()
            {
                self.slam.places.remove(id.0);
            }
        }
    }

    /// While several parts of the atlas exist, each new keyframe looks for its place in the others; when it is found,
    /// the active part moves into the other's frame.
    fn join_maps(&mut self, id: KeyFrameId) {
        let active = self.slam.tracker.active;
        if self.slam.tracker.next_map.0 < 2 || self.slam.map.keyframes().all(|k| k.map == active) {
            return;
        }
        let mut probe = self.frame.clone();
        let found = relocalize(&self.ctx, &self.slam.map, &self.slam.places, &mut probe, |k| k.map != active);
        let Some(found) = found else { return };
        let Some(keyframe) = self.slam.map.keyframe(id) else { return };
        // Both poses are of the same camera at the same time.
        let into_from_map = probe.camera_from_world.inverse() * keyframe.camera_from_world;
        let join = MapEdit::Join { map: active, into: found.map, into_from_map };
        self.edit(|_, editor, _| editor.apply(join));
        self.slam.tracker.active = found.map;
        self.frame.update_from(&self.slam.map);
        // What is remembered of the frames before must move along: motion is judged against it, and predicted from it.
        self.slam.filter.move_world(&into_from_map);
        if let Some(last) = &mut self.slam.tracker.last {
            last.update_from(&self.slam.map);
        }
        self.event(true, format!("{active} joined {} at {}", found.map, found.keyframe));
    }

    /// State for the next frame, history, digests, report.
    fn finish(mut self, tracked: bool, filter: &FrameFilter) -> FrameReport {
        self.slam.last_local = None;
        let pose = tracked.then_some(self.frame.camera_from_world);
        self.slam.filter.remember(&self.ctx, self.input, &self.frame.obs, pose.as_ref(), filter);
        self.advance_tracker(tracked);
        self.slam.frames.push(trajectory::Entry {
            id: self.frame.id,
            stamp: self.frame.stamp,
            tracked: tracked.then_some(trajectory::Tracked {
                map: self.slam.tracker.active,
                camera_from_world: self.frame.camera_from_world,
                reference: self.frame.reference,
                camera_from_reference: self.frame.camera_from_reference,
            }),
        });
        self.counts.keypoints = self.frame.obs.len() as u32;
        self.counts.static_keypoints = filter.verdict.iter().filter(|v| **v == Verdict::Static).count() as u32;
        self.counts.keyframes = self.slam.map.keyframe_count() as u32;
        self.counts.map_points = self.slam.map.point_count() as u32;
        let mut report = self.report(tracked, filter);
        report.records = vec![
            record::features(&self.frame.obs),
            record::regions(filter),
            record::verdicts(filter, &self.counts),
            record::matches(&report),
            record::pose(&report),
            record::map(&self.journal, self.edits, &self.counts),
        ];
        self.observer.done(Work::Report);
        report
    }

    fn advance_tracker(&mut self, tracked: bool) {
        let before = self.slam.tracker.state;
        let tracker: &mut Tracker = &mut self.slam.tracker;
        if tracked {
            let last = tracker.last.as_ref().filter(|_| before == TrackingState::Ok);
            tracker.velocity = last.map(|l| self.frame.camera_from_world * l.camera_from_world.inverse());
            tracker.last = Some(self.frame.clone());
            tracker.state = TrackingState::Ok;
            (tracker.lost_frames, tracker.lost_usable_frames) = (0, 0);
            return;
        }
        tracker.velocity = None;
        tracker.state = match before {
            TrackingState::NotInitialized => TrackingState::NotInitialized,
            _ if tracker.lost_usable_frames >= self.ctx.config.relocalization.frames_before_new_map => {
                TrackingState::Lost
            }
            _ => TrackingState::RecentlyLost,
        };
        tracker.lost_frames += 1;
        if before == TrackingState::Ok {
            self.event(true, format!("track lost with {} inliers", self.counts.inliers));
        }
    }

    fn report(&self, tracked: bool, filter: &FrameFilter) -> FrameReport {
        let obs = &self.frame.obs;
        let keypoint = |i: usize| KeypointReport {
            pixel: obs.raw_pixel[i],
            octave: obs.octave[i],
            depth_m: obs.depth_m[i],
            class: filter.class[i],
            verdict: filter.verdict[i],
            epipolar_px: filter.epipolar_px[i],
            motion_sigmas: filter.motion_sigmas[i],
            point: self.frame.points[i].filter(|_| tracked),
        };
        FrameReport {
            id: self.frame.id,
            stamp: self.frame.stamp,
            state: self.slam.tracker.state,
            map: self.slam.tracker.active,
            camera_from_world: tracked.then_some(self.frame.camera_from_world),
            reference: tracked.then_some(self.frame.reference),
            new_keyframe: self.new_keyframe,
            selection: self.selection,
            keypoints: (0..obs.len()).map(keypoint).collect(),
            regions: region_reports(filter),
            region_cells: (filter.regions.width, filter.regions.height, filter.regions.cell.clone()),
            epipolar: filter.epipolar.map(|e| EpipolarReport {
                matches: e.matches,
                inliers: e.inliers,
                degenerate: e.degenerate,
                matrix: std::array::from_fn(|i| e.matrix[(i / 3, i % 3)]),
            }),
            counts: self.counts,
            events: self.events.clone(),
            records: Vec::new(),
        }
    }
}

fn region_reports(filter: &FrameFilter) -> Vec<RegionReport> {
    let px = |cells: u16| f64::from(cells) * CELL_PX as f64;
    let one = |((region, track), evidence): (
        (&crate::panoptic::Region, &crate::panoptic::Track),
        &crate::panoptic::Evidence,
    )| {
        let [x0, x1, y0, y1] = region.extent;
        let last = evidence.counts.last().copied().unwrap_or_default();
        RegionReport {
            track: track.id,
            category: region.category,
            bbox: [px(x0), px(y0), px(x1 + 1 - x0), px(y1 + 1 - y0)],
            area_px: region.cells * (CELL_PX * CELL_PX) as u32,
            state: track.state,
            age_frames: track.age,
            free_space_share: evidence.free_space_share(),
            moved_share: evidence.moved_share(),
            samples: last.samples,
            keypoints: last.keypoints,
        }
    };
    filter.regions.list.iter().zip(&filter.tracks).zip(&filter.evidence).map(one).collect()
}
