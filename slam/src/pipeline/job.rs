//! Background work as values: a job holds all that it reads, and what it gives is a value too. Where and when it runs
//! makes no difference; when its result is applied is the [schedule](super::schedule)'s business.
//!
//! A new kind of job: a variant of [`JobKind`] with its lag, one of [`Task`], one of [`Outcome`] with what becomes of
//! it in `Slam::apply_job`.

use std::sync::Arc;

use slam_math::KeyFrameId;

use crate::config::Config;
use crate::context::Context;
use crate::map::{Editor, Journal, Map};
use crate::mapping::{MappingCounts, YoungPoints, local_mapping};

/// Kinds of background work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum JobKind {
    /// Local mapping after a keyframe.
    Mapping,
}

impl JobKind {
    /// All kinds.
    pub const ALL: [Self; 1] = [Self::Mapping];

    /// Name for tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mapping => "local mapping",
        }
    }

    /// Frames from submission to application.
    pub(super) fn lag(self, config: &Config) -> u32 {
        match self {
            Self::Mapping => config.jobs.mapping_lag_frames,
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
    Mapping { keyframe: KeyFrameId, young: YoungPoints },
}

/// What a job came to.
pub struct JobResult {
    pub(super) journal: Journal,
    pub(super) outcome: Outcome,
}

/// What a job came to besides edits of the map.
pub(super) enum Outcome {
    /// Of local mapping: the points that are still on probation, and counts.
    Mapping { young: YoungPoints, counts: MappingCounts },
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
        }
    }

    /// Does the work: a pure function of the job.
    #[must_use]
    pub fn run(mut self) -> JobResult {
        let mut editor = Editor::new(&mut self.map);
        let outcome = match self.task {
            Task::Mapping { keyframe, mut young } => {
                let counts = local_mapping(&self.ctx, &mut editor, &mut young, keyframe);
                Outcome::Mapping { young, counts }
            }
        };
        let (journal, _) = editor.finish();
        JobResult { journal, outcome }
    }
}

/// Number of a job, counting up from 0 in the order of submission.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
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
