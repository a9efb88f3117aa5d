//! `pslam slice`.

use super::moment::Moment;
use super::{Target, Topics};
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use recorder::edit::{Cut, slice};
use replayer::log::Log;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Slice {
    /// The log.
    log: PathBuf,
    /// These frames, as `pslam replay --frames` counts: 100..200; either end may be left away.
    #[arg(long, value_name = "A..B", value_parser = crate::cmd::replay::frames, conflicts_with_all = ["from", "to"])]
    frames: Option<Range<usize>>,
    /// From here on: 1.5s or 250ms after the first picture, a stamp in seconds (1600000006.666667), or RFC 3339
    /// (2026-11-27T08:39:54.5Z).
    #[arg(long, value_name = "TIME")]
    from: Option<Moment>,
    /// To before here.
    #[arg(long, value_name = "TIME")]
    to: Option<Moment>,
    /// How far beyond the cut ground truth, mocap, inertial samples and clocks reach, seconds.
    #[arg(long, value_name = "SECONDS", default_value = "1")]
    margin: f64,
    #[command(flatten)]
    topics: Topics,
    #[command(flatten)]
    target: Target,
}

impl Slice {
    pub(in crate::cmd) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        if !(0.0..=3600.0).contains(&self.margin) {
            return Err(Usage(format!("--margin {} is not between 0 and 3600 seconds", self.margin)).into());
        }
        let margin_ns = (self.margin * 1e9).round() as u64;
        let mut arguments = BTreeMap::from([("margin_ns".to_owned(), margin_ns.into())]);
        self.topics.add_to(&mut arguments);
        let cut = match &self.frames {
            Some(frames) => {
                let end = if frames.end == usize::MAX { String::new() } else { frames.end.to_string() };
                arguments.insert("frames".to_owned(), format!("{}..{end}", frames.start).into());
                Cut::Frames(frames.clone())
            }
            None => {
                let first = self.first_picture()?;
                let [from, to] = [&self.from, &self.to].map(|moment| moment.as_ref().map(|moment| moment.stamp(first)));
                let both = [("from_ns", from), ("to_ns", to)];
                arguments.extend(both.into_iter().filter_map(|(name, at)| Some((name.to_owned(), at?.0.into()))));
                Cut::Time(from, to)
            }
        };
        let keeps = self.topics.rule()?;
        let options = self.target.options("slice", arguments);
        let bar = progress.bar("slicing");
        let summary = slice(&self.log, &self.target.out, (&cut, margin_ns), &keeps, &options, &mut |done, all| {
            progress::update(&bar, done as usize, all as usize);
        })?;
        bar.finish_and_clear();
        stdout::either(self.target.json, "slice/1", &summary)?;
        Ok(Outcome::Good)
    }

    /// What relative times count from; only read where one is given.
    fn first_picture(&self) -> anyhow::Result<schemas::Stamp> {
        if ![&self.from, &self.to].into_iter().flatten().any(Moment::is_relative) {
            return Ok(schemas::Stamp(0));
        }
        Ok(Log::open(&self.log)?.timeline(None)?.frames()[0].stamp)
    }
}
