//! The log as a stream of [`Item`]s.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use schemas::alignment::Aligner;
use schemas::calibration::CameraModel;
use schemas::msg::{Image, Imu, PoseStamped};
use schemas::stereo::StereoModel;
use schemas::{Stamp, topics};

use super::{ExportError, ExportOptions, ExportReport, Item, Kind, Layout};
use crate::OutputFolder;
use crate::log::{Event, Log, LogError, MaskPixels, decoded, encoded_image, mask_pixels, scan};

/// Masks whose three messages have not all passed; writers put them side by side.
const MOST_OPEN_MASKS: usize = 64;

/// A log and what of it is wanted.
pub(crate) struct Source<'a> {
    pub log: &'a Log,
    pub camera: CameraModel,
    pub stereo: Option<StereoModel>,
    /// Layers to export.
    pub layers: Vec<String>,
    /// Colour pictures in the window, each stamp once, ascending.
    pub frames: Vec<Stamp>,
    /// Depth images in the window, ascending.
    pub depths: Vec<Stamp>,
    /// Right pictures in the window, ascending.
    pub rights: Vec<Stamp>,
    /// Depth value of one metre in the folder.
    pub units_per_metre: f64,
    pub tolerance_ns: u64,
    /// Whether depth is registered on the way.
    pub registers: bool,
    /// Wanted value of one unit of the log; `None` = values stay.
    rescale: Option<f64>,
    /// Stamps that are wanted; `None` = all.
    window: Option<(Stamp, Stamp)>,
    aligner: Option<Arc<Aligner>>,
    color_topic: &'static str,
    depth_topic: &'static str,
}

impl<'a> Source<'a> {
    pub fn new(log: &'a Log, options: &ExportOptions) -> Result<Self, ExportError> {
        let timeline = log.timeline(None)?;
        let layers = match &options.layers {
            None => log.layers().into_iter().map(str::to_owned).collect(),
            Some(named) => named.clone(),
        };
        for layer in &layers {
            log.timeline(Some(layer))?; // a layer that is not there is refused with the names of those that are
        }
        let window = options.frames.as_ref().map(|range| {
            let frames = timeline.frames().get(range.start..range.end.min(timeline.frames().len()));
            let stamps = frames.unwrap_or_default().iter();
            let stamps = stamps.flat_map(|f| [Some(f.stamp), f.depth_stamp(), f.right_stamp()]).flatten();
            let (first, last) = stamps.clone().min().zip(stamps.max()).ok_or_else(|| {
                let all = timeline.frames().len();
                ExportError::Refused(format!(
                    "frames {}..{} are not in the log, which has {all}",
                    range.start, range.end
                ))
            })?;
            Ok::<_, ExportError>((first, last))
        });
        let window = window.transpose()?;
        let wanted = |stamp: &Stamp| window.is_none_or(|(first, last)| (first..=last).contains(stamp));
        let (depths, aligner) = log.depths()?;
        let stamps = |entries: &[crate::log::Entry]| -> Vec<Stamp> {
            let set: BTreeSet<Stamp> = entries.iter().map(|entry| entry.stamp).filter(&wanted).collect();
            set.into_iter().collect()
        };
        let own_units = log.depth_units_per_metre()?;
        let units_per_metre = options.depth_units_per_metre.unwrap_or(own_units);
        Ok(Self {
            log,
            camera: log.camera()?,
            stereo: log.stereo()?,
            layers,
            frames: stamps(&log.colors()),
            depths: stamps(&depths),
            rights: stamps(&log.sorted(topics::RIGHT)),
            units_per_metre,
            tolerance_ns: log.pairing_tolerance_ns()?,
            registers: aligner.is_some(),
            rescale: (units_per_metre != own_units).then_some(units_per_metre / own_units),
            window,
            color_topic: if log.has_messages(topics::COLOR) { topics::COLOR } else { topics::COLOR_RAW },
            depth_topic: if aligner.is_some() { topics::DEPTH_NATIVE } else { topics::DEPTH },
            aligner,
        })
    }

    /// The log's name without extension.
    pub fn name(&self) -> String {
        self.log.path().file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// Hands everything in the window that the layout holds to it, and counts.
    pub fn pass(
        &self,
        layout: &mut dyn Layout,
        folder: &OutputFolder,
        report: &mut ExportReport,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<(), ExportError> {
        let mut pass =
            Pass { source: self, layout, folder, report, progress, masks: BTreeMap::new(), seen: BTreeSet::new() };
        let mut failed = None;
        let scanned = scan(self.log.path(), &mut |event| {
            if failed.is_none() {
                failed = pass.event(event).err();
            }
            // The scan asks again with what ended it, so a failure is told twice.
            failed.as_ref().map_or(Ok(()), |_| Err(LogError::missing(self.log.path(), "stopped")))
        });
        if let Some(error) = failed {
            return Err(error);
        }
        if scanned?.blake3 != self.log.blake3() {
            return Err(LogError::missing(self.log.path(), "changed while it was read: try again").into());
        }
        let open = pass.masks.len();
        pass.report.leave_out("incomplete masks", open);
        if !self.log.has_messages(topics::GROUND_TRUTH) && pass.layout.holds(Kind::Pose) {
            for pose in self.log.ground_truth().poses.iter().filter(|pose| self.wants(pose.stamp)) {
                let ([x, y, z], [qx, qy, qz, qw]) =
                    (pose.world_from_camera.translation.into(), pose.world_from_camera.quaternion_xyzw());
                pass.give(Item::Pose(pose.stamp, [x, y, z, qx, qy, qz, qw]))?;
            }
        }
        Ok(())
    }

    /// Completes the report: spans, notes, and the topics that nothing was taken from.
    pub fn describe(&self, layout: &dyn Layout, report: &mut ExportReport) {
        report.span_ns = self.frames.first().copied().zip(self.frames.last().copied());
        report.pairing_tolerance_ns = self.tolerance_ns;
        report.depth_units_per_metre = (report.depth_images > 0).then_some(self.units_per_metre);
        // What is told otherwise: poses, calibration and labels stand in the lists, calibration files and label tables.
        let told = [
            topics::TF,
            topics::TF_STATIC,
            topics::COLOR_INFO,
            topics::RIGHT_INFO,
            topics::DEPTH_INFO,
            topics::DEPTH_NATIVE_INFO,
        ];
        for (topic, count) in self.log.topic_counts() {
            if self.kind(topic).is_none_or(|kind| !layout.holds(kind)) && !told.contains(&topic) {
                let of_layer =
                    topics::layer_of(topic).is_some_and(|l| layout.holds(Kind::Mask) && self.layer(l).is_some());
                if !of_layer {
                    report.leave_out(topic, count);
                }
            }
        }
        if self.registers && report.depth_images > 0 {
            let what = "depth was recorded as the depth camera measures it and is registered to colour here, by the code \
                        of a replay";
            report.notes.push(what.to_owned());
        }
        report.notes.extend(layout.notes(self));
    }

    fn kind(&self, topic: &str) -> Option<Kind> {
        match topic {
            topics::RIGHT => Some(Kind::Right),
            topics::GROUND_TRUTH => Some(Kind::Pose),
            topics::IMU => Some(Kind::Imu),
            _ if topic == self.color_topic => Some(Kind::Color),
            _ if topic == self.depth_topic => Some(Kind::Depth),
            _ => None,
        }
    }

    fn layer(&self, name: &str) -> Option<&str> {
        self.layers.iter().map(String::as_str).find(|layer| *layer == name)
    }

    fn wants(&self, stamp: Stamp) -> bool {
        self.window.is_none_or(|(first, last)| (first..=last).contains(&stamp))
    }

    fn depth(&self, data: &[u8], lost: &mut usize) -> Result<Vec<u16>, String> {
        let mut units = decoded::<Image<'_>>(data)?.pixels_u16().map_err(|error| error.to_string())?;
        if let Some(aligner) = &self.aligner {
            units = aligner.align(&units).map_err(|error| error.to_string())?;
        }
        let wanted = self.camera.width as usize * self.camera.height as usize;
        if units.len() != wanted {
            return Err(format!("{} depth pixels where the camera has {wanted}", units.len()));
        }
        if let Some(factor) = self.rescale {
            for unit in &mut units {
                let scaled = (f64::from(*unit) * factor + 0.5).floor();
                let fits = scaled <= f64::from(u16::MAX);
                *lost += usize::from(!fits);
                *unit = if fits { scaled as u16 } else { 0 };
            }
        }
        Ok(units)
    }
}

/// The state of a pass.
struct Pass<'p, 'a> {
    source: &'p Source<'a>,
    layout: &'p mut dyn Layout,
    folder: &'p OutputFolder,
    report: &'p mut ExportReport,
    progress: &'p mut dyn FnMut(usize, usize),
    /// By layer and stamp: class, instance, segments as far as they came.
    masks: BTreeMap<(String, Stamp), [Option<Vec<u8>>; 3]>,
    /// Topic and stamp of what was taken.
    seen: BTreeSet<(String, Stamp)>,
}

impl Pass<'_, '_> {
    fn event(&mut self, event: Event<'_>) -> Result<(), ExportError> {
        let message = match event {
            Event::Message(message) => message,
            Event::Damage(error) => return Err(error.into()),
            Event::Attachment { name, data, .. } => {
                if !self.layout.attachment(&name, data) {
                    self.report.leave_out(&format!("attachment {name}"), 1);
                }
                return Ok(());
            }
            _ => return Ok(()),
        };
        let topic = message.channel.topic.as_str();
        let named = |reason: String| ExportError::from(message.error(self.source.log.path(), reason));
        let kind = self.source.kind(topic);
        let layer = topics::layer_of(topic).and_then(|layer| self.source.layer(layer));
        if kind.or(layer.map(|_| Kind::Mask)).is_none_or(|kind| !self.layout.holds(kind)) {
            return Ok(());
        }
        let stamp = crate::log::stamp_of(&message).map_err(named)?;
        if !self.source.wants(stamp) {
            return Ok(());
        }
        if let Some(layer) = layer {
            let part = match topic.rsplit('/').next() {
                Some("class") => 0,
                Some("instance") => 1,
                Some("segments") => 2,
                _ => return Ok(()),
            };
            let complete = self.mask_part(layer, stamp, part, message.data).map_err(named)?;
            return complete.map_or(Ok(()), |mask| self.give(Item::Mask(layer, stamp, mask)));
        }
        if !self.seen.insert((topic.to_owned(), stamp)) {
            self.report.leave_out(&format!("repeated stamp on {topic}"), 1);
            return Ok(());
        }
        let mut lost = 0;
        let item = self.source.item(kind, topic, stamp, message.data, &mut lost).map_err(named)?;
        self.report.leave_out("depth pixels beyond 16 bits in the wanted scale (written as none)", lost);
        item.map_or(Ok(()), |item| self.give(item))
    }

    /// The mask if this was the last part of it.
    fn mask_part(&mut self, layer: &str, stamp: Stamp, part: usize, data: &[u8]) -> Result<Option<MaskPixels>, String> {
        let key = (layer.to_owned(), stamp);
        let open = self.masks.entry(key.clone()).or_default();
        open[part] = Some(data.to_vec());
        if let [Some(class), Some(instance), Some(segments)] = open {
            let parts = [std::mem::take(class), std::mem::take(instance), std::mem::take(segments)];
            self.masks.remove(&key);
            let size = (self.source.camera.width as usize, self.source.camera.height as usize);
            return mask_pixels(&parts, size).map(Some);
        }
        if self.masks.len() > MOST_OPEN_MASKS {
            self.masks.pop_first();
            self.report.leave_out("incomplete masks", 1);
        }
        Ok(None)
    }

    fn give(&mut self, item: Item<'_>) -> Result<(), ExportError> {
        match &item {
            Item::Color(..) => {
                self.report.pictures += 1;
                (self.progress)(self.report.pictures, self.source.frames.len());
            }
            Item::Right(..) => self.report.right_pictures += 1,
            Item::Depth(..) => self.report.depth_images += 1,
            Item::Pose(..) => self.report.ground_truth_poses += 1,
            Item::Imu(..) => self.report.imu_rows += 1,
            Item::Mask(layer, stamp, _) => {
                if self.source.frames.binary_search(stamp).is_err() {
                    self.report.leave_out(&format!("masks of layer {layer} without a picture"), 1);
                    return Ok(());
                }
                *self.report.masks.entry((*layer).to_owned()).or_default() += 1;
            }
        }
        self.layout.take(item, self.folder, self.source)
    }
}

impl Source<'_> {
    fn item(
        &self,
        kind: Option<Kind>,
        topic: &str,
        stamp: Stamp,
        data: &[u8],
        lost: &mut usize,
    ) -> Result<Option<Item<'static>>, String> {
        Ok(match kind {
            Some(Kind::Color) => Some(Item::Color(stamp, encoded_image(data, topic == topics::COLOR_RAW)?)),
            Some(Kind::Right) => Some(Item::Right(stamp, encoded_image(data, false)?)),
            Some(Kind::Depth) => Some(Item::Depth(stamp, self.depth(data, lost)?)),
            Some(Kind::Pose) => {
                let (p, q) = { decoded::<PoseStamped>(data).map(|m| (m.pose.position, m.pose.orientation))? };
                Some(Item::Pose(stamp, [p.x, p.y, p.z, q.x, q.y, q.z, q.w]))
            }
            Some(Kind::Imu) => {
                let Imu { angular_velocity: w, linear_acceleration: a, .. } = decoded(data)?;
                Some(Item::Imu(stamp, [w.x, w.y, w.z, a.x, a.y, a.z]))
            }
            Some(Kind::Mask) | None => None,
        })
    }
}
