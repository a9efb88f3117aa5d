//! What an edit has to know of a log before it starts: which pictures are frames, and what else is there.

use super::{Channel, EditError, Item, RawMessage, Source};
use schemas::sync::SyncRecord;
use schemas::{Stamp, metadata, pairing, topics};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// A colour picture and what belongs to it, by stamps. Numbered as `pslam replay --frames` does it: in order of stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Of the colour picture.
    pub stamp: Stamp,
    /// Of the depth image that is paired with it.
    pub depth: Option<Stamp>,
    /// Of the right picture that is paired with it.
    pub right: Option<Stamp>,
}

/// Topics whose stamps are those of pictures.
const PICTURES: [&str; 5] = [topics::COLOR, topics::COLOR_RAW, topics::DEPTH, topics::DEPTH_NATIVE, topics::RIGHT];

/// A log, seen whole once.
#[derive(Debug, Default)]
pub struct Survey {
    /// In order of stamps.
    pub frames: Vec<Frame>,
    /// Every channel.
    pub channels: Vec<Arc<Channel>>,
    /// Names of attached files.
    pub attachments: Vec<String>,
    /// First and last stamp of all messages.
    pub span: Option<(Stamp, Stamp)>,
    /// Largest known distance between a picture's stamp and the same moment on the mocap's clock, nanoseconds.
    pub mocap_offset_ns: u64,
    stamps: BTreeMap<&'static str, Vec<Stamp>>,
    tolerance_ns: Option<u64>,
    depth_units: Option<String>,
}

impl Survey {
    /// Reads a log whole. `look` gets every message, `progress` bytes read and bytes in all.
    ///
    /// # Errors
    /// Damage, a message without a readable header, or what `look` refuses.
    pub fn read(
        path: &Path,
        look: &mut dyn FnMut(&RawMessage<'_>) -> Result<(), EditError>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<Self, EditError> {
        let mut source = Source::open(path)?;
        let mut survey = Self::default();
        let all = source.file_bytes();
        loop {
            progress(source.offset(), all);
            match source.next()? {
                None => break,
                Some(Item::Channel(channel)) => survey.channels.push(channel),
                Some(Item::Attachment(file)) => survey.attachments.push(file.name),
                Some(Item::Metadata { name, values }) => survey.record(&name, &values)?,
                Some(Item::Message(message)) => {
                    survey.message(&message)?;
                    look(&message)?;
                }
            }
        }
        survey.pair();
        Ok(survey)
    }

    fn message(&mut self, message: &RawMessage<'_>) -> Result<(), EditError> {
        let stamp = message.stamp().map_err(|why| EditError::message(message, why))?;
        let (first, last) = self.span.unwrap_or((stamp, stamp));
        self.span = Some((first.min(stamp), last.max(stamp)));
        if let Some(topic) = PICTURES.iter().find(|topic| **topic == message.topic()) {
            self.stamps.entry(topic).or_default().push(stamp);
        }
        Ok(())
    }

    fn record(&mut self, name: &str, values: &BTreeMap<String, String>) -> Result<(), EditError> {
        if name == metadata::PAIRING
            && let Some(text) = values.get(metadata::TOLERANCE_NS)
        {
            let wrong = |_| EditError::Refused(format!("pairing tolerance `{text}` is not whole nanoseconds"));
            self.tolerance_ns = Some(text.parse().map_err(wrong)?);
        }
        if name == metadata::DEPTH {
            self.depth_units = values.get(metadata::DEPTH_UNITS_PER_METRE).cloned();
        }
        if name == metadata::SYNC {
            let record = SyncRecord::from_metadata(values).map_err(EditError::Refused)?;
            let offset = record.camera_body().and_then(|body| body.offset.found());
            self.mocap_offset_ns = offset.map_or(0, |offset| offset.offset_ns.unsigned_abs());
        }
        Ok(())
    }

    /// Stamps of a topic of pictures, ascending.
    fn sorted(&self, topic: &str) -> Vec<Stamp> {
        let mut stamps = self.stamps.get(topic).cloned().unwrap_or_default();
        stamps.sort_unstable();
        stamps
    }

    /// Stamps of the first topic of two that has any.
    fn either(&self, first: &str, second: &str) -> Vec<Stamp> {
        let stamps = self.sorted(first);
        if stamps.is_empty() { self.sorted(second) } else { stamps }
    }

    fn pair(&mut self) {
        let colors = self.either(topics::COLOR, topics::COLOR_RAW);
        let depths = self.either(topics::DEPTH, topics::DEPTH_NATIVE);
        let rights = self.sorted(topics::RIGHT);
        let tolerance_ns = self.tolerance_ns.unwrap_or(pairing::DEFAULT_TOLERANCE_NS);
        self.frames = colors.iter().map(|stamp| Frame { stamp: *stamp, depth: None, right: None }).collect();
        for (i, j) in pairing::associate(&colors, &depths, tolerance_ns) {
            self.frames[i].depth = Some(depths[j]);
        }
        for (i, j) in pairing::associate(&colors, &rights, tolerance_ns) {
            self.frames[i].right = Some(rights[j]);
        }
    }

    /// The frames of a range.
    ///
    /// # Errors
    /// A range that holds none of them.
    pub fn frames_in(&self, range: &Range<usize>) -> Result<&[Frame], EditError> {
        let end = range.end.min(self.frames.len());
        let frames = self.frames.get(range.start.min(end)..end).unwrap_or_default();
        if frames.is_empty() {
            let (start, count) = (range.start, self.frames.len());
            let end = if range.end == usize::MAX { String::new() } else { range.end.to_string() };
            return Err(EditError::Refused(format!("frames {start}..{end} are not there: the log has {count}")));
        }
        Ok(frames)
    }

    /// Depth value of one metre, as text: the log's own word, else the channel's.
    #[must_use]
    pub fn depth_units<'s>(&'s self, channel: &'s Channel) -> Option<&'s str> {
        self.depth_units.as_deref().or(channel.metadata.get(metadata::DEPTH_UNITS_PER_METRE).map(String::as_str))
    }

    /// Names of the segmentation layers.
    #[must_use]
    pub fn layers(&self) -> BTreeSet<&str> {
        self.channels.iter().filter_map(|channel| topics::layer_of(&channel.topic)).collect()
    }
}
