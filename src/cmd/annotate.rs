//! `pslam annotate`.

use super::models::Labeller;
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::annotate::{AnnotateError, AnnotateOptions, Annotated, annotate, is_annotated};
use recorder::{LayerSpec, LogOptions};
use replayer::stopwatch::{Stopwatch, cpu_seconds};
use serde::Serialize;
use std::fmt;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Annotate {
    /// The logs.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The new log; with several logs, or if it is a folder: the folder for the new logs, which keep their names.
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    labeller: Labeller,
    /// Name of the new layer: letters, digits and _.
    #[arg(long, value_name = "NAME", default_value = "network")]
    layer: String,
    /// Pictures labelled at once; the labels do not depend on it. Default: all processors.
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Only the first pictures of each log.
    #[arg(long, value_name = "N")]
    limit: Option<usize>,
    /// Overwrite existing logs.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What happened to one log.
#[derive(Debug, Serialize)]
struct Done {
    log: PathBuf,
    out: PathBuf,
    /// None: an earlier run had made exactly this, or it failed.
    annotated: Option<Annotated>,
    /// Why there is no new log.
    error: Option<String>,
    /// Wall clock.
    seconds: f64,
    pictures_per_second: f64,
    /// Processor time of all threads a picture, where the system tells it.
    cpu_ms_per_picture: Option<f64>,
}

/// The result of the command.
#[derive(Debug, Serialize)]
struct Report {
    labeller: String,
    threads: usize,
    logs: Vec<Done>,
}

impl Annotate {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let source = self.labeller.open()?;
        let threads = self.threads.or_else(|| std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
        let options = AnnotateOptions {
            layer: LayerSpec { name: self.layer.clone(), origin: source.origin(), categories: source.categories() },
            record: source.record(),
            time: Some(super::models::time()?),
            limit: self.limit,
            threads,
            log: LogOptions { force: self.force, ..LogOptions::default() },
        };
        if progress.is_shown() {
            eprintln!("labels by {}", options.layer.origin);
        }
        let into_folder = self.logs.len() > 1 || self.out.is_dir();
        if into_folder {
            std::fs::create_dir_all(&self.out)?;
        }
        let outs = self.logs.iter().map(|log| self.target(log, into_folder)).collect::<Result<Vec<_>, _>>()?;
        let (mut done, mut failures) = (Vec::new(), Vec::new());
        for (log, out) in self.logs.iter().zip(outs) {
            let (watch, cpu) = (Stopwatch::start(), cpu_seconds());
            let one = || -> Result<Option<Annotated>, AnnotateError> {
                if !self.force && is_annotated(log, &out, &options)? {
                    return Ok(None);
                }
                let bar = progress.bar("annotate");
                let mut tell = |done: usize, all: usize| progress::update(&bar, done, all);
                let annotated = annotate(log, &out, &options, &|| source.segmenter(), &mut tell);
                bar.finish_and_clear();
                annotated.map(Some)
            };
            // One bad log keeps no other from being labelled.
            let (annotated, failure) = match one() {
                Ok(annotated) => (annotated, None),
                Err(error) => (None, Some(error)),
            };
            let error = failure.as_ref().map(AnnotateError::to_string);
            failures.extend(failure.map(anyhow::Error::from));
            let seconds = watch.elapsed().as_secs_f64();
            let pictures = annotated.as_ref().map_or(0, |a| a.pictures - a.resumed) as f64;
            let cpu = cpu.zip(cpu_seconds()).filter(|_| pictures > 0.0).map(|(a, b)| (b - a) * 1e3 / pictures);
            let pictures_per_second = pictures / seconds;
            let (log, cpu_ms_per_picture) = (log.clone(), cpu);
            done.push(Done { log, out, annotated, error, seconds, pictures_per_second, cpu_ms_per_picture });
        }
        let report = Report { labeller: options.layer.origin, threads: threads.get(), logs: done };
        let (failed, all) = (failures.len(), report.logs.len());
        match failures.into_iter().next() {
            Some(error) if all == 1 => Err(error),
            first => {
                stdout::either(self.json, "annotate/1", &report)?;
                let Some(error) = first else { return Ok(Outcome::Good) };
                Err(error.context(format!("{failed} of {all} logs were not annotated; the others are")))
            }
        }
    }

    fn target(&self, log: &Path, into_folder: bool) -> Result<PathBuf, Usage> {
        match log.file_name() {
            _ if !into_folder => Ok(self.out.clone()),
            Some(name) => Ok(self.out.join(name)),
            None => Err(Usage(format!("{} is no file", log.display()))),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "labels by {}", self.labeller)?;
        for done in &self.logs {
            if let Some(error) = &done.error {
                writeln!(f, "{}: FAILED: {error}", done.log.display())?;
                continue;
            }
            let Some(a) = &done.annotated else {
                writeln!(f, "{}: done by an earlier run", done.out.display())?;
                continue;
            };
            let rate = done.pictures_per_second;
            write!(f, "{}: layer {}, {} of {} pictures", done.out.display(), a.layer, a.labelled, a.pictures)?;
            if a.resumed > 0 {
                write!(f, " ({} of an interrupted run)", a.resumed)?;
            }
            write!(f, ", {rate:.1} pictures/s with {} threads", self.threads)?;
            if let Some(cpu) = done.cpu_ms_per_picture {
                write!(f, ", {cpu:.0} ms CPU a picture")?;
            }
            writeln!(f, "\n  labels blake3 {}", a.labels_blake3)?;
        }
        Ok(())
    }
}
