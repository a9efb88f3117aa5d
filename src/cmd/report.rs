//! `pslam report`.

use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use replayer::eval::Evaluation;
use replayer::report::{ReportOptions, report};
use replayer::write_file;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pslam report runs/balloon -o balloon.html
  pslam report runs/full -o page.html --compare runs/none
  pslam bench log.mcap --json > bench.json && pslam report runs/log -o page.html --bench bench.json")]
pub struct Report {
    /// The run's folder.
    run: PathBuf,
    /// The log, for pictures and verdicts; default: where it was when it was replayed.
    log: Option<PathBuf>,
    /// The page to write.
    #[arg(short, long, value_name = "FILE")]
    out: PathBuf,
    /// Ground truth, a log or TUM text; default: the log's.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Another run of the same log to compare with.
    #[arg(long, value_name = "RUN")]
    compare: Option<PathBuf>,
    /// Show the times that `pslam bench --json` wrote instead of the run's own.
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Do without pictures and verdicts, for which the log is replayed once more.
    #[arg(long)]
    no_pictures: bool,
    /// Threads; the page does not depend on them.
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Overwrite an existing page.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What was written.
#[derive(Debug, Serialize)]
struct Written {
    /// The page.
    page: PathBuf,
    /// Its size.
    bytes: usize,
    /// Frames shown.
    pictures: usize,
    /// What a reader should know, as it stands on the page.
    notices: Vec<String>,
    /// Errors, as `pslam eval` tells them; none without ground truth.
    evaluation: Option<Evaluation>,
}

impl Report {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let options = ReportOptions {
            log: self.log,
            truth: self.truth,
            bench: self.bench,
            compare: self.compare,
            no_pictures: self.no_pictures,
            threads: usize::from(self.threads),
        };
        if !self.force && self.out.exists() {
            // Before the long work, not after it.
            return Err(replayer::OutputError::Exists { path: self.out }.into());
        }
        let bar = progress.bar("looking again");
        let made = report(&self.run, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        write_file(&self.out, made.html.as_bytes(), self.force)?;
        let bytes = made.html.len();
        let written = Written {
            page: self.out,
            bytes,
            pictures: made.pictures,
            notices: made.notices,
            evaluation: made.evaluation,
        };
        stdout::either(self.json, "report/1", &written)?;
        Ok(Outcome::Good)
    }
}

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for notice in &self.notices {
            writeln!(f, "note       {notice}")?;
        }
        if let Some(evaluation) = &self.evaluation {
            writeln!(f, "ATE        {:.5} m RMSE over {} poses", evaluation.ate_m.rmse, evaluation.pairs)?;
        }
        let megabytes = self.bytes as f64 / 1e6;
        write!(f, "page       {} ({megabytes:.1} MB, {} pictures; any browser)", self.page.display(), self.pictures)
    }
}
