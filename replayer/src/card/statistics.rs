//! What a log holds, in numbers.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use schemas::sync::SyncRecord;
use schemas::{Stamp, metadata};
use serde::Serialize;

use super::sheet::Sheet;
use super::{CardError, issues};
use crate::OutputFolder;
use crate::export::{ExportError, ExportOptions, ExportReport, Format, Item, Kind, Layout, Source};
use crate::log::{CheckReport, Log};

/// Numbers of one log. Shares are of all pixels, 0 to 1.
#[derive(Debug, Clone, Serialize)]
pub struct LogStatistics {
    /// File in the folder.
    pub file: String,
    /// BLAKE3 of it, as replays name their input.
    pub blake3: String,
    /// Kind of source: `recording`, `tum`, `synthetic`, ...
    pub source: String,
    /// `rgbd`, `stereo` or `monocular`.
    pub camera_kind: &'static str,
    /// Columns and rows of a picture.
    pub picture_size: [u32; 2],
    /// From the first to the last message, seconds.
    pub duration_s: f64,
    /// Colour (left) pictures.
    pub frames: usize,
    /// Pictures a second, mean.
    pub rate_hz: f64,
    /// Longest time between two pictures, seconds.
    pub largest_gap_s: f64,
    /// Pictures with a depth image.
    pub frames_with_depth: usize,
    /// Pictures with a right one.
    pub frames_with_right: usize,
    /// Depth value of one metre.
    pub depth_units_per_metre: Option<f64>,
    /// Pixels with depth.
    pub depth_coverage: Option<f64>,
    /// Ground-truth poses.
    pub ground_truth_poses: usize,
    /// Where they come from.
    pub ground_truth_origin: Option<String>,
    /// Length of the camera's path, metres.
    pub path_m: f64,
    /// Its mean speed, metres a second.
    pub mean_speed_m_s: f64,
    /// Its largest speed over a tenth of a second or more, metres a second.
    pub top_speed_m_s: f64,
    /// Inertial rows, and rows of gyroscope and accelerometer alone.
    pub inertial_messages: usize,
    /// Masks by layer.
    pub masks: BTreeMap<String, usize>,
    /// The layer that a replay reads, by category: its share, largest first; void is what no segment claims.
    pub classes: Vec<ClassShare>,
    /// Clocks and hand-eye transform, if the log tells them.
    pub sync: Option<SyncQuality>,
    /// What `pslam check` found, drop ledger included.
    pub known_issues: Vec<String>,
    /// The audit record of `pslam redact`.
    pub redaction: Option<BTreeMap<String, String>>,
    /// What was done to the log since it was first written, oldest first.
    pub edits: Vec<String>,
    /// The contact sheet's file.
    pub contact_sheet: String,
    /// The log's own words on frames and units.
    pub conventions: BTreeMap<String, String>,
    #[serde(skip)]
    rows: Vec<FrameRow>,
}

/// A category's share of a layer's pixels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ClassShare {
    /// Its name.
    pub name: String,
    /// 0 to 1.
    pub share: f64,
    /// Pictures that show it.
    pub frames: usize,
}

/// How well the clocks and the hand-eye transform are known; what was not found is absent.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SyncQuality {
    /// How they were found.
    pub method: String,
    /// Marker body that carries the camera.
    pub body: Option<String>,
    /// Mocap minus camera, milliseconds.
    pub clock_offset_ms: Option<f64>,
    /// Its standard deviation, milliseconds.
    pub clock_offset_sigma_ms: Option<f64>,
    /// Drift between the clocks, parts in a million.
    pub clock_drift_ppm: Option<f64>,
    /// Residual of the hand-eye transform, degrees and millimetres.
    pub hand_eye_residual: Option<[f64; 2]>,
}

#[derive(Debug, Clone)]
struct FrameRow {
    stamp: Stamp,
    has_depth: bool,
    has_right: bool,
    has_mask: bool,
}

/// Reads a log for its card; draws its contact sheet into the folder.
pub(super) fn of(
    path: &Path,
    findings: &CheckReport,
    folder: &OutputFolder,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<LogStatistics, CardError> {
    let log = Log::open(path)?;
    let info = log.info();
    let timeline = log.timeline(log.default_layer())?;
    let source = Source::new(&log, &ExportOptions::default())?;
    let mut tally =
        Tally { layer: log.default_layer().map(str::to_owned), sheet: Sheet::new(&source), ..Tally::default() };
    let mut report = ExportReport::new(&log, Format::Png);
    source.pass(&mut tally, folder, &mut report, progress)?;
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let contact_sheet = format!("preview/{stem}.png");
    folder.write(&contact_sheet, &std::mem::take(&mut tally.sheet).draw()?)?;
    let pictures = info.topics.iter().find(|t| t.topic.starts_with("/camera/color/image"));
    let row = |frame: &crate::log::TimelineFrame| FrameRow {
        stamp: frame.stamp,
        has_depth: frame.depth_stamp().is_some(),
        has_right: frame.right_stamp().is_some(),
        has_mask: frame.has_mask(),
    };
    let camera_kind = match (info.frames_with_depth, info.frames_with_right) {
        (1.., _) => "rgbd",
        (_, 1..) => "stereo",
        _ => "monocular",
    };
    let inertial = info.topics.iter().filter(|t| t.schema == "sensor_msgs/msg/Imu");
    let (mean_speed_m_s, top_speed_m_s) = speeds(&log);
    Ok(LogStatistics {
        file: format!("logs/{}", path.file_name().unwrap_or_default().to_string_lossy()),
        blake3: log.blake3().to_owned(),
        source: source_kind(&log),
        camera_kind,
        picture_size: [source.camera.width, source.camera.height],
        duration_s: info.duration_s,
        frames: info.frames,
        rate_hz: pictures.map_or(0.0, |t| t.rate_hz),
        largest_gap_s: pictures.map_or(0.0, |t| t.largest_gap_s),
        frames_with_depth: info.frames_with_depth,
        frames_with_right: info.frames_with_right,
        depth_units_per_metre: info.depth_units_per_metre,
        depth_coverage: (tally.depth_pixels > 0).then(|| tally.measured as f64 / tally.depth_pixels as f64),
        ground_truth_poses: log.ground_truth().poses.len(),
        ground_truth_origin: log.ground_truth_origin().map(str::to_owned),
        path_m: log.ground_truth().length_m(),
        mean_speed_m_s,
        top_speed_m_s,
        inertial_messages: inertial.map(|t| t.count).sum(),
        masks: report.masks,
        classes: tally.classes(&log),
        sync: sync(&log),
        known_issues: issues::known(findings),
        redaction: issues::redaction(&log),
        edits: issues::edits(&log),
        contact_sheet,
        conventions: conventions(&log),
        rows: timeline.frames().iter().map(row).collect(),
    })
}

/// One line a frame.
pub(super) fn frames_csv(logs: &[LogStatistics]) -> String {
    let mut text = String::from("log,index,stamp_ns,has_depth,has_right,has_mask\n");
    for log in logs {
        // Names come from file names: quoted as CSV wants it.
        let name = format!("\"{}\"", log.file.replace('"', "\"\""));
        for (index, FrameRow { stamp, has_depth, has_right, has_mask }) in log.rows.iter().enumerate() {
            text += &format!("{name},{index},{},{has_depth},{has_right},{has_mask}\n", stamp.0);
        }
    }
    text
}

fn source_kind(log: &Log) -> String {
    if log.metadata().contains_key(metadata::RECORDING) {
        return "recording".to_owned();
    }
    let source = log.metadata().get(metadata::SOURCE);
    source.and_then(|source| source.get("kind")).cloned().unwrap_or_else(|| "unknown".to_owned())
}

fn conventions(log: &Log) -> BTreeMap<String, String> {
    let words = log.metadata().get(metadata::CONVENTIONS).cloned().unwrap_or_default();
    words.into_iter().filter(|(key, _)| key != metadata::CHECKSUM_KEY).collect()
}

/// Mean and largest speed. Single steps of a fast mocap are noise: steps are a tenth of a second.
fn speeds(log: &Log) -> (f64, f64) {
    let poses = &log.ground_truth().poses;
    let seconds = |a: Stamp, b: Stamp| b.abs_diff(a) as f64 / 1e9;
    let Some((first, last)) = poses.first().zip(poses.last()).filter(|(a, b)| b.stamp > a.stamp) else {
        return (0.0, 0.0);
    };
    let (mut from, mut top) = (first, 0.0);
    for pose in poses {
        let dt = seconds(from.stamp, pose.stamp);
        if dt >= 0.1 {
            let speed = (pose.world_from_camera.translation - from.world_from_camera.translation).norm() / dt;
            top = if speed > top { speed } else { top };
            from = pose;
        }
    }
    (log.ground_truth().length_m() / seconds(first.stamp, last.stamp), top)
}

fn sync(log: &Log) -> Option<SyncQuality> {
    let record = SyncRecord::from_metadata(log.metadata().get(metadata::SYNC)?).ok()?;
    let body = record.camera_body();
    let offset = body.and_then(|body| body.offset.found());
    let hand_eye = body.and_then(|body| body.hand_eye.found());
    Some(SyncQuality {
        method: record.method.clone(),
        body: body.map(|body| body.body.clone()),
        clock_offset_ms: offset.map(|offset| offset.offset_ns as f64 / 1e6),
        clock_offset_sigma_ms: offset.map(|offset| offset.offset_sigma_ns / 1e6),
        clock_drift_ppm: offset.map(|offset| offset.drift_ppm),
        hand_eye_residual: hand_eye.map(|found| [found.rotation_residual_deg, found.translation_residual_m * 1e3]),
    })
}

/// What is counted while a log passes.
#[derive(Default)]
struct Tally {
    layer: Option<String>,
    depth_pixels: u64,
    measured: u64,
    mask_pixels: u64,
    /// By class id: pixels and pictures.
    classes: BTreeMap<u16, (u64, usize)>,
    sheet: Sheet,
}

impl Layout for Tally {
    fn holds(&self, kind: Kind) -> bool {
        matches!(kind, Kind::Color | Kind::Depth | Kind::Mask)
    }

    fn take(&mut self, item: Item<'_>, _: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        match item {
            Item::Color(stamp, image) => self.sheet.color(stamp, &image, source)?,
            Item::Depth(stamp, units) => {
                self.depth_pixels += units.len() as u64;
                self.measured += units.iter().filter(|unit| **unit > 0).count() as u64;
                self.sheet.depth(stamp, &units, source);
            }
            Item::Mask(layer, stamp, mask) if self.layer.as_deref() == Some(layer) => {
                self.mask_pixels += mask.class.len() as u64;
                for id in &mask.class {
                    self.classes.entry(*id).or_default().0 += 1;
                }
                for id in mask.class.iter().collect::<BTreeSet<_>>() {
                    self.classes.entry(*id).or_default().1 += 1;
                }
                self.sheet.mask(stamp, &mask.class, source);
            }
            _ => {}
        }
        Ok(())
    }

    fn finish(&mut self, _: &OutputFolder, _: &Source<'_>) -> Result<(), ExportError> {
        Ok(())
    }
}

impl Tally {
    fn classes(&self, log: &Log) -> Vec<ClassShare> {
        let categories = self.layer.as_deref().map(|layer| log.categories(layer)).unwrap_or_default();
        let name = |id: u16| match categories.iter().find(|category| category.id == id) {
            Some(category) => category.name.clone(),
            None if id == schemas::panoptic::VOID_CLASS => "void".to_owned(),
            None => format!("class {id}"),
        };
        let mut counts: Vec<(u16, u64, usize)> =
            self.classes.iter().map(|(id, (n, frames))| (*id, *n, *frames)).collect();
        counts.sort_by_key(|(id, pixels, _)| (std::cmp::Reverse(*pixels), *id));
        let share = |(id, pixels, frames): (u16, u64, usize)| ClassShare {
            name: name(id),
            share: pixels as f64 / self.mask_pixels as f64,
            frames,
        };
        counts.into_iter().map(share).collect()
    }
}
