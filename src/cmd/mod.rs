//! One file a subcommand.

mod annotate;
mod bench;
mod board;
#[cfg_attr(not(feature = "opencv"), path = "calibrate_without.rs")]
mod calibrate;
mod card;
mod check;
mod completions;
mod config;
mod demo;
mod devices;
mod diff;
mod edit;
mod eval;
mod eval_masks;
mod export;
mod import;
mod info;
mod man;
mod models;
mod record;
mod recover;
mod replay;
mod report;
mod sim;
mod suite;
mod sync;
mod verify;

use crate::Outcome;
use crate::progress::Progress;

/// What to do.
#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Show what could be recorded.
    Devices(devices::Devices),
    /// Record sensors into a log; exit code 1 if anything is lost.
    Record(Box<record::Record>),
    /// Turn a data set folder or a vendor's recording into a log.
    #[command(subcommand)]
    Import(import::Source),
    /// Turn a log into a folder that other programs read.
    Export(export::Export),
    /// Make a dataset folder ready to publish: README, citation, checksums, Croissant metadata, statistics, contact sheets.
    Card(Box<card::Card>),
    /// Show what is in a log.
    Info(info::Info),
    /// Look for everything that is wrong with a log; exit code 1 if a replay would suffer.
    Check(check::Check),
    /// Save every intact part of a damaged log; exit code 1 if something is lost.
    Recover(recover::Recover),
    /// Cut a piece out of a log: by frames or time, and topics.
    Slice(edit::Slice),
    /// Put several logs into one.
    Merge(edit::Merge),
    /// Keep some topics of a log.
    Filter(edit::Filter),
    /// Pack a log smaller, or not at all, and prove that it holds the same.
    Compress(edit::Compress),
    /// Take people out of a log's pictures, depth and masks; exit code 1 if nobody can tell where they are.
    Redact(Box<edit::Redact>),
    /// Print the configuration with its documentation.
    Config(config::Config),
    /// Run the SLAM over a log, frame by frame, and write down everything.
    Replay(replay::Replay),
    /// Replay a run again and compare; exit code 1 if anything differs.
    Verify(verify::Verify),
    /// Name the first frame, stage and field that differ between two runs; exit code 1 if any does.
    Diff(diff::Diff),
    /// Find clock offset, drift and hand-eye transform of a recording; exit code 1 if no marker body fits the camera.
    Sync(sync::Sync),
    /// Write a calibration board to print, SVG or PDF.
    Board(board::Board),
    /// Check intrinsics and find the hand-eye transform from views of the board (needs the feature `opencv`); exit code 1 if
    /// either is wrong.
    Calibrate(calibrate::Calibrate),
    /// Compare a run's trajectory with the ground truth.
    Eval(eval::Eval),
    /// Write a run as one page of HTML: path, errors, verdicts, pictures; it needs no network and no other file.
    Report(report::Report),
    /// Label a log's pictures with networks, or add ready labels: a new segmentation layer.
    Annotate(annotate::Annotate),
    /// Judge a segmentation layer by another one: panoptic quality, and what becomes of people.
    EvalMasks(eval_masks::EvalMasks),
    /// Measure how fast a replay is, stage by stage.
    Bench(bench::Bench),
    /// Run many logs with several configurations and print the tables.
    Suite(suite::Suite),
    /// Serve a trajectory as a motion capture system would: for tests, and for people without one.
    #[command(subcommand)]
    Sim(sim::Sim),
    /// Render a sequence with movers, replay it with and without the panoptic filter, show the difference.
    Demo(demo::Demo),
    /// Print a completion script for a shell.
    Completions(completions::Completions),
    /// Write manual pages, one a command.
    #[command(name = "man")]
    Manual(man::Manual),
}

impl Command {
    /// Runs it.
    ///
    /// # Errors
    /// What the exit codes 2 and 3 of `pslam --help` say.
    pub fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        match self {
            Self::Devices(command) => command.run(),
            Self::Record(command) => command.run(progress),
            Self::Import(source) => source.run(progress),
            Self::Export(command) => command.run(progress),
            Self::Card(command) => command.run(progress),
            Self::Info(command) => command.run(),
            Self::Check(command) => command.run(),
            Self::Recover(command) => command.run(),
            Self::Slice(command) => command.run(progress),
            Self::Merge(command) => command.run(progress),
            Self::Filter(command) => command.run(progress),
            Self::Compress(command) => command.run(progress),
            Self::Redact(command) => command.run(progress),
            Self::Config(command) => command.run(),
            Self::Replay(command) => command.run(progress),
            Self::Verify(command) => command.run(progress),
            Self::Diff(command) => command.run(),
            Self::Sync(command) => command.run(progress),
            Self::Board(command) => command.run(),
            Self::Calibrate(command) => command.run(progress),
            Self::Eval(command) => command.run(),
            Self::Report(command) => command.run(progress),
            Self::Annotate(command) => command.run(progress),
            Self::EvalMasks(command) => command.run(),
            Self::Bench(command) => command.run(progress),
            Self::Suite(command) => command.run(progress),
            Self::Sim(command) => command.run(),
            Self::Demo(command) => command.run(progress),
            Self::Completions(command) => command.run(),
            Self::Manual(command) => command.run(),
        }
    }
}
