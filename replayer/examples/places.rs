//! How well, how fast and how large is place recognition?
//! `cargo run --release -p replayer --example places -- LOG...`
//!
//! Candidates of each new keyframe among the older ones are judged by the ground truth of the logs: two keyframes are of
//! one place when more than half of the depth of each is seen by the other. Keyframes of the last 1.5 s are left out, as
//! a slam that knows its neighbours does. Time and memory are those of the index alone.
//!
//! The index of descriptors is compared with two vocabularies of 10,000 words: one trained on the synthetic world, which could be
//! shipped, and one trained on the very logs that it is judged by, which no user has. Each gets the least score that gives
//! as many candidates over all logs as the index has: what is looked at closer costs the same. The lines "as in a replay"
//! have what `looping.min_word_share` of the best neighbour's score lets through; last comes a sweep of that share over all
//! logs.

#[path = "verdicts/steps.rs"]
mod steps;

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;

use replayer::eval::Trajectory;
use replayer::read_truth;
use slam::{Config, DepthImage};
use slam_math::{Rng, Se3};
use slam_vision::{
    Descriptor, OrbConfig, OrbExtractor, Places, Vocabulary, VocabularyOptions, Workspace, gray_from_rgb,
};

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
const MIN_VOTES: f64 = 20.0;
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

type New<'a> = &'a dyn Fn() -> Places;

/// The older keyframes of one place with each keyframe of a log, and how much of it they see.
struct Truth {
    same: Vec<Vec<usize>>,
    partly: Vec<Vec<usize>>,
}

fn truth(views: &[View]) -> Truth {
    let (mut same, mut partly) = (Vec::new(), Vec::new());
    for view in views {
        let old = (0..views.len()).filter(|&other| is_old(view, &views[other]));
        let seen: Vec<(usize, f64)> = old.map(|other| (other, seen_by(view, &views[other]))).collect();
        let by_half = |&&(other, share): &&(usize, f64)| share > OVERLAP && seen_by(&views[other], view) > OVERLAP;
        same.push(seen.iter().filter(by_half).map(|(other, _)| *other).collect());
        partly.push(seen.iter().filter(|(_, share)| *share > 0.2).map(|(other, _)| *other).collect());
    }
    Truth { same, partly }
}

fn is_old(view: &View, other: &View) -> bool {
    view.stamp_s - other.stamp_s > TEMPORAL_S
}

/// The best older keyframes of each keyframe of a log, with their scores: absolute ones, or as shares of the best score of
/// the keyframes that are no older.
fn candidates(views: &[View], new: New<'_>, relative: bool) -> Vec<Vec<(usize, f64)>> {
    let mut index = new();
    let of = |(id, view): (usize, &View)| {
        let found = index.query(&view.descriptors, usize::MAX, |_, _| true);
        index.add(id as u32, &numbered(&view.descriptors));
        let (old, near): (Vec<_>, Vec<_>) =
            found.into_iter().partition(|(other, _)| is_old(view, &views[*other as usize]));
        let unit = near.first().map_or(1.0, |(_, score)| *score);
        let scaled = |(other, score): (u32, f64)| (other as usize, if relative { score / unit } else { score });
        old.into_iter().take(CANDIDATES).map(scaled).collect()
    };
    views.iter().enumerate().map(of).collect()
}

/// How good the candidates are that have at least some score.
#[derive(Default)]
struct Quality {
    all: usize,
    /// Overlap by half, and by a fifth.
    right: usize,
    partly: usize,
    /// Keyframes with a true match, and those of them for which one was among the candidates.
    possible: usize,
    hit: usize,
}

impl Quality {
    fn add(&mut self, truth: &Truth, candidates: &[Vec<(usize, f64)>], least: f64) {
        for ((same, seen), candidates) in truth.same.iter().zip(&truth.partly).zip(candidates) {
            let chosen = || candidates.iter().filter(|(_, score)| *score >= least).map(|(other, _)| other);
            self.all += chosen().count();
            self.right += chosen().filter(|other| same.contains(other)).count();
            self.partly += chosen().filter(|other| seen.contains(other)).count();
            self.possible += usize::from(!same.is_empty());
            self.hit += usize::from(chosen().any(|other| same.contains(other)));
        }
    }

    fn print(&self, name: &str) {
        let Self { all, right, partly, possible, hit } = self;
        println!(
            "  {name}: of {all} candidates {right} overlap by half, {partly} by a fifth; a match is found for {hit} of \
             {possible} keyframes that have one"
        );
    }
}

fn judge(name: &str, truth: &Truth, candidates: &[Vec<(usize, f64)>], least: f64) {
    let mut quality = Quality::default();
    quality.add(truth, candidates, least);
    quality.print(name);
}

/// Quality over all logs with rising shares of the best neighbour's score.
fn sweep(name: &str, truths: &[Truth], candidates: &[Vec<Vec<(usize, f64)>>]) {
    println!("{name}, all logs:");
    for tenths in 0..10 {
        let share = f64::from(tenths) / 10.0;
        let mut quality = Quality::default();
        truths.iter().zip(candidates).for_each(|(truth, found)| quality.add(truth, found, share));
        quality.print(&format!("share {share:.1}"));
    }
}

/// The least of the `count` best scores.
fn least_of(count: usize, candidates: &[Vec<Vec<(usize, f64)>>]) -> f64 {
    let mut scores: Vec<f64> = candidates.iter().flatten().flatten().map(|(_, score)| *score).collect();
    scores.sort_by(|a, b| b.total_cmp(a));
    scores.get(count.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Real descriptors over and over, a quarter of their bits flipped each time: as many as wanted, in the buckets that real
/// ones crowd into.
fn scale(views: &[&View], keyframes: usize, new: New<'_>) -> f64 {
    let mut index = new();
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
    let found = queries().map(|v| index.query(&v.descriptors, usize::MAX, |_, _| true)).collect::<Vec<_>>();
    (cpu_ns() - start) as f64 * 1e-6 / found.len() as f64
}

/// Nanoseconds that this thread has computed, whatever else the machine does (Linux).
fn cpu_ns() -> u64 {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().and_then(|n| n.parse().ok()).unwrap_or(0)
}

/// Features of every third picture of the demo's world.
fn synthetic_pictures() -> Result<Vec<Vec<Descriptor>>> {
    let config = fixtures::scenario::demo();
    let size = (config.camera.width as usize, config.camera.height as usize);
    let world = fixtures::World::new(&config)?;
    let (extractor, mut workspace) = (OrbExtractor::new(&OrbConfig::default())?, Workspace::default());
    let mut features = |frame| -> Result<Vec<Descriptor>> {
        let gray = gray_from_rgb(&world.frame(frame).rgb, size.0, size.1)?;
        Ok(extractor.extract_with(&gray, None, &mut workspace).descriptor.to_vec())
    };
    (0..config.frame_count).step_by(3).map(&mut features).collect()
}

fn run() -> Result<()> {
    let logs: Vec<String> = std::env::args().skip(1).collect();
    if logs.is_empty() {
        return Err("usage: places LOG...".into());
    }
    let all = logs.iter().map(|log| views(Path::new(log))).collect::<Result<Vec<_>>>()?;
    let train = |pictures: &[Vec<Descriptor>]| -> Result<Arc<Vocabulary>> {
        Ok(Arc::new(Vocabulary::train(pictures, &VocabularyOptions::default())?))
    };
    let shipped = train(&synthetic_pictures()?)?;
    let own = train(&all.iter().flatten().map(|view| view.descriptors.clone()).collect::<Vec<_>>())?;
    println!("words: {} of the synthetic world, {} of the logs", shipped.len(), own.len());
    let methods: [(&str, New<'_>); 3] = [
        ("index", &Places::default),
        ("words of the synthetic world", &|| Places::new(Some(shipped.clone()))),
        ("words of the logs themselves", &|| Places::new(Some(own.clone()))),
    ];
    let of_all = |new, relative| all.iter().map(|views| candidates(views, new, relative)).collect::<Vec<_>>();
    let found = methods.map(|(_, new)| of_all(new, false));
    let relative = methods.map(|(_, new)| of_all(new, true));
    let least_share = Config::default().looping.min_word_share;
    let strong = found[0].iter().flatten().flatten().filter(|(_, votes)| *votes >= MIN_VOTES).count();
    let least = [MIN_VOTES, least_of(strong, &found[1]), least_of(strong, &found[2])];
    let truths: Vec<Truth> = all.iter().map(|views| truth(views)).collect();
    for (log, views) in all.iter().enumerate() {
        println!("{}: {} keyframes", logs[log], views.len());
        let truth = &truths[log];
        for (method, (name, _)) in methods.iter().enumerate() {
            judge(name, truth, &found[method][log], least[method]);
            if method > 0 {
                judge(&format!("{name}, as in a replay"), truth, &relative[method][log], least_share);
            }
        }
    }
    for (method, (name, _)) in methods.iter().enumerate().skip(1) {
        sweep(name, &truths, &relative[method]);
    }
    let views: Vec<&View> = all.iter().flatten().collect();
    for keyframes in [100, 1000, 10_000] {
        let times = methods.map(|(name, new)| format!("{name} {:.2}", scale(&views, keyframes, new)));
        let entries: usize = (0..keyframes).map(|id| views[id % views.len()].descriptors.len().min(500)).sum();
        let megabytes = [entries * 80 + 8 * 65536 * 8, entries * 12].map(|bytes| bytes as f64 * 1e-6);
        let times = times.join(", ");
        println!(
            "{keyframes} keyframes, ms of CPU a query: {times}; MB: {:.0}, words {:.0}",
            megabytes[0], megabytes[1]
        );
    }
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
