//! `pslam bench`.

use super::replay::How;
use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Bench {
    /// The log.
    log: PathBuf,
    #[command(flatten)]
    how: How,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Bench {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let options = self.how.options()?;
        let bar = progress.bar("replaying");
        let report = replayer::run::bench(&self.log, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, &report)?;
        Ok(Outcome::Good)
    }
}
