//! `pslam eval-masks`.

use crate::{Outcome, stdout};
use replayer::masks::compare_layers;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct EvalMasks {
    /// The log with the layer to judge.
    log: PathBuf,
    /// The layer to judge.
    #[arg(long, value_name = "NAME")]
    layer: String,
    /// The layer that is right.
    #[arg(long, value_name = "NAME")]
    truth: String,
    /// The log with the right layer, if it is another one of the same pictures.
    #[arg(long, value_name = "LOG")]
    truth_log: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl EvalMasks {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let truth_log = self.truth_log.as_ref().unwrap_or(&self.log);
        let report = compare_layers((&self.log, &self.layer), (truth_log, &self.truth))?;
        stdout::either(self.json, "eval-masks/1", &report)?;
        Ok(Outcome::Good)
    }
}
