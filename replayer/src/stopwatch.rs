//! The only place that reads a clock. What it tells goes into reports, never into results.

use std::time::{Duration, Instant};

/// Measures one stretch after the other.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    last: Instant,
}

impl Stopwatch {
    /// Starts the first stretch.
    #[must_use]
    pub fn start() -> Self {
        Self { last: now() }
    }

    /// How long the stretch has lasted.
    #[must_use]
    pub fn elapsed(&self) -> Duration {
        now() - self.last
    }

    /// Ends a stretch and starts the next one.
    pub fn lap(&mut self) -> Duration {
        let now = now();
        let lap = now - self.last;
        self.last = now;
        lap
    }
}

#[expect(clippy::disallowed_methods, reason = "measuring is this module's purpose; results never depend on it")]
fn now() -> Instant {
    Instant::now()
}

/// Processor time of this process so far, all threads, user and system, in seconds; `None` where the system does not
/// tell (other than Linux).
#[must_use]
pub fn cpu_seconds() -> Option<f64> {
    /// `USER_HZ` of the kernel's interface, the same on every x86-64 Linux.
    const TICKS_PER_SECOND: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field, the program's name, may hold anything; after its bracket `utime` and `stime` are fields 12, 13.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_ascii_whitespace().collect();
    let ticks = |index: usize| fields.get(index)?.parse::<u64>().ok();
    Some((ticks(11)? + ticks(12)?) as f64 / TICKS_PER_SECOND)
}

/// Largest resident memory of this process so far, bytes; `None` where the system does not tell.
#[must_use]
pub fn peak_memory_bytes() -> Option<u64> {
    memory_bytes("VmHWM:")
}

/// Resident memory of this process now, bytes; `None` where the system does not tell.
#[must_use]
pub fn resident_memory_bytes() -> Option<u64> {
    memory_bytes("VmRSS:")
}

fn memory_bytes(key: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(key))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_os = "linux")]
    fn the_system_tells_memory_and_processor_time() {
        let before = cpu_seconds().unwrap();
        let ballast = vec![1u8; 64 << 20];
        assert!(ballast.iter().map(|b| u64::from(*b)).sum::<u64>() == 64 << 20);
        assert!(peak_memory_bytes().unwrap() > 64 << 20);
        assert!(cpu_seconds().unwrap() >= before);
    }
}
