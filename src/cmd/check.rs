//! `pslam check`.

use crate::{Outcome, stdout};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Check {
    /// The log.
    log: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Check {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let report = replayer::log::check(&self.log)?;
        stdout::either(self.json, "check/1", &report)?;
        Ok(Outcome::from_good(report.is_sound()))
    }
}
