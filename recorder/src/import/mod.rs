//! Data set folders and vendors' recordings to logs. Nothing is lost: every picture, every ground-truth row, stamps to the
//! nanosecond; what had to be repaired or left out is counted in the report and in the log.

mod bag;
mod camera_file;
mod coco;
mod euroc;
mod kitti;
mod lists;
mod plain;
mod realsense;
mod sequence;
mod tum;

pub use bag::{BagOptions, TopicReport, rosbag2};
pub(crate) use coco::Labels;
pub use euroc::{EurocOptions, TruthOf, euroc};
pub use kitti::{KittiOptions, kitti};
pub use plain::png;
pub use realsense::{RealsenseReport, realsense};
pub use tum::tum;

use crate::log_writer::WriteError;
use crate::picture::PictureError;
use crate::realsense::CameraError;
use schemas::calibration::{CalibrationError, CameraModel, Preset};
use schemas::{Stamp, pairing, topics};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A larger file is refused rather than read into memory.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// Where intrinsics come from.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum CameraSource {
    /// `camera.json`, `camera.yaml` or `camera.yml` in the folder, else the preset that the folder's name tells
    /// (`freiburg1`, `freiburg2`, `freiburg3`, `rgbd_bonn`).
    #[default]
    Auto,
    /// A JSON or YAML file: flat keys (`fx`, `k1`), ORB-SLAM style (`Camera.fx`) or a ROS camera calibration.
    File(PathBuf),
    /// A published calibration.
    Preset(Preset),
    /// Numbers given by the user.
    Model(CameraModel),
}

/// COCO panoptic labels to import as a segmentation layer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PanopticSource {
    /// Folder of the PNG files.
    pub dir: PathBuf,
    /// The JSON file; by default `DIR.json`, `DIR/panoptic.json` or `DIR/../panoptic.json`, the first that exists.
    pub json: Option<PathBuf>,
    /// Layer name in the log.
    pub layer: String,
}

impl PanopticSource {
    /// Labels in `dir` as the layer that the SLAM reads.
    #[must_use]
    pub fn new(dir: &Path) -> Self {
        Self { dir: dir.to_owned(), json: None, layer: topics::DEFAULT_LAYER.to_owned() }
    }
}

/// How to import a TUM-style folder.
#[derive(Debug, Clone)]
pub struct TumOptions {
    /// Intrinsics.
    pub camera: CameraSource,
    /// Depth value of one metre as decimal text. None: the calibration file's (`depth_scale`, `DepthMapFactor`), else 5000.
    pub depth_units_per_metre: Option<String>,
    /// Colour and depth closer than this are one frame; nanoseconds.
    pub tolerance_ns: u64,
    /// Segmentation layers.
    pub panoptic: Vec<PanopticSource>,
    /// Replace an existing log.
    pub force: bool,
}

impl Default for TumOptions {
    fn default() -> Self {
        let tolerance_ns = pairing::DEFAULT_TOLERANCE_NS;
        Self {
            camera: CameraSource::Auto,
            depth_units_per_metre: None,
            tolerance_ns,
            panoptic: Vec::new(),
            force: false,
        }
    }
}

/// How colour and depth went together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct PairingReport {
    /// Pairs are closer than this; nanoseconds.
    pub tolerance_ns: u64,
    /// Pairs.
    pub paired: usize,
    /// Colour pictures without depth.
    pub unpaired_color: usize,
    /// Depth images without colour.
    pub unpaired_depth: usize,
    /// Largest distance within a pair, nanoseconds.
    pub largest_gap_ns: u64,
}

impl PairingReport {
    fn new(color: &[Stamp], depth: &[Stamp], tolerance_ns: u64) -> Self {
        let pairs = pairing::associate(color, depth, tolerance_ns);
        let gaps = pairs.iter().map(|(c, d)| color[*c].abs_diff(depth[*d]));
        Self {
            tolerance_ns,
            paired: pairs.len(),
            unpaired_color: color.len() - pairs.len(),
            unpaired_depth: depth.len() - pairs.len(),
            largest_gap_ns: gaps.max().unwrap_or(0),
        }
    }
}

/// What an import did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportReport {
    /// The folder.
    pub source: PathBuf,
    /// The log.
    pub log: PathBuf,
    /// Its size.
    pub log_bytes: u64,
    /// Colour pictures in the log.
    pub color_images: usize,
    /// Depth images in the log.
    pub depth_images: usize,
    /// Ground-truth poses in the log.
    pub ground_truth_poses: usize,
    /// Masks in the log, by layer.
    pub masks: BTreeMap<String, usize>,
    /// First and last stamp of all messages.
    pub span: (Stamp, Stamp),
    /// Colour and depth.
    pub pairing: PairingReport,
    /// The calibration.
    pub camera: CameraModel,
    /// Where it came from, in words.
    pub camera_origin: String,
    /// Depth value of one metre.
    pub depth_units_per_metre: String,
    /// What was repaired or left out, with counts; empty = nothing.
    pub repairs: BTreeMap<String, u64>,
}

impl fmt::Display for ImportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let p = &self.pairing;
        let ms = |ns: u64| ns as f64 / 1e6;
        writeln!(f, "log            {} ({:.1} MB)", self.log.display(), self.log_bytes as f64 / 1e6)?;
        writeln!(f, "time           {} .. {} s", self.span.0, self.span.1)?;
        writeln!(f, "colour         {} pictures {}x{}", self.color_images, self.camera.width, self.camera.height)?;
        writeln!(f, "depth          {} images, {} per metre", self.depth_images, self.depth_units_per_metre)?;
        write!(f, "pairs          {} nearer than {} ms", p.paired, ms(p.tolerance_ns))?;
        write!(f, " ({} colour, {} depth alone; ", p.unpaired_color, p.unpaired_depth)?;
        writeln!(f, "largest gap {:.3} ms)", ms(p.largest_gap_ns))?;
        writeln!(f, "ground truth   {} poses", self.ground_truth_poses)?;
        for (layer, masks) in &self.masks {
            writeln!(f, "segmentation   {masks} masks in layer {layer}")?;
        }
        let c = &self.camera;
        writeln!(f, "calibration    fx {} fy {} cx {} cy {}, {}", c.fx, c.fy, c.cx, c.cy, self.camera_origin)?;
        for (what, count) in &self.repairs {
            writeln!(f, "repaired       {count} x {what}")?;
        }
        Ok(())
    }
}

/// What the import of a sequence of one or two cameras did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SequenceReport {
    /// The folder.
    pub source: PathBuf,
    /// The log.
    pub log: PathBuf,
    /// Its size.
    pub log_bytes: u64,
    /// Left (or only) pictures in the log.
    pub pictures: usize,
    /// Right pictures in the log.
    pub right_pictures: usize,
    /// Pictures of both cameras that were taken at once.
    pub paired: usize,
    /// Inertial rows in the log.
    pub imu_rows: usize,
    /// Ground-truth poses in the log.
    pub ground_truth_poses: usize,
    /// Where they come from, in words.
    pub ground_truth_origin: String,
    /// Masks in the log, by layer.
    pub masks: BTreeMap<String, usize>,
    /// First and last stamp of all messages.
    pub span: (Stamp, Stamp),
    /// The left camera as it records.
    pub camera: CameraModel,
    /// Distance of the two cameras.
    pub baseline_m: Option<f64>,
    /// What was repaired or left out, with counts; empty = nothing.
    pub repairs: BTreeMap<String, u64>,
}

impl fmt::Display for SequenceReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "log            {} ({:.1} MB)", self.log.display(), self.log_bytes as f64 / 1e6)?;
        writeln!(f, "time           {} .. {} s", self.span.0, self.span.1)?;
        writeln!(f, "pictures       {} of {}x{}", self.pictures, self.camera.width, self.camera.height)?;
        if let Some(baseline) = self.baseline_m {
            let (right, paired) = (self.right_pictures, self.paired);
            writeln!(f, "right camera   {right} pictures, {paired} pairs, baseline {baseline:.4} m")?;
        }
        writeln!(f, "inertial       {} rows", self.imu_rows)?;
        writeln!(f, "ground truth   {} poses ({})", self.ground_truth_poses, self.ground_truth_origin)?;
        for (layer, masks) in &self.masks {
            writeln!(f, "segmentation   {masks} masks in layer {layer}")?;
        }
        let c = &self.camera;
        writeln!(f, "calibration    fx {} fy {} cx {} cy {}", c.fx, c.fy, c.cx, c.cy)?;
        for (what, count) in &self.repairs {
            writeln!(f, "repaired       {count} x {what}")?;
        }
        Ok(())
    }
}

/// Why a folder cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file is missing or unreadable.
    #[error("{}: {source}{hint}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The file system's answer.
        source: std::io::Error,
        /// What to do.
        hint: String,
    },
    /// A line of a text file cannot be read.
    #[error("{} line {line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// A picture file is unusable.
    #[error("{}: {source}", path.display())]
    Picture {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: PictureError,
    },
    /// A file's content contradicts another's.
    #[error("{}: {message}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        message: String,
    },
    /// No usable calibration.
    #[error("{}: {source}", path.display())]
    Calibration {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: CalibrationError,
    },
    /// librealsense cannot read it.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// The library's answer.
        source: CameraError,
    },
    /// The log cannot be written.
    #[error("{0}")]
    Write(#[from] WriteError),
}

impl ImportError {
    fn content(path: &Path, message: impl Into<String>) -> Self {
        Self::Content { path: path.to_owned(), message: message.into() }
    }
}

/// Reads a file whole, up to [`MAX_FILE_BYTES`].
fn read_file(path: &Path, hint: &str) -> Result<Vec<u8>, ImportError> {
    let io_error = |source| ImportError::Io { path: path.to_owned(), source, hint: hint.to_owned() };
    let mut bytes = Vec::new();
    let file = fs::File::open(path).map_err(io_error)?;
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(io_error)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImportError::content(path, format!("larger than {MAX_FILE_BYTES} bytes")));
    }
    Ok(bytes)
}

fn read_text(path: &Path, hint: &str) -> Result<String, ImportError> {
    let text = String::from_utf8(read_file(path, hint)?);
    let text = text.map_err(|_| ImportError::content(path, "not a UTF-8 text file"))?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// Counts what was repaired, by description.
#[derive(Debug, Default)]
pub(crate) struct Repairs(BTreeMap<String, u64>);

impl Repairs {
    fn count(&mut self, what: &str) {
        self.add(what, 1);
    }

    fn add(&mut self, what: &str, times: u64) {
        if times > 0 {
            *self.0.entry(what.to_owned()).or_default() += times;
        }
    }
}
