//! `pslam redact`.

use super::{Target, any, patterns};
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::edit::redact::{Method, RedactOptions, redact};
use schemas::{panoptic, topics};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Redact {
    /// The log.
    log: PathBuf,
    /// Segmentation layer that knows where they are.
    #[arg(long, value_name = "NAME", default_value = topics::DEFAULT_LAYER)]
    layer: String,
    /// Whom or what to take out; several times: all of them.
    #[arg(long, value_name = "NAME", default_value = panoptic::PERSON)]
    class: Vec<String>,
    /// How far around them, pixels; twice as far where masks of other frames stand in.
    #[arg(long, value_name = "PX", default_value = "64", value_parser = clap::value_parser!(u16).range(0..=500))]
    margin: u16,
    /// What no class claims, in frames with somebody: redact it too, since nobody can tell who is there, or keep it.
    #[arg(long, value_name = "WHAT", default_value = "keep")]
    unknown: Unknown,
    /// Frames before and after whose masks count too: networks miss people now and then.
    #[arg(long, value_name = "FRAMES", default_value = "2", value_parser = clap::value_parser!(u16).range(0..=100))]
    neighbours: u16,
    /// How far a border may move in a frame, pixels: the masks of other frames are grown by it.
    #[arg(long, value_name = "PX", default_value = "2", value_parser = clap::value_parser!(u16).range(0..=100))]
    motion: u16,
    /// Up to how many frames without anybody are bridged by the nearest frames with somebody.
    #[arg(long, value_name = "FRAMES", default_value = "30", value_parser = clap::value_parser!(u16).range(0..=1000))]
    bridge: u16,
    /// What becomes of colour: fill (grey), pixelate or blur; depth is always taken away.
    #[arg(long, value_name = "HOW", default_value = "fill")]
    method: How,
    /// Side of the blocks of pixelate and blur, pixels.
    #[arg(long, value_name = "PX", default_value = "32", value_parser = clap::value_parser!(u16).range(16..=512))]
    block: u16,
    /// Frames whose mask is in doubt and for which no frames around stand in: refuse the log, or cover them whole.
    #[arg(long, value_name = "WHAT", default_value = "refuse")]
    doubtful: Doubtful,
    /// Leave out topics and attached files that match (whole name).
    #[arg(long, value_name = "REGEX")]
    drop: Vec<String>,
    /// Topics and attached files unknown to this program that show nobody.
    #[arg(long, value_name = "REGEX")]
    allow: Vec<String>,
    #[command(flatten)]
    target: Target,
}

/// What becomes of colour.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum How {
    Fill,
    Pixelate,
    Blur,
}

/// What becomes of what no class claims.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Unknown {
    Cover,
    Keep,
}

/// What becomes of a doubtful frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Doubtful {
    Refuse,
    Cover,
}

impl Redact {
    pub(in crate::cmd) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let (drops, allows) = (patterns(&self.drop)?, patterns(&self.allow)?);
        if self.class.iter().any(String::is_empty) {
            return Err(Usage("--class wants a name".to_owned()).into());
        }
        let block_px = self.block.into();
        let asked = RedactOptions {
            classes: self.class.iter().cloned().collect(),
            margin_px: self.margin.into(),
            cover_unknown: self.unknown == Unknown::Cover,
            neighbours: self.neighbours.into(),
            motion_px: self.motion.into(),
            bridge: self.bridge.into(),
            method: match self.method {
                How::Fill => Method::Fill,
                How::Pixelate => Method::Pixelate { block_px },
                How::Blur => Method::Blur { block_px },
            },
            cover_doubtful: self.doubtful == Doubtful::Cover,
            drops: &|name| any(&drops, name),
            allows: &|name| any(&allows, name),
            ..RedactOptions::new(&self.layer)
        };
        let mut arguments: std::collections::BTreeMap<_, serde_json::Value> =
            asked.arguments().into_iter().map(|(name, value)| (name, value.into())).collect();
        for (name, list) in [("drop", &self.drop), ("allow", &self.allow)] {
            if !list.is_empty() {
                arguments.insert(name.to_owned(), list.clone().into());
            }
        }
        let options = self.target.options("redact", arguments);
        let bar = progress.bar("redacting");
        let report = redact(&self.log, &self.target.out, &asked, &options, &mut |done, all| {
            progress::update(&bar, done as usize, all as usize);
        })?;
        bar.finish_and_clear();
        stdout::either(self.target.json, "redact/1", &report)?;
        Ok(Outcome::from_good(!report.refused))
    }
}
