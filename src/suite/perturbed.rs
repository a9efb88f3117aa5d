//! Every sequence with every configuration under changes that must not matter, in memory.

use super::spec::Configuration;
use crate::progress::{self, Progress};
use anyhow::Context as _;
use replayer::robust::{Judged, Perturbation, Sequence, Verdict, judge_all};
use serde::Serialize;
use std::path::Path;

/// One sequence with one configuration under one perturbation.
#[derive(Debug, Serialize)]
pub struct PerturbedCell {
    /// Name of the configuration.
    pub config: String,
    /// Name of the perturbation.
    pub perturbation: String,
    /// The result.
    #[serde(flatten)]
    pub outcome: Perturbed,
}

/// What became of a perturbed sequence.
#[derive(Debug, Serialize)]
#[serde(tag = "outcome", rename_all = "snake_case")]
pub enum Perturbed {
    /// Replayed and judged.
    Judged(Judged),
    /// No replay, or nothing in it to judge: all frames count as lost.
    NotJudged {
        /// Frames of the perturbed sequence.
        frames: usize,
        /// Why.
        reason: String,
    },
}

impl PerturbedCell {
    /// Its errors.
    #[must_use]
    pub fn judged(&self) -> Option<&Judged> {
        match &self.outcome {
            Perturbed::Judged(judged) => Some(judged),
            Perturbed::NotJudged { .. } => None,
        }
    }

    /// Why there are no errors.
    #[must_use]
    pub fn reason(&self) -> Option<&str> {
        match &self.outcome {
            Perturbed::Judged(_) => None,
            Perturbed::NotJudged { reason, .. } => Some(reason),
        }
    }

    /// RMSE of the final trajectory, metres.
    #[must_use]
    pub fn error_m(&self) -> Option<f64> {
        self.judged().map(|judged| judged.error_m.rmse)
    }

    /// Frames without a pose in the final trajectory.
    #[must_use]
    pub fn lost(&self) -> usize {
        match &self.outcome {
            Perturbed::Judged(judged) => judged.frames.saturating_sub(judged.tracked),
            Perturbed::NotJudged { frames, .. } => *frames,
        }
    }
}

/// Judges a log with every configuration under every perturbation that makes sense there, in this order.
pub(super) fn judge_log(
    log: &Path,
    configs: &[(&Configuration, slam::Config)],
    perturbations: &[Perturbation],
    threads: usize,
    progress: Progress,
) -> anyhow::Result<Vec<PerturbedCell>> {
    let mut cells = Vec::new();
    // What a sequence is depends on the sensor that is chosen; it is read once for configurations that choose the same.
    for configs in configs.chunk_by(|(_, a), (_, b)| a.sensor.kind == b.sensor.kind) {
        let Some((_, first)) = configs.first() else { continue };
        let sequence = Sequence::open(log, first, None).with_context(|| log.display().to_string())?;
        let names = configs.iter().flat_map(|(spec, _)| perturbations.iter().map(|p| (&spec.name, *p)));
        let tasks = configs.iter().flat_map(|(_, config)| perturbations.iter().map(move |p| (*p, config)));
        let tasks: Vec<_> = tasks.collect();
        let bar = progress.bar("perturbing");
        let verdicts = judge_all(&sequence, &tasks, threads, &|done| progress::update(&bar, done, tasks.len()));
        bar.finish_and_clear();
        cells.extend(names.zip(verdicts).filter_map(|((config, p), verdict)| Some(cell(config, p, verdict?))));
    }
    Ok(cells)
}

fn cell(config: &str, perturbation: Perturbation, Verdict { frames, judged }: Verdict) -> PerturbedCell {
    let outcome = match judged {
        Ok(judged) => Perturbed::Judged(judged),
        Err(error) => Perturbed::NotJudged { frames, reason: error.to_string() },
    };
    PerturbedCell { config: config.to_owned(), perturbation: perturbation.to_string(), outcome }
}
