//! The camera's path: as it was known at each frame, as the map says now, and as well as it can be known at the end.

use serde::{Deserialize, Serialize};
use slam_math::{FrameId, KeyFrameId, MapId, Se3, Stamp};

use super::Slam;
use crate::context::Context;
use crate::map::Map;
use crate::offline::{Start, Trusted, adjust, depth_weight, refine_frames};
use crate::report::FinalReport;

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

impl Entry {
    fn at(&self, camera_from_world: Se3, map: MapId) -> TrajectoryPose {
        TrajectoryPose { id: self.id, stamp: self.stamp, map, world_from_camera: camera_from_world.inverse() }
    }
}

impl Tracked {
    /// Pose by the reference keyframe's in a map, and the part of the atlas that this is in.
    fn place_in(&self, map: &Map) -> (Se3, MapId) {
        match map.pose_of(self.reference) {
            Some((reference_from_world, part)) => (self.camera_from_reference * reference_from_world, part),
            None => (self.camera_from_world, self.map),
        }
    }
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

/// The path as well as it can be known at the end.
#[derive(Debug, Clone, PartialEq)]
pub struct FinalPath {
    /// Poses of all tracked frames. Lost frames are absent.
    pub poses: Vec<TrajectoryPose>,
    /// What was done to the parts of the atlas; none when the final stage is off.
    pub parts: Vec<FinalReport>,
}

impl Slam {
    /// The path after all that can be done when nothing is urgent: bundle adjustment of each part of the atlas with the
    /// points that are `trusted` ([`seen_twice`](crate::offline::seen_twice) for all that tie anything), then every
    /// frame's pose from its own matches. With `final.enabled` off it is [`trajectory`](Self::trajectory). To be called
    /// after [`settle`](Self::settle); changes nothing.
    #[must_use]
    pub fn final_path(&self, trusted: Trusted<'_>) -> FinalPath {
        let ctx = self.context();
        if !ctx.config.r#final.enabled {
            return FinalPath { poses: self.trajectory().collect(), parts: Vec::new() };
        }
        let (mut poses, mut starts): (Vec<_>, Vec<_>) = (self.trajectory().collect(), Vec::new());
        let tracked = || self.frames.iter().filter_map(|entry| Some((entry.id, entry.tracked.as_ref()?)));
        for (at, (frame, t)) in tracked().enumerate() {
            // Those of keyframes are adjusted with the map.
            if self.map.keyframe(t.reference).is_none_or(|keyframe| keyframe.frame != frame) {
                let (reference, camera_from_reference) = (t.reference, t.camera_from_reference);
                starts.push((at, Start { frame, reference, camera_from_reference }));
            }
        }
        let (places, starts): (Vec<usize>, Vec<Start>) = starts.into_iter().unzip();
        let depth_weight = depth_weight(ctx, &self.map, &self.sights, &starts, trusted);
        let ctx = &Context { depth_weight, ..ctx.clone() };
        let mut map = self.map.clone();
        let mut parts = adjust(ctx, &mut map, trusted);
        let refined = refine_frames(ctx, &map, &self.sights, &starts, ctx.config.r#final.min_inliers, trusted);
        for (pose, (_, t)) in poses.iter_mut().zip(tracked()) {
            pose.world_from_camera = t.place_in(&map).0.inverse();
        }
        for (at, refined) in places.into_iter().zip(refined) {
            let pose = &mut poses[at];
            if let Some(report) = parts.iter_mut().find(|report| report.map == pose.map.0) {
                report.refined += usize::from(refined.is_some());
                report.kept += usize::from(refined.is_none());
            }
            if let Some(refined) = refined {
                pose.world_from_camera = refined.camera_from_world.inverse();
            }
        }
        FinalPath { poses, parts }
    }

    /// Poses as they were known at each tracked frame, in the part of the atlas as it was then (later joined or not).
    /// Lost frames are absent: no pose is ever guessed.
    pub fn online_trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| (t.camera_from_world, t.map))
    }

    /// Poses relative to the keyframes as they are now, in the parts of the atlas as they are now. Lost frames are
    /// absent.
    pub fn trajectory(&self) -> impl Iterator<Item = TrajectoryPose> {
        self.tracked_frames(|t| t.place_in(&self.map))
    }

    fn tracked_frames(&self, place: impl Fn(&Tracked) -> (Se3, MapId)) -> impl Iterator<Item = TrajectoryPose> {
        self.frames.iter().filter_map(move |entry| {
            let (camera_from_world, map) = place(entry.tracked.as_ref()?);
            Some(entry.at(camera_from_world, map))
        })
    }
}
