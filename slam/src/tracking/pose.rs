//! Pose of a frame from its matches.

use nalgebra::{Cholesky, Matrix6};
use slam_optimize::{PoseObservation, PoseOptions, optimize_pose};

use super::TrackedFrame;
use crate::context::Context;
use crate::map::Map;

/// How well matches fix a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseFit {
    /// Matches that agree with it.
    pub inliers: u32,
    /// Covariance of `[translation, rotation]` in the camera's frame by the noise of the measurements alone, square metres
    /// and square radians; `None` where they leave a direction free.
    pub covariance: Option<Matrix6<f64>>,
}

impl PoseFit {
    /// Standard deviation of the camera's position, metres; infinite where it is not fixed.
    #[must_use]
    pub fn position_sigma_m(&self) -> f64 {
        self.covariance.map_or(f64::INFINITY, |c| (c[(0, 0)] + c[(1, 1)] + c[(2, 2)]).sqrt())
    }

    /// Standard deviation of its orientation, radians; infinite where it is not fixed.
    #[must_use]
    pub fn rotation_sigma_rad(&self) -> f64 {
        self.covariance.map_or(f64::INFINITY, |c| (c[(3, 3)] + c[(4, 4)] + c[(5, 5)]).sqrt())
    }
}

/// Optimises the pose on all matches and unmatches the outliers. The frame is unchanged but for lost points when there are
/// fewer than three.
pub fn refine_pose(ctx: &Context, map: &Map, frame: &mut TrackedFrame) -> PoseFit {
    let (mut indices, mut observations) = (ctx.buffers.empty(), ctx.buffers.empty());
    for (i, id) in frame.matches() {
        if let Some(point) = map.point(id) {
            indices.push(i);
            let measurement = ctx.measurement(&frame.obs, i);
            observations.push(PoseObservation { point_in_world: point.position, measurement });
        }
    }
    if observations.len() < 3 {
        return PoseFit::default();
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
    let covariance = Cholesky::new(result.information).map(|factor| factor.inverse());
    PoseFit { inliers: result.inliers as u32, covariance }
}
