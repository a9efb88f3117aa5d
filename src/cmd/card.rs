//! `pslam card`.

use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use replayer::card::{CardOptions, Transport, card};
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Card {
    /// The logs.
    #[arg(required = true)]
    logs: Vec<PathBuf>,
    /// The folder to write.
    #[arg(short, long)]
    out: PathBuf,
    /// Title of the dataset; default: the folder's name.
    #[arg(long, value_name = "TEXT")]
    title: Option<String>,
    /// What it is, one paragraph.
    #[arg(long, value_name = "TEXT")]
    description: Option<String>,
    /// SPDX identifier of the licence, as CC-BY-4.0; default: a placeholder.
    #[arg(long, value_name = "ID")]
    license: Option<String>,
    /// Text of the licence.
    #[arg(long, value_name = "FILE")]
    license_file: Option<PathBuf>,
    /// A person or institution, once for each; default: a placeholder.
    #[arg(long, value_name = "NAME")]
    author: Vec<String>,
    /// Where the dataset will be published.
    #[arg(long)]
    url: Option<String>,
    /// Version of the dataset; default: 1.0.0.
    #[arg(long = "dataset-version", value_name = "VERSION")]
    version: Option<String>,
    /// Day of publication, as 2026-01-31; default: not told.
    #[arg(long, value_name = "DAY")]
    date: Option<String>,
    /// How the logs come into the folder.
    #[arg(long, value_enum, default_value = "copy")]
    logs_by: By,
    /// Replace an older card.
    #[arg(long)]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How logs come into the folder.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum By {
    /// The originals stay.
    Copy,
    /// A hard link: a second name for the same bytes.
    Link,
    /// The originals are removed once the folder is complete.
    Move,
}

impl Card {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let transport = match self.logs_by {
            By::Copy => Transport::Copy,
            By::Link => Transport::HardLink,
            By::Move => Transport::Move,
        };
        let options = CardOptions {
            title: self.title,
            description: self.description,
            license: self.license,
            license_file: self.license_file,
            authors: self.author,
            url: self.url,
            version: self.version,
            date: self.date,
            transport,
            force: self.force,
        };
        let bar = progress.bar("reading");
        let report = card(&self.logs, &self.out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, "card/1", &report)?;
        Ok(Outcome::Good)
    }
}
