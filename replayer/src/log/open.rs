//! Opening a log: one pass that remembers where everything is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemas::calibration::CameraModel;
use schemas::cdr::{Cdr, Reader};
use schemas::msg::{CameraInfo, Category, CategoryTable, CompressedImage, Extrinsics, Header, PoseStamped, encoding};
use schemas::stereo::StereoModel;
use schemas::sync::{Signals, SyncRecord};
use schemas::topics::frame;
use schemas::{Message, Stamp, metadata, topics};
use slam_math::Se3;

use super::container::{Channel, Event, MessageEvent, Place, scan};
use super::mocap::{MocapTruth, mocap_truth};
use super::recording::OwnWords;
use super::registration::NativeDepth;
use super::{AttachmentInfo, LogError};
use crate::eval::{StampedPose, Trajectory};

/// One message of a topic.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Entry {
    /// The header's stamp, or the log time for messages without a header.
    pub stamp: Stamp,
    pub sequence: u32,
    pub place: Place,
}

/// One topic.
#[derive(Debug, Clone)]
pub(crate) struct Topic {
    pub channel: Channel,
    /// In file order.
    pub entries: Vec<Entry>,
    pub bytes: u64,
}

/// An opened log. Every CRC was right and every message had its place; pictures are not decoded yet.
#[derive(Debug, Clone)]
pub struct Log {
    pub(crate) path: PathBuf,
    pub(crate) blake3: String,
    pub(crate) file_bytes: u64,
    pub(crate) profile: String,
    pub(crate) library: String,
    pub(crate) topics: BTreeMap<String, Topic>,
    pub(crate) metadata: BTreeMap<String, BTreeMap<String, String>>,
    pub(crate) attachments: Vec<AttachmentInfo>,
    pub(crate) chunks: usize,
    pub(crate) camera_info: Option<CameraInfo>,
    pub(crate) right_info: Option<CameraInfo>,
    pub(crate) first_color_format: Option<String>,
    pub(crate) categories: BTreeMap<String, Vec<Category>>,
    pub(crate) native_depth: NativeDepth,
    pub(crate) own_words: OwnWords,
    ground_truth: Trajectory,
    ground_truth_origin: Option<String>,
    /// Motion capture of a recording.
    mocap: Signals,
}

impl Log {
    /// Reads the whole file once.
    ///
    /// # Errors
    /// No log, damage anywhere in the container (wrong CRC, cut off), or a message that is not what its topic says.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let mut log = Self::empty(path);
        let passed = scan(path, &mut |event| log.take(event))?;
        (log.blake3, log.file_bytes) = (passed.blake3, passed.file_bytes);
        log.settle_ground_truth()?;
        Ok(log)
    }

    /// Before anything is read.
    pub(crate) fn empty(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
            blake3: String::new(),
            file_bytes: 0,
            profile: String::new(),
            library: String::new(),
            topics: BTreeMap::new(),
            metadata: BTreeMap::new(),
            attachments: Vec::new(),
            chunks: 0,
            camera_info: None,
            right_info: None,
            first_color_format: None,
            categories: BTreeMap::new(),
            native_depth: NativeDepth::default(),
            own_words: OwnWords::default(),
            ground_truth: Trajectory::default(),
            ground_truth_origin: None,
            mocap: Signals::default(),
        }
    }

    /// Once everything is read: a log's own ground truth, else the mocap's at the pictures' stamps.
    pub(crate) fn settle_ground_truth(&mut self) -> Result<(), LogError> {
        self.ground_truth.poses.sort_by_key(|pose| pose.stamp);
        let signals = std::mem::take(&mut self.mocap);
        if !self.ground_truth.poses.is_empty() {
            self.ground_truth_origin = Some(topics::GROUND_TRUTH.to_owned());
            return Ok(());
        }
        let record = self.metadata.get(metadata::SYNC).map(SyncRecord::from_metadata).transpose();
        let record = record.map_err(|reason| LogError::missing(&self.path, reason))?;
        let pictures: Vec<Stamp> = self.colors().iter().map(|entry| entry.stamp).collect();
        if let Some(MocapTruth { trajectory, origin }) = mocap_truth(&signals, record.as_ref(), &pictures) {
            (self.ground_truth, self.ground_truth_origin) = (trajectory, Some(origin));
        }
        Ok(())
    }

    /// The file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// BLAKE3 of the whole file, 64 hexadecimal digits: what a run records about its input.
    #[must_use]
    pub fn blake3(&self) -> &str {
        &self.blake3
    }

    /// Ground truth, `world_from_camera`, in stamp order; empty without any. A recording's is the mocap's at the pictures'
    /// stamps, moved by its sync record; pictures in a gap have none.
    #[must_use]
    pub fn ground_truth(&self) -> &Trajectory {
        &self.ground_truth
    }

    /// Where the ground truth comes from, in words; `None` without any.
    #[must_use]
    pub fn ground_truth_origin(&self) -> Option<&str> {
        self.ground_truth_origin.as_deref()
    }

    /// The colour camera, from the first calibration in the log.
    ///
    /// # Errors
    /// No calibration, or an impossible or unsupported one.
    pub fn camera(&self) -> Result<CameraModel, LogError> {
        let topic = topics::COLOR_INFO;
        let missing = || LogError::missing(&self.path, format!("no calibration on {topic}"));
        let info = self.camera_info.as_ref().ok_or_else(missing)?;
        CameraModel::from_camera_info(info)
            .map_err(|error| LogError::missing(&self.path, format!("no usable calibration on {topic}: {error}")))
    }

    /// Both cameras of a stereo camera, from the first calibrations in the log; `None` without a right camera.
    ///
    /// # Errors
    /// Calibrations that are none, or not of one stereo camera.
    pub fn stereo(&self) -> Result<Option<StereoModel>, LogError> {
        let (Some(left), Some(right)) = (&self.camera_info, &self.right_info) else { return Ok(None) };
        let (a, b) = (topics::COLOR_INFO, topics::RIGHT_INFO);
        let unusable = |error| LogError::missing(&self.path, format!("no stereo camera on {a} and {b}: {error}"));
        StereoModel::from_camera_infos(left, right).map(Some).map_err(unusable)
    }

    /// Depth value of one metre: the log's metadata, else the channel's, else 1000 (ROS depth images are millimetres).
    ///
    /// # Errors
    /// A value that is no positive number.
    pub fn depth_units_per_metre(&self) -> Result<f64, LogError> {
        let record = self.metadata.get(metadata::DEPTH);
        let channel = self
            .topics
            .get(topics::DEPTH)
            .or_else(|| self.topics.get(topics::DEPTH_NATIVE))
            .map(|topic| &topic.channel.metadata);
        let text = [record, channel].into_iter().flatten().find_map(|map| map.get(metadata::DEPTH_UNITS_PER_METRE));
        let Some(text) = text else { return Ok(1000.0) };
        let wrong = || LogError::missing(&self.path, format!("depth scale `{text}` is not a positive number"));
        text.parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0).ok_or_else(wrong)
    }

    /// Topics and their messages, by name.
    pub(crate) fn topic_counts(&self) -> impl Iterator<Item = (&str, usize)> {
        self.topics.iter().map(|(name, topic)| (name.as_str(), topic.entries.len()))
    }

    pub(crate) fn has_messages(&self, topic: &str) -> bool {
        self.topics.get(topic).is_some_and(|topic| !topic.entries.is_empty())
    }

    /// Names of the segmentation layers, sorted.
    #[must_use]
    pub fn layers(&self) -> Vec<&str> {
        let mut layers: Vec<&str> = self.topics.keys().filter_map(|topic| topics::layer_of(topic)).collect();
        layers.dedup(); // topics are sorted, so one layer's stand together
        layers
    }

    /// The layer to use when nobody names one: the default one, else the first, else none.
    #[must_use]
    pub fn default_layer(&self) -> Option<&str> {
        let layers = self.layers();
        layers.iter().find(|layer| **layer == topics::DEFAULT_LAYER).or(layers.first()).copied()
    }

    /// Categories of a layer, ids ascending; empty for an unknown layer.
    #[must_use]
    pub fn categories(&self, layer: &str) -> &[Category] {
        self.categories.get(layer).map_or(&[], Vec::as_slice)
    }

    /// Metadata records by name; of records with the same name the last one.
    #[must_use]
    pub fn metadata(&self) -> &BTreeMap<String, BTreeMap<String, String>> {
        &self.metadata
    }

    pub(crate) fn take(&mut self, event: Event<'_>) -> Result<(), LogError> {
        match event {
            Event::Header { profile, library } => (self.profile, self.library) = (profile, library),
            Event::Channel(channel) => self.add_channel(channel)?,
            Event::Chunk { .. } => self.chunks += 1,
            Event::Message(message) => self.add_message(&message)?,
            Event::Metadata { name, values } => {
                self.metadata.insert(name, values);
            }
            Event::Attachment { name, media_type, data } => {
                self.attachments.push(AttachmentInfo { name, media_type, bytes: data.len() as u64 });
            }
            Event::Statistics(_) | Event::ChunkIndex(_) => {}
            Event::Damage(error) => return Err(error),
        }
        Ok(())
    }

    fn add_channel(&mut self, channel: &Channel) -> Result<(), LogError> {
        let topic = Topic { channel: channel.clone(), entries: Vec::new(), bytes: 0 };
        let known = &self.topics.entry(channel.topic.clone()).or_insert(topic).channel;
        if known.schema_name == channel.schema_name {
            return Ok(());
        }
        let (a, b) = (&known.schema_name, &channel.schema_name);
        Err(LogError::missing(&self.path, format!("topic {} carries both {a} and {b}", channel.topic)))
    }

    fn add_message(&mut self, message: &MessageEvent<'_>) -> Result<(), LogError> {
        let path = self.path.clone();
        let stamp = stamp_of(message).map_err(|reason| message.error(&path, reason))?;
        let entry = Entry { stamp, sequence: message.sequence, place: message.place };
        if let Some(topic) = self.topics.get_mut(&message.channel.topic) {
            topic.entries.push(entry);
            topic.bytes += message.data.len() as u64;
        }
        self.remember(message).map_err(|reason| message.error(&path, reason))
    }

    /// Keeps the contents that are needed before the first frame.
    fn remember(&mut self, message: &MessageEvent<'_>) -> Result<(), String> {
        let data = message.data;
        self.own_words.take(message)?;
        match message.channel.topic.as_str() {
            topics::COLOR_INFO if self.camera_info.is_none() => self.camera_info = Some(decoded(data)?),
            topics::RIGHT_INFO if self.right_info.is_none() => self.right_info = Some(decoded(data)?),
            topics::COLOR if self.first_color_format.is_none() => {
                self.first_color_format = Some(decoded::<CompressedImage<'_>>(data)?.format);
            }
            topics::COLOR_RAW if self.first_color_format.is_none() => {
                self.first_color_format = Some(encoding::RGB8.to_owned());
            }
            topics::DEPTH_NATIVE_INFO if self.native_depth.info.is_none() => {
                self.native_depth.info = Some(decoded(data)?);
            }
            topics::EXTRINSICS => {
                let rig: Extrinsics = decoded(data)?;
                let ours = (rig.header.frame_id.as_str(), rig.child_frame_id.as_str()) == (frame::CAMERA, frame::DEPTH);
                if ours && self.native_depth.color_from_depth.is_none() {
                    self.native_depth.color_from_depth = Some(rig);
                }
            }
            topics::GROUND_TRUTH => self.ground_truth.poses.push(true_pose(data)?),
            topics::MOCAP => self.mocap.take(topics::MOCAP, data).map_err(|error| error.to_string())?,
            topic => {
                let Some(layer) = topics::layer_of(topic).filter(|_| topic.ends_with("/categories")) else {
                    return Ok(());
                };
                let mut categories = decoded::<CategoryTable>(data)?.categories;
                categories.sort_by_key(|category| category.id);
                self.categories.insert(layer.to_owned(), categories);
            }
        }
        Ok(())
    }
}

pub(crate) fn decoded<'a, M: Message<'a>>(data: &'a [u8]) -> Result<M, String> {
    M::decode(data).map_err(|error| error.to_string())
}

/// A ground-truth message as a pose.
pub(crate) fn true_pose(data: &[u8]) -> Result<StampedPose, String> {
    let PoseStamped { header, pose } = decoded(data)?;
    let (p, q) = (pose.position, pose.orientation);
    let numbers = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
    let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if !numbers.iter().all(|v| v.is_finite()) || !(0.9..=1.1).contains(&norm) {
        return Err(format!("{numbers:?} is no pose: finite numbers and a unit quaternion are needed"));
    }
    let world_from_camera = Se3::from_quaternion([p.x, p.y, p.z], [q.x, q.y, q.z, q.w]);
    Ok(StampedPose { stamp: header.stamp.into(), world_from_camera })
}

/// The stamp in a message's header. Topics of this project must carry their type in CDR; others have no header to trust.
pub(crate) fn stamp_of(message: &MessageEvent<'_>) -> Result<Stamp, String> {
    let Channel { topic, schema_name, encoding, .. } = message.channel;
    let Some(wanted) = topics::schema_name(topic) else { return Ok(message.log_time) };
    if schema_name != wanted || encoding != "cdr" {
        return Err(format!("the topic carries {schema_name} in `{encoding}`, wanted {wanted} in `cdr`"));
    }
    if !topics::has_header(wanted) {
        return Ok(message.log_time);
    }
    let header = Reader::new(message.data).and_then(|mut reader| Header::read(&mut reader));
    header.map(|header| header.stamp.into()).map_err(|error| error.to_string())
}
