//! Measured depth against what pixels say.

use nalgebra::{Cholesky, Matrix3, Vector3};
use slam_math::KeyFrameId;

use crate::context::Context;
use crate::depth::DepthModel;
use crate::input::Sensor;
use crate::map::{Map, MapPoint};

/// Noise of a keypoint on level 0, pixels: the residuals of tracked frames have a mean square of 0.6 to 0.75 square pixels.
const KEYPOINT_SIGMA_PX: f64 = 0.8;
/// Views that fix a point by pixels alone.
const MIN_VIEWS: usize = 3;
/// A comparison tells something when pixels know the depth better than this many times what the sensor is configured to.
const MAX_SIGMA_RATIO: f64 = 1.0;

/// Compares the depths of a keyframe with its points as pixels alone have them.
pub(super) fn compare_depths(ctx: &Context, map: &Map, id: KeyFrameId) -> DepthModel {
    let mut found = DepthModel::default();
    let Some(keyframe) = map.keyframe(id).filter(|_| ctx.sensor == Sensor::Rgbd) else { return found };
    let axis = keyframe.camera_from_world.rotation.row(2).transpose();
    for (i, point) in keyframe.points.iter().enumerate() {
        let (Some(measured), Some(point)) = (keyframe.obs.depth(i), point.and_then(|id| map.point(id))) else {
            continue;
        };
        let Some((position, covariance)) = triangulated(ctx, map, point) else { continue };
        let z = keyframe.camera_from_world.transform(&position)[2];
        let variance = axis.dot(&(covariance * axis));
        let configured = ctx.config.sensor.depth_sigma(measured);
        let configured = configured * configured;
        if z > 0.0 && variance <= MAX_SIGMA_RATIO * MAX_SIGMA_RATIO * configured {
            found.compare(measured, z, variance, configured);
        }
    }
    found
}

/// Where the rays of a point's observations meet, and how surely.
fn triangulated(ctx: &Context, map: &Map, point: &MapPoint) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    if point.seen_in.len() < MIN_VIEWS {
        return None;
    }
    let (mut information, mut pull) = (Matrix3::zeros(), Vector3::zeros());
    for sighting in &point.seen_in {
        let Some(keyframe) = map.keyframe(sighting.keyframe) else { continue };
        let i = sighting.index as usize;
        let centre = keyframe.center();
        let ray = keyframe.camera_from_world.rotation.transpose() * ctx.camera.unproject(keyframe.obs.pixel[i], 1.0);
        let ray = ray / ray.norm();
        let spread =
            (point.position - centre).norm() * KEYPOINT_SIGMA_PX * ctx.scales[usize::from(keyframe.obs.octave[i])]
                / ctx.pinhole.fx;
        let across = (Matrix3::identity() - ray * ray.transpose()) / (spread * spread);
        information += across;
        pull += across * centre;
    }
    let covariance = Cholesky::new(information)?.inverse();
    Some((covariance * pull, covariance))
}
