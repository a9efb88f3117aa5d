//! `pslam man`: manual pages, one a subcommand.

use crate::{Outcome, help, stdout};
use anyhow::Context as _;
use clap_mangen::Man;
use replayer::write_file;
use std::fs;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  pslam man -o ~/.local/share/man/man1 && man pslam-replay
  pslam man -o man && man -l man/pslam.1")]
pub struct Manual {
    /// Folder to write: pslam.1, pslam-replay.1, ...
    #[arg(short, long, value_name = "DIR")]
    out: PathBuf,
    /// Overwrite existing pages.
    #[arg(long)]
    force: bool,
}

impl Manual {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let mut command = help::command().disable_help_subcommand(true);
        // Names of nested commands are known only then.
        command.build();
        fs::create_dir_all(&self.out).with_context(|| format!("cannot make {}", self.out.display()))?;
        let written = self.page(&command)?;
        stdout::text(&format!("{written} pages in {}", self.out.display()))?;
        Ok(Outcome::Good)
    }

    /// The page of a command and of those below it; how many.
    fn page(&self, command: &clap::Command) -> anyhow::Result<usize> {
        let page = Man::new(command.clone());
        let mut bytes = Vec::new();
        page.render(&mut bytes)?;
        write_file(&self.out.join(page.get_filename()), &bytes, self.force)?;
        let below = command.get_subcommands().map(|command| self.page(command));
        Ok(1 + below.sum::<anyhow::Result<usize>>()?)
    }
}
