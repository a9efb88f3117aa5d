//! Poses of frames against a map that is done.

use slam_math::{FrameId, KeyFrameId, Se3, float, par};
use slam_optimize::{DepthCamera, Measurement, PoseObservation, PoseOptions, PoseResult, optimize_pose};

use super::{Sights, Trusted};
use crate::context::Context;
use crate::map::Map;

/// A frame to be refined, with its place relative to a keyframe.
#[derive(Debug, Clone, Copy)]
pub struct Start {
    /// Which frame.
    pub frame: FrameId,
    /// The keyframe, alive or removed.
    pub reference: KeyFrameId,
    /// Pose relative to it.
    pub camera_from_reference: Se3,
}

/// A pose that fits the frame's own matches better than its place relative to a keyframe does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refined {
    /// In the part of the atlas of the reference.
    pub camera_from_world: Se3,
    /// Median of the squared normalised residuals in pixels, without depth.
    pub pixel_chi2: f64,
}

/// Fits each frame to what it saw of the map; `None` where fewer than `enough` matches are left or fit.
pub fn refine_frames(
    ctx: &Context,
    map: &Map,
    sights: &Sights,
    starts: &[Start],
    enough: usize,
    trusted: Trusted<'_>,
) -> Vec<Option<Refined>> {
    let places = sights.places();
    par::ordered_map(starts, |_, start| {
        let (reference_from_world, part) = map.pose_of(start.reference)?;
        let own = places.get(start.frame.index()).cloned().unwrap_or_default();
        let known = sights.at(ctx, own).filter_map(|(id, measurement)| {
            let point = map.point(id).filter(|point| point.map == part && trusted(point))?;
            Some(PoseObservation { point_in_world: point.position, measurement })
        });
        let observations = ctx.buffers.collect(known);
        let start = start.camera_from_reference * reference_from_world;
        if observations.len() < enough { None } else { refine(ctx, &observations, &start, enough) }
    })
}

fn refine(ctx: &Context, observations: &[PoseObservation], start: &Se3, enough: usize) -> Option<Refined> {
    let options = PoseOptions::default();
    let PoseResult { camera_from_world, inliers, .. } =
        optimize_pose(&ctx.pinhole, ctx.bf, observations, start, &options, &ctx.buffers);
    let cost = |pose: &Se3| cost(ctx, observations, pose, &options);
    let better = inliers >= enough && camera_from_world.is_finite() && cost(&camera_from_world) < cost(start);
    better.then(|| Refined { camera_from_world, pixel_chi2: pixel_chi2(ctx, observations, &camera_from_world) })
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

fn pixel_chi2(ctx: &Context, observations: &[PoseObservation], pose: &Se3) -> f64 {
    let camera = DepthCamera { pinhole: ctx.pinhole, bf: ctx.bf };
    let one = |o: &PoseObservation| {
        let pixel = Measurement { disparity: None, ..o.measurement };
        camera.chi2(&pose.transform(&o.point_in_world), &pixel).unwrap_or(f64::INFINITY)
    };
    let mut all = ctx.buffers.collect(observations.iter().map(one));
    float::median_in_place(&mut all).unwrap_or(f64::INFINITY)
}
