//! `pslam calibrate`: intrinsics check and hand-eye transform from views of a printed board.

use super::board::BoardLayout;
use crate::progress::{self, Progress};
use crate::{Outcome, stdout};
use anyhow::Context as _;
use recorder::calibrate::{Calibration, Calibrator};
use recorder::sync::{SyncOptions, append_record, solve};
use replayer::log::{Log, decode, read_signals};
use schemas::calibration::CameraModel;
use schemas::metadata;
use schemas::sync::{Estimate, HandEye, SyncRecord};
use serde::Serialize;
use slam_vision::gray_from_rgb;
use std::fmt;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Calibrate {
    /// A log in which the camera looks at the board.
    log: PathBuf,
    #[command(flatten)]
    layout: BoardLayout,
    /// Look at every n-th picture only.
    #[arg(long, value_name = "N", default_value = "3", value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// The marker body that carries the camera; default: the one whose turning agrees best.
    #[arg(long, value_name = "SUBJECT[/SEGMENT]")]
    subject: Option<String>,
    /// Reprojection error with the log's intrinsics above which they are called wrong, pixels.
    #[arg(long, value_name = "PX", default_value = "0.8")]
    max_error_px: f64,
    /// Write clocks and hand-eye transform into the log, as `pslam sync` does.
    #[arg(long)]
    write: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What was found.
#[derive(Debug, Serialize)]
struct Report {
    /// Intrinsics of the log.
    camera: CameraModel,
    /// Whether they fit the views.
    intrinsics_good: bool,
    /// Which of them the views contradict.
    contradicted: Vec<&'static str>,
    calibration: Calibration,
    /// None for a log without mocap.
    sync: Option<SyncRecord>,
    written: bool,
}

impl Calibrate {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        let layout = self.layout.layout()?;
        let log = Log::open(&self.log)?;
        let camera = log.camera()?;
        let timeline = log.timeline(None)?;
        let mut calibrator = Calibrator::new(layout, camera)?;
        let bar = progress.bar("looking for the board");
        for raw in timeline.stream(0..timeline.frames().len())? {
            let raw = raw?;
            progress::update(&bar, raw.index + 1, timeline.frames().len());
            if raw.index % self.every as usize == 0 {
                let frame = decode(&raw, &camera).with_context(|| self.log.display().to_string())?;
                let gray = gray_from_rgb(&frame.rgb.data, frame.rgb.width, frame.rgb.height)?;
                calibrator.frame(frame.stamp.0, &gray.data).with_context(|| format!("frame {}", frame.index))?;
            }
        }
        bar.finish_and_clear();
        let calibration = calibrator.finish()?;
        let (mut signals, _) = read_signals(&self.log)?;
        signals.camera = calibration.poses.clone();
        let options = SyncOptions { body: self.subject.clone(), ..SyncOptions::default() };
        let sync = (!signals.bodies.is_empty()).then(|| solve(&signals, &options));
        if let Some(record) = sync.as_ref().filter(|_| self.write) {
            append_record(&self.log, &self.log, metadata::SYNC, record.to_metadata(), false)?;
        }
        let contradicted = calibration.contradicted(&camera);
        let intrinsics_good = contradicted.is_empty() && calibration.rms_px <= self.max_error_px;
        let written = self.write && sync.is_some();
        let report = Report { camera, intrinsics_good, contradicted, calibration, sync, written };
        let hand_eye_good = report.sync.is_none() || report.hand_eye().is_some_and(|found| found.found().is_some());
        stdout::either(self.json, "calibrate/1", &report)?;
        Ok(Outcome::from_good(intrinsics_good && hand_eye_good))
    }
}

impl Report {
    fn hand_eye(&self) -> Option<&Estimate<HandEye>> {
        Some(&self.sync.as_ref()?.camera_body()?.hand_eye)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let c = &self.calibration;
        writeln!(f, "views       {} of {} pictures, {} corners", c.views, c.frames, c.corners)?;
        let verdict = if self.intrinsics_good { "good" } else { "WRONG: use the fitted ones" };
        writeln!(
            f,
            "intrinsics  {:.3} px with the log's: {verdict}; {:.3} px with the best",
            c.rms_px, c.fitted_rms_px
        )?;
        let rows = [
            ("fx", self.camera.fx, c.fitted.fx),
            ("fy", self.camera.fy, c.fitted.fy),
            ("cx", self.camera.cx, c.fitted.cx),
            ("cy", self.camera.cy, c.fitted.cy),
        ];
        if !self.contradicted.is_empty() {
            writeln!(f, "            the views contradict {}", self.contradicted.join(", "))?;
        }
        for ((name, log, fitted), sigma) in rows.iter().zip(&c.fitted_sigma_px) {
            writeln!(f, "  {name}        {log:.2} in the log, {fitted:.2} +- {sigma:.2} fitted")?;
        }
        match self.hand_eye() {
            None if self.sync.is_none() => writeln!(f, "hand-eye    the log has no mocap"),
            None => writeln!(f, "hand-eye    no body's turning agrees with the camera's: `pslam sync` tells more"),
            Some(Estimate::Missing(reason)) => writeln!(f, "hand-eye    {reason}"),
            Some(Estimate::Found(h)) => writeln!(
                f,
                "hand-eye    marker_from_camera = {:.4?} m, {:.5?} xyzw, +- {:.1} mm, +- {:.2} deg, condition {:.2}{}",
                h.translation_m,
                h.rotation_xyzw,
                h.translation_sigma_m * 1e3,
                h.rotation_sigma_deg,
                h.condition,
                if self.written { "; written to the log" } else { "; --write keeps it in the log" }
            ),
        }
    }
}
