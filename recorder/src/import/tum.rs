//! Folders in the layout of the TUM RGB-D benchmark, which Bonn RGB-D Dynamic and OpenLORIS share.

use super::camera_file::{self, CameraFile};
use super::coco::Labels;
use super::lists::{self, ListedFile, PoseRow};
use super::{CameraSource, ImportError, ImportReport, PairingReport, Repairs, TumOptions, read_file};
use crate::log_writer::LogOptions;
use crate::picture::{ColorFile, color_file, decode_gray16};
use crate::rgbd::{RgbdLog, RgbdSpec};
use schemas::calibration::Preset;
use schemas::{Stamp, metadata};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Lists of colour pictures (OpenLORIS; TUM and Bonn). The last one is asked for when none is there.
const COLOR_LISTS: &[&str] = &["color.txt", "rgb.txt"];
/// Lists of depth images: registered depth first (OpenLORIS has both).
const DEPTH_LISTS: &[&str] = &["aligned_depth.txt", "depth.txt"];
const GROUND_TRUTH: &str = "groundtruth.txt";
const DEFAULT_UNITS_PER_METRE: &str = "5000";
const CAMERA_FILES: &[&str] = &["camera.json", "camera.yaml", "camera.yml"];
/// Parts of folder names that tell the camera.
const NAMED_PRESETS: &[(&str, Preset)] = &[
    ("freiburg1", Preset::Freiburg1),
    ("freiburg2", Preset::Freiburg2),
    ("freiburg3", Preset::Freiburg3),
    ("rgbd_bonn", Preset::Bonn),
];

/// Imports a folder into a log at `out`. `progress` hears (messages done, messages in all) of pictures, masks and poses.
///
/// # Errors
/// A missing, damaged or contradicting file, named with its line or numbers; or the log cannot be written. The unfinished
/// log is then removed.
pub fn tum(
    dir: &Path,
    out: &Path,
    options: &TumOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<ImportReport, ImportError> {
    let mut repairs = Repairs::default();
    let folder = Folder::read(dir, options, &mut repairs)?;
    let events = folder.events();
    let Some(span) = events.first().zip(events.last()).map(|(first, last)| (first.0, last.0)) else {
        return Err(ImportError::content(dir, "its lists are empty: nothing to import"));
    };
    let log_options = LogOptions { force: options.force, ..LogOptions::default() };
    let mut log = RgbdLog::create(out, &log_options, &folder.spec)?;
    let written = folder.write(&mut log, &events, &mut repairs, progress);
    let written = written.and_then(|()| folder.write_findings(&mut log, &repairs));
    if let Err(error) = written {
        log.discard();
        return Err(error);
    }
    let log_bytes = log.finish()?;
    let masks = folder.labels.iter().map(|labels| (labels.0.layer.name.clone(), labels.1.len()));
    Ok(ImportReport {
        source: dir.to_owned(),
        log: out.to_owned(),
        log_bytes,
        color_images: folder.color.len(),
        depth_images: folder.depth.len(),
        ground_truth_poses: folder.poses.len(),
        masks: masks.collect(),
        span,
        pairing: folder.pairing,
        camera: folder.spec.camera,
        camera_origin: folder.camera_origin,
        depth_units_per_metre: folder.spec.depth_units_per_metre,
        repairs: repairs.0,
    })
}

/// What the text files of a folder tell; pictures are still on the disk.
struct Folder {
    dir: PathBuf,
    color: Vec<ListedFile>,
    depth: Vec<ListedFile>,
    poses: Vec<PoseRow>,
    /// Labels, and which annotation belongs to which colour picture (picture index, annotation index).
    labels: Vec<(Labels, Vec<(usize, usize)>)>,
    pairing: PairingReport,
    camera_origin: String,
    camera_path: Option<PathBuf>,
    spec: RgbdSpec,
}

/// One thing to write. Declared in the order in which equal stamps are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Event {
    Pose(usize),
    Color(usize),
    Depth(usize),
    Mask { layer: usize, entry: usize },
}

impl Folder {
    fn read(dir: &Path, options: &TumOptions, repairs: &mut Repairs) -> Result<Self, ImportError> {
        let color_list = first_existing(dir, COLOR_LISTS);
        let depth_list = first_existing(dir, DEPTH_LISTS);
        let hint = " (a TUM-style folder has rgb.txt and depth.txt)";
        let color = lists::files(&color_list, hint, repairs)?;
        let depth = lists::files(&depth_list, hint, repairs)?;
        let Some(first) = color.first() else {
            return Err(ImportError::content(&color_list, "lists no pictures"));
        };
        let truth = dir.join(GROUND_TRUTH);
        let poses = if truth.exists() { lists::poses(&truth, repairs)? } else { Vec::new() };
        let first_picture = read_color(dir, first)?;
        let size = (first_picture.width, first_picture.height);
        let (file, camera_origin, camera_path) = find_camera(dir, &options.camera, size)?;
        let mut labels = Vec::new();
        for source in &options.panoptic {
            labels.push(match_labels(Labels::open(source)?, &color, repairs));
        }
        let name = dir.canonicalize().unwrap_or_else(|_| dir.to_owned());
        let name = name.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let units = options.depth_units_per_metre.clone().or(file.depth_units_per_metre);
        let spec = RgbdSpec {
            depth_units_per_metre: units.unwrap_or_else(|| DEFAULT_UNITS_PER_METRE.to_owned()),
            tolerance_ns: options.tolerance_ns,
            layers: labels.iter().map(|(labels, _)| labels.layer.clone()).collect(),
            ..RgbdSpec::new("tum", &name, file.camera)
        };
        let pairing = PairingReport::new(&stamps(&color), &stamps(&depth), options.tolerance_ns);
        let dir = dir.to_owned();
        Ok(Self { dir, color, depth, poses, labels, pairing, camera_origin, camera_path, spec })
    }

    /// Everything to write, in order of time.
    fn events(&self) -> Vec<(Stamp, Event)> {
        let mut events: Vec<(Stamp, Event)> = Vec::new();
        events.extend(self.poses.iter().enumerate().map(|(i, row)| (row.stamp, Event::Pose(i))));
        events.extend(self.color.iter().enumerate().map(|(i, row)| (row.stamp, Event::Color(i))));
        events.extend(self.depth.iter().enumerate().map(|(i, row)| (row.stamp, Event::Depth(i))));
        for (layer, (_, matched)) in self.labels.iter().enumerate() {
            let masks = matched.iter().enumerate();
            events
                .extend(masks.map(|(entry, (picture, _))| (self.color[*picture].stamp, Event::Mask { layer, entry })));
        }
        events.sort_unstable();
        events
    }

    fn write(
        &self,
        log: &mut RgbdLog,
        events: &[(Stamp, Event)],
        repairs: &mut Repairs,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<(), ImportError> {
        if let (Some(path), Some((stamp, _))) = (&self.camera_path, events.first()) {
            let name = format!("calibration/{}", path.file_name().unwrap_or_default().to_string_lossy());
            log.log().attach(&name, "text/plain", *stamp, &read_file(path, "")?)?;
        }
        for (done, (stamp, event)) in events.iter().enumerate() {
            log.log().flush_if_due(*stamp)?;
            match *event {
                Event::Pose(i) => log.ground_truth(*stamp, self.poses[i].translation, self.poses[i].quaternion)?,
                Event::Color(i) => self.write_color(log, &self.color[i], repairs)?,
                Event::Depth(i) => self.write_depth(log, &self.depth[i])?,
                Event::Mask { layer, entry } => {
                    let (labels, matched) = &self.labels[layer];
                    let size = (self.spec.camera.width, self.spec.camera.height);
                    log.mask(layer, *stamp, &labels.mask(matched[entry].1, size, repairs)?)?;
                }
            }
            progress(done + 1, events.len());
        }
        Ok(())
    }

    fn write_color(&self, log: &mut RgbdLog, file: &ListedFile, repairs: &mut Repairs) -> Result<(), ImportError> {
        let picture = read_color(&self.dir, file)?;
        self.check_size(file, (picture.width, picture.height))?;
        if picture.reencoded {
            repairs.count("colour PNG that is not 8-bit RGB written as RGB");
        }
        Ok(log.color(file.stamp, picture.format, &picture.bytes)?)
    }

    fn write_depth(&self, log: &mut RgbdLog, file: &ListedFile) -> Result<(), ImportError> {
        let path = self.dir.join(&file.path);
        let decoded = decode_gray16(&read_file(&path, " (named in the depth list)")?);
        let (width, height, pixels) = decoded.map_err(|source| ImportError::Picture { path, source })?;
        self.check_size(file, (width, height))?;
        Ok(log.depth(file.stamp, &pixels)?)
    }

    fn check_size(&self, file: &ListedFile, (width, height): (u32, u32)) -> Result<(), ImportError> {
        let camera = &self.spec.camera;
        if (width, height) == (camera.width, camera.height) {
            return Ok(());
        }
        let message = format!(
            "{width}x{height} pixels, but the calibration ({}) is for {}x{}: colour and registered depth must have its size",
            self.camera_origin, camera.width, camera.height
        );
        Err(ImportError::content(&self.dir.join(&file.path), message))
    }

    /// What is only known at the end: pairing counts and repairs.
    fn write_findings(&self, log: &mut RgbdLog, repairs: &Repairs) -> Result<(), ImportError> {
        let p = &self.pairing;
        let counts = [
            ("paired", p.paired as u64),
            ("unpaired_color", p.unpaired_color as u64),
            ("unpaired_depth", p.unpaired_depth as u64),
            ("largest_gap_ns", p.largest_gap_ns),
        ];
        let mut values: BTreeMap<String, String> =
            counts.into_iter().map(|(key, value)| (key.to_owned(), value.to_string())).collect();
        values.insert("camera".to_owned(), self.camera_origin.clone());
        values.extend(repairs.0.iter().map(|(what, count)| (what.clone(), count.to_string())));
        Ok(log.log().metadata(metadata::IMPORT, values)?)
    }
}

fn stamps(files: &[ListedFile]) -> Vec<Stamp> {
    files.iter().map(|file| file.stamp).collect()
}

/// The first of the names that exists in the folder, else the last one, for the error message.
fn first_existing(dir: &Path, names: &[&str]) -> PathBuf {
    let mut paths = names.iter().map(|name| dir.join(name));
    paths.find(|path| path.exists()).unwrap_or_else(|| dir.join(names[names.len() - 1]))
}

fn read_color(dir: &Path, file: &ListedFile) -> Result<ColorFile, ImportError> {
    let path = dir.join(&file.path);
    let bytes = read_file(&path, " (named in the colour list)")?;
    color_file(bytes).map_err(|source| ImportError::Picture { path, source })
}

/// Finds annotations for the pictures; pictures without one and annotations without picture are counted.
pub fn match_labels(labels: Labels, color: &[ListedFile], repairs: &mut Repairs) -> (Labels, Vec<(usize, usize)>) {
    let found = color.iter().enumerate().filter_map(|(i, file)| Some((i, labels.find(&file.path)?)));
    let matched: Vec<(usize, usize)> = found.collect();
    let name = &labels.layer.name;
    repairs.add(&format!("colour picture without a mask in layer {name}"), (color.len() - matched.len()) as u64);
    let unused = labels.len().saturating_sub(matched.len());
    repairs.add(&format!("mask of layer {name} without a colour picture left out"), unused as u64);
    (labels, matched)
}

/// The calibration, where it came from in words, and its file if it is one.
fn find_camera(
    dir: &Path,
    source: &CameraSource,
    size: (u32, u32),
) -> Result<(CameraFile, String, Option<PathBuf>), ImportError> {
    let from_file = |path: PathBuf| -> Result<_, ImportError> {
        let file = camera_file::read(&path, size)?;
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok((file, format!("file {name}"), Some(path)))
    };
    let from_preset = |preset: Preset| {
        let name = Preset::ALL.iter().find(|(_, known)| *known == preset).map_or("", |(name, _)| *name);
        (CameraFile { camera: preset.camera(), depth_units_per_metre: None }, format!("preset {name}"), None)
    };
    match source {
        CameraSource::File(path) => from_file(path.clone()),
        CameraSource::Preset(preset) => Ok(from_preset(*preset)),
        CameraSource::Model(camera) => {
            Ok((CameraFile { camera: *camera, depth_units_per_metre: None }, "given by the user".to_owned(), None))
        }
        CameraSource::Auto => {
            if let Some(path) = CAMERA_FILES.iter().map(|name| dir.join(name)).find(|path| path.exists()) {
                return from_file(path);
            }
            let name = dir.canonicalize().unwrap_or_else(|_| dir.to_owned()).to_string_lossy().into_owned();
            let preset = NAMED_PRESETS.iter().find(|(part, _)| name.contains(part));
            preset.map(|(_, preset)| from_preset(*preset)).ok_or_else(|| {
                let message = "no camera.json or camera.yaml, and the name tells no known camera: \
                               give a calibration file, a preset (freiburg1-3, bonn) or the numbers";
                ImportError::content(dir, message)
            })
        }
    }
}
