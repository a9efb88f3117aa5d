//! Labels while a recording runs.
//!
//! ```text
//! Inlet ── newest colour picture ──▶ worker: network ──┐
//!   └───── "picture f + lag is here" ──▶ Schedule ─────┴─▶ decided, in order ─▶ label writer ─▶ outbox
//! ```
//!
//! The inlet leaves a picture and goes on; it never waits. [`schedule`] says which pictures get labels. What becomes of each
//! stands on [`schemas::topics::LABELS`], in order of the pictures.

mod schedule;
mod worker;

pub(super) use worker::start;

use super::inlet::Shared;
use super::latency::Latency;
use super::stream::Stream;
use crate::Arrival;
use crate::layer::{Layer, LayerSpec};
use crate::log_writer::WriteError;
use crate::realsense::Frame;
use schedule::{Outcome, Schedule};
use schemas::Stamp;
use segment::{Mask, SegmentError, Segmenter};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::num::{NonZeroU32, NonZeroUsize};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Makes a segmenter for one thread, on that thread.
pub type MakeSegmenter = Arc<dyn Fn() -> Result<Box<dyn Segmenter>, SegmentError> + Send + Sync>;

/// How colour pictures are labelled while they are recorded.
#[derive(Clone)]
pub struct Labelling {
    /// The layer that is written.
    pub layer: LayerSpec,
    /// How the labels are made: models, thresholds, runtime, as it shall stand in the log.
    pub record: BTreeMap<String, String>,
    /// When, in words.
    pub time: Option<String>,
    /// The labels of picture f are due when picture f + lag comes in.
    pub lag: NonZeroU32,
    /// Pictures labelled at once.
    pub threads: NonZeroUsize,
    /// Who labels.
    pub make: MakeSegmenter,
}

impl fmt::Debug for Labelling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { layer, lag, threads, .. } = self;
        f.debug_struct("Labelling").field("layer", layer).field("lag", lag).field("threads", threads).finish()
    }
}

/// How the labelling fares. `pictures` is the sum of the outcomes and of those that are not decided yet.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct LabelCounts {
    /// Name of the layer.
    pub layer: String,
    /// Labels are due so many pictures later.
    pub lag_pictures: u32,
    /// Colour pictures that came in.
    pub pictures: u64,
    /// Labels were ready in time and stand in the log.
    pub labelled: u64,
    /// Nobody was free for it: the network is slower than the camera.
    pub skipped_busy: u64,
    /// Labels were not ready when they were due.
    pub skipped_late: u64,
    /// There are no labels for it.
    pub unlabelled: u64,
    /// The network could not label it.
    pub failed: u64,
    /// The recording ended before its labels were ready.
    pub ended: u64,
    /// Half of the pictures that were worked at, late ones included, took no longer, milliseconds.
    pub p50_ms: f64,
    /// 99 % took no longer, milliseconds.
    pub p99_ms: f64,
    /// The longest, milliseconds.
    pub max_ms: f64,
}

impl LabelCounts {
    /// Pictures that got no labels although a faster network would have given them some.
    #[must_use]
    pub fn skipped(&self) -> u64 {
        self.skipped_busy + self.skipped_late
    }

    /// What is missing, in words. Pictures that are skipped are no fault: a network may be slower than the camera.
    pub(super) fn lacking(&self) -> Option<String> {
        if self.failed > 0 {
            return Some(format!("segmentation: {} pictures could not be labelled", self.failed));
        }
        let none = self.labelled == 0 && self.pictures > 0;
        none.then(|| format!("segmentation: none of {} pictures was labelled ({self})", self.pictures))
    }

    fn count(&mut self, outcome: Outcome) {
        *match outcome {
            Outcome::Labelled => &mut self.labelled,
            Outcome::Busy => &mut self.skipped_busy,
            Outcome::Late => &mut self.skipped_late,
            Outcome::Unlabelled => &mut self.unlabelled,
            Outcome::Failed => &mut self.failed,
            Outcome::Ended => &mut self.ended,
        } += 1;
    }

    /// For the layer's record in the log.
    fn record(&self) -> BTreeMap<String, String> {
        let counts = [
            ("pictures", self.pictures),
            ("labelled", self.labelled),
            ("live/skipped_busy", self.skipped_busy),
            ("live/skipped_late", self.skipped_late),
            ("live/unlabelled", self.unlabelled),
            ("live/failed", self.failed),
            ("live/ended", self.ended),
        ];
        counts.into_iter().map(|(key, count)| (key.to_owned(), count.to_string())).collect()
    }
}

impl fmt::Display for LabelCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { labelled, pictures, skipped_busy, skipped_late, p50_ms, p99_ms, .. } = self;
        write!(f, "{labelled} of {pictures} labelled, {skipped_busy} skipped (busy), {skipped_late} late")?;
        for (count, what) in [(self.unlabelled, "without labels"), (self.failed, "failed"), (self.ended, "at the end")]
        {
            if count > 0 {
                write!(f, ", {count} {what}")?;
            }
        }
        write!(f, "; a picture p50 {p50_ms:.0} ms, p99 {p99_ms:.0} ms")
    }
}

/// The state of the labelling, shared by the inlet, the workers and the writer of labels.
pub(super) struct Labels {
    asked: Labelling,
    description: BTreeMap<String, String>,
    /// Taken by the writer of labels.
    layer: Mutex<Option<Layer>>,
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    schedule: Schedule<Arc<Frame>>,
    /// Pictures up to here are on their way to the log: labels come behind their picture, and so behind its calibration.
    passed: Stamp,
    /// From the oldest picture that is not written yet to the newest, by number.
    pictures: BTreeMap<u64, Tracked>,
    counts: LabelCounts,
    times: Latency,
    /// The last complaint of a network.
    complaint: String,
}

/// A picture that came in.
struct Tracked {
    stamp: Stamp,
    counter: u64,
    decided: Option<Decision>,
}

/// What became of it.
struct Decision {
    outcome: Outcome,
    moment: Arrival,
    duration_ns: Option<i64>,
    size: (u32, u32),
    mask: Option<Mask>,
}

impl Decision {
    fn skipped(outcome: Outcome, moment: Arrival) -> Self {
        Self { outcome, moment, duration_ns: None, size: (0, 0), mask: None }
    }
}

impl State {
    fn decide(&mut self, number: u64, decision: Decision) {
        self.counts.count(decision.outcome);
        if let Some(picture) = self.pictures.get_mut(&number) {
            picture.decided = Some(decision);
        }
    }

    /// Masks in memory.
    fn masks(&self) -> usize {
        let decided = self.pictures.values().filter_map(|picture| picture.decided.as_ref());
        decided.filter(|decision| decision.mask.is_some()).count()
    }

    /// The oldest picture, if it is decided and before us in the log.
    fn pop_decided(&mut self) -> Option<(u64, Tracked)> {
        let is_due = |picture: &Tracked| picture.decided.is_some() && picture.stamp <= self.passed;
        let oldest = self.pictures.first_entry().filter(|oldest| is_due(oldest.get()))?;
        Some(oldest.remove_entry())
    }
}

impl Labels {
    pub fn new(asked: &Labelling) -> Result<Self, WriteError> {
        let (layer, lag_pictures) = (asked.layer.name.clone(), asked.lag.get());
        let counts = LabelCounts { layer, lag_pictures, ..LabelCounts::default() };
        let schedule = Schedule::new(u64::from(lag_pictures));
        let layer = Layer::new(&asked.layer)?;
        let (pictures, times, complaint) = (BTreeMap::new(), Latency::default(), String::new());
        Ok(Self {
            asked: asked.clone(),
            description: layer.record(&asked.layer.origin),
            layer: Mutex::new(Some(layer)),
            state: Mutex::new(State { schedule, passed: Stamp(i64::MIN), pictures, counts, times, complaint }),
            changed: Condvar::new(),
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How it fares.
    pub fn counts(&self) -> LabelCounts {
        let state = self.state();
        let (p50_ms, p99_ms) = (state.times.quantile_ms(0.5), state.times.quantile_ms(0.99));
        LabelCounts { p50_ms, p99_ms, max_ms: state.times.largest_ms(), ..state.counts.clone() }
    }

    /// The layer's record; with what came of it at the end.
    pub fn record(&self, ended: bool) -> (String, BTreeMap<String, String>) {
        let Labelling { layer, record, time, lag, threads, .. } = &self.asked;
        let name = format!("{}{}", schemas::metadata::SEGMENTATION_PREFIX, layer.name);
        let mut values = self.description.clone();
        values.extend(record.clone());
        values.extend(time.iter().map(|time| ("time".to_owned(), time.clone())));
        values.insert("live/lag_pictures".to_owned(), lag.to_string());
        values.insert("live/threads".to_owned(), threads.to_string());
        values.insert("live/rule".to_owned(), RULE.to_owned());
        values.extend(ended.then(|| self.counts().record()).into_iter().flatten());
        (name, values)
    }

    /// The picture at `stamp`, and all before it, went on their way to the log or are lost.
    pub fn passed(&self, stamp: Stamp) {
        let mut state = self.state();
        state.passed = state.passed.max(stamp);
        drop(state);
        self.changed.notify_all();
    }

    /// No more pictures come.
    pub fn end(&self, now: Arrival) {
        let mut state = self.state();
        for (number, outcome) in state.schedule.end() {
            state.decide(number, Decision::skipped(outcome, now));
        }
        drop(state);
        self.changed.notify_all();
    }
}

/// The lag rule, for who reads the log.
const RULE: &str = "labels of picture f stand in the log if they were ready before picture f + lag_pictures came in, else never; \
                    pictures are counted as they came in";

impl Shared {
    /// Leaves a colour picture to be labelled.
    pub(super) fn label(&self, stream: Stream, counter: u64, stamp: Stamp, frame: &Arc<Frame>) {
        let Some(labels) = self.labels.as_ref().filter(|_| stream == Stream::Color) else { return };
        let now = self.clock.now();
        let mut state = labels.state();
        let (number, decided) = state.schedule.arrive(Arc::clone(frame));
        state.counts.pictures += 1;
        state.pictures.insert(number, Tracked { stamp, counter, decided: None });
        for (number, outcome) in decided {
            state.decide(number, Decision::skipped(outcome, now));
        }
        drop(state);
        labels.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_wait_for_their_picture() {
        let categories = Vec::new();
        let asked = Labelling {
            layer: LayerSpec { name: "any".to_owned(), origin: "a test".to_owned(), categories },
            record: BTreeMap::new(),
            time: None,
            lag: NonZeroU32::MIN,
            threads: NonZeroUsize::MIN,
            make: Arc::new(|| Err(SegmentError::Runtime("nobody".to_owned()))),
        };
        let labels = Labels::new(&asked).unwrap();
        let decided = |outcome| Some(Decision::skipped(outcome, Arrival { monotonic_ns: 0, realtime_ns: 0 }));
        labels.state().pictures.insert(0, Tracked { stamp: Stamp(10), counter: 5, decided: decided(Outcome::Busy) });
        labels.state().pictures.insert(1, Tracked { stamp: Stamp(20), counter: 6, decided: None });
        assert!(labels.state().pop_decided().is_none(), "its picture is still with the encoder");
        labels.passed(Stamp(20));
        labels.passed(Stamp(15));
        assert_eq!(labels.state().pop_decided().map(|(number, _)| number), Some(0));
        assert!(labels.state().pop_decided().is_none(), "not decided yet");
    }
}
