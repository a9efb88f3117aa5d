//! Finding keypoints for points that are expected at a place in the picture.

use nalgebra::Vector3;
use slam_math::{Buffer, Buffers, Se3};
use slam_vision::{Camera, Descriptor, Nearest, nearest_two};

use crate::observation::Observation;

/// What is looked for, and where.
#[derive(Debug, Clone)]
pub struct Query<K> {
    /// Who asks; ties go to the smallest key.
    pub key: K,
    /// Expected undistorted pixel.
    pub pixel: [f64; 2],
    /// Search radius in pixels (square window).
    pub radius: f64,
    /// Pyramid levels that may match, both ends included.
    pub octaves: [u8; 2],
    /// Expected depth and the tolerated difference, metres; keypoints without depth pass.
    pub depth_m: Option<(f64, f64)>,
    /// What it looks like.
    pub descriptor: Descriptor,
}

/// A keypoint found for a query.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Match<K> {
    /// The query.
    pub key: K,
    /// The keypoint.
    pub index: u32,
    /// Hamming distance.
    pub distance: u32,
}

/// Limits of a search.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Largest Hamming distance.
    pub hamming: u32,
    /// Best over second best distance on the same level; 1 switches the test off.
    pub ratio: f64,
}

/// Best keypoint for each query among those that `allowed` admits. Each keypoint goes to the query with the smallest
/// (distance, key), so the order of the queries does not matter.
pub fn search<K: Copy + Ord + Send + 'static>(
    obs: &Observation,
    queries: &[Query<K>],
    limits: Limits,
    buffers: &Buffers,
    allowed: impl Fn(usize) -> bool,
) -> Buffer<Match<K>> {
    let mut owner: Buffer<Option<(u32, K)>> = buffers.filled(obs.len(), None);
    let mut nearby = buffers.empty();
    for query in queries {
        obs.grid.query(query.pixel, query.radius, query.octaves[0], query.octaves[1], &mut nearby);
        if let Some((index, distance)) = best(obs, query, &mut nearby, limits, &allowed) {
            let claim = (distance, query.key);
            if owner[index].is_none_or(|holder| claim < holder) {
                owner[index] = Some(claim);
            }
        }
    }
    claimed(&owner, buffers)
}

/// The claims that hold, by keypoint.
pub(crate) fn claimed<K: Copy + Send + 'static>(owner: &[Option<(u32, K)>], buffers: &Buffers) -> Buffer<Match<K>> {
    let claims = owner.iter().enumerate();
    buffers.collect(claims.filter_map(|(i, o)| o.map(|(distance, key)| Match { key, index: i as u32, distance })))
}

fn best<K>(
    obs: &Observation,
    query: &Query<K>,
    nearby: &mut Vec<u32>,
    limits: Limits,
    allowed: &impl Fn(usize) -> bool,
) -> Option<(usize, u32)> {
    nearby.retain(|i| allowed(*i as usize) && depth_agrees(obs.depth(*i as usize), query.depth_m));
    let [first, second] = nearest_two(&query.descriptor, &obs.descriptor, nearby);
    if first.distance > limits.hamming {
        return None;
    }
    let octave = |found: Nearest| obs.octave.get(found.index as usize);
    let ambiguous =
        octave(second) == octave(first) && f64::from(first.distance) > limits.ratio * f64::from(second.distance);
    (!ambiguous).then_some((first.index as usize, first.distance))
}

fn depth_agrees(measured: Option<f64>, expected: Option<(f64, f64)>) -> bool {
    match (measured, expected) {
        (Some(z), Some((expected, tolerance))) => (z - expected).abs() <= tolerance,
        _ => true,
    }
}

/// Where a world point falls in a camera: undistorted pixel inside the picture, and depth.
#[must_use]
pub fn project(camera: &Camera, camera_from_world: &Se3, point: &Vector3<f64>) -> Option<([f64; 2], f64)> {
    let p = camera_from_world.transform(point);
    let pixel = camera.project(p)?;
    (pixel[0] >= 0.0 && pixel[1] >= 0.0 && pixel[0] < f64::from(camera.width) && pixel[1] < f64::from(camera.height))
        .then_some((pixel, p[2]))
}

/// Drops matches whose keypoint turned differently from the rest: angle differences are put into 30 bins of 12 degrees
/// and the three fullest are kept (the second and third only with a tenth of the first).
pub fn consistent_rotation<K: Copy + Send>(
    mut matches: Buffer<Match<K>>,
    turn: impl Fn(&Match<K>) -> f32,
) -> Buffer<Match<K>> {
    const BINS: usize = 30;
    let bin_of = |m: &Match<K>| {
        let turns = f64::from(turn(m)) / std::f64::consts::TAU;
        (((turns - turns.floor()) * BINS as f64) as usize).min(BINS - 1)
    };
    let mut counts = [0usize; BINS];
    matches.iter().for_each(|m| counts[bin_of(m)] += 1);
    let mut order: [usize; BINS] = std::array::from_fn(|i| i);
    order.sort_unstable_by_key(|bin| (std::cmp::Reverse(counts[*bin]), *bin));
    let is_kept = |bin: usize| order[..3].contains(&bin) && counts[bin] * 10 >= counts[order[0]];
    matches.retain(|m| is_kept(bin_of(m)));
    matches
}
