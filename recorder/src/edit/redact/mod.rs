//! A log that can be shown: people, as a segmentation layer has them, taken out of pictures, depth and masks.
//!
//! A first pass finds who is where (`people.rs`) and refuses what no mask can vouch for; a second one rewrites the pictures
//! (`pixels.rs`). What is redacted of a frame is the area of the classes in it and in the frames around, grown by a margin;
//! masks then say that all of it is the first of the classes, so that a replay uses nothing of it and no outline is left.

mod area;
mod masks;
mod native;
mod people;
mod pictures;
mod pixels;
mod report;

pub use people::{Doubt, Reason};
pub use pixels::Method;
pub use report::{RedactReport, Redacted};

use super::{Channel, Edit, EditError, EditOptions, Frame, Output, RawMessage, Survey, rewrite};
use area::Cover;
use masks::Masks;
use mcap::Attachment;
use native::NativeDepth;
use people::People;
use schemas::topics::frame;
use schemas::{Stamp, metadata, topics};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

/// Attached files that show nobody: calibrations, as importers attach them.
const CALIBRATION_PREFIX: &str = "calibration/";
/// Covers that are kept: a frame's messages stand near each other.
const KEPT_COVERS: usize = 8;

/// An image farther than this from any frame has no mask that tells who is in it.
const FAR_NS: u64 = 100_000_000;

/// What to redact and how.
#[derive(Clone)]
pub struct RedactOptions<'a> {
    /// The segmentation layer that knows where people are.
    pub layer: String,
    /// Names of the classes.
    pub classes: BTreeSet<String>,
    /// How far around them, pixels; twice as far in frames where nobody is seen and masks of other frames stand in. Networks'
    /// borders are off by 2 to 6; single pixels of people that they leave out lie up to 54 from the rest (measured).
    pub margin_px: usize,
    /// In frames with somebody, redact what no class claims too, a few pixels around included: nobody can tell who is there.
    pub cover_unknown: bool,
    /// How many frames before and after count too: networks miss somebody in a few per cent of frames.
    pub neighbours: usize,
    /// How far a border moves in a frame, pixels; a mask of another frame is grown by that.
    pub motion_px: usize,
    /// Up to how many frames without anybody are bridged by the nearest ones with somebody.
    pub bridge: usize,
    /// How colour is redacted. Depth is always taken away: a blurred distance is a wrong one, which no reader can tell from
    /// a measurement, and the shape of a body would be left.
    pub method: Method,
    /// Redact doubtful frames whole instead of refusing the log.
    pub cover_doubtful: bool,
    /// Topics and attached files to leave out.
    pub drops: &'a dyn Fn(&str) -> bool,
    /// Topics and attached files unknown to this program that show nobody, as the caller vouches.
    pub allows: &'a dyn Fn(&str) -> bool,
}

impl RedactOptions<'_> {
    /// Distances and windows that hold for people at 30 pictures a second.
    #[must_use]
    pub fn new(layer: &str) -> Self {
        Self {
            layer: layer.to_owned(),
            classes: BTreeSet::from([schemas::panoptic::PERSON.to_owned()]),
            margin_px: 64,
            cover_unknown: false,
            neighbours: 2,
            motion_px: 2,
            bridge: 30,
            method: Method::Fill,
            cover_doubtful: false,
            drops: &|_| false,
            allows: &|_| false,
        }
    }
}

/// Writes `source` to `out` without its people. `progress` gets bytes read and bytes in all, of two passes.
///
/// A log with doubtful frames is not written unless they are redacted whole, see [`RedactReport::refused`].
///
/// # Errors
/// As [`rewrite`]; topics or attached files that may show people and that nothing covers.
pub fn redact(
    source: &Path,
    out: &Path,
    redact: &RedactOptions<'_>,
    options: &EditOptions,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<RedactReport, EditError> {
    let (mut people, mut rig) = (People::new(redact), Rig::default());
    let mut look = |message: &RawMessage<'_>| {
        rig.take(message)?;
        people.take(message)
    };
    let survey = Survey::read(source, &mut look, &mut |done, all| progress(done, 2 * all))?;
    refuse_unknown(&survey, redact)?;
    if people.size().is_none() || survey.frames.is_empty() {
        let layers: Vec<&str> = survey.layers().into_iter().collect();
        let (layer, layers) = (&redact.layer, layers.join(", "));
        return Err(EditError::Refused(format!("no pictures with masks of layer `{layer}`; the layers are: {layers}")));
    }
    let native = rig.native(&survey, redact)?;
    let doubts = people.doubts(&survey.frames, redact);
    let unbridged: BTreeSet<usize> = doubts.iter().filter(|doubt| !doubt.bridged).map(|doubt| doubt.frame).collect();
    if !unbridged.is_empty() && !redact.cover_doubtful {
        return Ok(RedactReport::refusal(redact, &survey.frames, doubts));
    }
    let mut edit = Redaction {
        options: redact,
        by_depth: by_stamp(&survey.frames, |frame| frame.depth),
        frames: &survey.frames,
        people,
        whole: unbridged,
        native,
        masks: Masks::new(redact),
        covers: Vec::new(),
        redacted: Redacted::new(survey.frames.len(), doubts),
    };
    let summary = rewrite(source, out, options, &mut edit, &mut |done, all| progress(all + done, 2 * all))?;
    Ok(RedactReport::done(redact, edit.redacted, summary))
}

fn by_stamp(frames: &[Frame], stamp: fn(&Frame) -> Option<Stamp>) -> BTreeMap<Stamp, usize> {
    frames.iter().enumerate().filter_map(|(index, frame)| Some((stamp(frame)?, index))).collect()
}

/// Everything that may show people without a mask over it, in one message.
fn refuse_unknown(survey: &Survey, options: &RedactOptions<'_>) -> Result<(), EditError> {
    let is_open = |name: &str| !(options.drops)(name) && !(options.allows)(name);
    let topics = survey.channels.iter().map(|channel| channel.topic.as_str());
    let topics = topics.filter(|topic| is_open(topic));
    let unknown = topics.filter(|topic| topics::schema_name(topic).is_none() || *topic == topics::RIGHT);
    let files = survey.attachments.iter().map(String::as_str);
    let files = files.filter(|name| is_open(name) && !name.starts_with(CALIBRATION_PREFIX));
    let open: BTreeSet<&str> = unknown.chain(files).collect();
    if open.is_empty() {
        return Ok(());
    }
    let right = if open.contains(topics::RIGHT) {
        format!("; {} needs masks of its own, which the left picture's are not", topics::RIGHT)
    } else {
        String::new()
    };
    let names = open.into_iter().collect::<Vec<_>>().join(", ");
    Err(EditError::Refused(format!(
        "these may show people and no mask covers them: {names}{right}. Leave them out (--drop) or vouch for them (--allow)"
    )))
}

/// Calibration that native depth needs.
#[derive(Default)]
struct Rig {
    color: Option<schemas::msg::CameraInfo>,
    depth: Option<schemas::msg::CameraInfo>,
    color_from_depth: Option<schemas::msg::Extrinsics>,
}

impl Rig {
    fn take(&mut self, message: &RawMessage<'_>) -> Result<(), EditError> {
        let error = |why: String| EditError::message(message, why);
        match message.topic() {
            topics::COLOR_INFO if self.color.is_none() => self.color = Some(message.decode().map_err(error)?),
            topics::DEPTH_NATIVE_INFO if self.depth.is_none() => self.depth = Some(message.decode().map_err(error)?),
            topics::EXTRINSICS if self.color_from_depth.is_none() => {
                let rig: schemas::msg::Extrinsics = message.decode().map_err(error)?;
                let ours = (rig.header.frame_id.as_str(), rig.child_frame_id.as_str()) == (frame::CAMERA, frame::DEPTH);
                self.color_from_depth = ours.then_some(rig);
            }
            _ => {}
        }
        Ok(())
    }

    fn native(&self, survey: &Survey, options: &RedactOptions<'_>) -> Result<Option<NativeDepth>, EditError> {
        let is_native = |channel: &&Arc<Channel>| channel.topic == topics::DEPTH_NATIVE;
        let Some(channel) = survey.channels.iter().find(is_native).filter(|c| !(options.drops)(&c.topic)) else {
            return Ok(None);
        };
        let units = survey.depth_units(channel);
        let units = units.and_then(|text| text.parse().ok()).filter(|units: &f32| units.is_finite() && *units > 0.0);
        let parts = self.depth.as_ref().zip(self.color.as_ref()).zip(self.color_from_depth.as_ref()).zip(units);
        let native = parts.and_then(|(((d, c), rig), units)| NativeDepth::new(d, c, rig, 1.0 / units));
        native.map(Some).ok_or_else(|| {
            EditError::Refused(format!(
                "{} cannot be brought to the colour picture that the masks belong to: calibration, extrinsics, scale or lens \
                 model are missing or not known. Leave it out (--drop)",
                topics::DEPTH_NATIVE
            ))
        })
    }
}

struct Redaction<'a> {
    options: &'a RedactOptions<'a>,
    frames: &'a [Frame],
    by_depth: BTreeMap<Stamp, usize>,
    people: People,
    /// Frames that are redacted whole.
    whole: BTreeSet<usize>,
    native: Option<NativeDepth>,
    masks: Masks,
    /// The last ones used, by frame.
    covers: Vec<(usize, Arc<Cover>)>,
    redacted: Redacted,
}

impl Redaction<'_> {
    /// What is redacted of a frame.
    fn cover(&mut self, frame: usize) -> Result<Arc<Cover>, EditError> {
        if let Some((_, cover)) = self.covers.iter().find(|(known, _)| *known == frame) {
            return Ok(Arc::clone(cover));
        }
        let cover = if self.whole.contains(&frame) {
            Cover::whole(self.people.size().unwrap_or_default())
        } else {
            let cover = self.people.cover(self.frames, frame, self.options);
            cover.map_err(|error| EditError::Refused(format!("masks around frame {frame}: {error}")))?
        };
        let cover = Arc::new(cover);
        self.redacted.count(frame, &cover);
        self.covers.push((frame, Arc::clone(&cover)));
        if self.covers.len() > KEPT_COVERS {
            self.covers.remove(0);
        }
        Ok(cover)
    }

    /// What is redacted of an image with this stamp: its frame's, or that of the frames around, or all if they are far.
    fn cover_at(&mut self, stamp: Stamp, frame: Option<usize>) -> Result<Arc<Cover>, EditError> {
        if let Some(frame) = frame {
            return self.cover(frame);
        }
        let size = self.people.size().unwrap_or_default();
        let after = self.frames.partition_point(|frame| frame.stamp < stamp);
        let around = after.saturating_sub(1)..(after + 1).min(self.frames.len());
        let near: Vec<usize> = around.filter(|at| self.frames[*at].stamp.abs_diff(stamp) <= FAR_NS).collect();
        if near.is_empty() {
            return Ok(Arc::new(Cover::whole(size)));
        }
        let mut joined = Cover::none(size);
        for frame in near {
            joined = joined.joined(&*self.cover(frame)?);
        }
        Ok(Arc::new(joined))
    }

    fn frame_of_color(&self, stamp: Stamp) -> Option<usize> {
        self.frames.binary_search_by_key(&stamp, |frame| frame.stamp).ok()
    }
}

impl Edit for Redaction<'_> {
    fn topic(&mut self, channel: &Channel) -> Result<Option<String>, EditError> {
        Ok((!(self.options.drops)(&channel.topic)).then(|| channel.topic.clone()))
    }

    fn message(&mut self, message: &RawMessage<'_>, out: &mut Output) -> Result<(), EditError> {
        let error = |why: String| EditError::message(message, why);
        let topic = message.topic();
        let is_depth = [topics::DEPTH, topics::DEPTH_NATIVE].contains(&topic);
        let is_color = [topics::COLOR, topics::COLOR_RAW].contains(&topic);
        if !is_depth && !is_color && topics::layer_of(topic).is_none() {
            return out.keep(message);
        }
        let stamp = message.stamp().map_err(error)?;
        let frame = if is_depth { self.by_depth.get(&stamp).copied() } else { self.frame_of_color(stamp) };
        let cover = self.cover_at(stamp, frame)?;
        let changed = match topic {
            topics::COLOR => pictures::color(message, &cover, self.options.method),
            topics::COLOR_RAW => pictures::raw_color(message, &cover, self.options.method),
            topics::DEPTH => pictures::depth(message, &cover),
            topics::DEPTH_NATIVE => pictures::native_depth(message, &cover, self.native.as_ref()),
            _ => self.masks.redact(message, stamp, &cover),
        };
        match changed.map_err(error)? {
            Some(data) => out.replace(message, &data),
            None => out.keep(message),
        }
    }

    fn attachment(&mut self, attachment: &Attachment<'_>, out: &mut Output) -> Result<(), EditError> {
        if (self.options.drops)(&attachment.name) { Ok(()) } else { out.keep_attachment(attachment) }
    }

    fn finish(&mut self, out: &mut Output) -> Result<(), EditError> {
        // Frames whose pictures are missing from the file still count.
        for frame in 0..self.frames.len() {
            self.cover(frame)?;
        }
        out.metadata(metadata::REDACTION, self.redacted.metadata(self.options))
    }
}
