//! What is told while a recording runs, and at its end.

use super::clock::ClockHealth;
use super::inlet::{EndedBy, Happening, MocapCounts};
use super::labelling::LabelCounts;
use super::ledger::Counts;
use super::stream::Stream;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// A moment of a running recording.
#[derive(Debug, Clone, Serialize)]
pub struct Status {
    /// `status`.
    pub kind: &'static str,
    /// Since the start, seconds.
    pub elapsed_s: f64,
    /// Streams that were promised or came.
    pub streams: Vec<StreamStatus>,
    /// Size of the file so far.
    pub file_bytes: u64,
    /// Growth of the file since the last status, bytes a second.
    pub bytes_per_s: f64,
    /// Encoded messages that wait for the disk, bytes.
    pub waiting_bytes: usize,
    /// Room on the disk above the reserve, bytes.
    pub room_bytes: u64,
    /// How long that lasts at the present speed, seconds.
    pub room_s: Option<f64>,
    /// The host's realtime clock.
    pub clock: ClockHealth,
    /// Motion capture.
    pub mocap: MocapCounts,
    /// Labels that are made meanwhile, if that was asked for.
    pub segmentation: Option<LabelCounts>,
    /// 99 % of all measurements took no longer from arrival into the file, milliseconds.
    pub latency_p99_ms: f64,
    /// What happened since the last status.
    pub happenings: Vec<Happening>,
}

/// How long a room lasts, seconds. `None` as long as no measurement is in the file: the records at its start say nothing
/// about how it will grow.
pub(super) fn room_s(room_bytes: u64, bytes_per_s: f64, flushed: u64) -> Option<f64> {
    (flushed > 0 && bytes_per_s > 0.0).then(|| room_bytes as f64 / bytes_per_s)
}

/// One stream.
#[derive(Debug, Clone, Serialize)]
pub struct StreamStatus {
    /// Which.
    pub stream: Stream,
    /// Measurements a second since the last status.
    pub rate_hz: f64,
    /// Measurements that wait for their encoder.
    pub waiting: usize,
    /// Counts since the start.
    #[serde(flatten)]
    pub counts: Counts,
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.0} s", self.elapsed_s)?;
        for s in &self.streams {
            write!(f, " | {} {:.1}/s", s.stream.name(), s.rate_hz)?;
            if s.counts.dropped_device + s.counts.dropped_host > 0 {
                write!(f, " LOST {}+{}", s.counts.dropped_device, s.counts.dropped_host)?;
            }
            if s.waiting > 1 {
                write!(f, " queue {}", s.waiting)?;
            }
            if s.stream == Stream::Mocap {
                write!(f, " seen {}/{}", self.mocap.bodies - self.mocap.occluded, self.mocap.bodies)?;
            }
        }
        if let Some(counts) = &self.segmentation {
            let LabelCounts { labelled, pictures, p50_ms, .. } = counts;
            write!(f, " | labels {labelled}/{pictures} skipped {} p50 {p50_ms:.0} ms", counts.skipped())?;
        }
        write!(f, " | {:.1} MB/s, {:.1} GB left", self.bytes_per_s / 1e6, self.room_bytes as f64 / 1e9)?;
        match self.room_s {
            Some(room_s) if room_s < 36_000.0 => write!(f, " ({:.0} min)", room_s / 60.0)?,
            Some(room_s) => write!(f, " ({:.0} h)", room_s / 3600.0)?,
            None => write!(f, " (time unknown)")?,
        }
        if self.clock.steps > 0 {
            write!(f, " | clock stepped {} x", self.clock.steps)?;
        }
        Ok(())
    }
}

/// How a recording ended.
#[derive(Debug, Clone, Serialize)]
pub struct Verdict {
    /// `verdict`.
    pub kind: &'static str,
    /// Whether everything that the sensors told of is in the log.
    pub complete: bool,
    /// What is missing, in words.
    pub reasons: Vec<String>,
    /// Why it ended.
    pub ended_by: EndedBy,
    /// The log, or what is left of it (`.partial`).
    pub file: PathBuf,
    /// Its size.
    pub file_bytes: u64,
    /// From the first measurement to the end, seconds.
    pub duration_s: f64,
    /// Streams that were promised or came.
    pub streams: Vec<StreamCounts>,
    /// Motion capture.
    pub mocap: MocapCounts,
    /// Labels that were made meanwhile, if that was asked for.
    pub segmentation: Option<LabelCounts>,
    /// The host's realtime clock.
    pub clock: ClockHealth,
    /// 99 % of all measurements took no longer from arrival into the file, milliseconds.
    pub latency_p99_ms: f64,
    /// The longest that one took, milliseconds.
    pub latency_max_ms: f64,
    /// Everything that happened.
    pub happenings: Vec<Happening>,
}

/// Counts of one stream.
#[derive(Debug, Clone, Serialize)]
pub struct StreamCounts {
    /// Which.
    pub stream: Stream,
    /// Counts since the start.
    #[serde(flatten)]
    pub counts: Counts,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (file, megabytes) = (self.file.display(), self.file_bytes as f64 / 1e6);
        writeln!(f, "{file}: {:.1} s, {megabytes:.1} MB", self.duration_s)?;
        for StreamCounts { stream, counts: c } in &self.streams {
            let (name, written, device, host) = (stream.name(), c.written, c.dropped_device, c.dropped_host);
            writeln!(f, "  {name:<6} {written:>8} written, {device} lost by the device, {host} lost here")?;
        }
        if self.streams.iter().any(|s| s.stream == Stream::Mocap) {
            let MocapCounts { occlusions, frames_with_occlusion, .. } = self.mocap;
            writeln!(f, "  mocap  {occlusions} occlusions in {frames_with_occlusion} frames")?;
        }
        if let Some(counts) = &self.segmentation {
            writeln!(f, "  labels {counts}, due {} pictures later", counts.lag_pictures)?;
        }
        writeln!(f, "  arrival to file: p99 {:.1} ms, max {:.1} ms", self.latency_p99_ms, self.latency_max_ms)?;
        for reason in &self.reasons {
            writeln!(f, "  {reason}")?;
        }
        writeln!(f, "{}", if self.complete { "complete: nothing is lost" } else { "INCOMPLETE" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_left_is_unknown_before_there_is_a_speed() {
        assert_eq!(room_s(100_000_000_000, 800.0, 0), None, "the records at the start alone");
        assert_eq!(room_s(100_000_000_000, 0.0, 30), None);
        assert_eq!(room_s(60_000_000, 1e6, 30), Some(60.0));
        let mut status = Status {
            kind: "status",
            elapsed_s: 1.0,
            streams: Vec::new(),
            file_bytes: 800,
            bytes_per_s: 800.0,
            waiting_bytes: 0,
            room_bytes: 100_000_000_000,
            room_s: room_s(100_000_000_000, 800.0, 0),
            clock: ClockHealth::default(),
            mocap: MocapCounts::default(),
            segmentation: None,
            latency_p99_ms: 0.0,
            happenings: Vec::new(),
        };
        assert_eq!(status.to_string(), "1 s | 0.0 MB/s, 100.0 GB left (time unknown)");
        status.room_s = Some(600.0);
        assert!(status.to_string().ends_with("left (10 min)"), "{status}");
        status.room_s = Some(720_000.0);
        assert!(status.to_string().ends_with("left (200 h)"), "{status}");
    }
}
