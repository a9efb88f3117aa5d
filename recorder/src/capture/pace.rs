//! The speed of a recording that is played.

use super::clock::HostClock;
use crate::realsense::{Frame, FrameHeader, Motion, Sample};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How samples come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// As a camera gives them: what is not taken in time is lost.
    Camera,
    /// From a recording, at the speed at which it was made. It waits where the log cannot keep up: nothing is lost.
    Recorded,
    /// From a recording, as fast as they are taken; nothing is lost.
    Free,
}

/// Stamps further from their neighbours are on another clock or wrong, milliseconds: they are not waited for.
const LONGEST_STEP_MS: f64 = 10_000.0;
/// A wait looks around so often.
const LOOK_NS: i64 = 50_000_000;

/// Holds up samples until their time has come. librealsense has such a mode too, which skips what it is late for.
pub(super) struct Pacer {
    clock: Arc<dyn HostClock>,
    /// The last stamp, milliseconds, and when that sample was due, `CLOCK_MONOTONIC`.
    last: Mutex<Option<(f64, i64)>>,
}

impl Pacer {
    pub fn new(clock: Arc<dyn HostClock>) -> Self {
        Self { clock, last: Mutex::new(None) }
    }

    /// Waits for a sample's time, at most until `stopping`; that is its arrival then.
    pub fn pace(&self, sample: &mut Sample, stopping: &dyn Fn() -> bool) {
        let (Sample::Frame(Frame { header, .. }) | Sample::Motion(Motion { header, .. })) = sample else { return };
        let due_ns = self.due_ns(header);
        loop {
            let left_ns = due_ns - self.clock.now().monotonic_ns;
            if left_ns <= 0 || stopping() {
                break;
            }
            std::thread::sleep(Duration::from_nanos(left_ns.min(LOOK_NS).unsigned_abs()));
        }
        header.arrival = self.clock.now();
    }

    fn due_ns(&self, header: &FrameHeader) -> i64 {
        let now_ns = self.clock.now().monotonic_ns;
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let step_ms = last.map(|(stamp_ms, _)| header.timestamp_ms - stamp_ms).filter(|ms| ms.abs() < LONGEST_STEP_MS);
        let due_ns = match (*last, step_ms) {
            (Some((_, due_ns)), Some(step_ms)) => due_ns + (step_ms * 1e6) as i64,
            _ => now_ns,
        };
        *last = Some((header.timestamp_ms, due_ns));
        due_ns
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arrival;
    use crate::realsense::{StreamId, StreamKind, TimestampDomain};
    use std::sync::atomic::{AtomicI64, Ordering};

    /// Every look takes a millisecond.
    #[derive(Default)]
    struct Ticking(AtomicI64);

    impl HostClock for Ticking {
        fn now(&self) -> Arrival {
            Arrival { monotonic_ns: self.0.fetch_add(1_000_000, Ordering::Relaxed), realtime_ns: 0 }
        }
    }

    #[test]
    fn samples_come_at_their_time() {
        let pacer = Pacer::new(Arc::new(Ticking::default()));
        let arrival_ms = |timestamp_ms| {
            let header = FrameHeader {
                stream: StreamId::only(StreamKind::Gyro),
                number: 0,
                timestamp_ms,
                domain: TimestampDomain::GlobalTime,
                metadata: Vec::new(),
                arrival: Arrival::default(),
            };
            let mut sample = Sample::Motion(Motion { header, xyz: [0.0; 3] });
            pacer.pace(&mut sample, &|| false);
            let Sample::Motion(motion) = sample else { panic!() };
            motion.header.arrival.monotonic_ns / 1_000_000
        };
        // The looks around a sample take up to three milliseconds.
        let first = arrival_ms(1.7e12);
        assert!((28..36).contains(&(arrival_ms(1.7e12 + 30.0) - first)));
        assert!((28..40).contains(&(arrival_ms(1.7e12 + 25.0) - first)), "another stream, a little behind");
        assert!((48..60).contains(&(arrival_ms(1.7e12 + 50.0) - first)));
        let reset = arrival_ms(7.0);
        assert!(reset - first < 70, "a clock that was set anew is not waited for");
        assert!((18..26).contains(&(arrival_ms(27.0) - reset)));
        assert!(arrival_ms(f64::NAN) - reset < 40);
    }
}
