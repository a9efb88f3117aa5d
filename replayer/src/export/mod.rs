//! Logs as folders that other programs read, and nothing re-encoded that need not be.
//!
//! An export is two passes over the log: the first one opens and checks it, the second one hands each thing in it to the
//! format's layout, so memory does not grow with the log. What a format cannot hold is counted by topic in the
//! report, which also stands in the folder as [`REPORT`]. `pslam import` reads every format back.

mod coco;
mod error;
mod euroc;
mod lists;
mod picture;
mod plain;
mod report;
mod rosbag;
mod source;
mod tum;
mod yaml;

pub use error::ExportError;
pub(crate) use picture::{Canvas, category_color, depth_color};
pub use report::ExportReport;

use std::ops::Range;
use std::path::Path;

use schemas::Stamp;

use crate::OutputFolder;
use crate::log::{EncodedImage, Log, MaskPixels};
pub(crate) use source::Source;

/// The report's name in the folder; an older folder without it is never replaced.
pub const REPORT: &str = "export.json";

/// Kinds of folders.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Format {
    /// TUM RGB-D: `rgb/`, `depth/`, lists of stamps in seconds.
    Tum,
    /// Bonn RGB-D Dynamic: the same layout, depth 5000 per metre.
    Bonn,
    /// EuRoC MAV (ASL): `mav0/cam0`, `cam1`, `imu0`, stamps in nanoseconds.
    Euroc,
    /// A ROS 2 bag: the log itself with a `metadata.yaml`.
    Rosbag2,
    /// Pictures with COCO panoptic labels.
    CocoPanoptic,
    /// Numbered pictures and tables in CSV.
    Png,
}

/// What to export and how.
#[derive(Debug, Clone, Default)]
pub struct ExportOptions {
    /// Segmentation layers; `None` = all of the log.
    pub layers: Option<Vec<String>>,
    /// Only these pictures, and what lies between the first and the last of them.
    pub frames: Option<Range<usize>>,
    /// Depth value of one metre in the folder; `None` = as in the log, values untouched.
    pub depth_units_per_metre: Option<f64>,
    /// Replace an older export.
    pub force: bool,
}

/// One thing in a log that a folder may hold.
pub(crate) enum Item<'a> {
    /// A colour (left) picture's file.
    Color(Stamp, EncodedImage),
    /// A right picture's file.
    Right(Stamp, EncodedImage),
    /// Depth registered to colour, row by row.
    Depth(Stamp, Vec<u16>),
    /// Labels of the picture with this stamp.
    Mask(&'a str, Stamp, MaskPixels),
    /// `world_from_camera`: metres, quaternion x y z w as in the log.
    Pose(Stamp, [f64; 7]),
    /// Turn rate in rad/s, acceleration in m/s^2.
    Imu(Stamp, [f64; 6]),
}

/// How a format arranges things. Items come in the log's order, which in a live recording is nearly that of time.
pub(crate) trait Layout {
    /// Whether the format can hold things of this kind.
    fn holds(&self, kind: Kind) -> bool;
    /// Writes one thing, or remembers it for the lists.
    fn take(&mut self, item: Item<'_>, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError>;
    /// Writes lists and calibration.
    fn finish(&mut self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError>;
    /// Takes a file attached to the log, if the format has a place for it.
    fn attachment(&mut self, _name: &str, _data: &[u8]) -> bool {
        false
    }
    /// What a reader should know beyond the counts.
    fn notes(&self, _: &Source<'_>) -> Vec<String> {
        Vec::new()
    }
}

/// Kinds of [`Item`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Color,
    Right,
    Depth,
    Mask,
    Pose,
    Imu,
}

/// Writes the log at `log` as a folder at `out`. `progress` hears (pictures done, pictures in all).
///
/// # Errors
/// A damaged log, one that the format can hold nothing of, something in the way at `out`, or the system refuses (then
/// nothing is left behind).
pub fn export(
    log: &Path,
    out: &Path,
    format: Format,
    options: &ExportOptions,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<ExportReport, ExportError> {
    let folder = OutputFolder::create(out, REPORT, options.force)?;
    let log = Log::open(log)?;
    let mut report = if format == Format::Rosbag2 {
        rosbag::write(&log, &folder, options)?
    } else {
        let source = Source::new(&log, options)?;
        let mut layout: Box<dyn Layout> = match format {
            Format::Tum | Format::Bonn => Box::new(tum::Tum::new(&source)?),
            Format::Euroc => Box::new(euroc::Euroc::new(&source)),
            Format::CocoPanoptic => Box::new(coco::Coco::new(&source)?),
            Format::Png | Format::Rosbag2 => Box::new(plain::Plain::new()),
        };
        let mut report = ExportReport::new(&log, format);
        source.pass(layout.as_mut(), &folder, &mut report, progress)?;
        layout.finish(&folder, &source)?;
        source.describe(layout.as_ref(), &mut report);
        report
    };
    folder.write(REPORT, report.to_json().as_bytes())?;
    report.folder = out.to_owned();
    folder.finish()?;
    Ok(report)
}
