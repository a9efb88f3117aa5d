//! Work that needs a frame alone - decoding, features - done ahead of time by other threads, handed out in order.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use slam::observation::Observation;
use slam::report::Event;
use slam::{FrameInput, FrontEnd};
use slam_vision::Workspace;

use super::RunError;
use super::source::Source;
use crate::log::{EncodedImage, RawFrame};
use crate::stopwatch::Stopwatch;

/// A frame ready for [`slam::Slam::step`].
pub(super) struct Prepared {
    pub input: FrameInput,
    pub observation: Arc<Observation>,
    /// The colour file as the log holds it, for the inspection file.
    #[cfg_attr(not(feature = "rerun"), expect(dead_code, reason = "only the inspection file shows it"))]
    pub color: EncodedImage,
    /// What the frame lacks.
    pub events: Vec<Event>,
    pub decode_time: Duration,
    pub features_time: Duration,
}

type Answer = Result<Prepared, RunError>;

struct Job {
    raw: RawFrame,
    answer: SyncSender<Answer>,
}

/// Calls `each` with every frame in order. With one thread everything happens on the caller's; with more, all but one
/// prepare frames, at most two a thread ahead. A `false` from `each` ends the walk early.
pub(super) fn for_each_frame(
    source: &Source,
    front_end: &FrontEnd,
    threads: usize,
    each: &mut dyn FnMut(Prepared) -> Result<bool, RunError>,
) -> Result<(), RunError> {
    let mut frames = source.timeline.stream(source.range.clone())?;
    if threads <= 1 {
        let mut workspace = Workspace::default();
        for raw in frames {
            if !each(prepare(source, front_end, raw?, &mut workspace)?)? {
                break;
            }
        }
        return Ok(());
    }
    let (jobs, queue) = channel();
    let queue = Mutex::new(queue);
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(|| work(source, front_end, &queue));
        }
        // Dropped at the end of this closure, which ends the workers.
        let jobs: Sender<Job> = jobs;
        let mut due: VecDeque<Receiver<Answer>> = VecDeque::new();
        for index in source.range.clone() {
            while due.len() < 2 * threads {
                let Some(raw) = frames.next() else { break };
                let (answer, receiver) = sync_channel(1);
                jobs.send(Job { raw: raw?, answer }).map_err(|_| RunError::Worker(index))?;
                due.push_back(receiver);
            }
            let prepared = due.pop_front().and_then(|answer| answer.recv().ok()).ok_or(RunError::Worker(index))?;
            if !each(prepared?)? {
                break;
            }
        }
        Ok(())
    })
}

fn work(source: &Source, front_end: &FrontEnd, queue: &Mutex<Receiver<Job>>) {
    let mut workspace = Workspace::default();
    loop {
        let job = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Job { raw, answer }) = job else { return };
        // The walk may have ended early; then nobody waits for the answer.
        let _ = answer.send(prepare(source, front_end, raw, &mut workspace));
    }
}

fn prepare(source: &Source, front_end: &FrontEnd, raw: RawFrame, workspace: &mut Workspace) -> Answer {
    let mut watch = Stopwatch::start();
    let (input, events) = source.input(&raw)?;
    let decode_time = watch.lap();
    let observation = Arc::new(front_end.observe(&input, workspace)?);
    let features_time = watch.lap();
    Ok(Prepared { input, observation, color: raw.color, events, decode_time, features_time })
}
