//! When something reached this computer.

use rustix::time::{ClockId, Timespec, clock_gettime};
use serde::{Deserialize, Serialize};
use std::time::{SystemTime, UNIX_EPOCH};

/// The host's two clocks at one moment. Both are kept: the first never jumps, the second names the hour and is what
/// other machines know.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize)]
pub struct Arrival {
    /// `CLOCK_MONOTONIC`: nanoseconds since some moment, usually the boot; stands still in suspend, never steps.
    pub monotonic_ns: i64,
    /// `CLOCK_REALTIME`: nanoseconds since 1970; steps when somebody sets the clock.
    pub realtime_ns: i64,
}

impl Arrival {
    /// Now.
    #[must_use]
    pub fn now() -> Self {
        let nanoseconds = |time: Timespec| time.tv_sec * 1_000_000_000 + time.tv_nsec;
        Self { monotonic_ns: nanoseconds(clock_gettime(ClockId::Monotonic)), realtime_ns: realtime_ns() }
    }
}

/// Through the C library, which `rustix` goes past: so that a clock can be set for one process alone (faketime, and
/// tests/it/record_faults.rs) instead of for the whole computer.
#[allow(clippy::disallowed_methods, reason = "a recording does come from the clock")]
fn realtime_ns() -> i64 {
    let nanoseconds = |time: std::time::Duration| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX);
    match SystemTime::now().duration_since(UNIX_EPOCH) {
        Ok(since) => nanoseconds(since),
        Err(before) => -nanoseconds(before.duration()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_passes() {
        let (first, second) = (Arrival::now(), Arrival::now());
        assert!(second.monotonic_ns >= first.monotonic_ns && first.monotonic_ns > 0);
        // This page was written in 2026.
        assert!(first.realtime_ns > 1_700_000_000_000_000_000);
    }
}
