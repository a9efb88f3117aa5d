//! `pslam bench`.

use super::replay::How;
use crate::progress::{self, Progress};
use crate::{Outcome, stdout, synthetic};
use anyhow::Context as _;
use replayer::run::{bench, bench_looped};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Bench {
    /// The log.
    #[arg(required_unless_present = "synthetic_hours")]
    log: Option<PathBuf>,
    /// Instead of a log: this many hours at 30 Hz of a small rendered room, run through forth and back.
    #[arg(long, value_name = "H", conflicts_with_all = ["log", "frames", "segmentation"])]
    synthetic_hours: Option<f64>,
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
        let mut tick = |done, all| progress::update(&bar, done, all);
        let report = match (&self.log, self.synthetic_hours) {
            (Some(log), _) => bench(log, &options, &mut tick)?,
            (None, hours) => {
                let hours = hours.filter(|h| (0.0..=1000.0).contains(h)).context("hours are numbers from 0 to 1000")?;
                let (frames, setup) = synthetic::small_sequence()?;
                let count = ((hours * 108_000.0) as usize).max(1);
                bench_looped(&format!("{hours} h of a rendered room"), &frames, &setup, count, &options, &mut tick)?
            }
        };
        bar.finish_and_clear();
        stdout::either(self.json, "bench/1", &report)?;
        Ok(Outcome::Good)
    }
}
