//! The camera's path: as it was known at each frame, and as the map says now.

use serde::{Deserialize, Serialize};
use slam_math::{FrameId, KeyFrameId, MapId, Se3, Stamp};

use super::Slam;

/// What is kept of every frame.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Entry {
    pub id: FrameId,
    pub stamp: Stamp,
    pub tracked: Option<Tracked>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Tracked {
    /// Part of the atlas at that time.
    pub map: MapId,
    pub camera_from_world: Se3,
    pub reference: KeyFrameId,
    pub camera_from_reference: Se3,
}

/// A frame's place on the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPose {
    /// Which frame.
    pub id: FrameId,
    /// Sensor time.
    pub stamp: Stamp,
    /// Part of the atlas; parts have no common frame.
    pub map: MapId,
    /// Pose of the camera in that part's world.
    pub world_from_camera: Se3,
}

impl Slam {
    /// Poses as they were known at each tracked frame, in the part of the atlas as it was then (later joined or not).
    /// Lost frames are absent: no pose is ever guessed.
    pub fn online_trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| (t.camera_from_world, t.map))
    }

    /// Poses relative to the keyframes as they are now, in the parts of the atlas as they are now. Lost frames are
    /// absent.
    pub fn trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| match self.map.pose_of(t.reference) {
            Some((reference_from_world, map)) => (t.camera_from_reference * reference_from_world, map),
            None => (t.camera_from_world, t.map),
        })
    }

    fn tracked_frames(&self, place: impl Fn(&Tracked) -> (Se3, MapId)) -> impl Iterator<Item = TrajectoryPose> {
        self.frames.iter().filter_map(move |entry| {
            let (camera_from_world, map) = place(entry.tracked.as_ref()?);
            let world_from_camera = camera_from_world.inverse();
            Some(TrajectoryPose { id: entry.id, stamp: entry.stamp, map, world_from_camera })
        })
    }
}
