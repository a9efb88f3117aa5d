//! Poses over time, and the only places where they may be interpolated.

use crate::{Se3, float};

/// Where something was at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// Clock of the source, nanoseconds.
    pub stamp_ns: i64,
    /// `world_from_body`, metres.
    pub world_from_body: Se3,
}

/// Poses in order of time, in stretches without gaps: a pose between two stretches is not known.
#[derive(Debug, Clone, Default)]
pub struct Track {
    poses: Vec<StampedPose>,
    /// Poses farther apart than this have a gap between them, nanoseconds.
    max_gap_ns: i64,
}

/// Poses so many usual intervals apart have a gap between them: one lost frame may be bridged, an occlusion may not.
const GAP_INTERVALS: f64 = 2.5;

impl Track {
    /// A track of poses in any order; of equal stamps the first stays. Poses that are not finite are left out.
    #[must_use]
    pub fn new(mut poses: Vec<StampedPose>) -> Self {
        poses.retain(|pose| pose.world_from_body.is_finite());
        poses.sort_by_key(|pose| pose.stamp_ns);
        poses.dedup_by_key(|pose| pose.stamp_ns);
        let mut intervals: Vec<f64> =
            poses.windows(2).map(|pair| (pair[1].stamp_ns - pair[0].stamp_ns) as f64).collect();
        let usual = float::median_in_place(&mut intervals).unwrap_or(0.0);
        Self { poses, max_gap_ns: (GAP_INTERVALS * usual) as i64 }
    }

    /// The poses, ascending.
    #[must_use]
    pub fn poses(&self) -> &[StampedPose] {
        &self.poses
    }

    /// The usual interval between poses, seconds; 0 for fewer than two.
    #[must_use]
    pub fn interval_s(&self) -> f64 {
        self.max_gap_ns as f64 * 1e-9 / GAP_INTERVALS
    }

    /// Windows without gaps: first and last stamp of each, nanoseconds.
    #[must_use]
    pub fn windows(&self) -> Vec<(i64, i64)> {
        let mut windows: Vec<(i64, i64)> = Vec::new();
        for pose in &self.poses {
            match windows.last_mut() {
                Some((_, end)) if pose.stamp_ns - *end <= self.max_gap_ns => *end = pose.stamp_ns,
                _ => windows.push((pose.stamp_ns, pose.stamp_ns)),
            }
        }
        windows
    }

    /// The pose at a moment, between its two neighbours on the shortest way; `None` in a gap and outside.
    #[must_use]
    pub fn at(&self, stamp_ns: i64) -> Option<Se3> {
        let after = self.poses.partition_point(|pose| pose.stamp_ns < stamp_ns);
        let next = self.poses.get(after)?;
        if next.stamp_ns == stamp_ns {
            return Some(next.world_from_body);
        }
        let last = self.poses.get(after.checked_sub(1)?)?;
        let length_ns = next.stamp_ns - last.stamp_ns;
        if length_ns > self.max_gap_ns {
            return None;
        }
        let share = (stamp_ns - last.stamp_ns) as f64 / length_ns as f64;
        // Position on the straight line, rotation on the shortest turn.
        let turn =
            Se3 { translation: nalgebra::Vector3::zeros(), ..last.world_from_body.inverse() * next.world_from_body };
        let rotation = last.world_from_body.rotation * Se3::exp(&(turn.log() * share)).rotation;
        let (from, to) = (last.world_from_body.translation, next.world_from_body.translation);
        Some(Se3 { rotation, translation: from + (to - from) * share })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    fn pose(stamp_ns: i64, x: f64, yaw: f64) -> StampedPose {
        let turned = Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, yaw)).rotation;
        let world_from_body = Se3 { rotation: turned, translation: nalgebra::Vector3::new(x, 0.0, 0.0) };
        StampedPose { stamp_ns, world_from_body }
    }

    #[test]
    fn between_neighbours_but_never_across_a_gap() {
        // The poses at 30 and 40 are missing.
        let track = Track::new([0, 10, 20, 50, 60].map(|t| pose(t, t as f64, t as f64 * 0.01)).to_vec());
        let middle = track.at(15).unwrap();
        assert!((middle.translation.x - 15.0).abs() < 1e-12 && (middle.angle() - 0.15).abs() < 1e-12);
        assert_eq!(track.at(20).unwrap().translation.x, 20.0);
        assert!(track.at(35).is_none() && track.at(-1).is_none() && track.at(61).is_none());
        assert_eq!(track.windows(), [(0, 20), (50, 60)]);
        assert!((track.interval_s() - 10e-9).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_pose_is_left_out() {
        let mut broken = pose(5, 1.0, 0.0);
        broken.world_from_body.translation.x = f64::NAN;
        let track = Track::new(vec![pose(10, 0.0, 0.0), broken, pose(0, 0.0, 0.0), pose(0, 9.0, 0.0)]);
        assert_eq!(track.poses().len(), 2);
        assert_eq!(track.at(0).unwrap().translation.x, 0.0);
        assert!(Track::default().at(0).is_none() && Track::default().windows().is_empty());
    }
}
