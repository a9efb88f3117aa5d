//! The host's clocks, and the log's timeline made of them.

use crate::Arrival;
use crate::mocap::MocapFrame;
use schemas::Stamp;
use serde::Serialize;

/// Where the host's time comes from. Tests put their own in.
pub trait HostClock: Send + Sync {
    /// Both clocks now.
    fn now(&self) -> Arrival;
}

/// The computer's own clocks.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemClock;

impl HostClock for SystemClock {
    fn now(&self) -> Arrival {
        Arrival::now()
    }
}

/// The log's timeline: the monotonic clock plus one constant, so that it is the realtime clock at the start and nothing
/// that happens to that one later moves a stamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HostTimeline {
    /// Timeline minus `CLOCK_MONOTONIC`, nanoseconds.
    pub anchor_ns: i64,
}

impl HostTimeline {
    /// The timeline of a recording that starts now.
    #[must_use]
    pub fn starting_at(now: Arrival) -> Self {
        Self { anchor_ns: now.realtime_ns - now.monotonic_ns }
    }

    /// When a motion capture frame was taken: its arrival less the latency that was told.
    #[must_use]
    pub fn captured(&self, frame: &MocapFrame) -> Stamp {
        Stamp(self.stamp(frame.arrival).0 - (frame.latency_s().unwrap_or(0.0) * 1e9) as i64)
    }

    /// The place of a moment.
    #[must_use]
    pub fn stamp(&self, moment: Arrival) -> Stamp {
        Stamp(moment.monotonic_ns.saturating_add(self.anchor_ns))
    }
}

/// Realtime may be slewed by 500 us/s against monotonic (NTP's limit) and read a little later than it; what is more
/// between two looks is a step.
const SLEW_PER_S_NS: i64 = 500_000;
const READ_JITTER_NS: i64 = 2_000_000;

/// Watches the realtime clock for steps.
#[derive(Debug, Clone, Copy)]
pub struct StepWatch {
    last: Arrival,
    health: ClockHealth,
}

/// What was seen of the realtime clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct ClockHealth {
    /// Steps so far.
    pub steps: u32,
    /// The last step, nanoseconds; positive = forward.
    pub last_step_ns: i64,
    /// Realtime minus the log's timeline: all steps and slews since the start, nanoseconds.
    pub offset_ns: i64,
}

impl StepWatch {
    /// Begins to watch.
    #[must_use]
    pub fn new(start: Arrival) -> Self {
        Self { last: start, health: ClockHealth::default() }
    }

    /// Takes a look; returns the step since the last one, nanoseconds, or 0.
    pub fn look(&mut self, now: Arrival) -> i64 {
        let passed_ns = now.monotonic_ns - self.last.monotonic_ns;
        let change_ns = (now.realtime_ns - self.last.realtime_ns) - passed_ns;
        self.last = now;
        self.health.offset_ns += change_ns;
        let allowed_ns = READ_JITTER_NS + passed_ns / 1_000_000_000 * SLEW_PER_S_NS;
        if change_ns.abs() <= allowed_ns {
            return 0;
        }
        (self.health.steps, self.health.last_step_ns) = (self.health.steps + 1, change_ns);
        change_ns
    }

    /// What was seen so far.
    #[must_use]
    pub fn health(&self) -> ClockHealth {
        self.health
    }
}

/// Whether the host says that somebody keeps its clock right, in words.
#[must_use]
pub fn synchronisation() -> String {
    let known = [
        ("/run/systemd/timesync/synchronized", "systemd-timesyncd says that it is synchronised"),
        ("/run/chrony/chronyd.pid", "chronyd runs"),
        ("/run/ntpd.pid", "ntpd runs"),
        ("/run/ptp4l", "ptp4l runs"),
    ];
    let found = known.iter().find(|(path, _)| std::path::Path::new(path).exists());
    found.map_or("nobody known keeps it", |(_, words)| words).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_told_from_slewing() {
        let at = |monotonic_ns, realtime_ns| Arrival { monotonic_ns, realtime_ns };
        let timeline = HostTimeline::starting_at(at(10, 1_000));
        let mut watch = StepWatch::new(at(10, 1_000));
        assert_eq!(watch.look(at(1_000_000_010, 1_000_400_001_000)), 999_400_000_000, "forward by 999 s");
        assert_eq!(watch.look(at(2_000_000_010, 1_001_400_401_000)), 0, "slewed by 400 us");
        assert_eq!(watch.look(at(3_000_000_010, 1_002_300_401_000)), -100_000_000, "back by 100 ms");
        let health = ClockHealth { steps: 2, last_step_ns: -100_000_000, offset_ns: 999_300_400_000 };
        assert_eq!(watch.health(), health);
        assert_eq!(timeline.stamp(at(3_000_000_010, 0)), Stamp(3_000_001_000), "no step moves the timeline");
    }
}
