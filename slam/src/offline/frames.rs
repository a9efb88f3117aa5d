//! Poses of frames against a map that is done.

use slam_math::{FrameId, MapId, Se3, float, par};
use slam_optimize::{DepthCamera, PoseObservation, PoseOptions, optimize_pose};

use super::{Sights, Trusted};
use crate::context::Context;
use crate::map::Map;

/// A frame to be refined.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// Which frame.
    pub frame: FrameId,
    /// The part of the atlas that it was tracked in.
    pub map: MapId,
    /// Its pose as far as is known.
    pub camera_from_world: Se3,
}

/// The poses that fit the frames' own matches better than the given ones do; `None` where too few of them are left.
pub fn refine_frames(
    ctx: &Context,
    map: &Map,
    sights: &Sights,
    starts: &[Start],
    trusted: Trusted<'_>,
) -> Vec<Option<Se3>> {
    let places = sights.places();
    par::ordered_map(starts, |_, start| {
        let own = places.get(start.frame.index()).cloned().unwrap_or_default();
        let known = sights.at(ctx, own).filter_map(|(id, measurement)| {
            let point = map.point(id).filter(|point| point.map == start.map && trusted(point))?;
            Some(PoseObservation { point_in_world: point.position, measurement })
        });
        let observations = ctx.buffers.collect(known);
        refine(ctx, &observations, &start.camera_from_world)
    })
}

fn refine(ctx: &Context, observations: &[PoseObservation], start: &Se3) -> Option<Se3> {
    let enough = ctx.config.r#final.min_inliers;
    if observations.len() < enough {
        return None;
    }
    let options = PoseOptions::default();
    let found = optimize_pose(&ctx.pinhole, ctx.bf, observations, start, &options, &ctx.buffers);
    let pose = found.camera_from_world;
    let better = || cost(ctx, observations, &pose, &options) < cost(ctx, observations, start, &options);
    (found.inliers >= enough && pose.is_finite() && better()).then_some(pose)
}

/// Squared normalised residuals, none counted for more than its gate: what the optimisation minimises in the end. A point
/// that can't be seen is as bad as any outlier.
fn cost(ctx: &Context, observations: &[PoseObservation], pose: &Se3, options: &PoseOptions) -> f64 {
    let camera = DepthCamera { pinhole: ctx.pinhole, bf: ctx.bf };
    observations.iter().fold(0.0, |sum, o| {
        let gate = if o.measurement.disparity.is_some() { options.chi2_stereo } else { options.chi2_mono };
        let chi2 = camera.chi2(&pose.transform(&o.point_in_world), &o.measurement).unwrap_or(gate);
        sum + float::min(chi2, gate)
    })
}
