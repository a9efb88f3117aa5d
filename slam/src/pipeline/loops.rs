//! Loops, the joining of maps and the adjustment of a whole map as jobs: when they are submitted, and what else moves when
//! the map is corrected.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{FrameId, KeyFrameId, MapId};

use super::job::{Job, JobKind, Task};
use super::{Slam, trajectory};
use crate::looping::{LoopFound, Votes, find_candidates};
use crate::map::Correction;
use crate::report::Event;

/// What is to be done when no job of its kind is in flight.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Waiting {
    /// The newest keyframe that has been mapped and not been searched for loops.
    pub search: Option<KeyFrameId>,
    /// The part of the atlas that was corrected and is to be adjusted as a whole.
    pub adjust: Option<MapId>,
}

impl Slam {
    /// Jobs that wait and can be submitted at this frame, and when they take effect.
    pub(super) fn loop_jobs(&mut self, frame: FrameId) -> Vec<(Job, FrameId)> {
        let mut jobs = Vec::new();
        if self.schedule.is_idle(JobKind::Loop)
            && let Some(task) = self.waiting.search.take().and_then(|id| self.search(id))
        {
            jobs.push((JobKind::Loop, task));
        }
        if self.schedule.is_idle(JobKind::Global)
            && let Some(part) = self.waiting.adjust.take()
        {
            jobs.push((JobKind::Global, Task::Global { part }));
        }
        let ctx = Arc::clone(&self.ctx);
        let due = |kind: JobKind| FrameId(frame.0 + kind.lag(&ctx.config));
        jobs.into_iter().map(|(kind, task)| (Job::new(ctx.clone(), &self.map, task), due(kind))).collect()
    }

    /// The search for the place of a keyframe, if there is anything to look at.
    fn search(&mut self, id: KeyFrameId) -> Option<Task> {
        let keyframe = self.map.keyframe(id)?;
        let usable = (0..keyframe.obs.len()).filter(|i| keyframe.usable[*i]);
        let descriptors: Vec<_> = usable.map(|i| keyframe.obs.descriptor[i]).collect();
        let may_vote = |id, keypoint| self.map.has_point(KeyFrameId(id), keypoint);
        let scores = self.places.query(&descriptors, usize::MAX, may_vote);
        let votes = Votes { scores, by_words: self.places.has_words() };
        let candidates = find_candidates(self.context(), &self.map, keyframe, &votes);
        let nothing = candidates.own.is_empty() && candidates.others.is_empty() && self.loops.is_idle();
        (!nothing).then(|| Task::Loop { keyframe: id, candidates, state: std::mem::take(&mut self.loops) })
    }

    /// To be called before a correction is applied: what is stored relative to keyframes takes on their new scale. Returns
    /// the scale at the last frame.
    pub(super) fn rescale(&mut self, correction: &Correction) -> f64 {
        let scale = |id: KeyFrameId| correction.of(&self.map, id).map_or(1.0, |by| by.scale);
        for entry in &mut self.frames {
            if let Some(trajectory::Tracked { reference, camera_from_reference, .. }) = &mut entry.tracked {
                camera_from_reference.translation *= scale(*reference);
            }
        }
        let here = self.tracker.last.as_ref().map_or(1.0, |last| scale(last.reference));
        if let Some(last) = &mut self.tracker.last {
            last.camera_from_reference.translation *= here;
        }
        if let Some(velocity) = &mut self.tracker.velocity {
            velocity.translation *= here;
        }
        here
    }

    /// A place was found again and the map has been corrected.
    pub(super) fn loop_closed(&mut self, found: &LoopFound) -> Event {
        let LoopFound { keyframe, matched, moved_m, .. } = found;
        let into = self.map.keyframe(*matched).map_or(found.part, |k| k.map);
        self.waiting.adjust = Some(into);
        let text = if into == found.part {
            let degrees = found.corrected_from_world.se3.angle() * 180.0 / std::f64::consts::PI;
            // Without depth lengths have no unit, and what drifts is the scale too.
            let (unit, scale) = match self.context().is_monocular() {
                true => ("units", format!(", {:.3} times as large", found.corrected_from_world.scale)),
                false => ("m", String::new()),
            };
            format!(
                "loop closed: {keyframe} sees {matched} again, {moved_m:.3} {unit} and {degrees:.2} degrees off{scale}"
            )
        } else {
            format!("{} joined {into} at {matched}", found.part)
        };
        if self.tracker.active == found.part {
            self.tracker.active = into;
        }
        Event { warning: true, text }
    }
}
