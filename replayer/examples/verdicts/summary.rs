//! The numbers that are printed.

use std::collections::BTreeMap;
use std::fmt;

use schemas::Stamp;
use serde::Serialize;
use slam::report::{KeypointReport, Verdict};

const NS_PER_S: u64 = 1_000_000_000;

/// Keypoints on one surface.
#[derive(Clone, Copy, Default, Serialize)]
pub struct Count {
    pub keypoints: u64,
    /// By [`Verdict::is_dynamic`].
    pub dynamic: u64,
    /// Matched to a map point, one made in the same frame included.
    pub matches: u64,
    /// In the order of [`Verdict::ALL`].
    pub verdicts: [u64; Verdict::ALL.len()],
}

impl Count {
    pub fn add(&mut self, keypoint: &KeypointReport) {
        self.keypoints += 1;
        self.dynamic += u64::from(keypoint.verdict.is_dynamic());
        self.matches += u64::from(keypoint.point.is_some());
        self.verdicts[keypoint.verdict as usize] += 1;
    }

    fn of(&self, verdict: Verdict) -> u64 {
        self.verdicts[verdict as usize]
    }
}

impl<'a> std::iter::Sum<&'a Count> for Count {
    fn sum<I: Iterator<Item = &'a Self>>(counts: I) -> Self {
        counts.fold(Self::default(), |mut sum, count| {
            sum.keypoints += count.keypoints;
            sum.dynamic += count.dynamic;
            sum.matches += count.matches;
            sum.verdicts.iter_mut().zip(count.verdicts).for_each(|(sum, n)| *sum += n);
            sum
        })
    }
}

/// A frame that shows a mover that stands still.
#[derive(Clone, Copy, Serialize)]
pub struct ParkedFrame {
    pub frame: u32,
    pub stamp: Stamp,
    pub count: Count,
}

/// A mover from when it stops until it moves again or the log ends.
#[derive(Clone, Serialize)]
pub struct Parking {
    mover: u8,
    /// Frame with the first map point on it.
    first_match: Option<u32>,
    /// Means over the frames of its last second.
    last_second_matches: f64,
    last_second_keypoints: f64,
    last_second_static: f64,
    frames: Vec<ParkedFrame>,
}

impl Parking {
    pub fn new(mover: u8, frames: Vec<ParkedFrame>) -> Self {
        let end_ns = frames.last().map_or(0, |last| last.stamp.0);
        let late: Vec<_> = frames.iter().filter(|f| end_ns.abs_diff(f.stamp.0) < NS_PER_S).map(|f| f.count).collect();
        let mean = |part: u64| part as f64 / late.len().max(1) as f64;
        let sum: Count = late.iter().sum();
        Self {
            mover,
            first_match: frames.iter().find(|frame| frame.count.matches > 0).map(|frame| frame.frame),
            last_second_matches: mean(sum.matches),
            last_second_keypoints: mean(sum.keypoints),
            last_second_static: mean(sum.of(Verdict::Static)),
            frames,
        }
    }
}

/// A judged replay. Shares of nothing are `None`.
#[derive(Serialize)]
pub struct Summary {
    pub frames: u32,
    pub tracked: u32,
    /// Of the keypoints called dynamic, those on movers that move; a parked one counts as wrong.
    pub precision: Option<f64>,
    /// Of the keypoints on movers that move, those called dynamic.
    pub recall: Option<f64>,
    /// Of the keypoints on the static scene, those with the verdict static.
    pub static_kept: Option<f64>,
    /// Of the matches to map points, those on movers that move.
    pub leak: Option<f64>,
    pub static_scene: Count,
    pub parked: Count,
    /// By mover, while it moves.
    pub moving: BTreeMap<u8, Count>,
    pub parkings: Vec<Parking>,
}

impl Summary {
    pub fn new(
        (frames, tracked): (u32, u32),
        static_scene: Count,
        moving: BTreeMap<u8, Count>,
        parkings: Vec<Parking>,
    ) -> Self {
        let parked = parkings.iter().flat_map(|parking| &parking.frames).map(|frame| &frame.count).sum();
        let movers: Count = moving.values().sum();
        let all: Count = [static_scene, movers, parked].iter().sum();
        Self {
            frames,
            tracked,
            precision: share(movers.dynamic, all.dynamic),
            recall: share(movers.dynamic, movers.keypoints),
            static_kept: share(static_scene.of(Verdict::Static), static_scene.keypoints),
            leak: share(movers.matches, all.matches),
            static_scene,
            parked,
            moving,
            parkings,
        }
    }
}

fn share(part: u64, whole: u64) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

fn percent(share: Option<f64>) -> String {
    share.map_or("-".to_owned(), |share| format!("{:.2} %", 100.0 * share))
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} frames, {} tracked", self.frames, self.tracked)?;
        let [precision, recall, kept, leak] = [self.precision, self.recall, self.static_kept, self.leak].map(percent);
        writeln!(
            f,
            "dynamic verdicts: precision {precision} (on what is parked they count as wrong), recall {recall}"
        )?;
        writeln!(f, "static keypoints kept {kept}, matches on movers that move (leak) {leak}")?;
        let names = self.moving.keys().map(|mover| format!("mover {mover}"));
        let names: Vec<_> = ["static scene".to_owned()].into_iter().chain(names).chain(["parked".to_owned()]).collect();
        let counts: Vec<_> =
            [&self.static_scene].into_iter().chain(self.moving.values()).chain([&self.parked]).collect();
        let mut row = |name: &str, cells: Vec<String>| {
            let cells: String = cells.iter().map(|cell| format!("{cell:>14}")).collect();
            writeln!(f, "{name:<20}{cells}")
        };
        row("", names)?;
        row("keypoints", counts.iter().map(|count| count.keypoints.to_string()).collect())?;
        for verdict in Verdict::ALL {
            let shares = counts.iter().map(|count| percent(share(count.of(verdict), count.keypoints)));
            row(&format!("  {}", verdict.name()), shares.collect())?;
        }
        row("dynamic verdicts", counts.iter().map(|c| percent(share(c.dynamic, c.keypoints))).collect())?;
        row("matches", counts.iter().map(|count| count.matches.to_string()).collect())?;
        self.parkings.iter().try_for_each(|parking| writeln!(f, "{parking}"))
    }
}

impl fmt::Display for Parking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(since) = self.frames.first() else { return Ok(()) };
        write!(f, "mover {} stands still from frame {}: ", self.mover, since.frame)?;
        match self.first_match {
            Some(frame) => write!(f, "first matched map point in frame {frame}")?,
            None => write!(f, "never a matched map point")?,
        }
        let [matches, points, kept] =
            [self.last_second_matches, self.last_second_keypoints, self.last_second_static].map(|n| format!("{n:.1}"));
        writeln!(f, "; last second {matches} matches of {points} keypoints a frame ({kept} static)")?;
        write!(f, "  matches a frame:")?;
        self.frames.iter().try_for_each(|frame| write!(f, " {}", frame.count.matches))
    }
}
