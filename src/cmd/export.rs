//! `pslam export`.

use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use replayer::export::{ExportOptions, Format, export};
use std::ops::Range;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Export {
    /// Kind of the folder.
    #[arg(value_enum)]
    format: Kind,
    /// The log.
    log: PathBuf,
    /// The folder to write; export.json in it tells what the format could not hold.
    #[arg(short, long)]
    out: PathBuf,
    /// Only this segmentation layer, several times for several; default: all.
    #[arg(long, value_name = "NAME", alias = "segmentation")]
    layer: Vec<String>,
    /// Leave segmentation out.
    #[arg(long, conflicts_with = "layer")]
    no_masks: bool,
    /// Only these frames, as 100..200, and what lies between them; either end may be left away.
    #[arg(long, value_name = "A..B", value_parser = super::replay::frames)]
    frames: Option<Range<usize>>,
    /// Depth value of one metre in the folder; default: the log's, values untouched.
    #[arg(long, value_name = "N")]
    depth_scale: Option<f64>,
    /// Replace an older export.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Kinds of folders.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// TUM RGB-D: rgb, depth, text lists, COCO panoptic labels.
    Tum,
    /// Bonn RGB-D Dynamic: the same with 5000 depth values a metre.
    Bonn,
    /// EuRoC MAV (ASL): mav0 with one or two cameras, inertial rows, ground truth.
    Euroc,
    /// ROS 2 bag: the log itself with metadata.yaml.
    Rosbag2,
    /// Pictures with COCO panoptic labels.
    CocoPanoptic,
    /// Numbered pictures, raw and colourised depth and masks, CSV tables.
    Png,
}

impl Export {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        if let Some(scale) = self.depth_scale.filter(|scale| !(scale.is_finite() && *scale > 0.0)) {
            return Err(Usage(format!("--depth-scale {scale} is not a positive number")).into());
        }
        let (format, own_scale) = match self.format {
            Kind::Tum => (Format::Tum, None),
            Kind::Bonn => (Format::Bonn, Some(5000.0)),
            Kind::Euroc => (Format::Euroc, None),
            Kind::Rosbag2 => (Format::Rosbag2, None),
            Kind::CocoPanoptic => (Format::CocoPanoptic, None),
            Kind::Png => (Format::Png, None),
        };
        let layers = (self.no_masks || !self.layer.is_empty()).then_some(self.layer);
        let (frames, force) = (self.frames, self.force);
        let options = ExportOptions { layers, frames, depth_units_per_metre: self.depth_scale.or(own_scale), force };
        let bar = progress.bar("exporting");
        let report =
            export(&self.log, &self.out, format, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, "export/1", &report)?;
        Ok(Outcome::Good)
    }
}
