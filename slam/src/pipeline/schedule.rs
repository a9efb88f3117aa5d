//! When the results of jobs are applied: a job submitted at frame f takes effect exactly before frame f + lag, on any
//! machine. With a lag of 0 it takes effect at the end of its own frame: the plain sequential system, by the same code.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, FrameId, KeyFrameId};

use super::job::{Executor, Job, JobKind, JobResult, Outcome, Task, Ticket};
use super::{Slam, SlamError};
use crate::context::Context;
use crate::depth::{DepthFound, DepthView};
use crate::map::{EditCounts, Editor, MapEdit};
use crate::mapping::MappingCounts;
use crate::report::Event;

/// Jobs that were submitted and have not been applied, in the order of submission.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Schedule {
    in_flight: Vec<InFlight>,
    next: Ticket,
}

#[derive(Clone, Serialize, Deserialize)]
struct InFlight {
    ticket: Ticket,
    kind: JobKind,
    /// Frame before which the result is applied.
    due: FrameId,
    /// When the executor was done at once.
    result: Option<JobResult>,
}

impl Schedule {
    /// Whether no job of a kind is in flight. Asked of this list, never of a thread.
    pub fn is_idle(&self, kind: JobKind) -> bool {
        self.in_flight.iter().all(|job| job.kind != kind)
    }

    pub fn submit(&mut self, job: Job, due: FrameId, executor: &mut dyn Executor) {
        let (ticket, kind) = (self.next, job.kind());
        self.next = Ticket(ticket.0 + 1);
        let result = executor.submit(ticket, job);
        self.in_flight.push(InFlight { ticket, kind, due, result });
    }

    /// Waits for all results and keeps them until they are due.
    pub fn collect_all(&mut self, frame: u32, executor: &mut dyn Executor) -> Result<(), SlamError> {
        for job in self.in_flight.iter_mut().filter(|job| job.result.is_none()) {
            job.result = executor.collect(job.ticket);
            job.result.is_some().then_some(()).ok_or(SlamError::Job { frame, kind: job.kind.name() })?;
        }
        Ok(())
    }

    /// The oldest job that is due by a frame; waits for it if it is late.
    pub fn take_due(&mut self, frame: FrameId, executor: &mut dyn Executor) -> Result<Option<JobResult>, SlamError> {
        // A correction moves the world under local mapping's feet, so it waits until none is in flight.
        let may = |job: &InFlight| job.kind == JobKind::Mapping || self.is_idle(JobKind::Mapping);
        let is_due = |job: &InFlight| may(job) && (job.due <= frame || executor.hurry(job.ticket));
        let Some(at) = self.in_flight.iter().position(is_due) else { return Ok(None) };
        let InFlight { ticket, kind, result, .. } = self.in_flight.remove(at);
        let result = result.or_else(|| executor.collect(ticket));
        result.map(Some).ok_or(SlamError::Job { frame: frame.0, kind: kind.name() })
    }
}

/// What the application of a job's result did.
pub(super) struct Applied {
    pub edits: Buffer<MapEdit>,
    pub counts: EditCounts,
    pub mapping: MappingCounts,
    /// What the application of a loop says, and what was found out about depth.
    pub events: Vec<Event>,
    /// Factor on all lengths around the last frame.
    pub scale: f64,
}

impl Slam {
    /// Local mapping around a keyframe that was made from a frame, and when its result takes effect.
    pub(super) fn mapping_job(&mut self, keyframe: KeyFrameId, frame: FrameId, view: DepthView) -> (Job, FrameId) {
        let ctx = Arc::clone(&self.ctx);
        let due = FrameId(frame.0 + JobKind::Mapping.lag(&ctx.config));
        let young = std::mem::take(&mut self.young);
        (Job::new(ctx, &self.map, Task::Mapping { keyframe, young, view }), due)
    }

    /// Does to the map and its surroundings what a job found.
    pub(super) fn apply_job(&mut self, result: JobResult) -> Applied {
        let corrections = self.map.corrections();
        let mut scale = 1.0;
        for edit in result.journal.edits() {
            if let MapEdit::Correct(correction) = edit
                && correction.based_on == corrections
            {
                scale = self.rescale(correction);
            }
        }
        let mut editor = Editor::new(&mut self.map, &self.front_end.context().buffers);
        let renaming = editor.replay(result.journal);
        let (journal, counts) = editor.finish();
        let edits = journal.into_edits();
        for edit in &edits {
            if let MapEdit::CullKeyFrame(id) = edit {
                self.places.remove(id.0);
            }
        }
        let (mut mapping, mut events) = (MappingCounts::default(), vec![]);
        match result.outcome {
            Outcome::Mapping { keyframe, mut young, counts, depth } => {
                young.rename(&renaming);
                events = self.learn_depth(&depth);
                self.young = young;
                self.waiting.search = Some(keyframe);
                mapping = counts;
            }
            Outcome::Loop { state, found } => {
                self.loops = state;
                let corrected = self.map.corrections() != corrections;
                events.extend(found.filter(|_| corrected).map(|found| self.loop_closed(&found)));
            }
            Outcome::Global => {}
        }
        Applied { edits, counts, mapping, events, scale }
    }

    /// From the next frame on, and in the next job, depth is believed as far as it deserves by all comparisons so far. Returns
    /// what a user should know.
    fn learn_depth(&mut self, found: &DepthFound) -> Vec<Event> {
        if *found == DepthFound::default() || !self.ctx.config.sensor.learn_noise {
            return vec![];
        }
        let mut depth = self.ctx.depth.clone();
        let news = depth.learn(found);
        self.ctx = Arc::new(Context { depth, ..(*self.ctx).clone() });
        news.into_iter().map(|text| Event { warning: true, text }).collect()
    }

    /// Applies what is still in flight. To be called after the last frame, before the map or the trajectory is read.
    ///
    /// # Errors
    /// When the executor lost a job.
    pub fn settle(&mut self, executor: &mut dyn Executor) -> Result<(), SlamError> {
        let last = FrameId(self.frames.len().saturating_sub(1) as u32);
        loop {
            while let Some(result) = self.schedule.take_due(FrameId(u32::MAX), executor)? {
                self.apply_job(result);
            }
            let jobs = self.loop_jobs(last);
            if jobs.is_empty() {
                self.sights.follow(self.map.take_merges());
                return Ok(());
            }
            jobs.into_iter().for_each(|(job, due)| self.schedule.submit(job, due, executor));
        }
    }
}
