//! What data set folders of pictures have in common: one or two cameras, inertial rows, poses, labels.

use super::coco::Labels;
use super::lists::{ListedFile, PoseRow};
use super::tum::match_labels;
use super::{ImportError, PanopticSource, Repairs, SequenceReport, read_file};
use crate::log_writer::{LogOptions, WriteError};
use crate::picture::{ColorFile, gray_or_color_file};
use crate::rgbd::{Beside, RgbdLog, RgbdSpec};
use schemas::calibration::CameraModel;
use schemas::msg::{Header, Imu, Vector3};
use schemas::stereo::StereoModel;
use schemas::topics::{self, frame};
use schemas::{Stamp, metadata, pairing};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Pictures of a pair are taken at once; nearer than this they are one frame.
const PAIR_TOLERANCE_NS: u64 = 1_000_000;

/// One row of an inertial sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuRow {
    /// Its time.
    pub stamp: Stamp,
    /// rad/s.
    pub turn_rate: [f64; 3],
    /// m/s^2, gravity included.
    pub acceleration: [f64; 3],
}

/// What the text files of a folder tell; pictures are still on the disk.
pub struct Sequence {
    /// Kind of the folder: `euroc`, `kitti`.
    pub kind: &'static str,
    /// The folder.
    pub dir: PathBuf,
    /// Name of the sequence.
    pub name: String,
    /// Left (or only) camera as it records.
    pub camera: CameraModel,
    /// Left pictures in order of time; paths are whole.
    pub left: Vec<ListedFile>,
    /// The right camera and its pictures.
    pub right: Option<(StereoModel, Vec<ListedFile>)>,
    /// Inertial rows in order of time.
    pub imu: Vec<ImuRow>,
    /// `world_from_left_camera` in order of time.
    pub poses: Vec<PoseRow>,
    /// Where the poses come from, in words.
    pub truth_origin: String,
    /// Files to attach: name in the log and path.
    pub attachments: Vec<(String, PathBuf)>,
}

/// One thing to write. Declared in the order in which equal stamps are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    Pose(usize),
    Imu(usize),
    Left(usize),
    Right(usize),
    Mask { layer: usize, entry: usize },
}

/// Annotations of a layer, and which of them belongs to which left picture.
type Matched = (Labels, Vec<(usize, usize)>);

impl Sequence {
    /// Writes the log and says what is in it.
    pub fn write(
        &self,
        out: &Path,
        panoptic: &[PanopticSource],
        force: bool,
        mut repairs: Repairs,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<SequenceReport, ImportError> {
        let mut labels: Vec<Matched> = Vec::new();
        for source in panoptic {
            labels.push(match_labels(Labels::open(source)?, &self.left, &mut repairs));
        }
        let events = self.events(&labels);
        let Some(span) = events.first().zip(events.last()).map(|(first, last)| (first.0, last.0)) else {
            return Err(ImportError::content(&self.dir, "lists no pictures: nothing to import"));
        };
        let options = LogOptions { force, ..LogOptions::default() };
        let mut log = RgbdLog::create(out, &options, &self.spec(&labels))?;
        let written = self.write_events(&mut log, &events, &labels, &mut repairs, progress);
        if let Err(error) = written.and_then(|()| self.write_findings(&mut log, &repairs)) {
            log.discard();
            return Err(error);
        }
        Ok(SequenceReport {
            source: self.dir.clone(),
            log: out.to_owned(),
            log_bytes: log.finish()?,
            pictures: self.left.len(),
            right_pictures: self.right.as_ref().map_or(0, |(_, files)| files.len()),
            paired: self.paired(),
            imu_rows: self.imu.len(),
            ground_truth_poses: self.poses.len(),
            ground_truth_origin: self.truth_origin.clone(),
            masks: labels.iter().map(|(labels, matched)| (labels.layer.name.clone(), matched.len())).collect(),
            span,
            camera: self.camera,
            baseline_m: self.right.as_ref().map(|(stereo, _)| stereo.baseline_m()),
            repairs: repairs.0,
        })
    }

    fn spec(&self, labels: &[Matched]) -> RgbdSpec {
        RgbdSpec {
            beside: self.right.as_ref().map_or(Beside::Nothing, |(stereo, _)| Beside::Right(*stereo)),
            tolerance_ns: PAIR_TOLERANCE_NS,
            layers: labels.iter().map(|(labels, _)| labels.layer.clone()).collect(),
            ..RgbdSpec::new(self.kind, &self.name, self.camera)
        }
    }

    /// Pictures of both cameras that were taken at once.
    fn paired(&self) -> usize {
        let stamps = |files: &[ListedFile]| files.iter().map(|file| file.stamp).collect::<Vec<_>>();
        let pairs = |(_, right): &(StereoModel, Vec<ListedFile>)| {
            pairing::associate(&stamps(&self.left), &stamps(right), PAIR_TOLERANCE_NS).len()
        };
        self.right.as_ref().map_or(0, pairs)
    }

    /// Everything to write, in order of time.
    fn events(&self, labels: &[Matched]) -> Vec<(Stamp, Event)> {
        let mut events: Vec<(Stamp, Event)> = Vec::new();
        events.extend(self.poses.iter().enumerate().map(|(i, row)| (row.stamp, Event::Pose(i))));
        events.extend(self.imu.iter().enumerate().map(|(i, row)| (row.stamp, Event::Imu(i))));
        events.extend(self.left.iter().enumerate().map(|(i, file)| (file.stamp, Event::Left(i))));
        let right = self.right.iter().flat_map(|(_, files)| files);
        events.extend(right.enumerate().map(|(i, file)| (file.stamp, Event::Right(i))));
        for (layer, (_, matched)) in labels.iter().enumerate() {
            let masks = matched.iter().enumerate();
            events.extend(masks.map(|(entry, (picture, _))| (self.left[*picture].stamp, Event::Mask { layer, entry })));
        }
        events.sort_unstable();
        events
    }

    fn write_events(
        &self,
        log: &mut RgbdLog,
        events: &[(Stamp, Event)],
        labels: &[Matched],
        repairs: &mut Repairs,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<(), ImportError> {
        for (name, path) in &self.attachments {
            log.log().attach(name, "text/plain", events[0].0, &read_file(path, "")?)?;
        }
        for (done, (stamp, event)) in events.iter().enumerate() {
            log.log().flush_if_due(*stamp)?;
            match *event {
                Event::Pose(i) => log.ground_truth(*stamp, self.poses[i].translation, self.poses[i].quaternion)?,
                Event::Imu(i) => log.log().write(topics::IMU, *stamp, &self.imu[i].message()?)?,
                Event::Left(i) => {
                    let picture = read_picture(&self.left[i], &self.camera, repairs)?;
                    log.color(*stamp, picture.format, &picture.bytes)?;
                }
                Event::Right(i) => {
                    let Some((stereo, files)) = &self.right else { continue };
                    let picture = read_picture(&files[i], &stereo.right, repairs)?;
                    log.right(*stamp, picture.format, &picture.bytes)?;
                }
                Event::Mask { layer, entry } => {
                    let (labels, matched) = &labels[layer];
                    let size = (self.camera.width, self.camera.height);
                    log.mask(layer, *stamp, &labels.mask(matched[entry].1, size, repairs)?)?;
                }
            }
            progress(done + 1, events.len());
        }
        Ok(())
    }

    /// What is only known at the end.
    fn write_findings(&self, log: &mut RgbdLog, repairs: &Repairs) -> Result<(), ImportError> {
        let mut values: BTreeMap<String, String> = BTreeMap::new();
        values.insert("ground_truth".to_owned(), self.truth_origin.clone());
        if let Some((_, right)) = &self.right {
            let paired = self.paired();
            values.insert("paired".to_owned(), paired.to_string());
            values.insert("unpaired_left".to_owned(), (self.left.len() - paired).to_string());
            values.insert("unpaired_right".to_owned(), (right.len() - paired).to_string());
        }
        values.extend(repairs.0.iter().map(|(what, count)| (what.clone(), count.to_string())));
        Ok(log.log().metadata(metadata::IMPORT, values)?)
    }
}

impl ImuRow {
    /// As a log holds it.
    pub fn message(&self) -> Result<Imu, ImportError> {
        let vector = |[x, y, z]: [f64; 3]| Vector3 { x, y, z };
        let header = Header::new(self.stamp, frame::IMU).map_err(WriteError::from)?;
        let mut imu = Imu { header, ..Imu::default() };
        imu.orientation_covariance[0] = -1.0;
        imu.angular_velocity = vector(self.turn_rate);
        imu.linear_acceleration = vector(self.acceleration);
        Ok(imu)
    }
}

/// Reads and checks a picture; it must have the calibration's size.
pub fn read_picture(file: &ListedFile, camera: &CameraModel, repairs: &mut Repairs) -> Result<ColorFile, ImportError> {
    let path = Path::new(&file.path);
    let bytes = read_file(path, " (named in the folder's list of pictures)")?;
    let picture = gray_or_color_file(bytes).map_err(|source| ImportError::Picture { path: path.to_owned(), source })?;
    let (width, height) = (picture.width, picture.height);
    if (width, height) != (camera.width, camera.height) {
        let message = format!("{width}x{height} pixels, but the calibration is for {}x{}", camera.width, camera.height);
        return Err(ImportError::content(path, message));
    }
    if picture.reencoded {
        repairs.count("picture that is neither 8-bit grey nor RGB written as RGB");
    }
    Ok(picture)
}

/// Size of a picture file.
pub fn picture_size(path: &Path) -> Result<(u32, u32), ImportError> {
    let picture = gray_or_color_file(read_file(path, "")?);
    let picture = picture.map_err(|source| ImportError::Picture { path: path.to_owned(), source })?;
    Ok((picture.width, picture.height))
}
