//! Labels while recording.

use crate::Usage;
use crate::cmd::models::{self, Labeller};
use recorder::LayerSpec;
use recorder::capture::Labelling;
use std::num::{NonZeroU32, NonZeroUsize};
use std::sync::Arc;

/// Arguments.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Segmentation")]
pub struct SegmentArgs {
    /// Label colour pictures while recording, with --model or --masks as for `pslam annotate`; the network takes the newest
    /// picture when it is free and never holds up the recording.
    #[arg(long)]
    segment: bool,
    /// The labels of a picture count if they are ready before so many pictures more have come in, else the picture stays without
    /// any: what a live SLAM with this lag would see.
    #[arg(long, value_name = "PICTURES", default_value = "15", requires = "segment")]
    segment_lag: NonZeroU32,
    #[command(flatten)]
    labeller: Labeller,
    /// Name of the segmentation layer: letters, digits and _.
    #[arg(long, value_name = "NAME", default_value = "network", requires = "segment")]
    layer: String,
    /// Pictures labelled at once, on a processor each.
    #[arg(long, value_name = "N", default_value = "1", requires = "segment")]
    threads: NonZeroUsize,
}

impl SegmentArgs {
    /// What the recording is to be given; `None` without --segment.
    ///
    /// # Errors
    /// A network without --segment, --segment without a network, models that cannot be used.
    pub fn labelling(&self) -> anyhow::Result<Option<Labelling>> {
        if !self.segment {
            let what = "--model and --masks label pictures while recording only with --segment";
            return if self.labeller.is_given() { Err(Usage(what.to_owned()).into()) } else { Ok(None) };
        }
        let source = Arc::new(self.labeller.open()?);
        Ok(Some(Labelling {
            layer: LayerSpec { name: self.layer.clone(), origin: source.origin(), categories: source.categories() },
            record: source.record(),
            time: Some(models::time()?),
            lag: self.segment_lag,
            threads: self.threads,
            make: Arc::new(move || source.segmenter()),
        }))
    }
}
