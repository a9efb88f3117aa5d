//! One file a subcommand.

mod check;
mod config;
mod eval;
mod import;
mod info;
mod recover;
mod run_folder;

use crate::Outcome;
use crate::progress::Progress;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Turn a data set folder into a log.
    #[command(subcommand)]
    Import(import::Source),
    /// Show what is in a log.
    Info(info::Info),
    /// Look for everything that is wrong with a log; exit code 1 if a replay would suffer.
    Check(check::Check),
    /// Save every intact part of a damaged log; exit code 1 if something is lost.
    Recover(recover::Recover),
    /// Print the configuration with its documentation.
    Config(config::Config),
    /// Compare a run's trajectory with the ground truth.
    Eval(eval::Eval),
}

impl Command {
    /// Runs it.
    ///
    /// # Errors
    /// What the exit codes 2 and 3 of `pslam --help` say.
    pub fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        match self {
            Self::Import(source) => source.run(progress),
            Self::Info(command) => command.run(),
            Self::Check(command) => command.run(),
            Self::Recover(command) => command.run(),
            Self::Config(command) => command.run(),
            Self::Eval(command) => command.run(),
        }
    }
}
