//! Running a suite.

use super::perturbed::{PerturbedCell, judge_log};
use super::source::Library;
use super::spec::{Configuration, Quantity, Sequence, Suite};
use super::{perturbed_table, table};
use crate::progress::{self, Progress};
use anyhow::Context as _;
use replayer::eval::{Coverage, EvalOptions, Trajectory, evaluate};
use replayer::read_truth;
use replayer::run::{ReplayOptions, RunSummary, TRAJECTORY_ONLINE_TXT, TRAJECTORY_TXT, replay};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// Everything a suite found.
#[derive(Debug, Serialize)]
pub struct SuiteReport {
    /// Heading.
    pub title: String,
    /// Folder with the logs and, without perturbations, runs.
    pub folder: PathBuf,
    /// One entry a sequence, in the suite's order.
    pub sequences: Vec<SequenceReport>,
    /// The tables as Markdown, ready to be pasted.
    pub tables: Vec<String>,
}

/// What became of a sequence.
#[derive(Debug, Serialize)]
pub struct SequenceReport {
    /// Its name in the suite.
    pub name: String,
    /// Why it did not run, when it is not on this machine.
    pub missing: Option<String>,
    /// One entry a configuration, in the suite's order; none for a missing sequence, or in a suite with perturbations.
    pub runs: Vec<Cell>,
    /// One entry a configuration and perturbation, in the suite's order; none in a suite without perturbations.
    pub perturbed: Vec<PerturbedCell>,
}

/// One sequence with one configuration.
#[derive(Debug, Serialize)]
pub struct Cell {
    /// Name of the configuration.
    pub config: String,
    /// The result.
    #[serde(flatten)]
    pub done: Done,
}

/// How a run ended.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "outcome", rename_all = "snake_case")]
pub enum Done {
    /// Replayed and judged.
    Judged {
        /// RMSE of the absolute trajectory error, metres.
        ate_m: f64,
        /// The same of the poses as they were known at each frame; none where they can't be judged.
        ate_online_m: Option<f64>,
        /// Frames in the trajectory, of all frames.
        tracked: usize,
        /// Frames of the log.
        frames: usize,
        /// Mean time per frame of features, filter and tracking, milliseconds; different every time.
        tracking_ms: f64,
        /// Of the run.
        fingerprint: String,
    },
    /// It ran, but there is nothing to judge: no frame was tracked, or no truth belongs to those that were.
    NotJudged {
        /// Why.
        reason: String,
    },
}

impl Done {
    /// The number for a table.
    #[must_use]
    pub fn value(&self, quantity: Quantity) -> Option<f64> {
        let Self::Judged { ate_m, ate_online_m, tracked, frames, tracking_ms, .. } = self else { return None };
        Some(match quantity {
            Quantity::AteM => *ate_m,
            Quantity::AteOnlineM => (*ate_online_m)?,
            Quantity::Tracked => 100.0 * *tracked as f64 / (*frames).max(1) as f64,
            Quantity::TrackingMs => *tracking_ms,
        })
    }
}

impl SuiteReport {
    /// Whether every sequence that is there was judged with every configuration (and perturbation), and at least one was.
    #[must_use]
    pub fn complete(&self) -> bool {
        let runs = self.sequences.iter().flat_map(|s| &s.runs).map(|cell| matches!(cell.done, Done::Judged { .. }));
        let perturbed = self.sequences.iter().flat_map(|s| &s.perturbed).map(|cell| cell.judged().is_some());
        let mut good = runs.chain(perturbed).peekable();
        good.peek().is_some() && good.all(|good| good)
    }
}

/// Runs a suite into the folder `out`; `data` is the folder that the sequences' paths start from.
///
/// # Errors
/// A configuration that makes no sense, data that is there and cannot be used, or results that cannot be written.
pub fn run(suite: &Suite, data: &Path, out: &Path, threads: usize, progress: Progress) -> anyhow::Result<SuiteReport> {
    // All mistakes of the file come before hours of work.
    let configs = suite.config.iter().map(|c| Ok((c, c.resolve().with_context(|| format!("config {}", c.name))?)));
    let configs = configs.collect::<anyhow::Result<Vec<_>>>()?;
    let perturbations = suite.perturbed()?;
    let logs = out.join("logs");
    std::fs::create_dir_all(&logs).with_context(|| format!("cannot make {}", logs.display()))?;
    let mut library = Library::new(data, logs, progress);
    let mut sequences = Vec::new();
    for sequence in &suite.sequence {
        let name = sequence.name.clone();
        let place = library.provide(sequence).with_context(|| format!("sequence {name}"))?;
        let (missing, log) = place.map_or_else(|reason| (Some(reason), None), |log| (None, Some(log)));
        let (mut runs, mut perturbed) = (Vec::new(), Vec::new());
        match (&log, &perturbations) {
            (None, _) => {}
            (Some(log), Some(perturbations)) => {
                let cells = judge_log(log, &configs, perturbations, threads, progress);
                perturbed = cells.with_context(|| format!("sequence {name}"))?;
            }
            (Some(log), None) => {
                let folder = out.join("runs").join(&name);
                for (spec, config) in &configs {
                    let cell = judge(sequence, spec, config, log, &folder, threads, progress);
                    runs.push(cell.with_context(|| format!("sequence {name}, config {}", spec.name))?);
                }
            }
        }
        sequences.push(SequenceReport { name, missing, runs, perturbed });
    }
    let tables = match perturbations {
        Some(_) => perturbed_table::markdown(suite, &sequences),
        None => suite.table.iter().map(|table| table::markdown(suite, table, &sequences)).collect(),
    };
    Ok(SuiteReport { title: suite.title.clone(), folder: out.to_owned(), sequences, tables })
}

fn judge(
    sequence: &Sequence,
    spec: &Configuration,
    config: &slam::Config,
    log: &Path,
    runs: &Path,
    threads: usize,
    progress: Progress,
) -> anyhow::Result<Cell> {
    std::fs::create_dir_all(runs).with_context(|| format!("cannot make {}", runs.display()))?;
    let folder = runs.join(&spec.name);
    let options = ReplayOptions {
        config: config.clone(),
        config_name: spec.name.clone(),
        threads,
        force: true,
        ..ReplayOptions::default()
    };
    let bar = progress.bar("replaying").with_prefix(sequence.name.clone());
    let summary = replay(log, &folder, &options, &mut |done, all| progress::update(&bar, done, all))?;
    bar.finish_and_clear();
    let done = evaluated(sequence, &summary, log, &folder);
    let done = done.unwrap_or_else(|error| Done::NotJudged { reason: format!("{error:#}") });
    Ok(Cell { config: spec.name.clone(), done })
}

fn evaluated(sequence: &Sequence, summary: &RunSummary, log: &Path, folder: &Path) -> anyhow::Result<Done> {
    let RunSummary { fingerprint, result, timing, .. } = summary;
    let coverage = Coverage { tracked: result.in_trajectory, frames: result.frames };
    let trajectory = Trajectory::read_tum(&folder.join(TRAJECTORY_TXT))?;
    let options = EvalOptions { alignment: sequence.alignment, ..EvalOptions::default() };
    let truth = read_truth(log)?;
    let evaluation = evaluate(&truth, &trajectory, Some(coverage), &options)?;
    let online = Trajectory::read_tum(&folder.join(TRAJECTORY_ONLINE_TXT))?;
    let online = evaluate(&truth, &online, None, &options).ok();
    Ok(Done::Judged {
        ate_m: evaluation.ate_m.rmse,
        ate_online_m: online.map(|online| online.ate_m.rmse),
        tracked: coverage.tracked,
        frames: coverage.frames,
        tracking_ms: timing.tracking_ms(),
        fingerprint: fingerprint.clone(),
    })
}

impl fmt::Display for SuiteReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "# {}", self.title)?;
        for table in &self.tables {
            write!(f, "\n{table}")?;
        }
        let missing: Vec<_> = self.sequences.iter().filter_map(|s| Some((&s.name, s.missing.as_ref()?))).collect();
        if !missing.is_empty() {
            writeln!(f, "\nLeft out:")?;
            missing.iter().try_for_each(|(name, reason)| writeln!(f, "- {name}: {reason}"))?;
        }
        for sequence in &self.sequences {
            for Cell { config, done } in &sequence.runs {
                if let Done::NotJudged { reason } = done {
                    writeln!(f, "- {}, {config}: not judged: {reason}", sequence.name)?;
                }
            }
        }
        let what = if self.sequences.iter().all(|s| s.perturbed.is_empty()) { "Logs and runs" } else { "Logs" };
        writeln!(f, "\n{what} are in {}.", self.folder.display())
    }
}
