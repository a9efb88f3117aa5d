//! Looks for everything that is wrong with a log, and goes on after damage.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::Path;

use schemas::calibration::CameraModel;
use schemas::msg::{CameraInfo, CategoryTable, CompressedImage, Image, LabelInfo, SegmentTable, encoding};
use schemas::stereo::StereoModel;
use schemas::{Stamp, metadata, topics};
use serde::Serialize;

use super::container::{Event, MessageEvent, scan};
use super::decode::{color, pixels};
use super::open::{decoded, stamp_of, true_pose};
use super::{Log, LogError, recording};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing.
    Note,
    /// Odd, but a replay can work with it.
    Warning,
    /// Damage, or a broken promise: a replay would refuse the log or be wrong.
    Error,
}

/// Findings of one kind.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad.
    pub severity: Severity,
    /// Stable name of the kind.
    pub kind: &'static str,
    /// How often it was met.
    pub count: usize,
    /// The first few, with their places.
    pub examples: Vec<String>,
}

/// All findings.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct CheckReport {
    /// Version of this form.
    pub version: u32,
    /// The file as it was named.
    pub file: String,
    /// Its size.
    pub file_bytes: u64,
    /// BLAKE3 of the file.
    pub blake3: String,
    /// Chunks met, damaged ones included.
    pub chunks: usize,
    /// Messages read.
    pub messages: usize,
    /// Colour pictures read.
    pub frames: usize,
    /// Worst first.
    pub findings: Vec<Finding>,
}

/// Examples kept of each kind.
const EXAMPLES: usize = 5;

impl CheckReport {
    /// The worst severity found; `None` for a spotless log.
    #[must_use]
    pub fn worst(&self) -> Option<Severity> {
        self.findings.iter().map(|finding| finding.severity).max()
    }

    /// True without errors.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.worst() < Some(Severity::Error)
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} ({}), blake3 {}", self.file, super::info::bytes(self.file_bytes), self.blake3)?;
        writeln!(f, "{} chunks, {} messages, {} pictures", self.chunks, self.messages, self.frames)?;
        for finding in &self.findings {
            writeln!(f, "{:?}: {} ({} x)", finding.severity, finding.kind.replace('_', " "), finding.count)?;
            for example in &finding.examples {
                writeln!(f, "  {example}")?;
            }
            if finding.count > finding.examples.len() {
                writeln!(f, "  and {} more", finding.count - finding.examples.len())?;
            }
        }
        match self.worst() {
            None => writeln!(f, "no findings"),
            Some(Severity::Error) => writeln!(f, "NOT SOUND"),
            Some(_) => writeln!(f, "sound"),
        }
    }
}

/// Reads the whole file, decodes every message and picture, and reports what is wrong.
///
/// # Errors
/// Only when the file cannot be read or is no MCAP log at all.
pub fn check(path: &Path) -> Result<CheckReport, LogError> {
    let mut checker = Checker::new(path);
    let passed = scan(path, &mut |event| {
        checker.take(event);
        Ok(())
    })?;
    checker.summary();
    if let Err(error) = checker.log.settle_ground_truth() {
        checker.find(Severity::Error, "sync", error.to_string());
    }
    checker.frames();
    for (severity, kind, example) in recording::findings(&checker.log) {
        checker.find(severity, kind, example);
    }
    let (file_bytes, blake3) = (passed.file_bytes, passed.blake3);
    let mut findings: Vec<Finding> = checker.findings.into_values().collect();
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    Ok(CheckReport {
        version: 1,
        file: path.display().to_string(),
        file_bytes,
        blake3,
        chunks: checker.chunk_offsets.len(),
        messages: checker.messages,
        frames: checker.log.colors().len(),
        findings,
    })
}

struct Checker {
    path: std::path::PathBuf,
    /// Everything that could be read, for the checks across messages.
    log: Log,
    findings: BTreeMap<&'static str, Finding>,
    chunk_offsets: BTreeSet<u64>,
    indexed_chunks: BTreeSet<u64>,
    messages: usize,
    statistics: Option<mcap::records::Statistics>,
    last_log_time: Option<Stamp>,
    last_of_topic: BTreeMap<String, (Stamp, u32)>,
    camera: Option<CameraModel>,
    infos: BTreeMap<String, CameraInfo>,
}

impl Checker {
    fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            log: Log::empty(path),
            findings: BTreeMap::new(),
            chunk_offsets: BTreeSet::new(),
            indexed_chunks: BTreeSet::new(),
            messages: 0,
            statistics: None,
            last_log_time: None,
            last_of_topic: BTreeMap::new(),
            camera: None,
            infos: BTreeMap::new(),
        }
    }

    fn find(&mut self, severity: Severity, kind: &'static str, example: impl Into<String>) {
        let finding = self.findings.entry(kind).or_insert(Finding { severity, kind, count: 0, examples: Vec::new() });
        finding.count += 1;
        if finding.examples.len() < EXAMPLES {
            finding.examples.push(example.into());
        }
    }

    fn take(&mut self, event: Event<'_>) {
        match &event {
            Event::Header { profile, .. } if profile != "ros2" => {
                let what = format!("profile `{profile}`, wanted `ros2`: other tools may not decode the messages");
                self.find(Severity::Warning, "profile", what);
            }
            Event::Chunk { offset } => {
                self.chunk_offsets.insert(*offset);
            }
            Event::Message(message) => self.message(message),
            Event::Metadata { name, values } => match metadata::verify(name, values) {
                Some(true) => {}
                Some(false) => self.find(Severity::Error, "metadata_checksum", format!("record {name}")),
                None if name.starts_with("pslam/") => {
                    self.find(Severity::Note, "metadata_without_checksum", format!("record {name}"));
                }
                None => {}
            },
            Event::Statistics(statistics) => self.statistics = Some(statistics.clone()),
            Event::ChunkIndex(index) => {
                self.indexed_chunks.insert(index.chunk_start_offset);
            }
            Event::Damage(error) => return self.find(Severity::Error, "damage", error.to_string()),
            Event::Header { .. } | Event::Channel(_) | Event::Attachment { .. } => {}
        }
        if let Err(error) = self.log.take(event) {
            self.find(Severity::Error, "message", error.to_string());
        }
    }

    fn message(&mut self, message: &MessageEvent<'_>) {
        self.messages += 1;
        let topic = &message.channel.topic;
        let (time, sequence) = (message.log_time, message.sequence);
        if self.last_log_time.is_some_and(|last| last > time) {
            let what = format!("{topic}, message {sequence}: log time {time} s after a later one");
            // A live recording stands in order of arrival.
            let live = self.log.metadata.contains_key(metadata::RECORDING);
            self.find(if live { Severity::Note } else { Severity::Warning }, "order_in_file", what);
        }
        self.last_log_time = self.last_log_time.max(Some(time));
        let Ok(stamp) = stamp_of(message) else { return }; // reported when the log takes the message
        if stamp != time {
            let what = format!("{topic}, message {sequence}: header {stamp} s, log time {time} s");
            self.find(Severity::Warning, "log_time_differs_from_header", what);
        }
        if let Some((last, last_sequence)) = self.last_of_topic.insert(topic.clone(), (stamp, sequence)) {
            let place = format!("{topic}, message {sequence} at {stamp} s");
            // Several of these may belong to one moment.
            let several = [topics::EXTRINSICS, topics::DROPS, topics::EVENTS].contains(&topic.as_str());
            if last == stamp && topics::schema_name(topic).is_some() && !several {
                let severity = if topic == topics::COLOR { Severity::Error } else { Severity::Warning };
                self.find(
                    severity,
                    if topic == topics::COLOR { "duplicate_picture" } else { "duplicate_stamp" },
                    &place,
                );
            }
            if stamp < last {
                self.find(Severity::Warning, "stamp_goes_back", format!("{place}: before it {last} s"));
            }
            // Writers that do not count leave every number 0.
            if sequence != last_sequence.wrapping_add(1) && (sequence, last_sequence) != (0, 0) {
                self.find(Severity::Warning, "sequence_jumps", format!("{place}: before it message {last_sequence}"));
            }
        }
        if let Err(reason) = self.contents(message) {
            self.find(Severity::Error, "contents", message.error(&self.path, reason).to_string());
        }
    }

    /// Decodes a message to the last pixel.
    fn contents(&mut self, message: &MessageEvent<'_>) -> Result<(), String> {
        let data = message.data;
        let topic = message.channel.topic.as_str();
        match topic {
            topics::DEPTH_NATIVE_INFO => self.steady(topic, decoded(data)?)?,
            topics::COLOR_INFO | topics::DEPTH_INFO => self.calibration(topic, decoded(data)?)?,
            topics::RIGHT_INFO => self.right_calibration(decoded(data)?)?,
            topics::COLOR | topics::RIGHT => {
                let picture: CompressedImage<'_> = decoded(data)?;
                color(&picture.format, &picture.data, self.size()?)?;
            }
            topics::DEPTH => {
                pixels(data, self.size()?)?;
            }
            topics::GROUND_TRUTH => {
                true_pose(data)?;
            }
            topics::COLOR_RAW => {
                let (width, height) = self.size()?;
                let image: Image<'_> = decoded(data)?;
                if (image.encoding.as_str(), image.data.len()) != (encoding::RGB8, width * height * 3) {
                    return Err(format!(
                        "{} in {} bytes is not rgb8 of the camera's size",
                        image.encoding,
                        image.data.len()
                    ));
                }
            }
            topics::DEPTH_NATIVE => {
                decoded::<Image<'_>>(data)?.pixels_u16().map_err(|error| error.to_string())?;
            }
            _ if recording::is_decoded(topic, data)? => {}
            _ => match topics::layer_of(topic).and_then(|_| topic.rsplit('/').next()) {
                Some("categories") => drop(decoded::<CategoryTable>(data)?),
                Some("label_info") => drop(decoded::<LabelInfo>(data)?),
                Some("segments") => drop(decoded::<SegmentTable>(data)?),
                Some(_) => drop(pixels(data, self.size()?)?),
                None => {}
            },
        }
        Ok(())
    }

    fn size(&self) -> Result<(usize, usize), String> {
        let camera = self.camera.ok_or("no usable calibration stands before it")?;
        Ok((camera.width as usize, camera.height as usize))
    }

    /// A calibration must stay the same.
    fn steady(&mut self, topic: &str, mut info: CameraInfo) -> Result<(), String> {
        info.header = schemas::msg::Header::default();
        let first = self.infos.entry(topic.to_owned()).or_insert_with(|| info.clone());
        if *first != info {
            return Err(format!("the calibration changes: k {:?} after {:?}", info.k, first.k));
        }
        Ok(())
    }

    /// A calibration must be usable, stay the same, and be that of the colour camera.
    fn calibration(&mut self, topic: &str, info: CameraInfo) -> Result<(), String> {
        let camera = CameraModel::from_camera_info(&info).map_err(|error| error.to_string())?;
        self.steady(topic, info)?;
        match self.camera {
            None => self.camera = Some(camera),
            Some(known) if known != camera => {
                return Err("depth and colour differ in calibration: depth must be registered to colour".to_owned());
            }
            Some(_) => {}
        }
        Ok(())
    }

    /// The right camera's calibration must make a stereo camera with the left one's, and stay the same.
    fn right_calibration(&mut self, mut info: CameraInfo) -> Result<(), String> {
        info.header = schemas::msg::Header::default();
        let left =
            self.infos.get(topics::COLOR_INFO).ok_or("no usable calibration of the left camera stands before it")?;
        StereoModel::from_camera_infos(left, &info).map_err(|error| error.to_string())?;
        let first = self.infos.entry(topics::RIGHT_INFO.to_owned()).or_insert_with(|| info.clone());
        if *first == info {
            Ok(())
        } else {
            Err(format!("the calibration changes: p {:?} after {:?}", info.p, first.p))
        }
    }

    /// Compares what the closing records say with what was met.
    fn summary(&mut self) {
        let Some(statistics) = self.statistics.take() else {
            return self.find(Severity::Warning, "no_statistics", "no statistics record: some readers refuse the file");
        };
        let (said, met) = (statistics.message_count, self.messages as u64);
        if said != met {
            self.find(Severity::Error, "message_count", format!("{met} messages read, the writer counted {said}"));
        }
        let (said, met) = (statistics.chunk_count as usize, self.chunk_offsets.len());
        if said != met {
            self.find(Severity::Error, "chunk_count", format!("{met} chunks met, the writer counted {said}"));
        }
        if self.indexed_chunks != self.chunk_offsets {
            let (indexed, met) = (self.indexed_chunks.len(), self.chunk_offsets.len());
            self.find(
                Severity::Error,
                "chunk_index",
                format!("the index lists {indexed} chunks, {met} were met elsewhere"),
            );
        }
    }

    /// A recording that was asked for without pictures has nothing to replay, which is no fault of it; one that holds
    /// nothing else either is empty.
    fn without_pictures(&mut self) {
        let measured = recording::MEASURED.iter().filter(|topic| self.last_of_topic.contains_key(**topic));
        let measured: Vec<&str> = measured.copied().collect();
        if measured.is_empty() {
            self.find(Severity::Error, "nothing_recorded", "it says that it has no pictures, and holds nothing else");
        } else {
            let what =
                format!("recorded without pictures, as was asked: {}; there is nothing to replay", measured.join(", "));
            self.find(Severity::Note, "no_pictures", what);
        }
    }

    /// Pairing, masks and ground truth against the pictures.
    fn frames(&mut self) {
        if self.log.colors().is_empty() && recording::says_no_pictures(&self.log) {
            return self.without_pictures();
        }
        let timeline = match self.log.timeline(None) {
            Ok(timeline) => timeline,
            Err(error) => return self.find(Severity::Error, "no_timeline", error.to_string()),
        };
        let has_depth = timeline.frames().iter().any(|frame| frame.depth_stamp().is_some());
        for frame in timeline.frames().iter().filter(|frame| has_depth && frame.depth_stamp().is_none()) {
            self.find(Severity::Warning, "picture_without_depth", format!("picture at {} s", frame.stamp));
        }
        if timeline.unpaired_depth > 0 {
            let what = format!("{} depth images belong to no picture", timeline.unpaired_depth);
            self.find(Severity::Warning, "depth_without_picture", what);
        }
        let has_right = timeline.frames().iter().any(|frame| frame.right_stamp().is_some());
        for frame in timeline.frames().iter().filter(|frame| has_right && frame.right_stamp().is_none()) {
            self.find(Severity::Warning, "picture_without_right", format!("picture at {} s", frame.stamp));
        }
        if timeline.unpaired_right > 0 {
            let what = format!("{} right pictures belong to no left one", timeline.unpaired_right);
            self.find(Severity::Warning, "right_without_picture", what);
        }
        let layers: Vec<String> = self.log.layers().into_iter().map(str::to_owned).collect();
        for layer in layers {
            if let Err(error) = self.layer(&layer) {
                self.find(Severity::Error, "masks", error.to_string());
            }
        }
        let truth = &self.log.ground_truth().poses;
        let span = truth.first().zip(truth.last()).map(|(first, last)| first.stamp..=last.stamp);
        let outside = span.map(|span| timeline.frames().iter().filter(|f| !span.contains(&f.stamp)).count());
        if let Some(outside) = outside.filter(|n| *n > 0) {
            self.find(
                Severity::Note,
                "outside_ground_truth",
                format!("{outside} pictures before or after the ground truth"),
            );
        }
    }

    /// Every mask against its picture, its table and its categories.
    fn layer(&mut self, layer: &str) -> Result<(), LogError> {
        let timeline = self.log.timeline(Some(layer))?;
        for frame in timeline.frames().iter().filter(|frame| !frame.has_mask()) {
            self.find(Severity::Note, "picture_without_mask", format!("layer {layer}, picture at {} s", frame.stamp));
        }
        let used = timeline.frames().iter().filter(|frame| frame.has_mask()).count();
        let classes = self.log.sorted(&topics::LayerTopics::new(layer).class).len();
        if classes > used {
            let what =
                format!("layer {layer}: {} of {classes} masks are incomplete or belong to no picture", classes - used);
            self.find(Severity::Warning, "mask_without_picture", what);
        }
        let Some(camera) = self.camera else { return Ok(()) };
        let categories: Vec<u16> = self.log.categories(layer).iter().map(|category| category.id).collect();
        for raw in timeline.stream(0..timeline.frames().len())? {
            let raw = raw?;
            let place = format!("layer {layer}, picture at {} s", raw.stamp);
            match super::decode::mask_of(&raw, &camera).map(|mask| mask.map(|mask| mask.contradiction(&categories))) {
                Ok(None | Some(None)) => {}
                Ok(Some(Some(what))) => self.find(Severity::Error, "mask_contradiction", format!("{place}: {what}")),
                Err(reason) => self.find(Severity::Error, "mask", format!("{place}: {reason}")),
            }
        }
        Ok(())
    }
}
