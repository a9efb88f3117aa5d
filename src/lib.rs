//! The command line of `pslam`: arguments to a checked plan to one library call to a table or JSON.
//!
//! One file a subcommand in [`cmd`]. Nothing here computes: recording is the crate `recorder`, everything that reads a
//! log is `replayer`, the SLAM is `slam`.

pub mod cmd;
mod exit;
pub mod help;
mod progress;
mod stdout;
pub mod suite;
pub mod synthetic;

use clap::{FromArgMatches as _, Parser};
use std::process::ExitCode;

pub use exit::{Outcome, Usage};

/// What `--help` prints under the commands.
const EXIT_CODES: &str = "\
Exit codes:
  0  done, nothing to object to
  1  the answer is no: a check or a verification failed, two runs differ, a recovery lost data, a redaction
     is in doubt
  2  the request makes no sense: unknown option, bad configuration, output exists and --force is not given
  3  a file is missing, damaged or cannot be written

Results go to standard output, progress and errors to standard error.";

/// Record, replay and inspect RGB-D datasets with a deterministic panoptic SLAM.
#[derive(Debug, Parser)]
#[command(name = "pslam", version, after_help = EXIT_CODES, subcommand_required = true, arg_required_else_help = true)]
pub struct Cli {
    /// Show no progress bars (they are hidden anyway when standard error is no terminal).
    #[arg(long, global = true)]
    no_progress: bool,
    #[command(subcommand)]
    command: cmd::Command,
}

/// Runs the command that the process was started with.
#[must_use]
pub fn run() -> ExitCode {
    let matches = help::command().get_matches();
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    exit::code(cli.command.run(progress::Progress::new(!cli.no_progress)))
}
