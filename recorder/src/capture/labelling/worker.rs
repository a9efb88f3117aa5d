//! The threads that label, and the one that writes labels.

use super::schedule::Outcome;
use super::{Decision, Labels, Tracked};
use crate::capture::encode::Encoded;
use crate::capture::inlet::{EndedBy, Shared};
use crate::capture::lane::Wait;
use crate::capture::outbox::Item;
use crate::layer::{Layer, Sink};
use crate::log_writer::WriteError;
use crate::realsense::{Format, Frame};
use schemas::msg::{Header, LabelRecord, NOT_TOLD, level};
use schemas::topics::{self, frame};
use schemas::{Message, Stamp};
use segment::{Mask, Picture, SegmentError, Segmenter};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, PoisonError};
use std::thread::{Scope, ScopedJoinHandle};

/// How much more willingly than the recording these threads give up the processor.
const NICENESS: i32 = 10;

/// Starts the threads that label pictures; returns when all are ready to, or have ended the recording.
pub fn start<'scope>(scope: &'scope Scope<'scope, '_>, shared: &'scope Shared) -> Vec<ScopedJoinHandle<'scope, ()>> {
    let Some(labels) = &shared.labels else { return Vec::new() };
    let count = labels.asked.threads.get();
    let (ready, is_ready) = sync_channel(count);
    let work = |ready| scope.spawn(move || labels.work(shared, ready));
    let mut threads: Vec<_> = (0..count).map(|_| work(ready.clone())).collect();
    drop(ready);
    // The channel ends when each has said so or given up.
    while is_ready.recv().is_ok() {}
    threads.push(scope.spawn(move || labels.write_all(shared)));
    threads
}

/// Messages of a layer, on their way to the log.
#[derive(Default)]
struct Bundle(Vec<Encoded>);

impl Sink for Bundle {
    type Error = WriteError;

    fn put<'a, M: Message<'a>>(&mut self, topic: &str, times: (Stamp, Stamp), message: &M) -> Result<(), WriteError> {
        self.0.push(Encoded::new(topic.to_owned(), times.0, times.1, message));
        Ok(())
    }
}

impl Labels {
    /// One worker: its own segmenter, always the newest picture. Says so when it is ready; dropping `ready` unused means that it
    /// is not.
    fn work(&self, shared: &Shared, ready: SyncSender<()>) {
        // Linux: this thread alone. Where it is refused the threads compete as equals.
        let _ = rustix::process::nice(NICENESS);
        let mut segmenter = match (self.asked.make)() {
            Ok(segmenter) => segmenter,
            Err(error) => return shared.end(EndedBy::Refused(format!("labelling: {error}"))),
        };
        let _ = ready.send(());
        drop(ready);
        let mut state = self.state();
        loop {
            // A disk that stands still must not fill the memory with masks: then pictures are skipped.
            let enough = 2 * self.asked.threads.get() + 2;
            let free = state.masks() < enough;
            let Some((number, frame)) = free.then(|| state.schedule.take()).flatten() else {
                if state.schedule.is_ended() {
                    return;
                }
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
                continue;
            };
            let stamp = state.pictures.get(&number).map_or(Stamp(0), |picture| picture.stamp);
            drop(state);
            let began_ns = shared.clock.now().monotonic_ns;
            let labels = segment(&mut *segmenter, stamp, number, &frame);
            let size = (frame.width, frame.height);
            drop(frame);
            let moment = shared.clock.now();
            let duration_ns = moment.monotonic_ns - began_ns;
            let (outcome, mask, complaint) = match labels {
                Ok(Some(mask)) => (Outcome::Labelled, Some(mask), None),
                Ok(None) => (Outcome::Unlabelled, None, None),
                Err(error) => (Outcome::Failed, None, Some(error.to_string())),
            };
            state = self.state();
            state.times.add(duration_ns);
            if state.schedule.done(number) {
                state.decide(number, Decision { outcome, moment, duration_ns: Some(duration_ns), size, mask });
                self.changed.notify_all();
            }
            if let Some(complaint) = complaint.filter(|complaint| *complaint != state.complaint) {
                state.complaint.clone_from(&complaint);
                drop(state);
                shared.event(level::ERROR, "segmentation.failed", &complaint);
                state = self.state();
            }
        }
    }

    /// Writes what is decided, in order of the pictures, until no more come.
    fn write_all(&self, shared: &Shared) {
        let taken = self.layer.lock().unwrap_or_else(PoisonError::into_inner).take();
        let Some(mut layer) = taken else { return };
        loop {
            let mut state = self.state();
            let (number, picture) = loop {
                if let Some(decided) = state.pop_decided() {
                    break decided;
                }
                if state.schedule.is_ended() && state.pictures.is_empty() {
                    return;
                }
                state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            };
            drop(state);
            // A worker may wait for room.
            self.changed.notify_all();
            match self.messages(shared, &mut layer, number, picture) {
                Ok(messages) => {
                    let weight = messages.iter().map(|message| message.bytes.len()).sum();
                    // After a failure of the log nobody takes them, which the verdict tells.
                    drop(shared.outbox.push(Item::Messages(messages), weight, Wait::Forever));
                }
                // A stamp that no message can hold.
                Err(error) => shared.event(level::ERROR, "segmentation.failed", &error.to_string()),
            }
        }
    }

    /// A mask that the layer cannot hold was no success.
    fn unfit(&self, shared: &Shared, decision: &mut Decision, error: &WriteError) {
        decision.outcome = Outcome::Failed;
        let mut state = self.state();
        state.counts.labelled -= 1;
        state.counts.failed += 1;
        drop(state);
        shared.event(level::ERROR, "segmentation.failed", &error.to_string());
    }

    fn messages(
        &self,
        shared: &Shared,
        layer: &mut Layer,
        number: u64,
        picture: Tracked,
    ) -> Result<Vec<Encoded>, WriteError> {
        let Tracked { stamp, counter, decided: Some(mut decision) } = picture else { return Ok(Vec::new()) };
        let times = (stamp, Stamp(decision.moment.realtime_ns));
        let mut bundle = Bundle::default();
        if let Some(mask) = decision.mask.take()
            && let Err(error) = layer.write(&mut bundle, times, decision.size.0, &mask)
        {
            bundle = Bundle::default();
            self.unfit(shared, &mut decision, &error);
        }
        let record = LabelRecord {
            header: Header::new(stamp, frame::CAMERA)?,
            layer: self.asked.layer.name.clone(),
            picture: number,
            counter,
            outcome: decision.outcome.name().to_owned(),
            decided_ns: shared.host.stamp(decision.moment).0,
            duration_ns: decision.duration_ns.unwrap_or(NOT_TOLD),
        };
        bundle.put(topics::LABELS, times, &record)?;
        Ok(bundle.0)
    }
}

/// Labels a picture as the camera gave it.
fn segment(
    segmenter: &mut dyn Segmenter,
    stamp: Stamp,
    number: u64,
    frame: &Arc<Frame>,
) -> Result<Option<Mask>, SegmentError> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let rgb = match frame.format {
        Format::Rgb8 => frame.bytes.clone(),
        Format::Bgr8 => frame.bytes.chunks_exact(3).flat_map(|p| [p[2], p[1], p[0]]).collect(),
        other => return Err(SegmentError::Picture(format!("pixels of format {other:?} are not labelled"))),
    };
    if rgb.len() != width * height * 3 {
        return Err(SegmentError::Picture(format!("{} bytes are no RGB picture of {width}x{height}", rgb.len())));
    }
    let picture = Picture { stamp, index: usize::try_from(number).unwrap_or(usize::MAX), width, height, rgb };
    let mask = segmenter.segment(&picture)?;
    let unfit = |mask: &&Mask| mask.class.len() != width * height || mask.instance.len() != width * height;
    match mask.as_ref().filter(unfit) {
        Some(mask) => Err(SegmentError::Picture(format!("{} labels for {width}x{height} pixels", mask.class.len()))),
        None => Ok(mask),
    }
}
