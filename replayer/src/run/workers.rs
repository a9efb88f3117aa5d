//! Threads that prepare frames and run the slam's background jobs. Who does what, and when, decides nothing but the
//! time it takes: frames are handed out in order, and the slam says when a job's result is applied.
//!
//! One queue for all, the most urgent first: local mapping, then frames in order, then jobs that have more time. Whoever waits, works: the tracking thread too takes from the
//! queue while what it needs is not there. With one thread there is nobody else, and everything happens on it.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use slam::observation::Observation;
use slam::report::Event;
use slam::{Executor, FrameInput, Job, JobKind, JobResult, Ticket};
use slam_math::par::Pool;
use slam_vision::Workspace;

use super::RunError;
use crate::log::EncodedImage;
use crate::stopwatch::Stopwatch;

/// A frame ready for [`slam::Slam::step`].
pub(super) struct Prepared {
    pub input: FrameInput,
    pub observation: Arc<Observation>,
    /// The colour file as the log holds it, for the inspection file; none without a log, or when the slam sees it
    /// rectified.
    pub color: Option<EncodedImage>,
    /// What the frame lacks.
    pub events: Vec<Event>,
    pub decode_time: Duration,
    pub features_time: Duration,
}

/// Work that needs a frame alone. The workspace only saves allocations.
pub(super) type FrameTask<'a> = Box<dyn FnOnce(&mut Workspace) -> Result<Prepared, RunError> + Send + 'a>;

/// For tests: disturbs those who work.
#[derive(Clone)]
pub struct Unrest {
    /// Called before and after every piece of work, by whoever does it; may sleep.
    pub pause: Arc<dyn Fn() + Send + Sync>,
    /// Applies results of jobs as soon as they are ready: what must never be done.
    pub hurry: bool,
}

impl fmt::Debug for Unrest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Unrest").field("hurry", &self.hurry).finish_non_exhaustive()
    }
}

/// The queue, and what came out of it. An answer is `None` when the thread that worked on it has failed.
#[derive(Default)]
struct Queue<'a> {
    /// In the order of urgency.
    jobs: BTreeMap<(JobKind, Ticket), Job>,
    frames: VecDeque<(usize, FrameTask<'a>)>,
    results: BTreeMap<Ticket, Option<(JobResult, JobTime)>>,
    prepared: BTreeMap<usize, Option<Result<Prepared, RunError>>>,
    closed: bool,
}

impl Queue<'_> {
    /// A job to do before any frame.
    fn next_job(&mut self) -> Option<(Ticket, Job)> {
        let first = self.jobs.first_entry()?;
        let (kind, ticket) = *first.key();
        (kind == JobKind::Mapping || self.frames.is_empty()).then(|| (ticket, first.remove()))
    }
}

/// How long a job took.
pub(super) type JobTime = (JobKind, Duration);

struct Shop<'a> {
    queue: Mutex<Queue<'a>>,
    changed: Condvar,
    /// For what is parallel inside a job.
    pool: Pool,
    unrest: Option<&'a Unrest>,
}

impl<'a> Shop<'a> {
    fn lock(&self) -> MutexGuard<'_, Queue<'a>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Works until `found` has what is waited for.
    fn work_until<T>(&self, workspace: &mut Workspace, mut found: impl FnMut(&mut Queue<'a>) -> Option<T>) -> T {
        let mut queue = self.lock();
        loop {
            if let Some(found) = found(&mut queue) {
                return found;
            }
            if let Some((ticket, job)) = queue.next_job() {
                drop(queue);
                self.run_job(ticket, job);
            } else if let Some((index, task)) = queue.frames.pop_front() {
                drop(queue);
                self.prepare(index, task, workspace);
            } else {
                queue = self.changed.wait(queue).unwrap_or_else(PoisonError::into_inner);
                continue;
            }
            queue = self.lock();
        }
    }

    fn run_job(&self, ticket: Ticket, job: Job) {
        let answer =
            Answer { shop: self, put: |queue, answer| drop(queue.results.insert(ticket, answer)), value: None };
        let kind = job.kind();
        self.pause();
        let mut watch = Stopwatch::start();
        let result = self.pool.run(|| job.run());
        let time = (kind, watch.lap());
        self.pause();
        answer.give((result, time));
    }

    fn prepare(&self, index: usize, task: FrameTask<'a>, workspace: &mut Workspace) {
        let answer =
            Answer { shop: self, put: |queue, answer| drop(queue.prepared.insert(index, answer)), value: None };
        self.pause();
        let prepared = task(workspace);
        self.pause();
        answer.give(prepared);
    }

    fn pause(&self) {
        if let Some(unrest) = self.unrest {
            (unrest.pause)();
        }
    }
}

/// Puts an answer into the queue when it is dropped, also when the work panics.
struct Answer<'s, 'a, T, F: FnMut(&mut Queue<'a>, Option<T>)> {
    shop: &'s Shop<'a>,
    put: F,
    value: Option<T>,
}

impl<'a, T, F: FnMut(&mut Queue<'a>, Option<T>)> Answer<'_, 'a, T, F> {
    fn give(mut self, value: T) {
        self.value = Some(value);
    }
}

impl<'a, T, F: FnMut(&mut Queue<'a>, Option<T>)> Drop for Answer<'_, 'a, T, F> {
    fn drop(&mut self) {
        (self.put)(&mut self.shop.lock(), self.value.take());
        self.shop.changed.notify_all();
    }
}

/// Ends the workers when it is dropped, also when the tracking thread panics.
struct Closing<'s, 'a>(&'s Shop<'a>);

impl Drop for Closing<'_, '_> {
    fn drop(&mut self) {
        self.0.lock().closed = true;
        self.0.changed.notify_all();
    }
}

/// The tracking thread's side: gets frames, hands out jobs.
pub(super) struct Foreman<'s, 'a> {
    shop: &'s Shop<'a>,
    feed: &'s mut dyn Iterator<Item = Result<FrameTask<'a>, RunError>>,
    workspace: Workspace,
    /// Frames prepared ahead at most.
    ahead: usize,
    asked: usize,
    given: usize,
    /// How long jobs took whose results were collected.
    pub job_times: Vec<JobTime>,
}

impl Foreman<'_, '_> {
    /// The next frame; none after the last.
    pub fn next_frame(&mut self) -> Result<Option<Prepared>, RunError> {
        while self.asked < self.given + self.ahead {
            let Some(task) = self.feed.next() else { break };
            let mut queue = self.shop.lock();
            match task {
                Ok(task) => queue.frames.push_back((self.asked, task)),
                Err(error) => drop(queue.prepared.insert(self.asked, Some(Err(error)))),
            }
            drop(queue);
            self.shop.changed.notify_all();
            self.asked += 1;
        }
        if self.given == self.asked {
            return Ok(None);
        }
        let index = self.given;
        self.given += 1;
        let prepared = self.shop.work_until(&mut self.workspace, |queue| queue.prepared.remove(&index));
        prepared.ok_or(RunError::Worker(index))?.map(Some)
    }
}

impl Foreman<'_, '_> {
    /// Runs what is parallel inside, with all threads that are allowed. For when no job is in flight.
    pub fn in_pool<R: Send>(&self, f: impl FnOnce() -> R + Send) -> R {
        self.shop.pool.run(f)
    }
}

impl Executor for Foreman<'_, '_> {
    fn submit(&mut self, ticket: Ticket, job: Job) -> Option<JobResult> {
        self.shop.lock().jobs.insert((job.kind(), ticket), job);
        self.shop.changed.notify_all();
        None
    }

    fn collect(&mut self, ticket: Ticket) -> Option<JobResult> {
        let answer = self.shop.work_until(&mut self.workspace, |queue| queue.results.remove(&ticket));
        let (result, time) = answer?;
        self.job_times.push(time);
        Some(result)
    }

    fn hurry(&self, ticket: Ticket) -> bool {
        self.shop.unrest.is_some_and(|unrest| unrest.hurry) && self.shop.lock().results.contains_key(&ticket)
    }
}

/// Runs `body` on the caller's thread with a foreman who has `threads - 1` workers.
pub(super) fn with_workers<'a, R>(
    threads: usize,
    unrest: Option<&'a Unrest>,
    feed: &mut dyn Iterator<Item = Result<FrameTask<'a>, RunError>>,
    body: impl FnOnce(&mut Foreman<'_, 'a>) -> Result<R, RunError>,
) -> Result<R, RunError> {
    let threads = threads.max(1);
    let pool = Pool::new(threads).map_err(RunError::Threads)?;
    let shop = Shop { queue: Mutex::default(), changed: Condvar::new(), pool, unrest };
    std::thread::scope(|scope| {
        let work = || shop.work_until(&mut Workspace::default(), |queue| queue.closed.then_some(()));
        let workers: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
        let closing = Closing(&shop);
        let workspace = Workspace::default();
        let ahead = if threads == 1 { 1 } else { 2 * threads };
        let mut foreman = Foreman { shop: &shop, feed, workspace, ahead, asked: 0, given: 0, job_times: Vec::new() };
        let result = body(&mut foreman);
        drop(closing);
        // A worker that has failed has told so by its answer.
        workers.into_iter().for_each(|worker| drop(worker.join()));
        result
    })
}
