//! A frame that is kept.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, FrameId, KeyFrameId, MapId, MapPointId, Se3, Stamp};
use smallvec::SmallVec;

use crate::observation::Observation;
use crate::report::KeypointClass;

/// A frame that is kept, with its place in the covisibility graph.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct KeyFrame {
    /// Its id, in creation order.
    pub id: KeyFrameId,
    /// The frame it was made from.
    pub frame: FrameId,
    /// Sensor time.
    pub stamp: Stamp,
    /// Part of the atlas.
    pub map: MapId,
    /// What the sensor said.
    pub obs: Arc<Observation>,
    /// What each keypoint lies on.
    pub class: Arc<Vec<KeypointClass>>,
    /// Keypoints that the panoptic filter lets into the map.
    pub usable: Arc<Vec<bool>>,
    /// Map point of each keypoint.
    pub points: Buffer<Option<MapPointId>>,
    /// Pose.
    pub camera_from_world: Se3,
    /// Keyframes that share points: `(id, shared points)`, most first, then oldest first.
    pub covisible: Buffer<(KeyFrameId, u32)>,
    /// Parent in the spanning tree; `None` for the first keyframe of a map.
    pub parent: Option<KeyFrameId>,
    /// Children in the spanning tree, sorted.
    pub children: SmallVec<[KeyFrameId; 8]>,
    /// Keyframes of the same place that a loop tied this one to, sorted.
    pub loops: SmallVec<[KeyFrameId; 8]>,
}

impl KeyFrame {
    /// The `n` keyframes that share the most points.
    pub fn best_covisible(&self, n: usize) -> impl Iterator<Item = KeyFrameId> {
        self.covisible.iter().take(n).map(|(id, _)| *id)
    }

    /// Camera centre in the world, metres.
    #[must_use]
    pub fn center(&self) -> nalgebra::Vector3<f64> {
        self.camera_from_world.inverse().translation
    }
}
