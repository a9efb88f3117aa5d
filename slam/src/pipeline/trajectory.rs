//! The camera's path: as it was known at each frame, and as the map says now.

use slam_math::{FrameId, KeyFrameId, MapId, Se3, Stamp};

use super::Slam;

/// What is kept of every frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub id: FrameId,
    pub stamp: Stamp,
    pub tracked: Option<Tracked>,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Tracked {
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
    /// Poses as they were known at each tracked frame. Lost frames are absent: no pose is ever guessed.
    pub fn online_trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| t.camera_from_world)
    }

    /// Poses relative to the keyframes as they are now.
    pub fn trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| match self.map.pose_of(t.reference) {
            Some((reference_from_world, _)) => t.camera_from_reference * reference_from_world,
            None => t.camera_from_world,
        })
    }

    fn tracked_frames(&self, pose: impl Fn(&Tracked) -> Se3) -> impl Iterator<Item = TrajectoryPose> {
        self.frames.iter().filter_map(move |entry| {
            let tracked = entry.tracked.as_ref()?;
            let map = self.map.pose_of(tracked.reference).map_or(MapId(0), |(_, map)| map);
            let world_from_camera = pose(tracked).inverse();
            Some(TrajectoryPose { id: entry.id, stamp: entry.stamp, map, world_from_camera })
        })
    }
}
