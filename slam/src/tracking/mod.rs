//! Where is the camera? Motion model, reference keyframe, local map, and what to do when all fail.

mod keyframe_policy;
mod local_map;
mod pose;
mod predict;
mod relocalize;
mod two_views;

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Buffers, FrameId, KeyFrameId, MapPointId, Se3, Stamp};

pub use keyframe_policy::{KeyframeNeed, keyframe_needed};
pub(crate) use local_map::appearance;
pub use local_map::{LocalMap, look_up, match_local_map, track_local_map};
pub use pose::{PoseFit, refine_pose};
pub(crate) use predict::depth_tolerance;
pub use predict::{Admits, track_motion_model, track_reference};
pub use relocalize::{Relocalized, relocalize};
pub use two_views::{FirstView, Start, TwoViews, offer_view};

use crate::map::Map;
use crate::observation::Observation;
use crate::report::KeypointClass;

/// A frame that is being or has been tracked.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct TrackedFrame {
    /// Which frame.
    pub id: FrameId,
    /// Sensor time.
    pub stamp: Stamp,
    /// What the sensor said.
    pub obs: Arc<Observation>,
    /// What each keypoint lies on.
    pub class: Buffer<KeypointClass>,
    /// Keypoints that tracking may use.
    pub usable: Buffer<bool>,
    /// Map point of each keypoint.
    pub points: Buffer<Option<MapPointId>>,
    /// Pose.
    pub camera_from_world: Se3,
    /// Keyframe that shares the most points.
    pub reference: KeyFrameId,
    /// Pose relative to the reference, which bundle adjustment may move later.
    pub camera_from_reference: Se3,
}

impl TrackedFrame {
    /// Follows the reference keyframe and merged points: what the map says about this frame now.
    pub fn update_from(&mut self, map: &Map) {
        if let Some((reference_from_world, _)) = map.pose_of(self.reference) {
            self.camera_from_world = self.camera_from_reference * reference_from_world;
        }
        for point in &mut self.points {
            *point = point.and_then(|id| map.current_point(id));
        }
    }

    /// Sets the reference and the pose relative to it.
    pub fn refer_to(&mut self, reference: KeyFrameId, map: &Map) {
        if let Some((reference_from_world, _)) = map.pose_of(reference) {
            self.reference = reference;
            self.camera_from_reference = self.camera_from_world * reference_from_world.inverse();
        }
    }

    /// Matched keypoints.
    pub fn matches(&self) -> impl Iterator<Item = (usize, MapPointId)> {
        self.points.iter().enumerate().filter_map(|(i, p)| p.map(|p| (i, p)))
    }

    /// The matched points, sorted.
    #[must_use]
    pub fn matched_points(&self, buffers: &Buffers) -> Buffer<MapPointId> {
        let mut points = buffers.collect(self.matches().map(|(_, id)| id));
        points.sort_unstable();
        points
    }

    /// Median depth of the matched points; `None` without any.
    #[must_use]
    pub fn median_depth(&self, map: &Map, buffers: &Buffers) -> Option<f64> {
        let depth = |id| map.point(id).map(|p| self.camera_from_world.transform(&p.position)[2]);
        let mut depths = buffers.collect(self.matches().filter_map(|(_, id)| depth(id)));
        let middle = depths.len() / 2;
        (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f64::total_cmp).1)
    }

    /// Number of matched keypoints.
    #[must_use]
    pub fn match_count(&self) -> u32 {
        self.matches().count() as u32
    }
}
