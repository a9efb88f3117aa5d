//! `pslam verify`.

use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Verify {
    /// The run's folder.
    run: PathBuf,
    /// The log; default: where it was when it was replayed.
    log: Option<PathBuf>,
    /// Threads; the result does not depend on them.
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Verify {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let bar = progress.bar("verifying");
        let threads = usize::from(self.threads);
        let mut update = |done, all| progress::update(&bar, done, all);
        let report = replayer::run::verify(&self.run, self.log.as_deref(), threads, &mut update)?;
        bar.finish_and_clear();
        stdout::either(self.json, "verify/1", &report)?;
        Ok(Outcome::from_good(report.passed()))
    }
}
