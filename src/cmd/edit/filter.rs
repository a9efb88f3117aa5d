//! `pslam filter`.

use super::{Target, Topics};
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::edit::{self, rewrite};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Filter {
    /// The log.
    log: PathBuf,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    target: Target,
}

impl Filter {
    pub(in crate::cmd) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let mut arguments = BTreeMap::new();
        self.topics.add_to(&mut arguments);
        if arguments.is_empty() {
            return Err(Usage("say which topics: --include REGEX, --exclude REGEX".to_owned()).into());
        }
        let keeps = self.topics.rule()?;
        let options = self.target.options("filter", arguments);
        let bar = progress.bar("filtering");
        let mut edit = edit::Filter { keeps: &keeps };
        let summary = rewrite(&self.log, &self.target.out, &options, &mut edit, &mut |done, all| {
            progress::update(&bar, done as usize, all as usize);
        })?;
        bar.finish_and_clear();
        stdout::either(self.target.json, "filter/1", &summary)?;
        Ok(Outcome::Good)
    }
}
