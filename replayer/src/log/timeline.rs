//! The one logical timeline of a log: colour pictures in stamp order, each with what belongs to it.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use schemas::{Stamp, metadata, pairing, topics};

use super::open::Entry;
use super::{FrameStream, Log, LogError};

/// One frame's place on the timeline.
#[derive(Debug, Clone, Copy)]
pub struct TimelineFrame {
    /// Of the colour picture; the frame's time.
    pub stamp: Stamp,
    pub(crate) color: Entry,
    pub(crate) depth: Option<Entry>,
    pub(crate) mask: Option<MaskEntries>,
}

/// The messages of one mask.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MaskEntries {
    pub class: Entry,
    pub instance: Entry,
    pub segments: Entry,
}

impl TimelineFrame {
    /// Stamp of the paired depth image.
    #[must_use]
    pub fn depth_stamp(&self) -> Option<Stamp> {
        self.depth.map(|entry| entry.stamp)
    }

    /// Whether the layer has a mask for this picture.
    #[must_use]
    pub fn has_mask(&self) -> bool {
        self.mask.is_some()
    }
}

/// Every colour picture of the log, none skipped.
#[derive(Debug, Clone)]
pub struct Timeline {
    pub(crate) path: PathBuf,
    /// Depth value of one metre.
    pub units_per_metre: f64,
    /// Name of the segmentation layer, if one was asked for.
    pub layer: Option<String>,
    /// Pictures without depth within the tolerance.
    pub unpaired_color: usize,
    /// Depth images that belong to no picture.
    pub unpaired_depth: usize,
    frames: Arc<[TimelineFrame]>,
}

impl Timeline {
    /// In stamp order.
    #[must_use]
    pub fn frames(&self) -> &[TimelineFrame] {
        &self.frames
    }

    /// Reads the frames of a range of indices; what is beyond the end is left out.
    ///
    /// # Errors
    /// The file cannot be opened again.
    pub fn stream(&self, range: Range<usize>) -> Result<FrameStream, LogError> {
        let end = range.end.min(self.frames.len());
        FrameStream::new(&self.path, Arc::clone(&self.frames), range.start.min(end)..end, self.units_per_metre)
    }
}

impl Log {
    /// Pairs colour with depth (the log's own tolerance, [`pairing::associate`]) and with the masks of `layer`, which
    /// carry the picture's stamp.
    ///
    /// # Errors
    /// No colour pictures, a layer that is not in the log, or an unreadable depth scale or tolerance.
    pub fn timeline(&self, layer: Option<&str>) -> Result<Timeline, LogError> {
        let colors = self.sorted(topics::COLOR);
        if colors.is_empty() {
            let there: Vec<&str> = self.topics.keys().map(String::as_str).collect();
            let what = format!("no pictures on {}; the topics are: {}", topics::COLOR, there.join(", "));
            return Err(LogError::missing(&self.path, what));
        }
        let depths = self.sorted(topics::DEPTH);
        let stamps = |entries: &[Entry]| entries.iter().map(|e| e.stamp).collect::<Vec<_>>();
        let pairs = pairing::associate(&stamps(&colors), &stamps(&depths), self.pairing_tolerance_ns()?);
        let mut depth_of = vec![None; colors.len()];
        for &(color, depth) in &pairs {
            depth_of[color] = Some(depths[depth]);
        }
        let masks = layer.map(|layer| self.masks(layer)).transpose()?.unwrap_or_default();
        let frame = |(color, depth): (&Entry, Option<Entry>)| {
            let mask = masks.binary_search_by_key(&color.stamp, |m| m.class.stamp).ok().map(|i| masks[i]);
            TimelineFrame { stamp: color.stamp, color: *color, depth, mask }
        };
        Ok(Timeline {
            path: self.path.clone(),
            units_per_metre: self.depth_units_per_metre()?,
            layer: layer.map(str::to_owned),
            unpaired_color: colors.len() - pairs.len(),
            unpaired_depth: depths.len() - pairs.len(),
            frames: colors.iter().zip(depth_of).map(frame).collect(),
        })
    }

    /// A topic's messages in stamp order; equal stamps in file order.
    pub(crate) fn sorted(&self, topic: &str) -> Vec<Entry> {
        let mut entries = self.topics.get(topic).map(|topic| topic.entries.clone()).unwrap_or_default();
        entries.sort_by_key(|entry| entry.stamp);
        entries
    }

    pub(crate) fn pairing_tolerance_ns(&self) -> Result<u64, LogError> {
        let text = self.metadata.get(metadata::PAIRING).and_then(|map| map.get(metadata::TOLERANCE_NS));
        let Some(text) = text else { return Ok(pairing::DEFAULT_TOLERANCE_NS) };
        let wrong = |_| LogError::missing(&self.path, format!("pairing tolerance `{text}` is not whole nanoseconds"));
        text.parse().map_err(wrong)
    }

    /// Complete masks of a layer in stamp order, each stamp once.
    pub(crate) fn masks(&self, layer: &str) -> Result<Vec<MaskEntries>, LogError> {
        let known = self.layers();
        if !known.contains(&layer) {
            let what = format!("no segmentation layer `{layer}`; there are: {}", known.join(", "));
            return Err(LogError::missing(&self.path, what));
        }
        let topics = topics::LayerTopics::new(layer);
        let [instances, segments] = [&topics.instance, &topics.segments].map(|topic| self.sorted(topic));
        let at = |entries: &[Entry], stamp| entries.binary_search_by_key(&stamp, |e| e.stamp).ok().map(|i| entries[i]);
        let mut classes = self.sorted(&topics.class);
        classes.dedup_by_key(|entry| entry.stamp);
        let mask = |class: Entry| {
            let (instance, segments) = (at(&instances, class.stamp)?, at(&segments, class.stamp)?);
            Some(MaskEntries { class, instance, segments })
        };
        Ok(classes.into_iter().filter_map(mask).collect())
    }
}
