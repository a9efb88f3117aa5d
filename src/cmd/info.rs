//! `pslam info`.

use crate::{Outcome, stdout};
use replayer::log::Log;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Info {
    /// The log.
    log: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Info {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        stdout::either(self.json, "info/1", &Log::open(&self.log)?.info())?;
        Ok(Outcome::Good)
    }
}
