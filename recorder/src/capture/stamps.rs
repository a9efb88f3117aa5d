//! From a camera's clocks to stamps on the log's timeline.

use super::clock::HostTimeline;
use crate::realsense::{DeviceClock, FrameHeader, TimestampDomain, metadata};
use schemas::Stamp;
use schemas::msg::{NOT_TOLD, device_clock};

/// A measurement's time, put on the log's timeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DeviceTime {
    /// Where the raw time comes from, see [`mod@device_clock`].
    pub clock: u8,
    /// As it came, microseconds; [`NOT_TOLD`] without.
    pub raw_us: i64,
    /// Without wraps, nanoseconds; [`NOT_TOLD`] without.
    pub time_ns: i64,
    /// On the log's timeline.
    pub stamp: Stamp,
}

/// The clock of one connection to a camera. All its streams share the counter and the constant that puts it on the log's
/// timeline; the constant comes from the first measurement's arrival and never changes.
#[derive(Debug, Clone, Copy, Default)]
pub struct CameraClock {
    counter: DeviceClock,
    /// Timeline minus unwrapped counter, nanoseconds.
    anchor_ns: Option<i64>,
    /// Timeline minus the library's own mapping of the counter to realtime, for streams that tell nothing else.
    global_anchor_ns: Option<i64>,
}

impl CameraClock {
    /// Timeline minus unwrapped device time, nanoseconds, once there was a measurement with a device time.
    #[must_use]
    pub fn anchor_ns(&self) -> Option<i64> {
        self.anchor_ns
    }

    /// The time of a measurement.
    pub fn time(&mut self, header: &FrameHeader, host: &HostTimeline) -> DeviceTime {
        let arrival = host.stamp(header.arrival);
        if let Some((clock, raw_us, fraction_ns)) = raw_time(header) {
            // The counter has 32 bits; what the library counted on top of it is of no use to a log.
            let time_ns = self.counter.unwrap_us(raw_us as u32) * 1000 + fraction_ns;
            let anchor_ns = *self.anchor_ns.get_or_insert(arrival.0 - time_ns);
            return DeviceTime { clock, raw_us, time_ns, stamp: Stamp(time_ns + anchor_ns) };
        }
        let none = DeviceTime { clock: device_clock::NONE, raw_us: NOT_TOLD, time_ns: NOT_TOLD, stamp: arrival };
        if header.domain != TimestampDomain::GlobalTime || !is_time(header.timestamp_ms) {
            return none;
        }
        let global_ns = nanoseconds(header.timestamp_ms);
        let anchor_ns = *self.global_anchor_ns.get_or_insert(arrival.0 - global_ns);
        DeviceTime { stamp: Stamp(global_ns + anchor_ns), ..none }
    }
}

/// Kind, microseconds and nanoseconds beyond, of the device's own clock.
fn raw_time(header: &FrameHeader) -> Option<(u8, i64, i64)> {
    if let Some(us) = header.metadata(metadata::SENSOR_TIMESTAMP) {
        return Some((device_clock::SENSOR_TIMESTAMP, us, 0));
    }
    if let Some(us) = header.metadata(metadata::FRAME_TIMESTAMP) {
        return Some((device_clock::FRAME_TIMESTAMP, us, 0));
    }
    if header.domain != TimestampDomain::HardwareClock || !is_time(header.timestamp_ms) {
        return None;
    }
    let ns = nanoseconds(header.timestamp_ms);
    Some((device_clock::TIMESTAMP, ns.div_euclid(1000), ns.rem_euclid(1000)))
}

/// Whole milliseconds apart: a product of all of them with a million would be rounded to hundreds of nanoseconds.
fn nanoseconds(ms: f64) -> i64 {
    ms.floor() as i64 * 1_000_000 + ((ms - ms.floor()) * 1e6).round() as i64
}

/// Whether a number of milliseconds is a time that nanoseconds in 64 bits can hold.
fn is_time(ms: f64) -> bool {
    (0.0..9e12).contains(&ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arrival;
    use crate::realsense::{StreamId, StreamKind};

    fn header(kind: StreamKind, domain: TimestampDomain, timestamp_ms: f64, sensor_us: Option<i64>) -> FrameHeader {
        FrameHeader {
            stream: StreamId::only(kind),
            number: 0,
            timestamp_ms,
            domain,
            metadata: sensor_us.map(|us| (metadata::SENSOR_TIMESTAMP, us)).into_iter().collect(),
            arrival: Arrival { monotonic_ns: 5_000, realtime_ns: 0 },
        }
    }

    #[test]
    fn streams_share_the_anchor_and_the_wrap() {
        let host = HostTimeline { anchor_ns: 1_000_000_000_000 };
        let mut clock = CameraClock::default();
        let hardware = TimestampDomain::HardwareClock;
        let before = clock.time(&header(StreamKind::Color, hardware, 1.0, Some((1 << 32) - 100)), &host);
        assert_eq!((before.stamp, before.raw_us), (Stamp(1_000_000_005_000), (1 << 32) - 100));
        let after = clock.time(&header(StreamKind::Depth, hardware, 2.0, Some(50)), &host);
        assert_eq!(after.stamp.0 - before.stamp.0, 150_000, "across the wrap");
        assert_eq!((after.raw_us, after.time_ns - before.time_ns), (50, 150_000));
        // An inertial sample has only the library's stamp, of the same counter: 150.25 us after the wrap.
        let gyro = clock.time(&header(StreamKind::Gyro, hardware, 4_294_967.446_25, None), &host);
        assert_eq!((gyro.clock, gyro.raw_us), (device_clock::TIMESTAMP, 4_294_967_446));
        assert_eq!(gyro.stamp.0 - after.stamp.0, 100_250, "{gyro:?}");
    }

    #[test]
    fn without_a_device_clock() {
        let host = HostTimeline { anchor_ns: 0 };
        let mut clock = CameraClock::default();
        let system = clock.time(&header(StreamKind::Color, TimestampDomain::SystemTime, 1.7e12, None), &host);
        assert_eq!((system.clock, system.stamp, system.time_ns), (device_clock::NONE, Stamp(5_000), NOT_TOLD));
        let mut global = |ms| clock.time(&header(StreamKind::Gyro, TimestampDomain::GlobalTime, ms, None), &host).stamp;
        assert_eq!(global(1.7e12), Stamp(5_000));
        assert_eq!(global(1.7e12 + 5.0), Stamp(5_005_000), "spaced as the library says, whatever the arrival");
        assert_eq!(global(f64::NAN), Stamp(5_000));
        assert_eq!(clock.anchor_ns(), None);
    }
}
