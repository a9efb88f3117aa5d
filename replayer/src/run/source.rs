//! From a log to what the slam takes.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use schemas::calibration::CameraModel;
use slam::report::Event;
use slam::{Category, Config, DepthImage, FrameInput, PanopticMask, Segment, Sensor, Setup};
use slam_math::{FrameId, Stamp};
use slam_vision::gray_from_rgb;

use super::records::RunHeader;
use super::rig::Rig;
use super::{ReplayOptions, RunError};
use crate::log::{DecodedFrame, Log, MaskPixels, RawFrame, Timeline, decode};
use crate::vocabulary::VocabularyFile;

/// A log, opened for one replay: everything that decides its result.
pub(super) struct Source {
    pub log: Log,
    pub timeline: Timeline,
    /// The camera as it records.
    pub camera: CameraModel,
    pub rig: Rig,
    pub setup: Setup,
    /// Names the vocabulary by its digest, not by its place.
    pub config: Config,
    pub vocabulary: Option<VocabularyFile>,
    /// Indices on the timeline, none beyond its end.
    pub range: Range<usize>,
    /// What a user should know about the choice of frames.
    pub notes: Vec<Event>,
    /// Ids of the layer's categories, ascending.
    category_ids: Vec<u16>,
}

impl Source {
    /// Opens what `options` ask for.
    pub fn open(log: &Path, options: &ReplayOptions) -> Result<Self, RunError> {
        let vocabulary = VocabularyFile::named(&options.config.looping.vocabulary)?;
        let (layer, frames) = (options.layer.as_deref(), options.frames.clone());
        Self::new(Log::open(log)?, &options.config, layer, frames, vocabulary)
    }

    pub fn new(
        log: Log,
        config: &Config,
        layer: Option<&str>,
        frames: Option<Range<usize>>,
        vocabulary: Option<VocabularyFile>,
    ) -> Result<Self, RunError> {
        let mut config = config.clone();
        if let Some(file) = &vocabulary {
            config.looping.vocabulary.clone_from(&file.digest);
        }
        let layer = layer.or_else(|| log.default_layer());
        let timeline = log.timeline(layer)?;
        let camera = log.camera()?;
        let rig = Rig::new(&log, &timeline, config.sensor.kind)?;
        let uses = |sensor: Sensor| rig.sensor.name() == sensor.name();
        let timeline = timeline.keeping(uses(Sensor::Rgbd), uses(Sensor::Stereo { bf: 0.0 }));
        let categories: Vec<Category> =
            layer.map_or(&[][..], |layer| log.categories(layer)).iter().map(category).collect();
        let (range, mut notes) = clip(frames, timeline.frames().len())?;
        if layer.is_none() {
            let text = "the log has no segmentation: every surface is unknown; add one with `pslam import --panoptic`";
            notes.push(Event { warning: true, text: text.to_owned() });
        }
        Ok(Self {
            category_ids: categories.iter().map(|c| c.id).collect(),
            setup: Setup { camera: rig.camera, sensor: rig.sensor, categories },
            config,
            vocabulary,
            log,
            timeline,
            camera,
            rig,
            range,
            notes,
        })
    }

    /// What the fingerprint begins with.
    pub fn header(&self) -> RunHeader {
        RunHeader {
            program: super::PROGRAM.to_owned(),
            log_blake3: self.log.blake3().to_owned(),
            config: self.config.to_toml(),
            layer: self.timeline.layer.clone(),
            frames: self.range.clone(),
        }
    }

    /// Decodes a frame. Pure: any thread may do it, in any order.
    pub fn input(&self, raw: &RawFrame) -> Result<(FrameInput, Vec<Event>), RunError> {
        let decoded =
            decode(raw, &self.camera).map_err(|source| RunError::Decode { log: self.log.path().to_owned(), source })?;
        let DecodedFrame { index, stamp, rgb, right, depth, mask } = decoded;
        let (width, height) = (rgb.width, rgb.height);
        let mut events = Vec::new();
        let mut warn = |text: String| events.push(Event { warning: true, text });
        match self.rig.sensor {
            Sensor::Rgbd if depth.is_none() => warn("no depth image within the pairing tolerance".to_owned()),
            Sensor::Stereo { .. } if right.is_none() => {
                warn("no right picture within the pairing tolerance".to_owned());
            }
            _ => {}
        }
        match (&mask, &self.timeline.layer) {
            (None, Some(layer)) => warn(format!("no mask in layer {layer}")),
            (Some(mask), _) => mask.contradiction(&self.category_ids).into_iter().for_each(warn),
            (None, None) => {}
        }
        let depth = depth.map(|depth| DepthImage {
            width,
            height,
            units: depth.units,
            metres_per_unit: 1.0 / depth.units_per_metre,
        });
        let input = FrameInput {
            id: FrameId((index - self.range.start) as u32),
            stamp: Stamp(stamp.0),
            gray: self.rig.left(gray_from_rgb(&rgb.data, width, height)?),
            right: right.map(|right| gray_from_rgb(&right.data, width, height)).transpose()?.map(|r| self.rig.right(r)),
            depth: depth.map(Arc::new),
            panoptic: mask.map(|mask| Arc::new(self.panoptic(mask, width, height))),
        };
        Ok((input, events))
    }

    fn panoptic(&self, mask: MaskPixels, width: usize, height: usize) -> PanopticMask {
        // What is no confidence, such as `SCORE_UNKNOWN`, tells nothing.
        let score = |score: f32| if (0.0..=1.0).contains(&score) { score } else { 1.0 };
        let segment = |s: schemas::msg::Segment| Segment { id: s.id, category: s.category_id, score: score(s.score) };
        PanopticMask {
            width,
            height,
            ids: self.rig.labels(mask.instance),
            segments: mask.segments.into_iter().map(segment).collect(),
        }
    }
}

/// The frames to replay, and a word when the log has fewer than asked for; `usize::MAX` asks for all there are.
fn clip(wanted: Option<Range<usize>>, there: usize) -> Result<(Range<usize>, Vec<Event>), RunError> {
    let wanted = wanted.unwrap_or(0..there);
    let range = wanted.start..wanted.end.min(there);
    if range.is_empty() {
        return Err(RunError::Range { start: wanted.start, end: wanted.end, frames: there });
    }
    let text = format!("frames {}..{} were asked for; the log ends at {there}", wanted.start, wanted.end);
    let clipped = range.end < wanted.end && wanted.end != usize::MAX;
    Ok((range, clipped.then_some(Event { warning: true, text }).into_iter().collect()))
}

fn category(category: &schemas::msg::Category) -> Category {
    Category { id: category.id, name: category.name.clone(), is_thing: category.is_thing }
}
