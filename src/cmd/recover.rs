//! `pslam recover`.

use crate::{Outcome, stdout};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Recover {
    /// The damaged log, also an unfinished one (`.partial`).
    damaged: PathBuf,
    /// The new log.
    #[arg(short, long)]
    out: PathBuf,
    /// Overwrite an existing log.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Recover {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let report = recorder::recover::recover(&self.damaged, &self.out, self.force)?;
        stdout::either(self.json, "recover/1", &report)?;
        Ok(Outcome::from_good(!report.lossy))
    }
}
