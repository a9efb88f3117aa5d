//! `pslam demo`: the whole program on a rendered sequence.

use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout, synthetic};
use anyhow::Context as _;
use replayer::eval::{Alignment, Comparison, Coverage, EvalOptions, Evaluation, Trajectory, evaluate};
use replayer::log::Log;
use replayer::plot::{PlotEstimate, trajectories_svg};
use replayer::run::{INSPECTION_RRD, ReplayOptions, RunSummary, TRAJECTORY_TXT, replay};
use replayer::write_file;
use serde::Serialize;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// Stands in a folder that a demo wrote, and only there: such a folder may be written again.
const MARKER: &str = "written-by-pslam-demo.txt";
const LOG: &str = "demo.mcap";
const PLOT: &str = "trajectories.svg";
/// Presets to compare: with the filter and without.
const PRESETS: [&str; 2] = ["full", "none"];

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Demo {
    /// Folder to write; one that an earlier demo wrote is written again.
    #[arg(short, long, default_value = "out/demo")]
    out: PathBuf,
    /// What the camera is: colour with depth, two colour cameras, or one alone.
    #[arg(long, value_name = "KIND", default_value = "rgbd")]
    sensor: Seen,
    /// Threads; the result does not depend on them.
    #[arg(long, value_name = "N", default_value = "2", value_parser = clap::value_parser!(u16).range(1..=256))]
    threads: u16,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Kinds of cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Seen {
    /// Colour with a depth image.
    Rgbd,
    /// Two colour cameras, 11 cm apart.
    Stereo,
    /// One colour camera.
    Mono,
}

/// Distance of the stereo demo's cameras: that of the EuRoC sensor, metres.
const STEREO_BASELINE_M: f64 = 0.11;

/// What the demo found.
#[derive(Debug, Serialize)]
struct Report {
    /// The rendered log.
    log: PathBuf,
    /// Trajectories and errors, SVG.
    plot: PathBuf,
    /// With the feature `rerun` only.
    inspection: Option<PathBuf>,
    /// One a preset.
    runs: Vec<Judged>,
}

/// One replay.
#[derive(Debug, Serialize)]
struct Judged {
    /// Its preset.
    preset: &'static str,
    /// Its folder.
    folder: PathBuf,
    /// Its fingerprint.
    fingerprint: String,
    /// Its errors.
    evaluation: Evaluation,
}

impl Demo {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        prepare(&self.out)?;
        let log = self.out.join(LOG);
        let right_camera_m = if self.sensor == Seen::Stereo { STEREO_BASELINE_M } else { 0.0 };
        let scenario = fixtures::WorldConfig { right_camera_m, ..fixtures::scenario::demo() };
        let world = fixtures::World::new(&scenario).context("the demo's world")?;
        let bar = progress.bar("rendering");
        synthetic::write_log(&world, "demo", &log, true, &mut |_| {}, &mut |done, all| {
            progress::update(&bar, done, all);
        })?;
        bar.finish_and_clear();
        let truth = Log::open(&log)?.ground_truth().clone();
        let runs = PRESETS.map(|preset| self.judge(preset, &log, &truth, progress));
        let runs = runs.into_iter().collect::<anyhow::Result<Vec<_>>>()?;
        let plot = self.out.join(PLOT);
        let estimates: Vec<_> = runs.iter().map(|run| PlotEstimate::new(run.preset, &run.evaluation)).collect();
        let svg = trajectories_svg("Demo: camera path with and without the panoptic filter", &truth, &estimates);
        write_file(&plot, svg.as_bytes(), true)?;
        let inspection = cfg!(feature = "rerun").then(|| self.out.join(PRESETS[0]).join(INSPECTION_RRD));
        stdout::either(self.json, "demo/1", &Report { log, plot, inspection, runs })?;
        Ok(Outcome::Good)
    }

    /// Replays with a preset and evaluates the result.
    fn judge(
        &self,
        preset: &'static str,
        log: &Path,
        truth: &Trajectory,
        progress: Progress,
    ) -> anyhow::Result<Judged> {
        let mut config = slam::Config::preset(preset)?;
        if self.sensor == Seen::Mono {
            // The log has depth as well; it is not looked at.
            config.sensor.kind = slam::config::SensorChoice::Monocular;
        }
        let options = ReplayOptions {
            config,
            config_name: preset.to_owned(),
            threads: usize::from(self.threads),
            force: true,
            rrd: cfg!(feature = "rerun") && preset == PRESETS[0],
            ..ReplayOptions::default()
        };
        let folder = self.out.join(preset);
        let bar = progress.bar(if preset == "none" { "replaying, no filter" } else { "replaying, filtered" });
        let summary = replay(log, &folder, &options, &mut |done, all| progress::update(&bar, done, all))?;
        bar.finish_and_clear();
        let RunSummary { fingerprint, result, .. } = summary;
        let coverage = Coverage { tracked: result.in_trajectory, frames: result.frames };
        let trajectory = Trajectory::read_tum(&folder.join(TRAJECTORY_TXT))?;
        let options = EvalOptions { alignment: Alignment::for_sensor(&result.sensor), ..EvalOptions::default() };
        let evaluation = evaluate(truth, &trajectory, Some(coverage), &options)?;
        Ok(Judged { preset, folder, fingerprint, evaluation })
    }
}

/// Makes the folder; one that holds something else is left alone.
fn prepare(dir: &Path) -> anyhow::Result<()> {
    let marker = dir.join(MARKER);
    let used = dir.exists() && fs::read_dir(dir).with_context(|| dir.display().to_string())?.next().is_some();
    if used && !marker.exists() {
        let message = format!("{} is not empty and no demo wrote it: choose another folder with --out", dir.display());
        return Err(Usage(message).into());
    }
    fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    Ok(write_file(&marker, b"Everything in this folder is written again by the next `pslam demo`.\n", true)?)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rows: Vec<_> = self.runs.iter().map(|run| (run.preset, &run.evaluation)).collect();
        writeln!(
            f,
            "A rendered room with two people, a carried box, a balloon and a robot dog; camera path against truth:"
        )?;
        writeln!(f, "\n{}", Comparison(&rows))?;
        if let [with, without] = self.runs.as_slice() {
            let (with, without) = (with.evaluation.ate_m.rmse, without.evaluation.ate_m.rmse);
            writeln!(
                f,
                "With the panoptic filter the error is {:.1} mm, without it {:.1} mm.",
                with * 1e3,
                without * 1e3
            )?;
        }
        writeln!(f, "\nlog        {}  (pslam info {0})", self.log.display())?;
        for run in &self.runs {
            writeln!(f, "run        {}  (pslam eval {0})", run.folder.display())?;
        }
        writeln!(f, "plot       {}  (any browser)", self.plot.display())?;
        match &self.inspection {
            Some(path) => {
                writeln!(f, "inspection {}  (pip install rerun-sdk==0.36.3, then: rerun {0})", path.display())
            }
            None => writeln!(f, "inspection none: this program was built without the feature `rerun`"),
        }
    }
}
