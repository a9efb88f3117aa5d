//! The start of a map without depth: a first view waits for a second one that shows it from far enough aside (ORB-SLAM,
//! T-RO 2015, section IV).

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Rng, Se3};
use slam_optimize::{TwoViewFailure, TwoViewOptions, two_view_reconstruction};

use super::TrackedFrame;
use crate::context::Context;
use crate::matching::{Limits, Match, Query, consistent_rotation, search};

/// Random stream of this stage, see [`Rng::at`].
const STAGE: u32 = 3;
/// Coarser keypoints are too blunt for a map's first two views.
const MAX_OCTAVE: u8 = 2;

/// A frame that waits for its partner.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FirstView {
    frame: TrackedFrame,
    /// Where each keypoint was seen last: the camera moves on while the view waits.
    seen_at: Vec<[f64; 2]>,
}

/// Two views and the points that both see. The unit of length is the median depth in the first one.
#[derive(Debug, Clone)]
pub struct TwoViews {
    /// The older frame; its camera is the world.
    pub first: TrackedFrame,
    /// `camera_from_world` of the newer frame.
    pub second_from_world: Se3,
    /// Keypoint of the first view, keypoint of the second one, position in the world.
    pub points: Vec<(u32, u32, Vector3<f64>)>,
}

/// What a frame did for the start.
#[derive(Debug, Clone)]
pub enum Start {
    /// It is no use as a view.
    Unusable,
    /// It is the first view from now on.
    First,
    /// It does not show the first view from far enough aside, or not surely enough.
    NotYet(TwoViewFailure),
    /// It is the second view.
    Done(Box<TwoViews>),
}

/// Tries a frame as the partner of the waiting view. When they share too little, it becomes the waiting view itself.
pub fn offer_view(ctx: &Context, waiting: &mut Option<FirstView>, frame: &TrackedFrame) -> Start {
    let m = &ctx.config.monocular;
    let usable = (0..frame.obs.len()).filter(|i| is_sharp(frame, *i)).count();
    if usable < m.min_matches as usize {
        *waiting = None;
        return Start::Unusable;
    }
    let Some(first) = waiting else {
        *waiting = Some(FirstView::new(frame));
        return Start::First;
    };
    let matches = first.find_in(ctx, frame);
    if matches.len() < m.min_matches as usize {
        *waiting = Some(FirstView::new(frame));
        return Start::First;
    }
    for pair in &matches {
        first.seen_at[pair.key as usize] = frame.obs.pixel[pair.index as usize];
    }
    match first.reconstruct(ctx, frame, &matches) {
        Err(failure) => Start::NotYet(failure),
        Ok(views) => {
            *waiting = None;
            Start::Done(Box::new(views))
        }
    }
}

fn is_sharp(frame: &TrackedFrame, i: usize) -> bool {
    frame.usable[i] && frame.obs.octave[i] <= MAX_OCTAVE
}

impl FirstView {
    fn new(frame: &TrackedFrame) -> Self {
        Self { frame: frame.clone(), seen_at: frame.obs.pixel.to_vec() }
    }

    /// The view's keypoints in a frame; the key is the view's keypoint.
    fn find_in(&self, ctx: &Context, frame: &TrackedFrame) -> Buffer<Match<u32>> {
        let m = &ctx.config.monocular;
        let obs = &self.frame.obs;
        let query = |i: usize| Query {
            key: i as u32,
            pixel: self.seen_at[i],
            radius: m.search_px,
            octaves: [obs.octave[i]; 2],
            depth_m: None,
            descriptor: obs.descriptor[i],
        };
        let queries: Vec<_> = (0..obs.len()).filter(|i| is_sharp(&self.frame, *i)).map(query).collect();
        let limits = Limits { hamming: ctx.config.tracking.hamming_low, ratio: m.ratio };
        let matches = search(&frame.obs, &queries, limits, &ctx.buffers, |i| is_sharp(frame, i));
        consistent_rotation(matches, |pair| frame.obs.angle[pair.index as usize] - obs.angle[pair.key as usize])
    }

    fn reconstruct(
        &self,
        ctx: &Context,
        frame: &TrackedFrame,
        matches: &[Match<u32>],
    ) -> Result<TwoViews, TwoViewFailure> {
        let m = &ctx.config.monocular;
        let before: Vec<_> = matches.iter().map(|pair| self.frame.obs.pixel[pair.key as usize]).collect();
        let now: Vec<_> = matches.iter().map(|pair| frame.obs.pixel[pair.index as usize]).collect();
        let options = TwoViewOptions {
            sigma_px: m.sigma_px,
            max_iterations: m.iterations as u32,
            min_points: m.min_points as usize,
            min_parallax_rad: m.min_parallax_deg.to_radians(),
            ..TwoViewOptions::default()
        };
        let mut rng = Rng::at(ctx.config.seed, frame.id.0, STAGE, self.frame.id.0);
        let found = two_view_reconstruction(&mut rng, &ctx.pinhole, &before, &now, &options)?;
        let mut depths: Vec<f64> = found.points_in_first.iter().flatten().map(|point| point[2]).collect();
        depths.sort_by(f64::total_cmp);
        // There are points, all in front of the camera, or the reconstruction would have failed.
        let scale = depths.get(depths.len() / 2).map_or(1.0, |median| 1.0 / median);
        let mut second_from_world = found.second_from_first;
        second_from_world.translation *= scale;
        let points = matches.iter().zip(&found.points_in_first);
        let points = points.filter_map(|(pair, point)| Some((pair.key, pair.index, (*point)? * scale))).collect();
        let mut first = self.frame.clone();
        first.camera_from_world = Se3::identity();
        first.points.fill(None);
        Ok(TwoViews { first, second_from_world, points })
    }
}
