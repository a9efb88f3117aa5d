//! What is measured depth worth?
//!
//! The noise that a sensor's model says is one thing; how well depth is registered to the picture, how its scale and its
//! smooth bias are, is another, and a run has all that is needed to tell. The map is made with depth counting for less and for
//! more, and frames that had no say in it are fitted to what they saw: where depth is wrong, their pixels fit worse the more
//! it counts. Where pixels do not object, depth is as good as it claims to be at its best.

use slam_math::float;

use super::{Sights, Start, Trusted, adjust, refine_frames};
use crate::context::Context;
use crate::map::{Map, MapPoint};

/// Points of the map that a trial is made with, about: a trial is to take a small part of the time of the adjustment itself.
const SAMPLE_POINTS: usize = 1000;
/// Matches that a frame must have with those.
const SAMPLE_MATCHES: usize = 12;
/// Frames that a trial needs to say anything.
const MIN_FRAMES: usize = 30;

/// The largest of the factors on the information of depth under which the pixels of frames fit, to within
/// `final.depth_slack`, as well as under the best; 1 where nothing can be said.
pub fn depth_weight(ctx: &Context, map: &Map, sights: &Sights, starts: &[Start], trusted: Trusted<'_>) -> f64 {
    let c = &ctx.config.r#final;
    match c.depth_weights[..] {
        _ if ctx.is_monocular() => return 1.0,
        [only] => return only,
        _ => {}
    }
    let points = map.points().filter(|point| trusted(point)).count();
    let every = points.div_ceil(SAMPLE_POINTS).max(1) as u32;
    let sampled = |point: &MapPoint| point.id.0.is_multiple_of(every) && trusted(point);
    // Each trial starts where the one before it ended.
    let (mut map, mut tried) = (map.clone(), Vec::new());
    for &depth_weight in &c.depth_weights {
        let ctx = Context { depth_weight, ..ctx.clone() };
        adjust(&ctx, &mut map, &sampled);
        let refined = refine_frames(&ctx, &map, sights, starts, SAMPLE_MATCHES, &sampled);
        let mut chi2: Vec<f64> = refined.iter().flatten().map(|frame| frame.pixel_chi2).collect();
        if chi2.len() < MIN_FRAMES {
            return 1.0;
        }
        tried.push((depth_weight, float::median_in_place(&mut chi2).unwrap_or(f64::INFINITY)));
    }
    let best = tried.iter().fold(f64::INFINITY, |best, (_, chi2)| float::min(best, *chi2));
    let good = tried.iter().filter(|(_, chi2)| *chi2 <= best * (1.0 + c.depth_slack));
    good.fold(0.0, |largest, (weight, _)| float::max(largest, *weight))
}
