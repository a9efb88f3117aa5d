//! A run as one page of HTML that needs nothing else: no network, no other file, no script to be read.
//!
//! The numbers are those of [`crate::eval`] and of the run's records. Pictures and verdicts come from going through the
//! run again with its log ([`Retrace`]); without the log the page has the rest. The same run gives the
//! same bytes: the only times on the page are those that the run, or a file of `pslam bench`, brought along.

mod chart;
mod html;
mod moments;
mod overlay;
mod path;
mod rows;
mod sections;

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::eval::{EvalError, EvalOptions, Evaluation, Trajectory, evaluate};
use crate::run::{DiffReport, Estimate, Progress, Retrace, RunError, RunSummary, Timing, diff};
use crate::{TruthError, read_truth};
use moments::{Seen, Witness, choose};
use rows::Row;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The run cannot be read.
    #[error(transparent)]
    Run(#[from] RunError),
    /// The ground truth that was named cannot be read.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// The file of `pslam bench` cannot be read.
    #[error("{}: {reason}; `pslam bench LOG --json > FILE` writes such a file", path.display())]
    Bench {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A picture cannot be drawn.
    #[error("frame {frame}: {reason}")]
    Picture {
        /// Frame of the run.
        frame: usize,
        /// What is wrong.
        reason: String,
    },
}

/// What to report.
#[derive(Debug, Clone)]
pub struct ReportOptions {
    /// The log; where it was, by default.
    pub log: Option<PathBuf>,
    /// Ground truth, a log or TUM text; the log's by default.
    pub truth: Option<PathBuf>,
    /// JSON of `pslam bench`, whose times are shown instead of the run's own.
    pub bench: Option<PathBuf>,
    /// Another run to compare with.
    pub compare: Option<PathBuf>,
    /// Do without pictures and verdicts: nothing is replayed.
    pub no_pictures: bool,
    /// Threads; the page does not depend on them.
    pub threads: usize,
}

/// A page, and what is to be known about it.
#[derive(Debug, Clone)]
pub struct Report {
    /// The page.
    pub html: String,
    /// Frames shown.
    pub pictures: usize,
    /// What a reader should know, as it stands on the page.
    pub notices: Vec<String>,
    /// The run's errors, if there is ground truth.
    pub evaluation: Option<Evaluation>,
}

/// All that a page shows.
struct Story {
    name: String,
    summary: RunSummary,
    rows: Vec<Row>,
    estimate: Trajectory,
    truth: Trajectory,
    evaluation: Option<Evaluation>,
    /// Of the poses as they were known at each frame.
    online: Option<Evaluation>,
    seen: Option<Seen>,
    bench: Option<BenchFile>,
    other: Option<Other>,
    notices: Vec<String>,
}

/// Another run.
struct Other {
    name: String,
    summary: RunSummary,
    evaluation: Option<Evaluation>,
    diff: DiffReport,
}

/// What is taken from the JSON of `pslam bench`.
#[derive(Deserialize)]
struct BenchFile {
    input: String,
    fingerprint: String,
    timing: Timing,
}

/// Makes the page of a run.
///
/// # Errors
/// No run, damaged records, or a file that was named and cannot be read. A log or ground truth that was not named and is
/// not there makes a poorer page, with a notice.
pub fn report(run: &Path, options: &ReportOptions, progress: Progress<'_>) -> Result<Report, ReportError> {
    let summary = RunSummary::read(run)?;
    let rows = rows::read(run)?;
    let mut notices = Vec::new();
    let retrace = match Retrace::open(run, options.log.as_deref()) {
        Ok(retrace) => Some(retrace),
        Err(error) if options.log.is_some() => return Err(error.into()),
        Err(error) => {
            notices.push(format!("No pictures and no verdicts, as the run's log cannot be used: {error}"));
            None
        }
    };
    let truth = match (&options.truth, &retrace) {
        (Some(path), _) => read_truth(path)?,
        (None, Some(retrace)) => retrace.log().ground_truth().clone(),
        (None, None) => Trajectory::default(),
    };
    let estimate = Estimate::of_run(run, &summary, false)?;
    let evaluation = judge(&truth, &estimate, &mut notices);
    // What is wrong with it is wrong with the final one too.
    let online = judge(&truth, &Estimate::of_run(run, &summary, true)?, &mut Vec::new());
    let other = options.compare.as_deref().map(|other| Other::read(run, other, &truth, &mut notices)).transpose()?;
    let bench = options.bench.as_deref().map(read_bench).transpose()?;
    let mut seen = None;
    if let Some(retrace) = retrace.filter(|_| !options.no_pictures) {
        let mut witness = Witness::new(choose(&rows, evaluation.as_ref()), rows.len(), retrace.setup());
        let difference = retrace.frames(options.threads, progress, &mut |retraced| {
            witness.frame(retraced);
            Ok(())
        })?;
        if let Some(difference) = difference {
            notices.push(format!(
                "This program does not replay the run as it was recorded, so pictures and verdicts may differ from what \
                 happened then. Recorded and now: {difference}"
            ));
        }
        seen = Some(witness.finish());
    }
    let name = name_of(run);
    let estimate = estimate.trajectory;
    let story = Story { name, summary, rows, estimate, truth, evaluation, online, seen, bench, other, notices };
    let html = sections::page(&story)?;
    let pictures = story.seen.map_or(0, |seen| seen.moments.len());
    Ok(Report { html, pictures, notices: story.notices, evaluation: story.evaluation })
}

/// The run's errors as `pslam eval` tells them.
fn judge(truth: &Trajectory, estimate: &Estimate, notices: &mut Vec<String>) -> Option<Evaluation> {
    if truth.poses.is_empty() {
        notices.push("No errors, as there is no ground truth: name a log or a text file with --truth.".to_owned());
        return None;
    }
    if estimate.trajectory.poses.is_empty() {
        notices.push("No errors, as no frame has a pose.".to_owned());
        return None;
    }
    let options = EvalOptions::for_sensor(estimate.sensor.as_deref().unwrap_or_default());
    match evaluate(truth, &estimate.trajectory, estimate.coverage, &options) {
        Ok(evaluation) => Some(evaluation),
        Err(error) => {
            notices.push(match error {
                EvalError::Degenerate { pairs } => {
                    format!(
                        "No errors: {pairs} positions on a point or a line cannot be aligned with the ground truth."
                    )
                }
                error => format!("No errors: {error}"),
            });
            None
        }
    }
}

impl Other {
    fn read(run: &Path, other: &Path, truth: &Trajectory, notices: &mut Vec<String>) -> Result<Self, ReportError> {
        let summary = RunSummary::read(other)?;
        let estimate = Estimate::of_run(other, &summary, false)?;
        let mut of_other = Vec::new();
        let evaluation = judge(truth, &estimate, &mut of_other);
        let name = name_of(other);
        if !truth.poses.is_empty() {
            notices.extend(of_other.into_iter().map(|notice| format!("{name}: {notice}")));
        }
        Ok(Self { name, summary, evaluation, diff: diff(run, other)? })
    }
}

/// The folder's name.
fn name_of(run: &Path) -> String {
    let full = std::path::absolute(run).unwrap_or_else(|_| run.to_owned());
    full.file_name().unwrap_or(full.as_os_str()).to_string_lossy().into_owned()
}

fn read_bench(path: &Path) -> Result<BenchFile, ReportError> {
    let wrong = |reason: String| ReportError::Bench { path: path.to_owned(), reason };
    let text = std::fs::read_to_string(path).map_err(|error| wrong(error.to_string()))?;
    serde_json::from_str(&text).map_err(|error| wrong(error.to_string()))
}
