//! What pixels alone say about the depths of a keyframe.
//!
//! Poses of the map have used depth, so they bend until depth looks right: of an offset of 3 cm planted into a rendered world
//! a third was left in the map's residuals. So the keyframes around are adjusted once more, without any depth, and thrown away.

use nalgebra::{Cholesky, Matrix3, Vector3};
use slam_math::{Buffer, KeyFrameId, float};
use slam_optimize::{BaOptions, BaReport, bundle_adjust};

use super::local_ba::{Window, collect};
use crate::context::Context;
use crate::depth::{DepthView, Motion, Normal, Residual, Slope};
use crate::input::Sensor;
use crate::map::Map;

/// Views that fix a point by pixels alone.
const MIN_VIEWS: u32 = 3;
/// Noise of a keypoint on level 0, pixels, as in the comparison with the map.
const KEYPOINT_SIGMA_PX: f64 = 0.8;
/// Noise of depth that weights go by, metres and 1/metres: of a good sensor, lest far ones rule. The standard error is found
/// without it.
const DEPTH_SIGMA: [f64; 2] = [0.005, 0.005];
/// Share of the depth that pixels must know it to.
const MAX_SIGMA_SHARE: f64 = 0.02;
/// Residuals beyond so many sigmas are mismatches and movers.
const MAX_SIGMAS: f64 = 4.0;
/// No plane where more than this is left, metres at no and per metre of depth: an edge.
const MAX_RMS: [f64; 2] = [0.01, 0.01];
/// Steeper is an edge too, metres a pixel: a floor that a camera at 1 m sees at 4 m has 0.03.
const MAX_SLOPE: f64 = 0.03;

/// Compares the depths of a keyframe with pixels alone.
pub(super) fn witness(ctx: &Context, map: &Map, id: KeyFrameId, view: &DepthView) -> Normal {
    let due = ctx.sensor == Sensor::Rgbd && ctx.config.sensor.learn_noise;
    let Some(motion) = view.motion.filter(|motion| due && motion.seconds > 0.0) else { return Normal::default() };
    residuals(ctx, map, id, view, &motion).map_or_else(Normal::default, |residuals| Normal::of(&residuals))
}

fn residuals(ctx: &Context, map: &Map, id: KeyFrameId, view: &DepthView, motion: &Motion) -> Option<Buffer<Residual>> {
    let keyframe = map.keyframe(id)?;
    let moving = 1 + keyframe.best_covisible(ctx.config.mapping.ba_keyframes - 1).count();
    let mut window = collect(ctx, map, id)?;
    let report = adjust_by_pixels(ctx, &mut window, moving);
    let own = window.keyframes[..moving].binary_search(&id).ok()?;
    let pose = window.problem.poses[own].camera_from_world;
    let known = information(ctx, &window, &report);
    let axis = pose.rotation.row(2).transpose();
    let mut compared = ctx.buffers.empty();
    for (i, point) in keyframe.points.iter().enumerate() {
        let slope = view.slopes.get(i).copied().flatten();
        let (Some(measured), Some(point), Some(slope)) = (keyframe.obs.depth(i), point, slope) else { continue };
        let Ok(n) = window.points.binary_search(point) else { continue };
        let (information, views) = &known[n];
        let Some(cholesky) = Cholesky::new(*information).filter(|_| *views >= MIN_VIEWS) else { continue };
        let in_camera = pose.transform(&window.problem.points[n]);
        let sigma = axis.dot(&cholesky.solve(&axis)).sqrt();
        if in_camera[2] > 0.0 && sigma < MAX_SIGMA_SHARE * in_camera[2] && is_plane(&slope, measured) {
            compared.push((measured, in_camera, sigma / in_camera[2], slope));
        }
    }
    // Lengths of pixels have no unit.
    let mut factors = ctx.buffers.collect(compared.iter().map(|(measured, p, ..)| measured / p[2]));
    let factor = float::median_in_place(&mut factors)?;
    let one = |(measured, p, share, slope): &(f64, Vector3<f64>, f64, Slope)| {
        residual(ctx, motion, *measured, &(p * factor), *share, slope)
    };
    let small = |residual: &Residual| residual.difference_m.abs() < MAX_SIGMAS * residual.sigma_m;
    Some(ctx.buffers.collect(compared.iter().map(one).filter(small)))
}

fn is_plane(slope: &Slope, depth_m: f64) -> bool {
    let [gx, gy] = slope.metres_per_px;
    slope.rms_m < MAX_RMS[0] + MAX_RMS[1] * depth_m && gx * gx + gy * gy < MAX_SLOPE * MAX_SLOPE
}

fn residual(
    ctx: &Context,
    motion: &Motion,
    measured: f64,
    in_camera: &Vector3<f64>,
    share: f64,
    slope: &Slope,
) -> Residual {
    let before = motion.last_from_now.transform(in_camera);
    let pixel = |p: &Vector3<f64>| [ctx.pinhole.fx * p[0] / p[2], ctx.pinhole.fy * p[1] / p[2]];
    let (now, then) = (pixel(in_camera), pixel(&before));
    let (by_pixels, by_depth) = (share * measured, DEPTH_SIGMA[0] + DEPTH_SIGMA[1] * measured * measured);
    Residual {
        difference_m: measured - in_camera[2],
        sigma_m: (by_pixels * by_pixels + by_depth * by_depth).sqrt(),
        depth_m: measured,
        slope: slope.metres_per_px,
        depth_rate: (in_camera[2] - before[2]) / motion.seconds,
        pixel_rate: [0, 1].map(|axis| (now[axis] - then[axis]) / motion.seconds),
    }
}

/// Adjusts the first keyframes of a window, all but the oldest free, without depth. Lengths stay about what they are: nothing
/// pulls at their scale.
fn adjust_by_pixels(ctx: &Context, window: &mut Window, moving: usize) -> BaReport {
    let Window { points, problem, .. } = window;
    problem.poses.truncate(moving);
    problem.poses.iter_mut().enumerate().for_each(|(n, pose)| pose.fixed = n == 0);
    let mut views: Buffer<u32> = ctx.buffers.filled(points.len(), 0);
    problem.observations.retain(|o| (o.pose as usize) < moving);
    for observation in &mut problem.observations {
        observation.measurement.disparity = None;
        views[observation.point as usize] += 1;
    }
    problem.observations.retain(|o| views[o.point as usize] >= MIN_VIEWS);
    // To the end: what the map's adjustment leaves over is what depth did to it.
    let options = BaOptions { iterations: 15, relative_decrease: 1e-5, ..BaOptions::default() };
    bundle_adjust(problem, &options, &ctx.buffers)
}

/// What pixels know about the place of each point under the poses of the window, and how many views say so.
fn information(ctx: &Context, window: &Window, report: &BaReport) -> Buffer<(Matrix3<f64>, u32)> {
    let mut known = ctx.buffers.filled(window.points.len(), (Matrix3::zeros(), 0));
    let problem = &window.problem;
    for (o, _) in problem.observations.iter().zip(&report.outlier).filter(|(_, outlier)| !**outlier) {
        let centre = problem.poses[o.pose as usize].camera_from_world.inverse().translation;
        let ray = problem.points[o.point as usize] - centre;
        let squared = ray.dot(&ray);
        let spread = KEYPOINT_SIGMA_PX / ctx.pinhole.fx;
        let weight = o.measurement.weight / (squared * spread * spread);
        let (information, views) = &mut known[o.point as usize];
        *information += (Matrix3::identity() - ray * ray.transpose() / squared) * weight;
        *views += 1;
    }
    known
}
