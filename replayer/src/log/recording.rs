//! What a live recording says about itself: losses, clocks, its own verdict.

use schemas::msg::{
    ClockPair, DropRecord, Extrinsics, FrameMetadata, Imu, LabelRecord, LogEntry, MocapFrame, MotionIntrinsics,
    PoseStamped, TFMessage, level,
};
use schemas::{metadata, topics};
use std::collections::BTreeMap;

use super::Log;
use super::check::Severity;
use super::container::MessageEvent;
use super::open::decoded;

/// A recording's own words, kept while the log is opened.
#[derive(Debug, Clone, Default)]
pub(crate) struct OwnWords {
    pub drops: Vec<DropRecord>,
    /// Warnings and errors.
    pub events: Vec<LogEntry>,
    /// Steps of the host's realtime clock, nanoseconds.
    pub steps_ns: Vec<i64>,
    pub occluded_bodies: usize,
}

/// A hostile log may hold any number of them; what is beyond is counted by the verdict alone.
const MOST_WORDS: usize = 100_000;

impl OwnWords {
    /// Remembers a message that tells something.
    pub fn take(&mut self, message: &MessageEvent<'_>) -> Result<(), String> {
        let data = message.data;
        match message.channel.topic.as_str() {
            topics::DROPS if self.drops.len() < MOST_WORDS => self.drops.push(decoded(data)?),
            topics::EVENTS if self.events.len() < MOST_WORDS => {
                let entry: LogEntry = decoded(data)?;
                if entry.level >= level::WARN {
                    self.events.push(entry);
                }
            }
            topics::CLOCK if self.steps_ns.len() < MOST_WORDS => {
                let step_ns = decoded::<ClockPair>(data)?.step_ns;
                self.steps_ns.extend(Some(step_ns).filter(|ns| *ns != 0));
            }
            topics::MOCAP => {
                let frame: MocapFrame = decoded(data)?;
                self.occluded_bodies += frame.bodies.iter().filter(|body| body.occluded).count();
            }
            _ => {}
        }
        Ok(())
    }
}

/// Decodes a message of a topic that needs no more than that; `false` for another topic.
pub(super) fn is_decoded(topic: &str, data: &[u8]) -> Result<bool, String> {
    match topic {
        topics::TF | topics::TF_STATIC => drop(decoded::<TFMessage>(data)?),
        topics::IMU | topics::GYRO | topics::ACCEL => drop(decoded::<Imu>(data)?),
        topics::GYRO_INFO | topics::ACCEL_INFO => drop(decoded::<MotionIntrinsics>(data)?),
        topics::COLOR_METADATA | topics::DEPTH_NATIVE_METADATA | topics::GYRO_METADATA | topics::ACCEL_METADATA => {
            let FrameMetadata { attribute_ids: ids, attribute_values: values, .. } = decoded(data)?;
            if ids.len() != values.len() {
                return Err(format!("{} numbers of metadata values and {} values", ids.len(), values.len()));
            }
        }
        topics::EXTRINSICS => drop(decoded::<Extrinsics>(data)?),
        topics::MOCAP => drop(decoded::<MocapFrame>(data)?),
        topics::DROPS => drop(decoded::<DropRecord>(data)?),
        topics::LABELS => drop(decoded::<LabelRecord>(data)?),
        topics::CLOCK => drop(decoded::<ClockPair>(data)?),
        topics::EVENTS => drop(decoded::<LogEntry>(data)?),
        _ if topics::mocap_body_of(topic).is_some() => drop(decoded::<PoseStamped>(data)?),
        _ => return Ok(false),
    }
    Ok(true)
}

/// What sensors measure, apart from pictures in colour.
pub(super) const MEASURED: [&str; 4] = [topics::DEPTH_NATIVE, topics::GYRO, topics::ACCEL, topics::MOCAP];

/// Whether a recording says that no colour pictures were asked for: no camera, or one without its colour.
pub(super) fn says_no_pictures(log: &Log) -> bool {
    let asked = |key: &str, value: &str| {
        log.metadata.get(metadata::RECORDING).and_then(|record| record.get(key)).is_some_and(|told| told == value)
    };
    asked("option/source", "none") || asked("option/color", "off")
}

/// What a recording's own words come to.
pub(super) fn findings(log: &Log) -> Vec<(Severity, &'static str, String)> {
    if !log.metadata.contains_key(metadata::RECORDING) {
        return Vec::new();
    }
    let words = &log.own_words;
    let mut found = Vec::new();
    found.extend(losses(&words.drops).map(|what| (Severity::Warning, "lost_in_recording", what)));
    for event in &words.events {
        found.push((Severity::Warning, "recording_event", format!("{}: {}", event.name, event.msg)));
    }
    for step_ns in &words.steps_ns {
        let what = format!("the host's realtime clock was set by {:.6} s; stamps stay", *step_ns as f64 / 1e9);
        found.push((Severity::Note, "clock_step", what));
    }
    if words.occluded_bodies > 0 {
        let what = format!("{} poses missing because a body was not seen", words.occluded_bodies);
        found.push((Severity::Note, "mocap_occlusions", what));
    }
    match log.metadata.get(metadata::VERDICT) {
        None => found.push((Severity::Warning, "no_verdict", "the recording was interrupted".to_owned())),
        Some(verdict) if verdict.get("verdict").map(String::as_str) != Some("complete") => {
            let reason = verdict.get("reason").cloned().unwrap_or_default();
            found.push((Severity::Warning, "incomplete_recording", reason));
        }
        Some(_) => {}
    }
    found
}

/// Runs of lost measurements that are named one by one.
const NAMED_RUNS: usize = 5;

/// A sentence for each stream and cause.
fn losses(drops: &[DropRecord]) -> impl Iterator<Item = String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&DropRecord>> = BTreeMap::new();
    for drop in drops {
        groups.entry((&drop.stream, &drop.cause)).or_default().push(drop);
    }
    groups.into_iter().map(|((stream, cause), runs)| {
        let count: u64 = runs.iter().map(|run| run.count).sum();
        let run = |run: &&DropRecord| match run.last_counter == run.first_counter {
            true => run.first_counter.to_string(),
            false => format!("{}..={}", run.first_counter, run.last_counter),
        };
        let named: Vec<String> = runs.iter().take(NAMED_RUNS).map(run).collect();
        let more = runs.len().saturating_sub(NAMED_RUNS);
        let more = if more > 0 { format!(" and {more} runs more") } else { String::new() };
        format!("{stream}: {count} lost by the {cause}: {}{more}", named.join(", "))
    })
}
