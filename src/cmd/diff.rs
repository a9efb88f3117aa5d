//! `pslam diff`.

use crate::{Outcome, stdout};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Diff {
    /// A run's folder.
    run_a: PathBuf,
    /// Another one.
    run_b: PathBuf,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Diff {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let report = replayer::run::diff(&self.run_a, &self.run_b)?;
        stdout::either(self.json, "diff/1", &report)?;
        Ok(Outcome::from_good(report.same()))
    }
}
