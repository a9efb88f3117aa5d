//! What an export wrote and what it had to leave out.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use schemas::{Stamp, metadata};
use serde::Serialize;

use super::Format;
use crate::log::Log;

/// Version of the JSON form.
const VERSION: u32 = 1;

/// What stands in a folder, where it came from, and what the format could not hold.
#[derive(Debug, Clone, Serialize)]
pub struct ExportReport {
    /// Version of this form; grows when a field changes its meaning.
    pub version: u32,
    /// Writing program.
    pub program: String,
    /// The folder; not part of the file in it, whose bytes depend on the log alone.
    #[serde(skip)]
    pub folder: PathBuf,
    /// Kind of the folder.
    pub format: Format,
    /// The log's file name.
    pub log: String,
    /// BLAKE3 of the log.
    pub log_blake3: String,
    /// Colour (left) pictures.
    pub pictures: usize,
    /// Right pictures.
    pub right_pictures: usize,
    /// Depth images.
    pub depth_images: usize,
    /// Depth value of one metre in the folder.
    pub depth_units_per_metre: Option<f64>,
    /// Colour and depth (left and right) closer than this are one frame, nanoseconds.
    pub pairing_tolerance_ns: u64,
    /// Ground-truth poses.
    pub ground_truth_poses: usize,
    /// Where they come from, in words.
    pub ground_truth_origin: Option<String>,
    /// Inertial rows.
    pub imu_rows: usize,
    /// Masks by layer.
    pub masks: BTreeMap<String, usize>,
    /// First and last picture, nanoseconds.
    pub span_ns: Option<(Stamp, Stamp)>,
    /// Messages that the format (or the options) left out, by topic or reason.
    pub left_out: BTreeMap<String, usize>,
    /// What a reader should know.
    pub notes: Vec<String>,
    /// The log's own words about itself: source, conventions, devices, clocks.
    pub log_metadata: BTreeMap<String, BTreeMap<String, String>>,
}

impl ExportReport {
    pub(crate) fn new(log: &Log, format: Format) -> Self {
        let words = log.metadata().iter().filter(|(name, _)| !name.starts_with(metadata::CHANNEL_PREFIX));
        Self {
            version: VERSION,
            program: concat!("pslam ", env!("CARGO_PKG_VERSION")).to_owned(),
            folder: PathBuf::new(),
            format,
            log: log.path().file_name().unwrap_or_default().to_string_lossy().into_owned(),
            log_blake3: log.blake3().to_owned(),
            pictures: 0,
            right_pictures: 0,
            depth_images: 0,
            depth_units_per_metre: None,
            pairing_tolerance_ns: 0,
            ground_truth_poses: 0,
            ground_truth_origin: log.ground_truth_origin().map(str::to_owned),
            imu_rows: 0,
            masks: BTreeMap::new(),
            span_ns: None,
            left_out: BTreeMap::new(),
            notes: Vec::new(),
            log_metadata: words.map(|(name, values)| (name.clone(), values.clone())).collect(),
        }
    }

    pub(super) fn leave_out(&mut self, what: &str, count: usize) {
        if count > 0 {
            *self.left_out.entry(what.to_owned()).or_default() += count;
        }
    }

    pub(super) fn to_json(&self) -> String {
        // Maps with text keys and plain values: there is nothing that cannot be written.
        serde_json::to_string_pretty(self).unwrap_or_default() + "\n"
    }
}

impl fmt::Display for ExportReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "folder         {}", self.folder.display())?;
        if let Some((first, last)) = self.span_ns {
            writeln!(f, "time           {first} .. {last} s")?;
        }
        writeln!(f, "pictures       {}", self.pictures)?;
        if self.right_pictures > 0 {
            writeln!(f, "right camera   {} pictures", self.right_pictures)?;
        }
        if let Some(units) = self.depth_units_per_metre {
            writeln!(f, "depth          {} images, {units} per metre", self.depth_images)?;
        }
        if self.imu_rows > 0 {
            writeln!(f, "inertial       {} rows", self.imu_rows)?;
        }
        writeln!(f, "ground truth   {} poses", self.ground_truth_poses)?;
        for (layer, count) in &self.masks {
            writeln!(f, "segmentation   {count} masks in layer {layer}")?;
        }
        for (what, count) in &self.left_out {
            writeln!(f, "left out       {count} x {what}")?;
        }
        for note in &self.notes {
            writeln!(f, "note           {note}")?;
        }
        Ok(())
    }
}
