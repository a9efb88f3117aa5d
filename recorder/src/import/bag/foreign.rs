//! Bags of other programs: known message types on any topic.

use super::super::{ImportError, Repairs};
use super::read::{Message, Record, read};
use super::{BagOptions, TopicReport, pixels};
use crate::log_writer::LogOptions;
use crate::rgbd::{Beside, RgbdLog, RgbdSpec};
use schemas::calibration::CameraModel;
use schemas::cdr::{Cdr, Reader};
use schemas::msg::{CameraInfo, CompressedImage, Header, Image, Imu, PoseStamped};
use schemas::{Message as _, Stamp, metadata, topics};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Messages that wait for older ones; bags are nearly in order of their stamps.
const MOST_WAITING_BYTES: usize = 512 << 20;

/// What a topic is taken for, in the order in which equal stamps are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Role {
    Pose,
    Imu,
    Color,
    Depth,
}

/// What a first pass finds.
#[derive(Default)]
struct Survey {
    /// By topic: its type.
    types: BTreeMap<String, String>,
    /// The first calibration on each topic.
    infos: BTreeMap<String, CameraInfo>,
}

pub fn import(
    dir: &Path,
    files: &[PathBuf],
    out: &Path,
    options: &BagOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<TopicReport, ImportError> {
    let survey = Survey::of(files)?;
    let (roles, camera) = survey.roles(dir, options)?;
    let mut repairs = Repairs::default();
    let order = order(files, &roles, &mut repairs)?;
    let Some(span) = order.first().zip(order.last()).map(|(first, last)| (first.0, last.0)) else {
        return Err(ImportError::content(dir, "holds none of the messages that a log is made of"));
    };
    let has_depth = roles.values().any(|role| *role == Role::Depth);
    let name = dir.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let spec = RgbdSpec {
        beside: if has_depth { Beside::Depth } else { Beside::Nothing },
        depth_units_per_metre: "1000".to_owned(),
        ..RgbdSpec::new("rosbag2", &name, camera)
    };
    let mut log = RgbdLog::create(out, &LogOptions { force: options.force, ..LogOptions::default() }, &spec)?;
    let mut writer =
        Writer { camera, roles: &roles, order: &order, next: 0, waiting: BTreeMap::new(), waiting_bytes: 0 };
    let written = writer.write(files, &mut log, &mut repairs, progress).and_then(|taken| {
        let values = repairs.0.iter().map(|(what, count)| (what.clone(), count.to_string()));
        log.log().metadata(metadata::IMPORT, values.collect())?;
        Ok(taken)
    });
    let taken = match written {
        Ok(taken) => taken,
        Err(error) => {
            log.discard();
            return Err(error);
        }
    };
    let (source, log_path, log_bytes) = (dir.to_owned(), out.to_owned(), log.finish()?);
    Ok(TopicReport { source, log: log_path, log_bytes, same_bytes: false, taken, span: Some(span), repairs: repairs.0 })
}

impl Survey {
    fn of(files: &[PathBuf]) -> Result<Self, ImportError> {
        let mut survey = Self::default();
        for file in files {
            read(file, &mut |record| {
                let Record::Message(Message { topic, schema, encoding, data }) = record else { return Ok(()) };
                if encoding != "cdr" || survey.types.contains_key(topic) {
                    return Ok(());
                }
                survey.types.insert(topic.to_owned(), schema.to_owned());
                if schema == CameraInfo::SCHEMA_NAME {
                    let info = CameraInfo::decode(data);
                    let info = info.map_err(|error| ImportError::content(file, format!("{topic}: {error}")))?;
                    survey.infos.insert(topic.to_owned(), info);
                }
                Ok(())
            })?;
        }
        Ok(survey)
    }

    /// Which topics are taken for what, and the camera.
    fn roles(&self, dir: &Path, options: &BagOptions) -> Result<(BTreeMap<String, Role>, CameraModel), ImportError> {
        let image = |topic: &str, schema: &str| {
            let depth = topic.contains("depth");
            (schema == Image::SCHEMA_NAME || schema == CompressedImage::SCHEMA_NAME) && !depth
        };
        let depth = |topic: &str, schema: &str| schema == Image::SCHEMA_NAME && topic.contains("depth");
        let imu = |_: &str, schema: &str| schema == Imu::SCHEMA_NAME;
        let color = self.one(dir, "colour", "--color", options.color.as_deref(), &image)?;
        let color =
            color.ok_or_else(|| ImportError::content(dir, format!("no pictures; its topics: {}", self.names())))?;
        let depth = self.one(dir, "depth", "--depth", options.depth.as_deref(), &depth)?;
        let imu = self.one(dir, "inertial", "--imu", options.imu.as_deref(), &imu)?;
        let nothing = |_: &str, _: &str| false;
        let pose = self.one(dir, "pose", "--pose", options.pose.as_deref(), &nothing)?;
        if let Some(topic) = pose.as_ref().filter(|topic| self.types[topic.as_str()] != PoseStamped::SCHEMA_NAME) {
            let found = &self.types[topic.as_str()];
            return Err(ImportError::content(
                dir,
                format!("{topic} carries {found}, wanted {}", PoseStamped::SCHEMA_NAME),
            ));
        }
        let camera = self.camera(dir, &color, options.info.as_deref())?;
        let roles = [(Some(color), Role::Color), (depth, Role::Depth), (imu, Role::Imu), (pose, Role::Pose)];
        Ok((roles.into_iter().filter_map(|(topic, role)| Some((topic?, role))).collect(), camera))
    }

    /// The topic that was asked for, or the only one that fits.
    fn one(
        &self,
        dir: &Path,
        what: &str,
        option: &str,
        wanted: Option<&str>,
        fits: &dyn Fn(&str, &str) -> bool,
    ) -> Result<Option<String>, ImportError> {
        if let Some(wanted) = wanted {
            if self.types.contains_key(wanted) {
                return Ok(Some(wanted.to_owned()));
            }
            return Err(ImportError::content(dir, format!("no topic {wanted}; its topics: {}", self.names())));
        }
        let found: Vec<&String> = self.types.iter().filter(|(t, s)| fits(t, s)).map(|(topic, _)| topic).collect();
        match found.as_slice() {
            [] => Ok(None),
            [one] => Ok(Some((*one).clone())),
            many => {
                let names: Vec<&str> = many.iter().map(|topic| topic.as_str()).collect();
                Err(ImportError::content(dir, format!("several {what} topics, say {option}: {}", names.join(", "))))
            }
        }
    }

    /// The calibration beside the pictures (`camera_info` in the topic's own or its parent namespace).
    fn camera(&self, dir: &Path, color: &str, wanted: Option<&str>) -> Result<CameraModel, ImportError> {
        let parents = std::iter::successors(color.rsplit_once('/'), |(parent, _)| parent.rsplit_once('/'));
        let beside = parents.map(|(parent, _)| format!("{parent}/camera_info")).find(|t| self.infos.contains_key(t));
        let topic = wanted.map(str::to_owned).or(beside).or_else(|| {
            let only = self.infos.keys().next().filter(|_| self.infos.len() == 1);
            only.cloned()
        });
        let info = topic.as_ref().and_then(|topic| self.infos.get(topic));
        let info = info.ok_or_else(|| {
            ImportError::content(dir, format!("no calibration of {color}, say --info; its topics: {}", self.names()))
        })?;
        CameraModel::from_camera_info(info).map_err(|source| ImportError::Calibration { path: dir.to_owned(), source })
    }

    fn names(&self) -> String {
        self.types.keys().map(String::as_str).collect::<Vec<_>>().join(", ")
    }
}

/// The header's stamp, as far as a log can hold it.
fn stamp(data: &[u8]) -> Option<Stamp> {
    let header = Reader::new(data).and_then(|mut reader| Header::read(&mut reader)).ok()?;
    Some(Stamp::from(header.stamp)).filter(|stamp| stamp.0 >= 0)
}

/// Everything to write, in order of time, each stamp of a topic once.
fn order(
    files: &[PathBuf],
    roles: &BTreeMap<String, Role>,
    repairs: &mut Repairs,
) -> Result<Vec<(Stamp, Role)>, ImportError> {
    let mut order = BTreeSet::new();
    for file in files {
        read(file, &mut |record| {
            let Record::Message(message) = record else { return Ok(()) };
            let Some(role) = roles.get(message.topic) else {
                repairs.count(&format!("message on {} left out", message.topic));
                return Ok(());
            };
            match stamp(message.data) {
                Some(stamp) if order.insert((stamp, *role)) => {}
                Some(_) => repairs.count(&format!("repeated stamp on {} left out", message.topic)),
                None => repairs.count(&format!("message on {} without a usable stamp left out", message.topic)),
            }
            Ok(())
        })?;
    }
    Ok(order.into_iter().collect())
}

struct Writer<'a> {
    camera: CameraModel,
    roles: &'a BTreeMap<String, Role>,
    order: &'a [(Stamp, Role)],
    /// Written so far.
    next: usize,
    /// Met, but something older is still to come: type and data.
    waiting: BTreeMap<(Stamp, Role), (String, Vec<u8>)>,
    waiting_bytes: usize,
}

impl Writer<'_> {
    fn write(
        &mut self,
        files: &[PathBuf],
        log: &mut RgbdLog,
        repairs: &mut Repairs,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<BTreeMap<String, u64>, ImportError> {
        let mut taken: BTreeMap<String, u64> = BTreeMap::new();
        for file in files {
            read(file, &mut |record| {
                let Record::Message(Message { topic, schema, data, .. }) = record else { return Ok(()) };
                let (Some(role), Some(stamp)) = (self.roles.get(topic), stamp(data)) else { return Ok(()) };
                let key = (stamp, *role);
                let is_due = self.order.get(self.next).is_some_and(|next| *next <= key);
                if !is_due || self.waiting.contains_key(&key) {
                    return Ok(()); // the second one of its stamp
                }
                *taken.entry(topic.to_owned()).or_default() += 1;
                self.waiting_bytes += data.len();
                self.waiting.insert(key, (schema.to_owned(), data.to_vec()));
                if self.waiting_bytes > MOST_WAITING_BYTES {
                    let what = format!("its messages stand too far from the order of their stamps (at {stamp} s)");
                    return Err(ImportError::content(file, what));
                }
                self.write_due(file, log, repairs)?;
                progress(self.next, self.order.len());
                Ok(())
            })?;
        }
        Ok(taken)
    }

    fn write_due(&mut self, file: &Path, log: &mut RgbdLog, repairs: &mut Repairs) -> Result<(), ImportError> {
        while let Some((key, (schema, data))) = self.order.get(self.next).and_then(|key| self.waiting.remove_entry(key))
        {
            self.next += 1;
            self.waiting_bytes -= data.len();
            let (stamp, role) = key;
            log.log().flush_if_due(stamp)?;
            self.write_one(role, stamp, &schema, &data, log, repairs).map_err(|error| match error {
                Failure::Message(reason) => ImportError::content(file, format!("message at {stamp} s: {reason}")),
                Failure::Log(error) => error.into(),
            })?;
        }
        Ok(())
    }

    fn write_one(
        &self,
        role: Role,
        stamp: Stamp,
        schema: &str,
        data: &[u8],
        log: &mut RgbdLog,
        repairs: &mut Repairs,
    ) -> Result<(), Failure> {
        let wanted = (self.camera.width, self.camera.height);
        let fits = |what: &str, (width, height): (u32, u32)| {
            let same = (width, height) == wanted;
            let reason =
                format!("{what} of {width}x{height} pixels, but the calibration is for {}x{}", wanted.0, wanted.1);
            if same { Ok(()) } else { Err(Failure::Message(reason)) }
        };
        match role {
            Role::Color => {
                let picture = pixels::color(schema, data)?;
                fits("a picture", (picture.width, picture.height))?;
                log.color(stamp, picture.format, &picture.bytes)?;
            }
            Role::Depth => {
                let pixels::Depth { size, units, lost } = pixels::depth(data)?;
                fits("depth (it must be registered to colour)", size)?;
                repairs.add("depth pixel beyond 65.535 m made none", lost);
                log.depth(stamp, &units)?;
            }
            Role::Imu => log.log().write(topics::IMU, stamp, &Imu::decode(data).map_err(|e| e.to_string())?)?,
            Role::Pose => {
                let pose = PoseStamped::decode(data).map_err(|e| e.to_string())?.pose;
                let (p, q) = (pose.position, pose.orientation);
                let values = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
                let norm = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
                if values.iter().all(|v| v.is_finite()) && (0.9..=1.1).contains(&norm) {
                    log.ground_truth(stamp, [p.x, p.y, p.z], [q.x, q.y, q.z, q.w])?;
                } else {
                    repairs.count("pose without a rotation, or with NaN or infinity, left out");
                }
            }
        }
        Ok(())
    }
}

/// Why a message cannot be written.
enum Failure {
    Message(String),
    Log(crate::WriteError),
}

impl From<String> for Failure {
    fn from(reason: String) -> Self {
        Self::Message(reason)
    }
}

impl From<crate::WriteError> for Failure {
    fn from(error: crate::WriteError) -> Self {
        Self::Log(error)
    }
}
