//! The frames that are shown, and what the log tells when a run is gone through again.

use std::collections::BTreeMap;

use slam::input::{PanopticMask, Setup};
use slam::report::{KeypointReport, RegionReport, Verdict};
use slam_math::Buffer;
use slam_vision::GrayImage;

use super::rows::{Row, lost};
use crate::eval::Evaluation;
use crate::log::EncodedImage;
use crate::run::Retraced;

/// Frames at even distances.
const EVEN: usize = 4;
/// Frames with the largest errors, and of lost stretches.
const WORST: usize = 2;
const LOST: usize = 2;

/// One frame to show.
#[derive(Debug, Clone)]
pub struct Moment {
    pub frame: usize,
    /// Why it is shown.
    pub reasons: Vec<&'static str>,
    pub size: (u32, u32),
    pub color: Option<EncodedImage>,
    pub gray: GrayImage,
    pub keypoints: Vec<KeypointReport>,
    pub regions: Vec<RegionReport>,
    pub region_cells: (usize, usize, Buffer<u16>),
}

impl Moment {
    fn new(seen: Retraced<'_>, reasons: Vec<&'static str>) -> Self {
        let Retraced { input, color, report } = seen;
        Self {
            frame: report.id.index(),
            reasons,
            size: (input.gray.width as u32, input.gray.height as u32),
            color: color.cloned(),
            gray: input.gray.clone(),
            keypoints: report.keypoints.to_vec(),
            regions: report.regions.to_vec(),
            region_cells: report.region_cells.clone(),
        }
    }
}

/// Frames to show, known before the run is gone through, with the reasons.
pub type Chosen = BTreeMap<usize, Vec<&'static str>>;

/// First, last, largest errors, lost ones, and some at even distances. Ties go to the earlier frame.
pub fn choose(rows: &[Row], evaluation: Option<&Evaluation>) -> Chosen {
    let mut chosen = Chosen::new();
    let Some(end) = rows.len().checked_sub(1) else { return chosen };
    let mut add = |frame: usize, reason| chosen.entry(frame).or_default().push(reason);
    add(0, "first");
    add(end, "last");
    let apart = rows.len() / 10;
    for frame in worst(rows, evaluation, apart) {
        add(frame, "large error");
    }
    // The longest stretches, each in its middle.
    let mut stretches = lost(rows);
    stretches.sort_by_key(|(from, to)| (std::cmp::Reverse(to - from), *from));
    stretches.iter().take(LOST).for_each(|(from, to)| add((from + to) / 2, "no pose"));
    (1..=EVEN).for_each(|i| add(i * end / (EVEN + 1), "even distance"));
    chosen
}

/// Frames with the largest errors, some distance from one another.
fn worst(rows: &[Row], evaluation: Option<&Evaluation>, apart: usize) -> Vec<usize> {
    let mut samples = evaluation.map_or(Vec::new(), |e| e.samples.clone());
    samples.sort_by(|a, b| b.translation_m.total_cmp(&a.translation_m).then(a.stamp.cmp(&b.stamp)));
    let mut found: Vec<usize> = Vec::new();
    for sample in samples {
        let Ok(frame) = rows.binary_search_by_key(&sample.stamp, |row| row.stamp) else { continue };
        if found.len() < WORST && found.iter().all(|other| other.abs_diff(frame) > apart) {
            found.push(frame);
        }
    }
    found
}

/// A category and how much of the sequence it fills.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Presence {
    /// Frames with at least one pixel of it.
    pub frames: usize,
    /// Pixels in all of them.
    pub pixels: u64,
}

/// What going through the run again showed.
pub struct Seen {
    pub setup: Setup,
    /// Keypoints by verdict, a frame each.
    pub verdicts: Vec<[u32; Verdict::ALL.len()]>,
    /// By category; 0 is unknown.
    pub categories: BTreeMap<u16, Presence>,
    /// Pixels of all masks.
    pub masked_pixels: u64,
    /// In order.
    pub moments: Vec<Moment>,
}

/// Looks at every frame and keeps what is to be shown.
pub struct Witness {
    chosen: Chosen,
    frames: usize,
    seen: Seen,
    /// The frame with the most moving keypoints of either half, and their number.
    liveliest: [Option<(usize, Moment)>; 2],
}

impl Witness {
    pub fn new(chosen: Chosen, frames: usize, setup: &Setup) -> Self {
        let seen = Seen {
            setup: setup.clone(),
            verdicts: Vec::with_capacity(frames),
            categories: BTreeMap::new(),
            masked_pixels: 0,
            moments: Vec::new(),
        };
        Self { chosen, frames, seen, liveliest: [None, None] }
    }

    pub fn frame(&mut self, retraced: Retraced<'_>) {
        let report = retraced.report;
        let mut verdicts = [0; Verdict::ALL.len()];
        report.keypoints.iter().for_each(|keypoint| verdicts[keypoint.verdict as usize] += 1);
        self.seen.verdicts.push(verdicts);
        if let Some(mask) = &retraced.input.panoptic {
            self.mask(mask);
        }
        let frame = report.id.index();
        let moving = report.keypoints.iter().filter(|keypoint| keypoint.verdict.is_dynamic()).count();
        let best = &mut self.liveliest[usize::from(frame * 2 >= self.frames)];
        if moving > best.as_ref().map_or(0, |(most, _)| *most) {
            *best = Some((moving, Moment::new(retraced, Vec::new())));
        }
        if let Some(reasons) = self.chosen.remove(&frame) {
            self.seen.moments.push(Moment::new(retraced, reasons));
        }
    }

    fn mask(&mut self, mask: &PanopticMask) {
        let mut pixels: BTreeMap<u16, u64> = BTreeMap::new();
        // Equal pixels stand in runs.
        for run in mask.ids.chunk_by(|a, b| a == b) {
            *pixels.entry(run[0]).or_default() += run.len() as u64;
        }
        let mut of_frame: BTreeMap<u16, u64> = BTreeMap::new();
        for (id, count) in pixels {
            *of_frame.entry(mask.segment(id).map_or(0, |segment| segment.category)).or_default() += count;
        }
        for (category, count) in of_frame {
            let presence = self.seen.categories.entry(category).or_default();
            presence.frames += 1;
            presence.pixels += count;
        }
        self.seen.masked_pixels += mask.ids.len() as u64;
    }

    pub fn finish(mut self) -> Seen {
        for (_, moment) in self.liveliest.into_iter().flatten() {
            const REASON: &str = "most moving keypoints";
            match self.seen.moments.iter_mut().find(|other| other.frame == moment.frame) {
                Some(other) => other.reasons.push(REASON),
                None => self.seen.moments.push(Moment { reasons: vec![REASON], ..moment }),
            }
        }
        self.seen.moments.sort_by_key(|moment| moment.frame);
        self.seen
    }
}
