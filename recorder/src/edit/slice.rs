//! A piece of a log that replays as it did inside the whole.
//!
//! Frames are taken whole: a picture with its depth image, right picture, masks, calibration and metadata, whatever their
//! stamps. What holds from its message on (calibration, extrinsics, categories) is kept from before the cut. What is
//! interpolated (ground truth, mocap, inertial samples, clocks) reaches a margin beyond it. All other messages are cut at
//! the first and last moment.

use super::{Channel, Edit, EditError, EditOptions, EditSummary, Filter, Frame, Output, RawMessage, Survey, rewrite};
use schemas::{Stamp, topics};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

/// Which piece.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cut {
    /// These frames, by the numbers that `pslam replay --frames` takes.
    Frames(Range<usize>),
    /// From one stamp to before another; everything where there is none.
    Time(Option<Stamp>, Option<Stamp>),
}

/// What is interpolated, and so reaches beyond the cut.
fn is_signal(topic: &str) -> bool {
    use topics::{ACCEL, ACCEL_METADATA, CLOCK, GROUND_TRUTH, GYRO, GYRO_METADATA, IMU, MOCAP, TF};
    [GROUND_TRUTH, TF, IMU, GYRO, GYRO_METADATA, ACCEL, ACCEL_METADATA, MOCAP, CLOCK].contains(&topic)
        || topics::mocap_body_of(topic).is_some()
}

/// What holds from its message on.
fn is_state(channel: &Channel) -> bool {
    let topic = channel.topic.as_str();
    let layer = topics::layer_of(topic).is_some();
    let latched = || {
        let qos = channel.metadata.get("offered_qos_profiles");
        qos.is_some_and(|qos| qos.contains("durability: transient_local") || qos.contains("durability: 1"))
    };
    [topics::EXTRINSICS, topics::TF_STATIC, topics::GYRO_INFO, topics::ACCEL_INFO].contains(&topic)
        || (layer && (topic.ends_with("/categories") || topic.ends_with("/label_info")))
        || (topics::schema_name(topic).is_none() && latched())
}

/// Pictures of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Color,
    Depth,
    Right,
}

/// The pictures that a topic's stamps refer to, and whether it holds their calibration.
fn bound_to(topic: &str) -> Option<(Kind, bool)> {
    use topics::{COLOR, COLOR_INFO, COLOR_METADATA, COLOR_RAW, DEPTH, DEPTH_INFO, RIGHT, RIGHT_INFO};
    use topics::{DEPTH_NATIVE, DEPTH_NATIVE_INFO, DEPTH_NATIVE_METADATA, LABELS};
    Some(match topic {
        COLOR | COLOR_RAW | COLOR_METADATA | LABELS => (Kind::Color, false),
        COLOR_INFO => (Kind::Color, true),
        DEPTH | DEPTH_NATIVE | DEPTH_NATIVE_METADATA => (Kind::Depth, false),
        DEPTH_INFO | DEPTH_NATIVE_INFO => (Kind::Depth, true),
        RIGHT => (Kind::Right, false),
        RIGHT_INFO => (Kind::Right, true),
        _ => {
            topics::layer_of(topic).filter(|_| !topic.ends_with("/categories") && !topic.ends_with("/label_info"))?;
            (Kind::Color, false)
        }
    })
}

/// The moments and pictures that stay.
struct Window {
    first: Stamp,
    last: Stamp,
    margin_ns: u64,
    /// Stamps of paired pictures: those that stay, and those that go although they may be in the window.
    inside: [BTreeSet<Stamp>; 3],
    outside: [BTreeSet<Stamp>; 3],
}

impl Window {
    fn new(survey: &Survey, cut: &Cut, margin_ns: u64) -> Result<Self, EditError> {
        let (span_first, span_last) = survey.span.unwrap_or_default();
        let (frames, first, last) = match cut {
            Cut::Frames(range) => {
                let frames = survey.frames_in(range)?;
                (frames.to_vec(), frames[0].stamp, frames[frames.len() - 1].stamp)
            }
            Cut::Time(from, to) => {
                let (first, end) = (from.unwrap_or(span_first), to.unwrap_or(Stamp(span_last.0.saturating_add(1))));
                if first >= end || first > span_last || end <= span_first {
                    return Err(EditError::Refused(format!(
                        "nothing from {first} s to {end} s: the log goes from {span_first} s to {span_last} s"
                    )));
                }
                let inside = survey.frames.iter().filter(|frame| first <= frame.stamp && frame.stamp < end);
                (inside.copied().collect(), first, Stamp(end.0 - 1))
            }
        };
        let stays = |frame: &&Frame| frames.binary_search_by_key(&frame.stamp, |f| f.stamp).is_ok();
        let stamps = |frames: &mut dyn Iterator<Item = &Frame>| {
            let mut sets: [BTreeSet<Stamp>; 3] = Default::default();
            for frame in frames {
                sets[Kind::Color as usize].insert(frame.stamp);
                sets[Kind::Depth as usize].extend(frame.depth);
                sets[Kind::Right as usize].extend(frame.right);
            }
            sets
        };
        let inside = stamps(&mut survey.frames.iter().filter(stays));
        let outside = stamps(&mut survey.frames.iter().filter(|frame| !stays(frame)));
        Ok(Self { first, last, margin_ns: margin_ns.saturating_add(survey.mocap_offset_ns), inside, outside })
    }

    /// Whether a message stays.
    fn holds(&self, channel: &Channel, stamp: Stamp) -> bool {
        if is_state(channel) {
            return stamp <= self.last;
        }
        if let Some((kind, _)) = bound_to(&channel.topic) {
            let (inside, outside) = (&self.inside[kind as usize], &self.outside[kind as usize]);
            return inside.contains(&stamp) || (self.spans(stamp, 0) && !outside.contains(&stamp));
        }
        self.spans(stamp, if is_signal(&channel.topic) { self.margin_ns } else { 0 })
    }

    fn spans(&self, stamp: Stamp, margin_ns: u64) -> bool {
        let margin = i64::try_from(margin_ns).unwrap_or(i64::MAX);
        (self.first.0.saturating_sub(margin)..=self.last.0.saturating_add(margin)).contains(&stamp.0)
    }
}

struct Slice<'a> {
    window: Window,
    topics: Filter<'a>,
    /// Calibrations that have no message for the pictures that stay: another program wrote them once.
    carried: BTreeSet<String>,
}

impl Edit for Slice<'_> {
    fn topic(&mut self, channel: &Channel) -> Result<Option<String>, EditError> {
        self.topics.topic(channel)
    }

    fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        let stamp = message.stamp().map_err(|why| EditError::message(message, why))?;
        let carried = stamp <= self.window.last && self.carried.contains(message.topic());
        if carried || self.window.holds(&message.channel, stamp) { out.keep(message) } else { Ok(()) }
    }

    fn metadata(&mut self, name: &str, values: BTreeMap<String, String>, out: &mut Output) -> Result<(), EditError> {
        self.topics.metadata(name, values, out)
    }
}

/// Writes a piece of `source` to `out`. `margin_ns` is how far signals reach beyond it; `topics` says which topics stay.
/// `progress` gets bytes read and bytes in all, of two passes.
///
/// # Errors
/// As [`rewrite`]; a piece that holds nothing.
pub fn slice(
    source: &Path,
    out: &Path,
    (cut, margin_ns): (&Cut, u64),
    topics: &dyn Fn(&str) -> bool,
    options: &EditOptions,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<EditSummary, EditError> {
    // Calibrations by stamp: which are there says whether the pictures that stay have theirs.
    let mut infos: BTreeMap<String, BTreeSet<Stamp>> = BTreeMap::new();
    let mut look = |message: &RawMessage<'_>| {
        if bound_to(message.topic()).is_some_and(|(_, info)| info) {
            let stamp = message.stamp().map_err(|why| EditError::message(message, why))?;
            infos.entry(message.topic().to_owned()).or_default().insert(stamp);
        }
        Ok(())
    };
    let survey = Survey::read(source, &mut look, &mut |done, all| progress(done, 2 * all))?;
    let window = Window::new(&survey, cut, margin_ns)?;
    let has_none = |(topic, stamps): &(String, BTreeSet<Stamp>)| {
        let kind = bound_to(topic).map_or(Kind::Color, |(kind, _)| kind);
        stamps.is_disjoint(&window.inside[kind as usize])
    };
    let carried = infos.into_iter().filter(has_none).map(|(topic, _)| topic).collect();
    let mut edit = Slice { window, topics: Filter { keeps: topics }, carried };
    let options = EditOptions { renumber: true, ..options.clone() };
    rewrite(source, out, &options, &mut edit, &mut |done, all| progress(all + done, 2 * all))
}
