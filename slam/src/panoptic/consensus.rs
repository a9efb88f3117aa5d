//! Does a region move as the background does? Judged by the map points matched in it, all of them together.
//!
//! The camera's motion is what the background says. Each region says by its own matches how it would have the camera stand; the
//! difference is judged by the uncertainty of both, in all six directions at once. Many keypoints that are all off by a little
//! show a slow motion that none of them shows alone, and where the background fixes the pose poorly nothing is condemned by it.

use nalgebra::{Cholesky, Matrix6, Vector3, Vector6};
use slam_math::{Buffer, Se3};
use slam_optimize::{PoseObservation, PoseOptions, optimize_pose, pose_equations};

use super::FrameFilter;
use crate::config::ConsensusConfig;
use crate::context::Context;
use crate::observation::Observation;
use crate::report::KeypointClass;

/// A keypoint and the map point it is matched with, in the world.
pub type Matched = (u32, Vector3<f64>);

/// What the matched map points say about regions.
#[derive(Debug, Clone)]
pub struct Consensus {
    /// The pose by background alone.
    pub camera_from_world: Se3,
    /// Regions whose matches would have the camera elsewhere, an entry a region.
    pub disagrees: Buffer<bool>,
}

/// Compares the regions of a frame with its background. `None` when the background fixes no pose, or when its own matches do
/// not agree with each other.
#[must_use]
pub fn consensus(
    ctx: &Context,
    obs: &Observation,
    matches: &[Matched],
    start: &Se3,
    filter: &FrameFilter,
) -> Option<Consensus> {
    let c = &ctx.config.panoptic.consensus;
    let observed = |(i, point): &Matched| PoseObservation {
        point_in_world: *point,
        measurement: ctx.measurement(obs, *i as usize),
    };
    let is_background = |(i, _): &&Matched| filter.is_background(*i as usize);
    let background = ctx.buffers.collect(matches.iter().filter(is_background).map(observed));
    if background.len() < c.min_background as usize {
        return None;
    }
    let options = PoseOptions::default();
    let fit = optimize_pose(&ctx.pinhole, ctx.bf, &background, start, &options, &ctx.buffers);
    let agree = fit.inliers as f64 >= c.min_inlier_share * background.len() as f64;
    if fit.inliers < c.min_background as usize || !agree || !fit.camera_from_world.is_finite() {
        return None;
    }
    let pose = fit.camera_from_world.normalized();
    let depth_m = median_depth(ctx, matches, &pose)?;
    let uncertainty = Cholesky::new(fit.information)?.inverse() + model_error(c, depth_m);
    let regions = filter.regions.list.len();
    let mut disagrees = ctx.buffers.filled(regions, false);
    for (region, disagrees) in disagrees.iter_mut().enumerate() {
        let is_own = |(i, _): &&Matched| {
            let i = *i as usize;
            filter.region[i] == Some(region) && !filter.is_background(i)
        };
        let mut own = ctx.buffers.collect(matches.iter().filter(is_own).map(observed));
        keep_coherent(ctx, &mut own, &pose, c);
        if own.len() >= c.min_matches as usize {
            let sums = pose_equations(&ctx.pinhole, ctx.bf, own.iter().copied(), &pose, &options);
            *disagrees = distance2(&sums.information, &sums.gradient, &uncertainty).is_some_and(|d| d > c.max_chi2);
        }
    }
    Some(Consensus { camera_from_world: pose, disagrees })
}

/// Leaves the matches of a region that agree on some motion of their own, or none when most of them do not: mismatches are no
/// motion.
fn keep_coherent(ctx: &Context, own: &mut Buffer<PoseObservation>, pose: &Se3, c: &ConsensusConfig) {
    if own.len() < c.min_matches as usize {
        return;
    }
    let fit = optimize_pose(&ctx.pinhole, ctx.bf, own, pose, &PoseOptions::default(), &ctx.buffers);
    if (fit.inliers as f64) < c.min_inlier_share * own.len() as f64 {
        own.clear();
        return;
    }
    let mut inlier = fit.inlier.iter();
    own.retain(|_| inlier.next().is_some_and(|inlier| *inlier));
}

/// Squared Mahalanobis distance of a region's wish from no wish: its gradient has the covariance `A + A U A`, by its own noise
/// and by the uncertainty `U` of the pose at which it was taken.
fn distance2(information: &Matrix6<f64>, gradient: &Vector6<f64>, uncertainty: &Matrix6<f64>) -> Option<f64> {
    let mut covariance = information + information * uncertainty * information;
    // Few points leave directions free; nothing is asked in those.
    let tiny = 1e-9 * covariance.trace();
    (0..6).for_each(|i| covariance[(i, i)] += tiny);
    let solved = Cholesky::new(covariance)?.solve(gradient);
    Some(gradient.dot(&solved)).filter(|d| d.is_finite())
}

/// What map points are off by together, as those of one keyframe are: pixels of turn, and shares of the depth.
fn model_error(c: &ConsensusConfig, depth_m: f64) -> Matrix6<f64> {
    let (position, turn) = (c.position_share * depth_m, c.rotation_rad);
    let (position, turn) = (position * position, turn * turn);
    Matrix6::from_diagonal(&Vector6::new(position, position, position, turn, turn, turn))
}

fn median_depth(ctx: &Context, matches: &[Matched], pose: &Se3) -> Option<f64> {
    let mut depths = ctx.buffers.collect(matches.iter().map(|(_, point)| pose.transform(point)[2]));
    let middle = depths.len() / 2;
    (!depths.is_empty()).then(|| *depths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

impl FrameFilter {
    /// Whether a keypoint shows background, by its label or by its place.
    pub(crate) fn is_background(&self, i: usize) -> bool {
        self.class[i] == KeypointClass::Stuff || self.keypoint_ground[i] && self.class[i] != KeypointClass::Person
    }
}
