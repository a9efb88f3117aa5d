//! The one logical timeline of a log: colour pictures in stamp order, each with what belongs to it.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use schemas::alignment::Aligner;
use schemas::{Stamp, metadata, pairing, topics};

use super::open::Entry;
use super::stream::Pixels;
use super::{FrameStream, Log, LogError};

/// One frame's place on the timeline.
#[derive(Debug, Clone, Copy)]
pub struct TimelineFrame {
    /// Of the colour picture; the frame's time.
    pub stamp: Stamp,
    pub(crate) color: Entry,
    pub(crate) depth: Option<Entry>,
    pub(crate) right: Option<Entry>,
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

    /// Stamp of the right picture of a pair.
    #[must_use]
    pub fn right_stamp(&self) -> Option<Stamp> {
        self.right.map(|entry| entry.stamp)
    }

    /// Whether the layer has a mask for this picture.
    #[must_use]
    pub fn has_mask(&self) -> bool {
        self.mask.is_some()
    }
}

/// Messages of another topic that belong to the pictures.
struct Partners {
    /// By picture.
    of: Vec<Option<Entry>>,
    /// Messages that belong to none.
    left_over: usize,
}

impl Partners {
    fn find(pictures: &[Entry], others: &[Entry], tolerance_ns: u64) -> Self {
        let stamps = |entries: &[Entry]| entries.iter().map(|e| e.stamp).collect::<Vec<_>>();
        let pairs = pairing::associate(&stamps(pictures), &stamps(others), tolerance_ns);
        let mut of = vec![None; pictures.len()];
        for &(picture, other) in &pairs {
            of[picture] = Some(others[other]);
        }
        Self { of, left_over: others.len() - pairs.len() }
    }

    /// Pictures without a partner.
    fn missing(&self) -> usize {
        self.of.iter().filter(|partner| partner.is_none()).count()
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
    /// Right pictures that belong to no left one.
    pub unpaired_right: usize,
    /// Registers depth to colour, if it is native.
    aligner: Option<Arc<Aligner>>,
    /// Where the pictures stand.
    color_topic: &'static str,
    frames: Arc<[TimelineFrame]>,
}

impl Timeline {
    /// In stamp order.
    #[must_use]
    pub fn frames(&self) -> &[TimelineFrame] {
        &self.frames
    }

    /// The same frames without their depth images or right pictures, which are then not read.
    #[must_use]
    pub fn keeping(self, depth: bool, right: bool) -> Self {
        let kept = |frame: &TimelineFrame| TimelineFrame {
            depth: frame.depth.filter(|_| depth),
            right: frame.right.filter(|_| right),
            ..*frame
        };
        Self { frames: self.frames.iter().map(kept).collect(), ..self }
    }

    /// Reads the frames of a range of indices; what is beyond the end is left out.
    ///
    /// # Errors
    /// The file cannot be opened again.
    pub fn stream(&self, range: Range<usize>) -> Result<FrameStream, LogError> {
        let end = range.end.min(self.frames.len());
        let range = range.start.min(end)..end;
        let pixels = Pixels {
            units_per_metre: self.units_per_metre,
            aligner: self.aligner.clone(),
            color_topic: self.color_topic,
        };
        FrameStream::new(&self.path, Arc::clone(&self.frames), range, pixels)
    }
}

impl Log {
    /// Pairs pictures with depth images and right pictures (the log's own tolerance, [`pairing::associate`]) and with the
    /// masks of `layer`, which carry the picture's stamp.
    ///
    /// # Errors
    /// No colour pictures, a layer that is not in the log, or an unreadable depth scale or tolerance.
    pub fn timeline(&self, layer: Option<&str>) -> Result<Timeline, LogError> {
        let colors = self.colors();
        if colors.is_empty() {
            let there: Vec<&str> = self.topics.keys().map(String::as_str).collect();
            let what = format!("no pictures on {}; the topics are: {}", topics::COLOR, there.join(", "));
            return Err(LogError::missing(&self.path, what));
        }
        let tolerance_ns = self.pairing_tolerance_ns()?;
        let (depths, aligner) = self.depths()?;
        let depths = Partners::find(&colors, &depths, tolerance_ns);
        let rights = Partners::find(&colors, &self.sorted(topics::RIGHT), tolerance_ns);
        let masks = layer.map(|layer| self.masks(layer)).transpose()?.unwrap_or_default();
        let frame = |(i, color): (usize, &Entry)| {
            let mask = masks.binary_search_by_key(&color.stamp, |m| m.class.stamp).ok().map(|i| masks[i]);
            TimelineFrame { stamp: color.stamp, color: *color, depth: depths.of[i], right: rights.of[i], mask }
        };
        Ok(Timeline {
            path: self.path.clone(),
            units_per_metre: self.depth_units_per_metre()?,
            layer: layer.map(str::to_owned),
            unpaired_color: depths.missing(),
            unpaired_depth: depths.left_over,
            unpaired_right: rights.left_over,
            aligner,
            color_topic: if self.sorted(topics::COLOR).is_empty() { topics::COLOR_RAW } else { topics::COLOR },
            frames: colors.iter().enumerate().map(frame).collect(),
        })
    }

    /// Colour pictures in stamp order: compressed ones if there are any, else the raw ones of a live recording.
    pub(crate) fn colors(&self) -> Vec<Entry> {
        let colors = self.sorted(topics::COLOR);
        if colors.is_empty() { self.sorted(topics::COLOR_RAW) } else { colors }
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
