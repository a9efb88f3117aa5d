//! How long the stages took. Kept apart from everything that is hashed.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use slam::{JobKind, Observer, Work};

use super::workers::JobTime;
use crate::stopwatch::{Stopwatch, cpu_seconds, peak_memory_bytes};

/// Time of one stage, milliseconds a frame; of a background job, milliseconds a job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage or job.
    pub stage: String,
    /// How often it was measured: frames, or jobs.
    pub count: usize,
    /// Mean over all frames, those without such work included.
    pub mean_ms: f64,
    /// Half of the frames took at most this.
    pub p50_ms: f64,
    /// 95 % of the frames took at most this.
    pub p95_ms: f64,
    /// 99 % of the frames took at most this.
    pub p99_ms: f64,
}

/// What a replay cost.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Timing {
    /// Threads that were allowed.
    pub threads: usize,
    /// From an empty slam to the first frame's result.
    pub start_up_s: f64,
    /// From an empty slam to the last result, decoding included; opening the log is not.
    pub wall_s: f64,
    /// Processor time of all threads in that stretch.
    pub cpu_s: Option<f64>,
    /// The same a frame, milliseconds.
    pub cpu_ms_per_frame: Option<f64>,
    /// Frames a second of wall time.
    pub frames_per_s: f64,
    /// Largest resident memory of the process, MiB.
    pub peak_memory_mib: Option<f64>,
    /// Stages in order.
    pub stages: Vec<StageTime>,
    /// What the field calls tracking time: features, filter, pose, keyframes, and applying what jobs found. Decoding,
    /// digests, the jobs themselves and waiting for them stand apart.
    pub tracking: StageTime,
    /// The tracking thread waiting for late jobs, or running them when it is alone.
    pub waiting: StageTime,
    /// Background jobs, wherever they ran.
    pub jobs: Vec<StageTime>,
    /// The final stage after the last frame, seconds of wall time.
    pub final_s: f64,
}

impl Timing {
    /// Mean tracking time, milliseconds a frame.
    #[must_use]
    pub fn tracking_ms(&self) -> f64 {
        self.tracking.mean_ms
    }
}

impl fmt::Display for Timing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<16}{:>10}{:>10}{:>10}{:>10}", "ms per frame", "mean", "p50", "p95", "p99")?;
        for stage in self.stages.iter().chain([&self.tracking, &self.waiting]) {
            writeln!(f, "{stage}")?;
        }
        for job in &self.jobs {
            writeln!(f, "{job} a job, {} jobs", job.count)?;
        }
        let plural = if self.threads == 1 { "" } else { "s" };
        write!(f, "{:.1} frames/s, {:.2} s with {} thread{plural}", self.frames_per_s, self.wall_s, self.threads)?;
        if let Some(cpu_s) = self.cpu_s {
            write!(f, ", {cpu_s:.2} s of processor time")?;
        }
        if let Some(cpu_ms) = self.cpu_ms_per_frame {
            write!(f, " ({cpu_ms:.1} ms a frame)")?;
        }
        if let Some(mib) = self.peak_memory_mib {
            write!(f, ", peak memory {mib:.0} MiB")?;
        }
        write!(f, ", start-up {:.2} s, final stage {:.2} s", self.start_up_s, self.final_s)
    }
}

impl fmt::Display for StageTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, mean_ms, p50_ms, p95_ms, p99_ms, .. } = self;
        write!(f, "{stage:<16}{mean_ms:>10.2}{p50_ms:>10.2}{p95_ms:>10.2}{p99_ms:>10.2}")
    }
}

/// Stages before the slam's own.
const BEFORE: [&str; 2] = ["decode", "features"];
const FEATURES: usize = 1;
const STAGES: usize = BEFORE.len() + Work::ALL.len();

/// Where the time of a piece of work is kept.
fn column(work: Work) -> usize {
    BEFORE.len() + work as usize
}

/// Collects times during a replay.
pub(super) struct Clock {
    /// Over the whole replay.
    start: Stopwatch,
    cpu_at_start_s: Option<f64>,
    start_up_s: f64,
    /// Within a frame.
    lap: Stopwatch,
    /// One entry a frame, one value a stage, seconds.
    frames: Vec<[f32; STAGES]>,
}

impl Clock {
    pub fn start() -> Self {
        let now = Stopwatch::start();
        Self { start: now, cpu_at_start_s: cpu_seconds(), start_up_s: 0.0, lap: now, frames: Vec::new() }
    }

    /// The slam begins with the next frame.
    pub fn frame(&mut self, decode: Duration, features: Duration) {
        let mut times = [0.0; STAGES];
        (times[0], times[FEATURES]) = (decode.as_secs_f32(), features.as_secs_f32());
        self.frames.push(times);
        self.lap.lap();
    }

    /// The slam has ended with a frame.
    pub fn frame_done(&mut self) {
        if self.frames.len() == 1 {
            self.start_up_s = self.start.elapsed().as_secs_f64();
        }
    }

    pub fn finish(self, threads: usize, job_times: &[JobTime], final_stage: Duration) -> Timing {
        let wall_s = self.start.elapsed().as_secs_f64();
        let frames = self.frames.len();
        let cpu_s = cpu_seconds().zip(self.cpu_at_start_s).map(|(end, start)| end - start);
        let sum = |name: &str, columns: &[usize]| {
            let of_frame = |times: &[f32; STAGES]| columns.iter().fold(0.0, |sum, i| sum + times[*i]);
            stage_time(name, self.frames.iter().map(of_frame).collect())
        };
        let stages = BEFORE.iter().enumerate().map(|(i, name)| sum(name, &[i]));
        let works = Work::ALL.into_iter().filter(|work| *work != Work::Jobs);
        let tracking: Vec<usize> = works.clone().filter(|work| *work != Work::Report).map(column).collect();
        let jobs = JobKind::ALL.into_iter().map(|kind| {
            let of_kind = job_times.iter().filter(|(of, _)| *of == kind);
            stage_time(kind.name(), of_kind.map(|(_, time)| time.as_secs_f32()).collect())
        });
        Timing {
            threads,
            start_up_s: rounded(self.start_up_s),
            wall_s: rounded(wall_s),
            cpu_s: cpu_s.map(rounded),
            cpu_ms_per_frame: cpu_s.map(|s| rounded(1e3 * s / frames.max(1) as f64)),
            frames_per_s: if wall_s > 0.0 { rounded(frames as f64 / wall_s) } else { 0.0 },
            peak_memory_mib: peak_memory_bytes().map(|bytes| rounded(bytes as f64 / f64::from(1 << 20))),
            stages: stages.chain(works.map(|work| sum(work.name(), &[column(work)]))).collect(),
            tracking: sum("tracking", &[&[FEATURES], tracking.as_slice()].concat()),
            waiting: sum("waiting", &[column(Work::Jobs)]),
            jobs: jobs.filter(|job| job.count > 0).collect(),
            final_s: rounded(final_stage.as_secs_f64()),
        }
    }
}

impl Observer for Clock {
    fn done(&mut self, work: Work) {
        let lap = self.lap.lap().as_secs_f32();
        if let Some(frame) = self.frames.last_mut() {
            frame[column(work)] += lap;
        }
    }
}

/// Three decimals: more would be noise.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

fn stage_time(stage: &str, mut seconds: Vec<f32>) -> StageTime {
    seconds.sort_by(f32::total_cmp);
    let n = seconds.len();
    // Nearest rank: the smallest value that at least this share of the frames does not exceed.
    let percentile =
        |percent: usize| seconds.get((n * percent).div_ceil(100).saturating_sub(1)).copied().unwrap_or(0.0);
    let mean = seconds.iter().fold(0.0, |a, b| a + f64::from(*b)) / n.max(1) as f64;
    let [p50_ms, p95_ms, p99_ms] = [50, 95, 99].map(|percent| rounded(f64::from(percentile(percent)) * 1e3));
    StageTime { stage: stage.to_owned(), count: n, mean_ms: rounded(mean * 1e3), p50_ms, p95_ms, p99_ms }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_nearest_ranks() {
        let times = stage_time("x", (1..=200_u8).rev().map(f32::from).collect());
        let found = [times.mean_ms, times.p50_ms, times.p95_ms, times.p99_ms];
        assert_eq!(found, [100_500.0, 100_000.0, 190_000.0, 198_000.0]);
        assert_eq!(stage_time("none", Vec::new()).p99_ms, 0.0);
    }
}
