//! Pose of a frame from its matches.

use slam_optimize::{PoseObservation, PoseOptions, optimize_pose};

use super::TrackedFrame;
use crate::context::Context;
use crate::map::Map;

/// Optimises the pose on all matches and unmatches the outliers. Returns the number of inliers; the frame is unchanged
/// but for lost points when there are fewer than three.
pub fn refine_pose(ctx: &Context, map: &Map, frame: &mut TrackedFrame) -> u32 {
    let (mut indices, mut observations) = (ctx.buffers.empty(), ctx.buffers.empty());
    for (i, id) in frame.matches() {
        if let Some(point) = map.point(id) {
            indices.push(i);
            let measurement = ctx.measurement(&frame.obs, i);
            observations.push(PoseObservation { point_in_world: point.position, measurement });
        }
    }
    if observations.len() < 3 {
        return 0;
    }
    let (start, options) = (&frame.camera_from_world, PoseOptions::default());
    let result = optimize_pose(&ctx.pinhole, ctx.bf, &observations, start, &options, &ctx.buffers);
    for (i, inlier) in indices.iter().zip(&result.inlier) {
        if !inlier {
            frame.points[*i] = None;
        }
    }
    if result.inliers >= 3 && result.camera_from_world.is_finite() {
        frame.camera_from_world = result.camera_from_world.normalized();
    }
    result.inliers as u32
}
