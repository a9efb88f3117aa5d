//! From the sequences of a suite to their logs.

use super::spec::Sequence;
use crate::progress::{self, Progress};
use crate::{Usage, synthetic};
use anyhow::Context as _;
use fixtures::{World, scenario};
use recorder::import::{PanopticSource, TumOptions, tum};
use std::path::{Path, PathBuf};

/// Makes the logs of a suite's sequences, or finds them.
pub struct Library<'a> {
    /// Folder that the paths of sequences start from.
    pub data: &'a Path,
    /// Folder for the logs that are made.
    pub logs: PathBuf,
    /// What was made, so that several ways to degrade a sequence share their source.
    made: Vec<PathBuf>,
    progress: Progress,
}

impl<'a> Library<'a> {
    /// An empty library.
    pub fn new(data: &'a Path, logs: PathBuf, progress: Progress) -> Self {
        Self { data, logs, made: Vec::new(), progress }
    }

    /// The log of a sequence; `Err(reason)` inside: it is not on this machine.
    ///
    /// # Errors
    /// The data is there and cannot be used, or the log cannot be written.
    pub fn provide(&mut self, sequence: &Sequence) -> anyhow::Result<Result<PathBuf, String>> {
        let source = match self.source(sequence)? {
            Ok(source) => source,
            missing => return Ok(missing),
        };
        let Some(degrade) = sequence.degrade else { return Ok(Ok(source)) };
        let harder = self.logs.join(format!("{}.mcap", sequence.name));
        let bar = self.progress.bar("degrading");
        degrade.apply(&source, &harder, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        Ok(Ok(harder))
    }

    /// The sequence before it is degraded.
    fn source(&mut self, sequence: &Sequence) -> anyhow::Result<Result<PathBuf, String>> {
        let named = |kind: &str, of: &Path| self.logs.join(format!("{kind}.{}.mcap", of.display()).replace('/', "."));
        if let Some(scenario) = &sequence.synthetic {
            let log = named("synthetic", Path::new(scenario));
            return self.once(&log, |progress| render(scenario, &log, progress)).map(Ok);
        }
        let Some(path) = sequence.log.as_ref().or(sequence.tum.as_ref()) else {
            return Ok(Err("no source".to_owned()));
        };
        let there = self.data.join(path);
        if !there.exists() {
            return Ok(Err(format!("{} is not there", there.display())));
        }
        if sequence.log.is_some() {
            return Ok(Ok(there));
        }
        let (log, data) = (named("tum", path), self.data);
        self.once(&log, |progress| import(sequence, &there, data, &log, progress)).map(Ok)
    }

    fn once(&mut self, log: &Path, make: impl FnOnce(Progress) -> anyhow::Result<()>) -> anyhow::Result<PathBuf> {
        if !self.made.iter().any(|made| made == log) {
            make(self.progress)?;
            self.made.push(log.to_owned());
        }
        Ok(log.to_owned())
    }
}

fn import(sequence: &Sequence, folder: &Path, data: &Path, log: &Path, progress: Progress) -> anyhow::Result<()> {
    let panoptic = sequence.panoptic.as_ref().map(|labels| PanopticSource::new(&data.join(labels)));
    let options = TumOptions {
        camera: sequence.camera()?,
        depth_units_per_metre: sequence.depth_scale.clone(),
        // Labels of a data set are made by its user; without them the sequence still runs, everything unknown.
        panoptic: panoptic.filter(|labels| labels.dir.exists()).into_iter().collect(),
        force: true,
        ..TumOptions::default()
    };
    let bar = progress.bar("importing");
    tum(folder, log, &options, &mut |done, all| progress::update(&bar, done, all))?;
    bar.finish_and_clear();
    Ok(())
}

fn render(name: &str, log: &Path, progress: Progress) -> anyhow::Result<()> {
    let known = scenario::names();
    let config = scenario::by_name(name);
    let config = config.ok_or_else(|| Usage(format!("there is no scenario `{name}`; choose {known}")))?;
    let world = World::new(&config).with_context(|| format!("scenario {name}"))?;
    let bar = progress.bar("rendering");
    synthetic::write_log(&world, name, log, true, &mut |_| {}, &mut |done, all| progress::update(&bar, done, all))?;
    bar.finish_and_clear();
    Ok(())
}
