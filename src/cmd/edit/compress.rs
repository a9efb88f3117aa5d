//! `pslam compress`.

use super::Target;
use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use recorder::edit::{self, Level};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Compress {
    /// The log.
    log: PathBuf,
    /// zstd's level, 1 (fast, as recorded) to 22 (small), or none.
    #[arg(long, value_name = "N", value_parser = level)]
    level: Level,
    #[command(flatten)]
    target: Target,
}

fn level(text: &str) -> Result<Level, String> {
    match text.parse() {
        _ if text == "none" => Ok(Level::None),
        Ok(level @ 1..=22) => Ok(Level::Zstd(level)),
        _ => Err(format!("`{text}` is neither a level from 1 to 22 nor none")),
    }
}

impl Compress {
    pub(in crate::cmd) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let level = match self.level {
            Level::None => "none".into(),
            Level::Zstd(level) => level.into(),
        };
        let options = self.target.options("compress", BTreeMap::from([("level".to_owned(), level)]));
        let bar = progress.bar("compressing");
        let done = edit::compress(&self.log, &self.target.out, self.level, options, &mut |done, all| {
            progress::update(&bar, done as usize, all as usize);
        })?;
        bar.finish_and_clear();
        stdout::either(self.target.json, "compress/1", &done)?;
        Ok(Outcome::Good)
    }
}
