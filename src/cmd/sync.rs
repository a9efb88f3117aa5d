//! `pslam sync`: clocks, offset to the mocap and hand-eye transform of a recording.

use super::replay::How;
use crate::progress::{self, Progress};
use crate::{Outcome, Usage, stdout};
use anyhow::Context as _;
use recorder::sync::{OffsetOptions, SyncOptions, append_record, is_of, solve};
use replayer::log::read_signals;
use replayer::run::{self, trajectory};
use schemas::metadata;
use schemas::sync::{BodySync, Estimate, PoseSample, SyncRecord};
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Sync {
    /// The recording; the result becomes a record of its own in it, no stamp is changed.
    log: PathBuf,
    /// Write a copy instead.
    #[arg(short, long, value_name = "LOG")]
    out: Option<PathBuf>,
    /// Overwrite an existing copy.
    #[arg(long, requires = "out")]
    force: bool,
    /// Only print what is found.
    #[arg(long, conflicts_with = "out")]
    dry_run: bool,
    /// The marker body that carries the camera; default: the one whose turning agrees best.
    #[arg(long, value_name = "SUBJECT[/SEGMENT]")]
    subject: Option<String>,
    /// Largest clock offset looked for, milliseconds.
    #[arg(long, value_name = "MS", default_value = "500")]
    max_offset_ms: f64,
    /// Camera poses: a run's folder or a TUM trajectory; default: a replay of the log.
    #[arg(long, value_name = "RUN", conflicts_with = "no_poses")]
    poses: Option<PathBuf>,
    /// Do without camera poses: clocks and offset from the gyroscope, no hand-eye transform.
    #[arg(long)]
    no_poses: bool,
    #[command(flatten)]
    how: How,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// The record, and where it went.
#[derive(Debug, Serialize)]
struct Report {
    /// None in a dry run, and where the log keeps an earlier record.
    written_to: Option<PathBuf>,
    /// Nothing was found now, but in an earlier record: that one stays the last.
    kept_earlier: bool,
    #[serde(flatten)]
    record: SyncRecord,
}

impl Sync {
    pub(super) fn run(self, progress: Progress) -> anyhow::Result<Outcome> {
        if !(1.0..=60_000.0).contains(&self.max_offset_ms) {
            return Err(Usage(format!("--max-offset-ms {} is not between 1 and 60000", self.max_offset_ms)).into());
        }
        let Self { log, out, force, dry_run, subject, max_offset_ms, poses, no_poses, how, json } = self;
        let (mut signals, earlier) = read_signals(&log)?;
        if signals.bodies.is_empty() && signals.arrivals.is_empty() {
            let message =
                format!("{} holds no mocap frames and no raw clocks: only `pslam record` writes them", log.display());
            return Err(Usage(message).into());
        }
        if let Some(subject) =
            subject.as_ref().filter(|subject| !signals.bodies.keys().any(|body| is_of(body, subject)))
        {
            let known = signals.bodies.keys().map(String::as_str).collect::<Vec<_>>();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            return Err(Usage(format!("no body `{subject}` was seen; the recording has {known}")).into());
        }
        let path = match (&poses, no_poses || signals.bodies.is_empty()) {
            (_, true) => None,
            (Some(run), false) => Some(run::Estimate::read(run, false)?.trajectory),
            (None, false) => {
                let bar = progress.bar("replaying");
                let path = trajectory(&log, &how.options()?, &mut |done, all| progress::update(&bar, done, all));
                bar.finish_and_clear();
                Some(path.context("the camera's path for the hand-eye transform; --no-poses does without")?)
            }
        };
        signals.camera = path.iter().flat_map(|path| &path.poses).map(sample).collect();
        let offset = OffsetOptions { max_offset_s: max_offset_ms * 1e-3, ..OffsetOptions::default() };
        let record = solve(&signals, &SyncOptions { offset, body: subject, ..SyncOptions::default() });
        let found = record.camera_body().is_some() || record.bodies.is_empty();
        let kept_earlier = !found && earlier.is_some_and(|earlier| earlier.camera_body().is_some());
        let written_to = (!dry_run && !kept_earlier).then(|| out.unwrap_or_else(|| log.clone()));
        if let Some(out) = &written_to {
            append_record(&log, out, metadata::SYNC, record.to_metadata(), force)?;
        }
        stdout::either(json, "sync/1", &Report { written_to, kept_earlier, record })?;
        Ok(Outcome::from_good(found))
    }
}

fn sample(pose: &replayer::eval::StampedPose) -> PoseSample {
    let world = &pose.world_from_camera;
    PoseSample {
        stamp_ns: pose.stamp.0,
        system_ns: None,
        translation_m: world.translation.into(),
        rotation_xyzw: world.quaternion_xyzw(),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (stream, clock) in &self.record.clocks {
            match clock {
                Estimate::Missing(reason) => writeln!(f, "clock {stream:<8} {reason}")?,
                Estimate::Found(fit) => writeln!(
                    f,
                    "clock {stream:<8} drift {:+.2} ppm against the host over {:.0} s, residual {:.3} ms, delay above the \
                     shortest: median {:.2} ms, longest {:.1} ms",
                    fit.drift_ppm,
                    fit.span_s,
                    fit.residual_ns * 1e-6,
                    fit.delay_p50_ns * 1e-6,
                    fit.delay_max_ns * 1e-6
                )?,
            }
        }
        self.record.bodies.iter().try_for_each(|one| body(f, one))?;
        match &self.record.camera_body {
            Some(name) => writeln!(f, "camera on   {name}")?,
            None if self.record.bodies.is_empty() => writeln!(f, "the recording has no mocap")?,
            None => writeln!(f, "camera on   unknown: no body's turning agrees with the camera's")?,
        }
        match &self.written_to {
            Some(path) => writeln!(f, "written to  {}", path.display()),
            None if self.kept_earlier => writeln!(f, "nothing is written: the log has an offset from an earlier time"),
            None => writeln!(f, "nothing is written (dry run)"),
        }
    }
}

fn body(f: &mut fmt::Formatter<'_>, body: &BodySync) -> fmt::Result {
    let seen_s = body.windows.iter().fold(0.0, |sum, (start, end)| sum + (end - start) as f64 * 1e-9);
    writeln!(f, "body {}: seen for {seen_s:.1} s in {} windows without a gap", body.body, body.windows.len())?;
    match &body.offset {
        Estimate::Missing(reason) => writeln!(f, "  offset    {reason}")?,
        Estimate::Found(o) => {
            let drift = o.drift_sigma_ppm.map_or("not estimated (less than 30 s)".to_owned(), |sigma| {
                format!("{:+.2} +- {sigma:.2} ppm", o.drift_ppm)
            });
            let worst = o.windows.iter().map(|w| w.deviation_ns.abs()).fold(0.0, slam_math::float::max);
            writeln!(
                f,
                "  offset    camera - mocap = {:.3} +- {:.3} ms from the {}, drift {drift}",
                o.offset_ns as f64 * 1e-6,
                o.offset_sigma_ns * 1e-6,
                body.camera_side
            )?;
            writeln!(
                f,
                "            correlation {:.3} (next best {:.3}), residual {:.3} rad/s, pieces of 20 s deviate by {:.3} ms at most",
                o.correlation,
                o.rival_correlation,
                o.residual_rad_s,
                worst * 1e-6
            )?;
        }
    }
    match &body.hand_eye {
        Estimate::Missing(reason) => writeln!(f, "  hand-eye  {reason}"),
        Estimate::Found(h) => {
            let ([x, y, z], [qx, qy, qz, qw]) = (h.translation_m, h.rotation_xyzw);
            writeln!(
                f,
                "  hand-eye  marker_from_camera = [{x:.4} {y:.4} {z:.4}] m, [{qx:.5} {qy:.5} {qz:.5} {qw:.5}] xyzw, +- {:.1} \
                 mm, +- {:.2} deg",
                h.translation_sigma_m * 1e3,
                h.rotation_sigma_deg
            )?;
            writeln!(
                f,
                "            condition {:.2}, {} motions, residual {:.1} mm, {:.2} deg",
                h.condition,
                h.motions,
                h.translation_residual_m * 1e3,
                h.rotation_residual_deg
            )
        }
    }
}
