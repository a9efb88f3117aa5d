//! How well, how fast and how large is place recognition?
//! `cargo run --release -p replayer --example places -- LOG...`
//!
//! Candidates of each new keyframe among the older ones are judged by the ground truth of the logs: two keyframes are of
//! one place when more than half of the depth of each is seen by the other. Keyframes of the last 1.5 s are left out, as
//! a slam that knows its neighbours does. Time and memory are those of the index alone.

#[path = "verdicts/steps.rs"]
mod steps;

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use replayer::eval::Trajectory;
use replayer::read_truth;
use slam::{Config, DepthImage};
use slam_math::{Rng, Se3};
use slam_vision::{Descriptor, PlaceIndex};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// A keyframe with what decides about it.
struct View {
    stamp_s: f64,
    descriptors: Vec<Descriptor>,
    depth: Arc<DepthImage>,
    world_from_camera: Se3,
}

const TEMPORAL_S: f64 = 1.5;
const OVERLAP: f64 = 0.5;
/// Votes from which a keyframe is a candidate at all, `looping.min_matches`, and how many are looked at.
const MIN_VOTES: u32 = 20;
const CANDIDATES: usize = 3;
/// Grid of depth samples, pixels, and how far a surface may be off, share of its depth.
const GRID_PX: usize = 16;
const TOLERANCE: f64 = 0.05;
/// The pinhole of the recordings named in the README of the test data.
const CAMERA: [f64; 3] = [525.0, 320.0, 240.0];

fn views(log: &Path) -> Result<Vec<View>> {
    let truth = read_truth(log)?;
    let mut views = Vec::new();
    steps::for_each_report(log, &Config::default(), &mut |report, input, obs, _| {
        let (Some(_), Some(depth)) = (report.new_keyframe, input.depth.clone()) else { return Ok(()) };
        let Some(world_from_camera) = pose_at(&truth, report.stamp.0) else { return Ok(()) };
        let known = report.keypoints.iter().zip(&obs.descriptor).filter(|(k, _)| k.point.is_some());
        let descriptors = known.map(|(_, d)| *d).collect();
        views.push(View { stamp_s: report.stamp.seconds(), descriptors, depth, world_from_camera });
        Ok(())
    })?;
    Ok(views)
}

fn pose_at(truth: &Trajectory, stamp_ns: i64) -> Option<Se3> {
    let nearest = truth.poses.iter().min_by_key(|p| (p.stamp.0 - stamp_ns).abs())?;
    ((nearest.stamp.0 - stamp_ns).abs() < 20_000_000).then_some(nearest.world_from_camera)
}

/// Share of the depth samples of `a` that `b` sees at the same place.
fn seen_by(a: &View, b: &View) -> f64 {
    let [f, cx, cy] = CAMERA;
    let b_from_a = b.world_from_camera.inverse() * a.world_from_camera;
    let (mut all, mut seen) = (0, 0);
    for y in (0..a.depth.height).step_by(GRID_PX) {
        for x in (0..a.depth.width).step_by(GRID_PX) {
            let Some(z) = a.depth.metres(x as i64, y as i64) else { continue };
            all += 1;
            let p = b_from_a.transform(&nalgebra::Vector3::new((x as f64 - cx) / f * z, (y as f64 - cy) / f * z, z));
            let (u, v) = (f * p[0] / p[2] + cx, f * p[1] / p[2] + cy);
            let measured = (p[2] > 0.0).then(|| b.depth.metres(u as i64, v as i64)).flatten();
            seen += usize::from(measured.is_some_and(|m| (m - p[2]).abs() < TOLERANCE * p[2]));
        }
    }
    seen as f64 / f64::from(all.max(1))
}

fn numbered(descriptors: &[Descriptor]) -> Vec<(u32, Descriptor)> {
    (0..).zip(descriptors.iter().copied()).collect()
}

/// Prints precision of the candidates, and the share of keyframes with a true match for which one was among them.
fn judge(name: &str, views: &[View]) {
    let mut index = PlaceIndex::new();
    let (mut candidates, mut right, mut partly, mut possible, mut hit) = (0, 0, 0, 0, 0);
    for (id, view) in views.iter().enumerate() {
        let old = |other: usize| view.stamp_s - views[other].stamp_s > TEMPORAL_S;
        let same = |other: usize| seen_by(view, &views[other]) > OVERLAP && seen_by(&views[other], view) > OVERLAP;
        let found = index.query(&view.descriptors, usize::MAX, |other, _| old(other as usize));
        let strong = found.iter().filter(|(_, votes)| *votes >= MIN_VOTES).take(CANDIDATES);
        let chosen: Vec<usize> = strong.map(|(other, _)| *other as usize).collect();
        let verdicts: Vec<bool> = chosen.iter().map(|other| same(*other)).collect();
        candidates += verdicts.len();
        right += verdicts.iter().filter(|v| **v).count();
        partly += chosen.iter().filter(|other| seen_by(view, &views[**other]) > 0.2).count();
        if (0..id).any(|other| old(other) && same(other)) {
            possible += 1;
            hit += usize::from(verdicts.contains(&true));
        }
        index.add(id as u32, &numbered(&view.descriptors));
    }
    println!(
        "{name}: {} keyframes; of {candidates} candidates {right} overlap by half, {partly} by a fifth; a match is found \
         for {hit} of {possible} keyframes that have one",
        views.len()
    );
}

/// Real descriptors over and over, a quarter of their bits flipped each time: as many as wanted, in the buckets that real
/// ones crowd into.
fn scale(views: &[View], keyframes: usize) {
    let mut index = PlaceIndex::new();
    for id in 0..keyframes {
        let mut rng = Rng::at(1, id as u32, 0, 0);
        let flip = |mut d: Descriptor| {
            for _ in 0..if id < views.len() { 0 } else { 64 } {
                let bit = rng.below(256);
                d[bit / 64] ^= 1 << (bit % 64);
            }
            d
        };
        let changed: Vec<Descriptor> = views[id % views.len()].descriptors.iter().copied().map(flip).collect();
        index.add(id as u32, &numbered(&changed));
    }
    let queries = || views.iter().step_by(1 + views.len() / 50);
    let start = cpu_ns();
    let found = queries().map(|v| index.query(&v.descriptors, 20, |_, _| true)).collect::<Vec<_>>();
    let mean_ms = (cpu_ns() - start) as f64 * 1e-6 / found.len() as f64;
    let entries: usize = (0..keyframes).map(|id| views[id % views.len()].descriptors.len().min(500)).sum();
    let megabytes = (entries * 80 + 8 * 65536 * 8) as f64 / 1e6;
    println!("{keyframes} keyframes: query {mean_ms:.2} ms of CPU, {megabytes:.0} MB");
}

/// Nanoseconds that this thread has computed, whatever else the machine does (Linux).
fn cpu_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(0)
}

fn run() -> Result<()> {
    let mut all = Vec::new();
    for log in std::env::args().skip(1) {
        let views = views(Path::new(&log))?;
        judge(&log, &views);
        all.extend(views);
    }
    if all.is_empty() {
        return Err("usage: places LOG...".into());
    }
    [100, 1000, 10_000].into_iter().for_each(|keyframes| scale(&all, keyframes));
    Ok(())
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
