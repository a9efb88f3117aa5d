//! Background work as values: a job holds all that it reads, and what it gives is a value too. Where and when it runs
//! makes no difference; when its result is applied is the [schedule](super::schedule)'s business.
//!
//! A new kind of job: a variant of [`JobKind`] with its lag, one of [`Task`], one of [`Outcome`] with what becomes of
//! it in `Slam::apply_job`.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{KeyFrameId, MapId};

use crate::config::Config;
use crate::context::Context;
use crate::depth::{DepthFound, DepthView};
use crate::looping::{Candidates, LoopFound, LoopState, correct, detect, global_adjustment};
use crate::map::{Editor, Journal, Map};
use crate::mapping::{MappingCounts, YoungPoints, local_mapping};

/// Kinds of background work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum JobKind {
    /// Local mapping after a keyframe.
    Mapping,
    /// Search for the place of a keyframe among those seen before, and the correction when it is found.
    Loop,
    /// Bundle adjustment of a whole part of the atlas after a correction.
    Global,
}

impl JobKind {
    /// All kinds.
    pub const ALL: [Self; 3] = [Self::Mapping, Self::Loop, Self::Global];

    /// Name for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mapping => "local mapping",
            Self::Loop => "loop search",
            Self::Global => "global adjustment",
        }
    }

    /// Frames from submission to application.
    pub(super) fn lag(self, config: &Config) -> u32 {
        match self {
            Self::Mapping => config.jobs.mapping_lag_frames,
            Self::Loop => config.jobs.loop_lag_frames,
            Self::Global => config.jobs.global_lag_frames,
        }
    }
}

/// Work to be done on a snapshot of the map, by any thread.
pub struct Job {
    ctx: Arc<Context>,
    map: Map,
    task: Task,
}

/// What is to be done.
pub(super) enum Task {
    /// Local mapping around a keyframe.
    Mapping { keyframe: KeyFrameId, young: YoungPoints, view: DepthView },
    /// Verification of the candidates for a keyframe.
    Loop { keyframe: KeyFrameId, candidates: Candidates, state: LoopState },
    /// Adjustment of a part of the atlas.
    Global { part: MapId },
}

/// What a job came to.
#[derive(Clone, Serialize, Deserialize)]
pub struct JobResult {
    pub(super) journal: Journal,
    pub(super) outcome: Outcome,
}

/// What a job came to besides edits of the map.
#[derive(Clone, Serialize, Deserialize)]
pub(super) enum Outcome {
    /// Of local mapping: the points that are still on probation, counts, and depths compared with pixels.
    Mapping { keyframe: KeyFrameId, young: YoungPoints, counts: MappingCounts, depth: Box<DepthFound> },
    /// Of a loop search: what detection remembers, and the place that the correction is about.
    Loop { state: LoopState, found: Option<Box<LoopFound>> },
    /// Of a global adjustment: nothing.
    Global,
}

impl Job {
    pub(super) fn new(ctx: Arc<Context>, map: &Map, task: Task) -> Self {
        Self { ctx, map: map.snapshot(), task }
    }

    /// Which kind of work it is.
    #[must_use]
    pub fn kind(&self) -> JobKind {
        match self.task {
            Task::Mapping { .. } => JobKind::Mapping,
            Task::Loop { .. } => JobKind::Loop,
            Task::Global { .. } => JobKind::Global,
        }
    }

    /// Does the work: a pure function of the job.
    #[must_use]
    pub fn run(mut self) -> JobResult {
        let mut editor = Editor::new(&mut self.map, &self.ctx.buffers);
        let outcome = match self.task {
            Task::Mapping { keyframe, mut young, view } => {
                let (counts, depth) = local_mapping(&self.ctx, &mut editor, &mut young, keyframe, &view);
                Outcome::Mapping { keyframe, young, counts, depth: Box::new(depth) }
            }
            Task::Loop { keyframe, candidates, mut state } => {
                let found = detect(&self.ctx, editor.map(), &candidates, keyframe, &mut state);
                let correction = found.as_ref().and_then(|found| correct(&self.ctx, editor.map(), found));
                if let Some(edit) = correction {
                    editor.apply(edit);
                }
                Outcome::Loop { state, found: found.map(Box::new) }
            }
            Task::Global { part } => {
                if let Some(edit) = global_adjustment(&self.ctx, editor.map(), part) {
                    editor.apply(edit);
                }
                Outcome::Global
            }
        };
        let (journal, _) = editor.finish();
        JobResult { journal, outcome }
    }
}

/// Number of a job, counting up from 0 in the order of submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Ticket(pub u64);

/// Whoever runs jobs: the caller itself, or other threads.
pub trait Executor {
    /// Takes a job. Gives its result when it was done at once, else the job is kept for [`collect`](Self::collect).
    fn submit(&mut self, ticket: Ticket, job: Job) -> Option<JobResult>;

    /// The result of a job that was kept, waited for if need be; `None` when whoever ran it has failed.
    fn collect(&mut self, ticket: Ticket) -> Option<JobResult>;

    /// Whether to apply the result now although it is not due. Never: the result of a run would depend on who is
    /// quick. A test answers otherwise to show that this is found.
    fn hurry(&self, _ticket: Ticket) -> bool {
        false
    }
}

/// Runs every job when it is submitted.
pub struct Inline;

impl Executor for Inline {
    fn submit(&mut self, _ticket: Ticket, job: Job) -> Option<JobResult> {
        Some(job.run())
    }

    fn collect(&mut self, _ticket: Ticket) -> Option<JobResult> {
        None
    }
}
