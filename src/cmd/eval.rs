//! `pslam eval`.

use crate::{Outcome, Usage, stdout};
use replayer::eval::{Alignment, DeltaUnit, EvalOptions, Evaluation, RpeOptions, Statistics, evaluate};
use replayer::plot::{PlotEstimate, trajectories_svg};
use replayer::run::{Estimate, MapFrames};
use replayer::{read_truth, write_file};
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Eval {
    /// A run's folder, or a trajectory as TUM text.
    run: PathBuf,
    /// Ground truth: a log or TUM text; default: the log that was replayed.
    log: Option<PathBuf>,
    /// Judge the poses as they were known at each frame instead of the final ones.
    #[arg(long)]
    online: bool,
    /// Align with scale too; the default for monocular runs.
    #[arg(long, conflicts_with_all = ["no_align", "se3"])]
    sim3: bool,
    /// Align without scale; the default for all other runs and for text files.
    #[arg(long, conflicts_with = "no_align")]
    se3: bool,
    /// Do not align: both trajectories stand in the same frame already.
    #[arg(long)]
    no_align: bool,
    /// Relative errors over these distances: 1f (frames), 0.5m (metres), 2s (seconds); several with commas.
    #[arg(long, value_name = "DELTA", value_delimiter = ',', default_values = ["1f", "1s", "1m"])]
    rpe_delta: Vec<String>,
    /// Relative errors from every pose on, not only over consecutive stretches.
    #[arg(long)]
    rpe_all_pairs: bool,
    /// Poses nearer in time than this are compared, milliseconds.
    #[arg(long, value_name = "MS", default_value = "10")]
    max_difference_ms: f64,
    /// Draw trajectories and errors into an SVG file.
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// Overwrite an existing plot.
    #[arg(long, requires = "plot")]
    force: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The errors, and what they do not cover.
#[derive(Serialize)]
struct Judgement {
    #[serde(flatten)]
    evaluation: Evaluation,
    /// Position errors of the poses as they were known at each frame, where the final ones of a run are judged.
    online_ate_m: Option<Statistics>,
    /// Maps that were never joined to the one of the trajectory, with their frames: these are not judged.
    never_joined: Vec<MapFrames>,
}

impl fmt::Display for Judgement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for MapFrames { map, frames } in &self.never_joined {
            writeln!(
                f,
                "not judged: {frames} frames of map{map}, which was never joined to the map of the trajectory"
            )?;
        }
        write!(f, "{}", self.evaluation)?;
        if let Some(Statistics { rmse, median, max, count, .. }) = &self.online_ate_m {
            write!(
                f,
                "\nonline    ATE {rmse:.5} m rmse, {median:.5} median, {max:.5} max over {count} poses as known at each frame"
            )?;
        }
        Ok(())
    }
}

impl Eval {
    /// What was asked for, else what the sensor needs.
    fn alignment(&self, sensor: Option<&str>) -> Alignment {
        match (self.sim3, self.no_align, self.se3) {
            (true, ..) => Alignment::Sim3,
            (_, true, _) => Alignment::None,
            (_, _, true) => Alignment::Se3,
            _ => Alignment::for_sensor(sensor.unwrap_or_default()),
        }
    }

    fn options(&self) -> anyhow::Result<EvalOptions> {
        if !(0.0..=1e6).contains(&self.max_difference_ms) {
            return Err(
                Usage(format!("--max-difference-ms {} is not between 0 and 1e6", self.max_difference_ms)).into()
            );
        }
        let rpe = self.rpe_delta.iter().map(|text| Ok(RpeOptions { all_pairs: self.rpe_all_pairs, ..delta(text)? }));
        Ok(EvalOptions {
            max_difference_s: self.max_difference_ms / 1e3,
            rpe: rpe.collect::<Result<_, Usage>>()?,
            ..EvalOptions::default()
        })
    }

    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let mut options = self.options()?;
        let estimate = Estimate::read(&self.run, self.online)?;
        options.alignment = self.alignment(estimate.sensor.as_deref());
        let truth = self.log.clone().or(estimate.log);
        let truth = truth.ok_or_else(|| Usage("give the ground truth: a log or a text file".to_owned()))?;
        let truth = read_truth(&truth)?;
        let evaluation = evaluate(&truth, &estimate.trajectory, estimate.coverage, &options)?;
        if let Some(path) = &self.plot {
            let name = self.run.file_name().unwrap_or(self.run.as_os_str()).to_string_lossy();
            let svg = trajectories_svg(&name, &truth, &[PlotEstimate::new(&name, &evaluation)]);
            write_file(path, svg.as_bytes(), self.force)?;
        }
        let mut online_ate_m = None;
        if self.run.is_dir() && !self.online {
            // Where it can't be judged, the final one still is.
            let online = Estimate::read(&self.run, true)?.trajectory;
            online_ate_m = evaluate(&truth, &online, None, &options).ok().map(|evaluation| evaluation.ate_m);
        }
        let judgement = Judgement { evaluation, online_ate_m, never_joined: estimate.never_joined };
        stdout::either(self.json, "eval/1", &judgement)?;
        Ok(Outcome::Good)
    }
}

/// `0.5m` as metres, `1f` as frames, `2s` as seconds.
fn delta(text: &str) -> Result<RpeOptions, Usage> {
    let wrong = || Usage(format!("--rpe-delta `{text}` is not a distance like 1f, 0.5m or 2s"));
    let split = text.char_indices().last().map_or(0, |(at, _)| at);
    let unit = match &text[split..] {
        "m" => DeltaUnit::Metres,
        "f" => DeltaUnit::Frames,
        "s" => DeltaUnit::Seconds,
        _ => return Err(wrong()),
    };
    Ok(RpeOptions::new(text[..split].parse().map_err(|_| wrong())?, unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_have_a_number_and_a_unit() {
        assert_eq!(delta("0.5m").unwrap(), RpeOptions::new(0.5, DeltaUnit::Metres));
        assert_eq!(delta("3f").unwrap(), RpeOptions::new(3.0, DeltaUnit::Frames));
        for wrong in ["", "m", "1", "1 m ", "xs", "1µ"] {
            assert!(delta(wrong).is_err(), "{wrong}");
        }
    }
}
