//! What is in a log, for people and programs.

use std::collections::BTreeMap;
use std::fmt;

use schemas::calibration::{CameraModel, Distortion};
use schemas::topics;
use schemas::{Stamp, metadata};
use serde::Serialize;

use super::open::Topic;
use super::{Log, Timeline};

/// Version of the JSON form of [`LogInfo`].
const INFO_VERSION: u32 = 1;

/// Contents of a log.
#[derive(Debug, Clone, Serialize)]
pub struct LogInfo {
    /// Version of this form; grows when a field changes its meaning.
    pub version: u32,
    /// The file as it was named.
    pub file: String,
    /// Size of the file.
    pub file_bytes: u64,
    /// BLAKE3 of the file.
    pub blake3: String,
    /// MCAP profile, `ros2`.
    pub profile: String,
    /// Writer of the container.
    pub library: String,
    /// Compressed chunks.
    pub chunks: usize,
    /// First stamp of any topic with a header, nanoseconds.
    pub start_ns: Option<Stamp>,
    /// Last one.
    pub end_ns: Option<Stamp>,
    /// From the first to the last, seconds.
    pub duration_s: f64,
    /// Colour pictures.
    pub frames: usize,
    /// Pictures with a depth image.
    pub frames_with_depth: usize,
    /// Depth images that belong to no picture.
    pub unpaired_depth: usize,
    /// Pictures with a right one.
    pub frames_with_right: usize,
    /// Distance of the cameras of a stereo camera, metres.
    pub baseline_m: Option<f64>,
    /// Format of the first picture, `png` or `jpeg`.
    pub color_format: Option<String>,
    /// Colour camera.
    pub camera: Option<CameraModel>,
    /// Depth value of one metre.
    pub depth_units_per_metre: Option<f64>,
    /// What could not be told and why.
    pub problems: Vec<String>,
    /// Segmentation.
    pub layers: Vec<LayerInfo>,
    /// Ground truth.
    pub ground_truth: Option<GroundTruthInfo>,
    /// Sorted by name.
    pub topics: Vec<TopicInfo>,
    /// Metadata records: provenance, conventions, repairs.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Names of metadata records whose checksum is wrong.
    pub wrong_checksums: Vec<String>,
    /// Attached files.
    pub attachments: Vec<AttachmentInfo>,
}

/// One topic.
#[derive(Debug, Clone, Serialize)]
pub struct TopicInfo {
    /// Name.
    pub topic: String,
    /// Message type.
    pub schema: String,
    /// Messages.
    pub count: usize,
    /// Bytes of the messages, unpacked.
    pub bytes: u64,
    /// Mean rate, messages a second; 0 with fewer than two.
    pub rate_hz: f64,
    /// Longest time without a message between two, seconds.
    pub largest_gap_s: f64,
    /// Stamp of the message before that gap, nanoseconds.
    pub largest_gap_at_ns: Option<Stamp>,
}

/// One segmentation layer.
#[derive(Debug, Clone, Serialize)]
pub struct LayerInfo {
    /// Its name.
    pub name: String,
    /// Pictures with a mask.
    pub masked_frames: usize,
    /// Names of its Things.
    pub things: usize,
    /// Names of its Stuff.
    pub stuff: usize,
}

/// Ground truth.
#[derive(Debug, Clone, Serialize)]
pub struct GroundTruthInfo {
    /// Where it comes from, in words.
    pub origin: String,
    /// Poses.
    pub poses: usize,
    /// Length of the path, metres.
    pub length_m: f64,
    /// Pictures between its first and last pose.
    pub frames_within: usize,
}

/// An attached file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AttachmentInfo {
    /// Its name.
    pub name: String,
    /// Its media type.
    pub media_type: String,
    /// Its size.
    pub bytes: u64,
}

impl TopicInfo {
    pub(crate) fn of(name: &str, topic: &Topic) -> Self {
        let mut stamps: Vec<Stamp> = topic.entries.iter().map(|entry| entry.stamp).collect();
        stamps.sort_unstable();
        let gaps = stamps.windows(2).map(|pair| (pair[1].abs_diff(pair[0]), pair[0]));
        // Of equal gaps the first.
        let largest = gaps.fold(None, |best: Option<(u64, Stamp)>, gap| match best {
            Some(best) if best.0 >= gap.0 => Some(best),
            _ => Some(gap),
        });
        let span_s = seconds_between(stamps.first(), stamps.last());
        Self {
            topic: name.to_owned(),
            schema: topic.channel.schema_name.clone(),
            count: stamps.len(),
            bytes: topic.bytes,
            rate_hz: if span_s > 0.0 { (stamps.len() - 1) as f64 / span_s } else { 0.0 },
            largest_gap_s: largest.map_or(0.0, |(gap, _)| gap as f64 / 1e9),
            largest_gap_at_ns: largest.map(|(_, at)| at),
        }
    }
}

fn seconds_between(first: Option<&Stamp>, last: Option<&Stamp>) -> f64 {
    first.zip(last).map_or(0.0, |(first, last)| last.abs_diff(*first) as f64 / 1e9)
}

impl Log {
    /// Summarises the log; what cannot be told stands in [`LogInfo::problems`].
    #[must_use]
    pub fn info(&self) -> LogInfo {
        let mut problems = Vec::new();
        let stamps = || self.topics.values().flat_map(|topic| topic.entries.iter().map(|entry| entry.stamp));
        let (start, end) = (stamps().min(), stamps().max());
        let timeline = self.timeline(None);
        let (unpaired_color, unpaired_depth) =
            timeline.as_ref().map_or((0, 0), |t| (t.unpaired_color, t.unpaired_depth));
        let with_right = |t: &Timeline| t.frames().iter().filter(|frame| frame.right_stamp().is_some()).count();
        let frames_with_right = timeline.as_ref().map_or(0, with_right);
        let stereo = self.stereo().map_err(|error| problems.push(error.to_string())).ok().flatten();
        let colors = self.colors();
        problems.extend(timeline.err().map(|error| error.to_string()));
        let camera = self.camera().map_err(|error| problems.push(error.to_string())).ok();
        let units = self
            .depth_units_per_metre()
            .ok()
            .filter(|_| [topics::DEPTH, topics::DEPTH_NATIVE].iter().any(|topic| self.topics.contains_key(*topic)));
        let layer = |name: &str| {
            let masks = self.masks(name).unwrap_or_default();
            let masked = colors.iter().filter(|c| masks.binary_search_by_key(&c.stamp, |m| m.class.stamp).is_ok());
            let things = self.categories(name).iter().filter(|category| category.is_thing).count();
            let stuff = self.categories(name).len() - things;
            LayerInfo { name: name.to_owned(), masked_frames: masked.count(), things, stuff }
        };
        let truth = &self.ground_truth().poses;
        let ground_truth = truth.first().zip(truth.last()).map(|(first, last)| GroundTruthInfo {
            origin: self.ground_truth_origin().unwrap_or_default().to_owned(),
            poses: truth.len(),
            length_m: self.ground_truth().length_m(),
            frames_within: colors.iter().filter(|c| (first.stamp..=last.stamp).contains(&c.stamp)).count(),
        });
        let wrong = self.metadata.iter().filter(|(name, values)| metadata::verify(name, values) == Some(false));
        LogInfo {
            version: INFO_VERSION,
            file: self.path.display().to_string(),
            file_bytes: self.file_bytes,
            blake3: self.blake3.clone(),
            profile: self.profile.clone(),
            library: self.library.clone(),
            chunks: self.chunks,
            start_ns: start,
            end_ns: end,
            duration_s: seconds_between(start.as_ref(), end.as_ref()),
            frames: colors.len(),
            frames_with_depth: colors.len().saturating_sub(unpaired_color),
            unpaired_depth,
            frames_with_right,
            baseline_m: stereo.map(|stereo| stereo.baseline_m()),
            color_format: self.first_color_format.clone(),
            camera,
            depth_units_per_metre: units,
            problems,
            layers: self.layers().into_iter().map(layer).collect(),
            ground_truth,
            topics: self.topics.iter().map(|(name, topic)| TopicInfo::of(name, topic)).collect(),
            wrong_checksums: wrong.map(|(name, _)| name.clone()).collect(),
            metadata: self.metadata.clone(),
            attachments: self.attachments.clone(),
        }
    }
}

impl fmt::Display for LogInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "file          {} ({})", self.file, bytes(self.file_bytes))?;
        writeln!(f, "blake3        {}", self.blake3)?;
        writeln!(f, "container     MCAP, profile {}, by {}, {} chunks", self.profile, self.library, self.chunks)?;
        if let (Some(start), Some(end)) = (self.start_ns, self.end_ns) {
            writeln!(f, "time          {start} to {end} s, {:.3} s", self.duration_s)?;
        }
        let format = self.color_format.as_deref().unwrap_or("no");
        let (with_depth, alone) = (self.frames_with_depth, self.unpaired_depth);
        writeln!(
            f,
            "frames        {} {format} pictures, {with_depth} with depth, {alone} depth images alone",
            self.frames
        )?;
        if let Some(c) = &self.camera {
            writeln!(f, "camera        {}x{}, fx {} fy {} cx {} cy {}", c.width, c.height, c.fx, c.fy, c.cx, c.cy)?;
            let d = c.distortion.parameters();
            match c.distortion {
                Distortion::None => writeln!(f, "distortion    none")?,
                Distortion::Radtan { .. } => writeln!(f, "distortion    radtan {d:?}")?,
                Distortion::ModifiedRadtan { .. } => writeln!(f, "distortion    modified radtan {d:?}")?,
            }
        }
        if let Some(baseline) = self.baseline_m {
            writeln!(f, "right camera  {} pictures in pairs, baseline {baseline:.4} m", self.frames_with_right)?;
        }
        if let Some(units) = self.depth_units_per_metre {
            writeln!(f, "depth         {units} per metre")?;
        }
        match &self.ground_truth {
            None => writeln!(f, "ground truth  none")?,
            Some(t) => {
                let (poses, length, within) = (t.poses, t.length_m, t.frames_within);
                writeln!(
                    f,
                    "ground truth  {poses} poses over {length:.3} m, {within} of {} frames inside",
                    self.frames
                )?;
                writeln!(f, "              from {}", t.origin)?;
            }
        }
        if self.layers.is_empty() {
            writeln!(f, "segmentation  none")?;
        }
        for layer in &self.layers {
            let LayerInfo { name, masked_frames, things, stuff } = layer;
            writeln!(f, "segmentation  {name}: {masked_frames} masks, {things} things and {stuff} stuff categories")?;
        }
        // Copies of channel definitions are for `recover`; the table of topics tells the same.
        let copy =
            |name: &str| name.starts_with(metadata::CHANNEL_PREFIX) && !self.wrong_checksums.iter().any(|w| w == name);
        for (name, values) in self.metadata.iter().filter(|(name, _)| !copy(name)) {
            let wrong = if self.wrong_checksums.contains(name) { "  WRONG CHECKSUM" } else { "" };
            writeln!(f, "\n{name}{wrong}")?;
            for (key, value) in values.iter().filter(|(key, _)| *key != metadata::CHECKSUM_KEY) {
                writeln!(f, "  {key:<20} {value}")?;
            }
        }
        for a in &self.attachments {
            writeln!(f, "\nattached      {} ({}, {})", a.name, a.media_type, bytes(a.bytes))?;
        }
        self.fmt_topics(f)?;
        for problem in &self.problems {
            writeln!(f, "\nproblem: {problem}")?;
        }
        Ok(())
    }
}

impl LogInfo {
    fn fmt_topics(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.topics.iter().map(|t| t.topic.len()).fold(5, usize::max);
        let head = ["count", "Hz", "largest gap", "size"];
        writeln!(f, "\n{:<width$} {:>7} {:>9} {:>12} {:>10}  type", "topic", head[0], head[1], head[2], head[3])?;
        for t in &self.topics {
            let (topic, gap, size) = (&t.topic, format!("{:.3} s", t.largest_gap_s), bytes(t.bytes));
            writeln!(f, "{topic:<width$} {:>7} {:>9.2} {gap:>12} {size:>10}  {}", t.count, t.rate_hz, t.schema)?;
        }
        Ok(())
    }
}

/// Bytes for people.
pub(crate) fn bytes(n: u64) -> String {
    match n {
        0..10_000 => format!("{n} B"),
        10_000..10_000_000 => format!("{:.1} kB", n as f64 / 1e3),
        10_000_000..10_000_000_000 => format!("{:.1} MB", n as f64 / 1e6),
        _ => format!("{:.1} GB", n as f64 / 1e9),
    }
}
