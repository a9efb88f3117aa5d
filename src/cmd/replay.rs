//! `pslam replay`.

use super::config::Choice;
use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use replayer::run::{ReplayOptions, replay};
use slam::config::SensorChoice;
use std::ops::Range;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Replay {
    /// The log.
    log: PathBuf,
    /// Folder to write: trajectories, records, run.json.
    #[arg(short, long, value_name = "RUN")]
    out: PathBuf,
    /// Write replay.rrd too, for the Rerun viewer.
    #[arg(long)]
    rrd: bool,
    /// Overwrite an earlier run.
    #[arg(long)]
    force: bool,
    /// Save the whole state before this frame of the log, and go on.
    #[arg(long, value_name = "FRAME:FILE", value_parser = save_state)]
    save_state: Option<(usize, PathBuf)>,
    /// Go on from a saved state: the run becomes the same as without, but for replay.rrd, which begins there. Wants the same
    /// log, configuration and first frame.
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    #[command(flatten)]
    how: How,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// How to replay, for every command that does.
#[derive(Debug, clap::Args)]
pub struct How {
    #[command(flatten)]
    choice: Choice,
    /// Only these frames of the log, as 100..200; either end may be left away.
    #[arg(long, value_name = "A..B", value_parser = frames)]
    frames: Option<Range<usize>>,
    /// Segmentation layer to use; default: the log's.
    #[arg(long, alias = "layer", value_name = "NAME")]
    segmentation: Option<String>,
    /// What to use of the log, whatever the configuration says: rgbd, stereo or monocular; default: depth images if
    /// there are any, else right pictures if there are any, else one picture at a time.
    #[arg(long, value_name = "KIND", value_parser = sensor)]
    sensor: Option<SensorChoice>,
    /// Threads; the result does not depend on them.
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
}

impl How {
    pub(super) fn options(self) -> anyhow::Result<ReplayOptions> {
        let mut config = self.choice.read()?;
        config.sensor.kind = self.sensor.unwrap_or(config.sensor.kind);
        Ok(ReplayOptions {
            config,
            config_name: self.choice.name(),
            frames: self.frames,
            threads: usize::from(self.threads),
            layer: self.segmentation,
            ..ReplayOptions::default()
        })
    }
}

fn sensor(text: &str) -> Result<SensorChoice, String> {
    match text {
        "rgbd" => Ok(SensorChoice::Rgbd),
        "stereo" => Ok(SensorChoice::Stereo),
        "monocular" | "mono" => Ok(SensorChoice::Monocular),
        _ => Err(format!("`{text}` is not rgbd, stereo or monocular")),
    }
}

/// `FRAME:FILE`.
fn save_state(text: &str) -> Result<(usize, PathBuf), String> {
    let parts = text.split_once(':').filter(|(_, file)| !file.is_empty());
    let parts = parts.and_then(|(frame, file)| Some((frame.parse().ok()?, PathBuf::from(file))));
    parts.ok_or_else(|| format!("`{text}` is not a frame and a file like 120:run.state"))
}

/// `A..B`, `A..`, `..B`; a range without frames makes no sense.
pub(super) fn frames(text: &str) -> Result<Range<usize>, String> {
    let wrong = || format!("`{text}` is not a range of frames like 100..200");
    let (start, end) = text.split_once("..").ok_or_else(wrong)?;
    let number = |text: &str, default| if text.is_empty() { Ok(default) } else { text.parse().map_err(|_| wrong()) };
    let range = number(start, 0)?..number(end, usize::MAX)?;
    if range.is_empty() { Err(format!("`{text}` holds no frame")) } else { Ok(range) }
}

impl Replay {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let Self { force, rrd, save_state, resume, .. } = self;
        let options = ReplayOptions { force, rrd, save_state, resume, ..self.how.options()? };
        let bar = progress.bar("replaying");
        let summary = replay(&self.log, &self.out, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        stdout::either(self.json, "replay/1", &summary)?;
        Ok(Outcome::Good)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_has_a_frame_and_a_file() {
        assert_eq!(save_state("12:a:b"), Ok((12, PathBuf::from("a:b"))));
        for wrong in ["", "12", "12:", ":file", "x:file"] {
            assert!(save_state(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn ranges_may_be_open() {
        assert_eq!(frames("3..7"), Ok(3..7));
        assert_eq!(frames("..7"), Ok(0..7));
        assert_eq!(frames("3.."), Ok(3..usize::MAX));
        for wrong in ["", "3", "7..3", "3..3", "a..b", "-1..2", "1..2..3"] {
            assert!(frames(wrong).is_err(), "{wrong}");
        }
    }
}
