//! The stages of one frame.

use std::sync::Arc;

use slam_math::{Buffer, KeyFrameId, Se3, Sim3};

use super::{Executor, Observer, Slam, SlamError, Tracker, Work, record, trajectory};
use crate::context::Context;
use crate::depth::{DepthView, Motion};
use crate::input::{FrameInput, Sensor};
use crate::map::{EditCounts, Editor, MapEdit};
use crate::mapping::YoungPoints;
use crate::observation::Observation;
use crate::panoptic::FrameFilter;
use crate::report::{Counts, Event, FrameReport, Selection, TrackingState, Verdict};
use crate::tracking::TrackedFrame;

/// One frame on its way through the stages.
pub(super) struct Step<'a> {
    pub slam: &'a mut Slam,
    pub ctx: Arc<Context>,
    pub input: &'a FrameInput,
    pub frame: TrackedFrame,
    pub executor: &'a mut dyn Executor,
    pub observer: &'a mut dyn Observer,
    pub counts: Counts,
    pub selection: Selection,
    pub new_keyframe: Option<KeyFrameId>,
    /// The keyframe around which local mapping is to be done.
    pub mapping_due: Option<KeyFrameId>,
    journal: Buffer<MapEdit>,
    edits: EditCounts,
    pub events: Vec<Event>,
}

impl<'a> Step<'a> {
    pub(super) fn new(
        slam: &'a mut Slam,
        input: &'a FrameInput,
        obs: Arc<Observation>,
        executor: &'a mut dyn Executor,
        observer: &'a mut dyn Observer,
    ) -> Self {
        let (n, ctx) = (obs.len(), Arc::clone(&slam.ctx));
        let frame = TrackedFrame {
            id: input.id,
            stamp: input.stamp,
            obs,
            class: ctx.buffers.empty(),
            usable: ctx.buffers.filled(n, true),
            points: ctx.buffers.filled(n, None),
            camera_from_world: Se3::identity(),
            reference: KeyFrameId(0),
            camera_from_reference: Se3::identity(),
        };
        Self {
            journal: ctx.buffers.empty(),
            ctx,
            slam,
            input,
            frame,
            executor,
            observer,
            counts: Counts::default(),
            selection: Selection::default(),
            new_keyframe: None,
            mapping_due: None,
            edits: EditCounts::default(),
            events: vec![],
        }
    }

    pub(super) fn run(mut self) -> Result<FrameReport, SlamError> {
        self.apply_due_jobs()?;
        // They may have found out more about depth.
        self.ctx = Arc::clone(&self.slam.ctx);
        // The last frame has just followed them.
        let merges = self.slam.map.take_merges();
        self.slam.sights.follow(merges);
        if let Some(last) = &self.slam.tracker.last {
            (self.frame.reference, self.frame.camera_from_world) = (last.reference, last.camera_from_world);
        }

        let obs = self.frame.obs.clone();
        let mut filter = self.slam.filter.label(&self.ctx, self.input, &obs);
        self.frame.class = filter.class.clone();
        self.observer.done(Work::Label);

        let tracked = match self.slam.tracker.state {
            TrackingState::NotInitialized => self.initialize(&filter),
            TrackingState::Ok => self.track(&mut filter),
            TrackingState::RecentlyLost | TrackingState::Lost => self.recover(&mut filter),
        };
        if tracked {
            self.map_frame(&filter);
        }
        self.observer.done(Work::Keyframe);
        while self.submit_jobs() {
            // Those without lag; they may lead to others.
            if self.apply_due_jobs()? && tracked {
                self.frame.update_from(&self.slam.map);
            }
        }
        Ok(self.finish(tracked, &filter))
    }

    /// Submits what is to be done in the background. Tells whether there was anything.
    fn submit_jobs(&mut self) -> bool {
        let mapping = self.mapping_due.take().map(|keyframe| {
            let view = self.depth_view();
            self.slam.mapping_job(keyframe, self.frame.id, view)
        });
        let mut jobs: Vec<_> = mapping.into_iter().collect();
        jobs.extend(self.slam.loop_jobs(self.frame.id));
        self.observer.done(Work::Snapshot);
        let any = !jobs.is_empty();
        for (job, due) in jobs {
            self.slam.schedule.submit(job, due, self.executor);
        }
        self.observer.done(Work::Jobs);
        any
    }

    /// The depth image around the keypoints, and the camera's motion, for the comparison of depth with pixels.
    fn depth_view(&self) -> DepthView {
        let (Sensor::Rgbd, Some(depth)) = (self.ctx.sensor, &self.input.depth) else { return DepthView::default() };
        let last = self.slam.tracker.last.as_ref().filter(|_| self.slam.tracker.state == TrackingState::Ok);
        let motion = last.map(|last| Motion {
            last_from_now: last.camera_from_world * self.frame.camera_from_world.inverse(),
            seconds: (self.frame.stamp.0 - last.stamp.0) as f64 * 1e-9,
        });
        DepthView::new(depth, &self.frame.obs.raw_pixel, motion, &self.ctx.buffers)
    }

    /// Applies the results that take effect before this frame (or, without lag, at its end). Tells whether any changed the map.
    fn apply_due_jobs(&mut self) -> Result<bool, SlamError> {
        let mut any = false;
        while let Some(result) = self.slam.schedule.take_due(self.frame.id, self.executor)? {
            self.observer.done(Work::Jobs);
            let mut applied = self.slam.apply_job(result);
            self.edits.applied += applied.counts.applied;
            self.edits.void += applied.counts.void;
            self.journal.append(&mut applied.edits);
            self.counts.points_created += applied.mapping.triangulated;
            self.counts.points_culled += applied.mapping.culled;
            self.counts.points_fused += applied.mapping.fused;
            self.counts.ba_outliers += applied.mapping.ba_outliers;
            self.events.extend(applied.events);
            // Following a map that has not moved would still round.
            if applied.counts.applied > 0 {
                any = true;
                self.frame.camera_from_reference.translation *= applied.scale;
                self.follow_map(applied.scale);
            }
            self.observer.done(Work::Apply);
        }
        Ok(any)
    }

    /// What is remembered of the frames before moves with the map: motion is judged against it, and predicted from it.
    /// `scale` is the factor on all lengths there.
    fn follow_map(&mut self, scale: f64) {
        let Some(last) = &mut self.slam.tracker.last else { return };
        let before = last.camera_from_world;
        last.update_from(&self.slam.map);
        if last.camera_from_world != before {
            let now = last.camera_from_world;
            let scaled = Sim3 { scale: 1.0 / scale, se3: Se3 { translation: now.translation / scale, ..now } };
            self.slam.filter.move_world(&(scaled.inverse() * Sim3::from(before)));
        }
    }

    pub(super) fn edit<R>(&mut self, f: impl FnOnce(&Context, &mut Editor<'_>, &mut YoungPoints) -> R) -> R {
        let mut editor = Editor::new(&mut self.slam.map, &self.ctx.buffers);
        let result = f(&self.ctx, &mut editor, &mut self.slam.young);
        let (journal, counts) = editor.finish();
        self.edits.applied += counts.applied;
        self.edits.void += counts.void;
        self.journal.append(&mut journal.into_edits());
        result
    }

    pub(super) fn event(&mut self, warning: bool, text: String) {
        self.events.push(Event { warning, text });
    }

    /// State for the next frame, history, digests, report.
    fn finish(mut self, tracked: bool, filter: &FrameFilter) -> FrameReport {
        self.slam.last_local = None;
        let pose = tracked.then_some(self.frame.camera_from_world);
        self.slam.filter.remember(&self.ctx, self.input, &self.frame.obs, pose.as_ref(), filter);
        self.advance_tracker(tracked);
        if self.ctx.config.r#final.enabled {
            self.slam.sights.remember(&self.ctx, tracked.then_some(&self.frame));
        }
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
        let records = [
            record::features(&self.frame.obs),
            record::regions(filter),
            record::verdicts(filter, &self.counts),
            record::matches(&report),
            record::pose(&report),
            record::map(&self.journal, self.edits, &self.counts),
        ];
        report.records.extend(records);
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
}
