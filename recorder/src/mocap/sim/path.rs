//! A trajectory that can be asked at any time.

use slam_math::Se3;

/// Poses in order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Path {
    /// Stamp in nanoseconds and `world_from_camera`; stamps strictly ascending.
    samples: Vec<(i64, Se3)>,
}

/// Poses further apart have a gap between them: the ground truth was not seen there. Ground truths have 30 to 500 Hz.
const LONGEST_STEP_NS: i64 = 200_000_000;

impl Path {
    /// From stamps in nanoseconds and `world_from_camera`, in order of time; of equal stamps the first one counts.
    #[must_use]
    pub fn new(poses: impl IntoIterator<Item = (i64, Se3)>) -> Self {
        let mut samples: Vec<(i64, Se3)> = poses.into_iter().collect();
        samples.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        samples.dedup_by_key(|(stamp_ns, _)| *stamp_ns);
        Self { samples }
    }

    /// Stamp of the first pose, nanoseconds.
    #[must_use]
    pub fn start_ns(&self) -> Option<i64> {
        self.samples.first().map(|(stamp_ns, _)| *stamp_ns)
    }

    /// Time from the first to the last pose, nanoseconds.
    #[must_use]
    pub fn length_ns(&self) -> i64 {
        match (self.samples.first(), self.samples.last()) {
            (Some((first, _)), Some((last, _))) => last - first,
            _ => 0,
        }
    }

    /// `world_from_camera` at a time, linear in position, constant in angular velocity; `None` outside and within gaps.
    #[must_use]
    pub fn at(&self, stamp_ns: i64) -> Option<Se3> {
        let after = self.samples.partition_point(|(stamp, _)| *stamp < stamp_ns);
        let (next_ns, next) = *self.samples.get(after)?;
        if next_ns == stamp_ns {
            return Some(next);
        }
        let (last_ns, last) = *self.samples.get(after.checked_sub(1)?)?;
        if next_ns - last_ns > LONGEST_STEP_NS {
            return None;
        }
        let share = (stamp_ns - last_ns) as f64 / (next_ns - last_ns) as f64;
        let translation = last.translation + (next.translation - last.translation) * share;
        let turn = |pose: &Se3| Se3 { rotation: pose.rotation, ..Se3::identity() };
        let step = (turn(&last).inverse() * turn(&next)).log() * share;
        Some(Se3 { rotation: last.rotation * Se3::exp(&step).rotation, translation })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    #[test]
    fn between_poses_and_not_beyond() {
        let pose = |x: f64| Se3::exp(&Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, x)) * Se3::identity();
        let shifted = |x: f64| Se3 { translation: [x, 0.0, 0.0].into(), ..pose(x) };
        let path =
            Path::new([(200, shifted(1.0)), (100, shifted(0.0)), (100, shifted(9.0)), (1_000_000_000, pose(0.0))]);
        assert_eq!((path.start_ns(), path.length_ns()), (Some(100), 999_999_900));
        assert_eq!(path.at(100), Some(shifted(0.0)));
        let middle = path.at(150).unwrap();
        assert!((middle.translation.x - 0.5).abs() < 1e-12 && (middle.angle() - 0.5).abs() < 1e-12);
        assert_eq!(path.at(99), None);
        assert_eq!(path.at(1_000_000_001), None);
        assert_eq!(path.at(500_000_000), None, "a gap");
        assert_eq!(Path::default().at(0), None);
    }
}
