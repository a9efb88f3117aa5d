//! `pslam suite`.

use crate::progress::Progress;
use crate::suite::spec::Suite as Spec;
use crate::suite::{BUILT_IN, run};
use crate::{Outcome, Usage, stdout};
use anyhow::Context as _;
use replayer::write_file;
use std::fs;
use std::path::{Path, PathBuf};

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Suite {
    /// A suite file, or one that comes along: tum, bonn, quadruped, kitchens, synthetic, unseen, rooms, robust, hard.
    suite: String,
    /// Folder to write: logs, runs, suite.json, tables.md.
    #[arg(short, long, value_name = "DIR", required_unless_present = "print")]
    out: Option<PathBuf>,
    /// Folder of the data sets; default: what the suite says.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Print the suite file instead of running it, to start one's own from.
    #[arg(long)]
    print: bool,
    /// Write into a folder that is not empty.
    #[arg(long)]
    force: bool,
    /// Threads; the result does not depend on them. A suite with perturbations has so many sequences in memory and one.
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

impl Suite {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let (text, home) = self.text()?;
        let spec = Spec::parse(&text).with_context(|| format!("suite {}", self.suite))?;
        let Some(out) = self.out.as_deref().filter(|_| !self.print) else {
            stdout::text(&text)?;
            return Ok(Outcome::Good);
        };
        if !self.force && out.exists() && fs::read_dir(out).map(|mut d| d.next().is_some()).unwrap_or(true) {
            let message =
                format!("{} is not empty: choose another folder, or --force replaces what is in it", out.display());
            return Err(Usage(message).into());
        }
        let data = self.data.clone().unwrap_or_else(|| home.join(&spec.data));
        let report = run(&spec, &data, out, usize::from(self.threads), progress)?;
        write_file(&out.join("suite.json"), serde_json::to_string_pretty(&report)?.as_bytes(), true)?;
        write_file(&out.join("tables.md"), report.to_string().as_bytes(), true)?;
        stdout::either(self.json, "suite/1", &report)?;
        Ok(Outcome::from_good(report.complete()))
    }

    /// The suite's text, and the folder it stands in.
    fn text(&self) -> anyhow::Result<(String, PathBuf)> {
        if let Some((_, text)) = BUILT_IN.iter().find(|(name, _)| *name == self.suite) {
            return Ok(((*text).to_owned(), PathBuf::new()));
        }
        let path = Path::new(&self.suite);
        let text = fs::read_to_string(path).with_context(|| format!("cannot read the suite {}", path.display()))?;
        Ok((text, path.parent().unwrap_or(Path::new("")).to_owned()))
    }
}
