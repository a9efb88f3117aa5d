//! Angular velocities over time.

use super::seconds;
use nalgebra::Vector3;
use slam_math::{Se3, Track};

/// Half of the time over which an angular velocity is averaged, seconds: short enough for hand-held motion, long enough
/// for the noise of poses (0.05 degrees over 60 ms are 0.02 rad/s).
const HALF_WINDOW_S: f64 = 0.03;

/// Angular velocity in the body's own frame at ascending times.
#[derive(Debug, Clone, Default)]
pub struct AngularVelocity {
    /// What times are counted from, nanoseconds on the source's clock.
    pub origin_ns: i64,
    /// Seconds since the origin, ascending.
    pub time_s: Vec<f64>,
    /// Radians a second in the body's frame, averaged over 60 ms.
    pub rad_s: Vec<Vector3<f64>>,
    /// Samples farther apart than this have a gap between them, seconds.
    pub max_gap_s: f64,
}

impl AngularVelocity {
    /// Value and slope at a time, `None` in a gap and outside.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let after = self.time_s.partition_point(|t| *t <= time_s);
        let (last, next) = (after.checked_sub(1)?, after);
        if next >= self.time_s.len() {
            return None;
        }
        let length = self.time_s[next] - self.time_s[last];
        if length > self.max_gap_s {
            return None;
        }
        let slope = (self.rad_s[next] - self.rad_s[last]) / length;
        Some((self.rad_s[last] + slope * (time_s - self.time_s[last]), slope))
    }

    /// Time of the last sample, seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }
}

/// From the samples of a gyroscope: `(nanoseconds, rad/s)` in any order; samples that are not finite are left out.
#[must_use]
pub fn from_gyro(samples: &[(i64, [f64; 3])]) -> AngularVelocity {
    let mut samples: Vec<_> = samples.iter().filter(|(_, v)| v.iter().all(|v| v.is_finite())).collect();
    samples.sort_by_key(|(stamp, _)| *stamp);
    let origin_ns = samples.first().map_or(0, |(stamp, _)| *stamp);
    let time_s: Vec<f64> = samples.iter().map(|(stamp, _)| seconds(*stamp, origin_ns)).collect();
    let mut smooth = Vec::with_capacity(samples.len());
    let (mut from, mut to) = (0, 0);
    for &t in &time_s {
        while time_s[from] < t - HALF_WINDOW_S {
            from += 1;
        }
        while to < time_s.len() && time_s[to] <= t + HALF_WINDOW_S {
            to += 1;
        }
        let sum = samples[from..to].iter().fold(Vector3::zeros(), |sum, (_, v)| sum + Vector3::from(*v));
        smooth.push(sum / (to - from) as f64);
    }
    AngularVelocity { origin_ns, time_s, rad_s: smooth, max_gap_s: HALF_WINDOW_S }
}

/// From poses: the turn between two poses 60 ms apart, in the body's frame at their middle. None where the track has a
/// gap.
#[must_use]
pub fn from_poses(track: &Track) -> AngularVelocity {
    let poses = track.poses();
    let origin_ns = poses.first().map_or(0, |pose| pose.stamp_ns);
    let interval_s = track.interval_s();
    let mut signal = AngularVelocity { origin_ns, max_gap_s: 2.5 * interval_s, ..AngularVelocity::default() };
    if interval_s <= 0.0 {
        return signal;
    }
    let reach = ((HALF_WINDOW_S / interval_s).round() as usize).max(1);
    for i in reach..poses.len().saturating_sub(reach) {
        let (before, after) = (&poses[i - reach], &poses[i + reach]);
        let length_s = seconds(after.stamp_ns, before.stamp_ns);
        // A lost frame stretches the turn; an occlusion inside makes it say nothing.
        if length_s > interval_s * (2 * reach + 1) as f64 {
            continue;
        }
        let turn: Se3 = before.world_from_body.inverse() * after.world_from_body;
        let rotation = turn.log().fixed_rows::<3>(3).into_owned();
        signal.time_s.push(0.5 * (seconds(before.stamp_ns, origin_ns) + seconds(after.stamp_ns, origin_ns)));
        signal.rad_s.push(rotation / length_s);
    }
    signal
}
