//! How long the stages took. Kept apart from everything that is hashed.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use slam::{Observer, Work};

use crate::stopwatch::{Stopwatch, cpu_seconds, peak_memory_bytes};

/// Time of one stage per frame, milliseconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageTime {
    /// Name of the stage.
    pub stage: String,
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
    /// From the first frame's bytes to the last result, decoding included; opening the log is not.
    pub wall_s: f64,
    /// Processor time of all threads in that stretch.
    pub cpu_s: Option<f64>,
    /// Frames a second of wall time.
    pub frames_per_s: f64,
    /// Largest resident memory of the process, MiB.
    pub peak_memory_mib: Option<f64>,
    /// Stages in order, the last one is their sum.
    pub stages: Vec<StageTime>,
}

impl Timing {
    /// Mean time of features, filter and tracking, milliseconds a frame: what the field calls tracking time. Decoding
    /// and mapping stand apart.
    #[must_use]
    pub fn tracking_ms(&self) -> f64 {
        let tracking = [Work::Label, Work::Predict, Work::Judge, Work::LocalMap].map(Work::name);
        let counts = |stage: &str| stage == BEFORE[1] || tracking.contains(&stage);
        self.stages.iter().filter(|s| counts(&s.stage)).map(|s| s.mean_ms).fold(0.0, |a, b| a + b)
    }
}

impl fmt::Display for Timing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<16}{:>10}{:>10}{:>10}{:>10}", "ms per frame", "mean", "p50", "p95", "p99")?;
        for StageTime { stage, mean_ms, p50_ms, p95_ms, p99_ms } in &self.stages {
            writeln!(f, "{stage:<16}{mean_ms:>10.2}{p50_ms:>10.2}{p95_ms:>10.2}{p99_ms:>10.2}")?;
        }
        let plural = if self.threads == 1 { "" } else { "s" };
        write!(f, "{:.1} frames/s, {:.2} s with {} thread{plural}", self.frames_per_s, self.wall_s, self.threads)?;
        if let Some(cpu_s) = self.cpu_s {
            write!(f, ", {cpu_s:.2} s of processor time")?;
        }
        if let Some(mib) = self.peak_memory_mib {
            write!(f, ", peak memory {mib:.0} MiB")?;
        }
        Ok(())
    }
}

/// Stages before the slam's own.
const BEFORE: [&str; 2] = ["decode", "features"];

/// Collects times during a replay.
pub(super) struct Clock {
    /// Over the whole replay.
    whole: Stopwatch,
    cpu_at_start_s: Option<f64>,
    /// Within a frame.
    lap: Stopwatch,
    /// One entry a frame, one value a stage, seconds.
    frames: Vec<[f64; BEFORE.len() + Work::ALL.len()]>,
}

impl Clock {
    pub fn start() -> Self {
        let now = Stopwatch::start();
        Self { whole: now, cpu_at_start_s: cpu_seconds(), lap: now, frames: Vec::new() }
    }

    /// The slam begins with the next frame.
    pub fn frame(&mut self, decode: Duration, features: Duration) {
        let mut times = [0.0; BEFORE.len() + Work::ALL.len()];
        (times[0], times[1]) = (decode.as_secs_f64(), features.as_secs_f64());
        self.frames.push(times);
        self.lap.lap();
    }

    pub fn finish(mut self, threads: usize) -> Timing {
        let wall_s = self.whole.lap().as_secs_f64();
        let names = BEFORE.into_iter().chain(Work::ALL.iter().map(|work| work.name()));
        let column = |i: usize| self.frames.iter().map(|frame| frame[i]).collect();
        let mut stages: Vec<_> = names.enumerate().map(|(i, name)| stage_time(name, column(i))).collect();
        stages.push(stage_time("all", self.frames.iter().map(|frame| frame.iter().fold(0.0, |a, b| a + b)).collect()));
        Timing {
            threads,
            wall_s: rounded(wall_s),
            cpu_s: cpu_seconds().zip(self.cpu_at_start_s).map(|(end, start)| rounded(end - start)),
            frames_per_s: if wall_s > 0.0 { rounded(self.frames.len() as f64 / wall_s) } else { 0.0 },
            peak_memory_mib: peak_memory_bytes().map(|bytes| rounded(bytes as f64 / f64::from(1 << 20))),
            stages,
        }
    }
}

impl Observer for Clock {
    fn done(&mut self, work: Work) {
        let lap = self.lap.lap().as_secs_f64();
        if let Some(frame) = self.frames.last_mut() {
            frame[BEFORE.len() + work as usize] += lap;
        }
    }
}

/// Three decimals: more would be noise.
fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

fn stage_time(stage: &str, mut seconds: Vec<f64>) -> StageTime {
    seconds.sort_by(f64::total_cmp);
    let n = seconds.len();
    // Nearest rank: the smallest value that at least this share of the frames does not exceed.
    let percentile =
        |percent: usize| seconds.get((n * percent).div_ceil(100).saturating_sub(1)).copied().unwrap_or(0.0);
    let mean = seconds.iter().fold(0.0, |a, b| a + b) / n.max(1) as f64;
    let [mean_ms, p50_ms, p95_ms, p99_ms] =
        [mean, percentile(50), percentile(95), percentile(99)].map(|s| rounded(s * 1e3));
    StageTime { stage: stage.to_owned(), mean_ms, p50_ms, p95_ms, p99_ms }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_nearest_ranks() {
        let times = stage_time("x", (1..=200).rev().map(f64::from).collect());
        let found = [times.mean_ms, times.p50_ms, times.p95_ms, times.p99_ms];
        assert_eq!(found, [100_500.0, 100_000.0, 190_000.0, 198_000.0]);
        assert_eq!(stage_time("none", Vec::new()).p99_ms, 0.0);
    }
}
