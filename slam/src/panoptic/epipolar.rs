//! Two-view geometry with the last frame: the fundamental matrix and distances to epipolar lines.

use nalgebra::Matrix3;
use slam_math::{Buffer, FrameId, Rng, Se3, se3::skew};
use slam_optimize::{FundamentalOptions, epipolar_distance, fundamental_ransac};
use slam_vision::nearest_two;

use super::{FrameFilter, Remembered};
use crate::context::Context;
use crate::observation::Observation;
use crate::report::KeypointClass;

/// Random stream of this stage, see [`Rng::at`].
const STAGE: u32 = 1;
/// Ratio test of the paper's implementation.
const RATIO: f64 = 0.9;
/// Camera motion below which epipolar lines are noise, metres.
const MIN_TRANSLATION_M: f64 = 0.002;

/// The fundamental matrix between the last frame and this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epipolar {
    /// `current^T F last = 0` on undistorted pixels.
    pub matrix: Matrix3<f64>,
    /// Stuff matches.
    pub matches: u32,
    /// Stuff matches that agree.
    pub inliers: u32,
    /// One plane or no motion explains them as well.
    pub degenerate: bool,
}

/// The paper's step: F from Stuff matches by seeded RANSAC, then distances for all matched keypoints.
pub(super) fn measure(ctx: &Context, id: FrameId, last: &Remembered, obs: &Observation, frame: &mut FrameFilter) {
    let e = &ctx.config.panoptic.epipolar;
    let matches = match_last(ctx, last, obs, frame, u8::MAX);
    let stuff: Vec<(usize, usize)> =
        matches.iter().copied().filter(|(i, _)| frame.class[*i] == KeypointClass::Stuff).collect();
    if stuff.len() < e.min_matches {
        return;
    }
    let before: Vec<[f64; 2]> = stuff.iter().map(|(_, j)| last.obs.pixel[*j]).collect();
    let now: Vec<[f64; 2]> = stuff.iter().map(|(i, _)| obs.pixel[*i]).collect();
    let options = FundamentalOptions {
        threshold_px: e.ransac_px,
        confidence: e.confidence,
        max_iterations: e.iterations as u32,
        ..Default::default()
    };
    let mut rng = Rng::at(ctx.config.seed, id.0, STAGE, 0);
    let Some(found) = fundamental_ransac(&mut rng, &before, &now, &options) else { return };
    let inliers = found.inlier.iter().filter(|inlier| **inlier).count() as u32;
    let degenerate = found.degenerate;
    record(found.matrix, &matches, last, obs, frame);
    frame.epipolar = Some(Epipolar { matrix: found.matrix, matches: stuff.len() as u32, inliers, degenerate });
}

/// The same distances with F from the camera's motion, which needs no RANSAC and no Stuff.
pub(super) fn from_motion(ctx: &Context, pose: &Se3, last: &Remembered, obs: &Observation, frame: &mut FrameFilter) {
    let motion = *pose * last.camera_from_world.inverse();
    let matches = match_last(ctx, last, obs, frame, 1);
    let p = &ctx.pinhole;
    let k_inverse = Matrix3::new(1.0 / p.fx, 0.0, -p.cx / p.fx, 0.0, 1.0 / p.fy, -p.cy / p.fy, 0.0, 0.0, 1.0);
    let matrix = k_inverse.transpose() * skew(&motion.translation) * motion.rotation * k_inverse;
    let degenerate = motion.translation.norm() < MIN_TRANSLATION_M;
    let stuff = matches.iter().filter(|(i, _)| frame.class[*i] == KeypointClass::Stuff).count() as u32;
    if !degenerate {
        record(matrix, &matches, last, obs, frame);
    }
    let near = |(i, _): &&(usize, usize)| frame.class[*i] == KeypointClass::Stuff && frame.epipolar_px[*i] < 1.0;
    let inliers = matches.iter().filter(near).count() as u32;
    frame.epipolar = Some(Epipolar { matrix, matches: stuff, inliers, degenerate });
}

fn record(
    matrix: Matrix3<f64>,
    matches: &[(usize, usize)],
    last: &Remembered,
    obs: &Observation,
    frame: &mut FrameFilter,
) {
    for (i, j) in matches {
        frame.epipolar_px[*i] = epipolar_distance(&matrix, last.obs.pixel[*j], obs.pixel[*i]);
    }
}

/// Nearest descriptor of the last frame for each keypoint, among keypoints of the same class (and, for Things, the same
/// track) and at most so many octaves away, with ratio test; each keypoint of the last frame serves once.
fn match_last(
    ctx: &Context,
    last: &Remembered,
    obs: &Observation,
    frame: &FrameFilter,
    octaves: u8,
) -> Buffer<(usize, usize)> {
    let e = &ctx.config.panoptic.epipolar;
    let all = ctx.buffers.collect(0..last.obs.len() as u32);
    let mut nearby = ctx.buffers.empty();
    let mut owner: Buffer<Option<(u32, usize)>> = ctx.buffers.filled(last.obs.len(), None);
    for i in (0..obs.len()).filter(|i| frame.class[*i] != KeypointClass::Person) {
        if e.radius_px > 0.0 {
            let (lowest, highest) = (obs.octave[i].saturating_sub(octaves), obs.octave[i].saturating_add(octaves));
            last.obs.grid.query(obs.pixel[i], e.radius_px, lowest, highest, &mut nearby);
        } else {
            nearby.clone_from(&all);
        }
        let track = frame.region[i].map(|r| frame.tracks[r].id);
        let is_thing = frame.class[i] == KeypointClass::Thing;
        nearby.retain(|j| {
            let j = *j as usize;
            last.class[j] == frame.class[i] && (!is_thing || last.track[j] == track)
        });
        let [first, second] = nearest_two(&obs.descriptor[i], &last.obs.descriptor, &nearby);
        let sure = first.distance <= ctx.config.tracking.hamming_low
            && f64::from(first.distance) <= RATIO * f64::from(second.distance);
        let claim = (first.distance, i);
        if sure && owner[first.index as usize].is_none_or(|holder| claim < holder) {
            owner[first.index as usize] = Some(claim);
        }
    }
    let mut pairs = ctx.buffers.collect(owner.iter().enumerate().filter_map(|(j, o)| o.map(|(_, i)| (i, j))));
    pairs.sort_unstable();
    pairs
}
