//! What a live recording says about itself: losses, clocks, its own verdict.

use schemas::msg::{
    ClockPair, DropRecord, Extrinsics, FrameMetadata, Imu, LogEntry, MocapFrame, MotionIntrinsics, PoseStamped,
    TFMessage, level,
};
use schemas::{metadata, topics};

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
        topics::CLOCK => drop(decoded::<ClockPair>(data)?),
        topics::EVENTS => drop(decoded::<LogEntry>(data)?),
        _ if topics::mocap_body_of(topic).is_some() => drop(decoded::<PoseStamped>(data)?),
        _ => return Ok(false),
    }
    Ok(true)
}

/// What a recording's own words come to.
pub(super) fn findings(log: &Log) -> Vec<(Severity, &'static str, String)> {
    if !log.metadata.contains_key(metadata::RECORDING) {
        return Vec::new();
    }
    let words = &log.own_words;
    let mut found = Vec::new();
    for drop in &words.drops {
        let DropRecord { stream, cause, first_counter, last_counter, count, .. } = drop;
        let what = format!("{stream} {first_counter}..={last_counter}: {count} lost, by the {cause}");
        found.push((Severity::Warning, "lost_in_recording", what));
    }
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
