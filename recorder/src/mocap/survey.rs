//! What a motion capture system shows within a moment.

use super::tcp::Deadline;
use super::{MocapError, MocapSource};
use crate::Arrival;
use std::time::Duration;

/// A system at a glance.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Survey {
    /// [`MocapSource::describe`].
    pub source: String,
    /// Frames that came.
    pub frames: u32,
    /// Frames that their numbers say are missing; `None` without numbers.
    pub lost_frames: Option<u64>,
    /// Frames a second, as the system says, else as they came.
    pub rate_hz: Option<f64>,
    /// Time from the picture to the frame's leaving the system, seconds, as the system says.
    pub latency_s: Option<f64>,
    /// Segments in the order in which they were first told.
    pub bodies: Vec<SurveyBody>,
}

/// One segment of one subject.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SurveyBody {
    /// Subject.
    pub subject: String,
    /// Segment.
    pub segment: String,
    /// Frames in which it was seen.
    pub seen_frames: u32,
    /// How well the markers fit, last told value, 0..=1.
    pub quality: Option<f64>,
}

/// Connects and looks for `moment`.
///
/// # Errors
/// As the source's own; a system that sends nothing is [`MocapError::Silent`].
pub fn survey(source: &mut dyn MocapSource, moment: Duration) -> Result<Survey, MocapError> {
    source.connect()?;
    let mut found = Survey {
        source: source.describe(),
        frames: 0,
        lost_frames: None,
        rate_hz: None,
        latency_s: None,
        bodies: Vec::new(),
    };
    let deadline = Deadline::after(moment);
    let (mut first_number, mut last_number) = (None, None);
    let (mut first, mut last) = (Arrival::default(), Arrival::default());
    while !deadline.left().is_zero() {
        let Some(frame) = source.next_frame(deadline.left())? else { continue };
        if found.frames == 0 {
            (first_number, first) = (frame.number, frame.arrival);
        }
        (last_number, last) = (frame.number, frame.arrival);
        found.frames += 1;
        found.rate_hz = frame.rate_hz;
        found.latency_s = frame.latency_s();
        for body in frame.bodies {
            let known = found.bodies.iter().position(|b| b.subject == body.subject && b.segment == body.segment);
            let at = known.unwrap_or(found.bodies.len());
            if known.is_none() {
                let (subject, segment) = (body.subject, body.segment);
                found.bodies.push(SurveyBody { subject, segment, seen_frames: 0, quality: None });
            }
            found.bodies[at].seen_frames += u32::from(body.world_from_segment.is_some());
            found.bodies[at].quality = body.quality.or(found.bodies[at].quality);
        }
    }
    if found.frames == 0 {
        return Err(MocapError::Silent { address: source.describe(), waited: moment });
    }
    let numbers = first_number.zip(last_number);
    found.lost_frames = numbers.map(|(a, b)| (b.saturating_sub(a) + 1).saturating_sub(found.frames.into()));
    let span_s = (last.monotonic_ns - first.monotonic_ns) as f64 * 1e-9;
    let measured = (span_s > 0.0).then(|| f64::from(found.frames - 1) / span_s);
    found.rate_hz = found.rate_hz.or(measured);
    Ok(found)
}
