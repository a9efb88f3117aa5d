//! Who is where in each frame, and where that is in doubt.

use super::RedactOptions;
use super::area::{Area, Cover, Packed};
use crate::edit::{EditError, Frame, RawMessage};
use schemas::msg::{CategoryTable, Image, SegmentTable};
use schemas::topics::LayerTopics;
use schemas::{Stamp, panoptic};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::io;

/// Why a frame's mask may not show everybody.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The layer has no mask for the picture.
    NoMask,
    /// Nobody here, but somebody shortly before and after (at an end of the log: on its one side).
    Missing,
    /// Somebody was here, away from the picture's border, and is not seen again for longer than can be bridged (or was not
    /// seen before).
    Vanished,
    /// Less than half the area of the frames around.
    AreaDrop,
    /// A segment below the confidence that is asked for.
    LowScore,
    /// Much of where people were in the frame before is unknown here.
    Void,
}

/// A frame whose mask is in doubt.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Doubt {
    /// Number of the frame, as `pslam replay --frames` counts.
    pub frame: usize,
    /// Of the picture.
    pub stamp: Stamp,
    /// Why.
    pub reasons: BTreeSet<Reason>,
    /// Whether masks of frames around stand in.
    pub bridged: bool,
}

/// Less than this share of the smaller neighbour is a drop.
const AREA_DROP: f64 = 0.5;
/// Confidence below which a segment counts as doubtful.
const LOW_SCORE: f32 = 0.5;
/// Share of the people before that may be unknown now.
const VOID_SHARE: f64 = 0.2;
/// Side of the squares that unknown areas are kept in, pixels.
const SQUARE_PX: usize = 4;
/// People smaller than this share of the picture come and go behind things.
const SMALL_SHARE: f64 = 0.003;

/// One mask.
#[derive(Debug, Clone, Default)]
struct Seen {
    people: Packed,
    /// Squares with pixels that no class claims, and those beside them.
    unknown: Packed,
    /// Pixels of the people in the mask before that are unknown in this one, and pixels of those people.
    void: (usize, usize),
    touches_border: bool,
}

/// All masks of a layer, without their pixels but those of people.
pub struct People {
    topics: LayerTopics,
    classes: BTreeSet<String>,
    ids: Option<BTreeSet<u16>>,
    size: Option<(usize, usize)>,
    seen: BTreeMap<Stamp, Seen>,
    lowest_score: BTreeMap<Stamp, f32>,
    last: Area,
}

impl People {
    pub fn new(options: &RedactOptions<'_>) -> Self {
        Self {
            topics: LayerTopics::new(&options.layer),
            classes: options.classes.clone(),
            ids: None,
            size: None,
            seen: BTreeMap::new(),
            lowest_score: BTreeMap::new(),
            last: Area::default(),
        }
    }

    /// Looks at a message of the log.
    pub fn take(&mut self, message: &RawMessage<'_>) -> Result<(), EditError> {
        let error = |why: String| EditError::message(message, why);
        let topic = message.topic();
        if topic == self.topics.categories {
            let table: CategoryTable = message.decode().map_err(error)?;
            let named = |name: &String| panoptic::ids_by_name(&table.categories, name).collect::<Vec<_>>();
            if let Some(unknown) = self.classes.iter().find(|name| named(name).is_empty()) {
                return Err(EditError::Refused(format!("layer {} knows no class `{unknown}`", table.layer)));
            }
            self.ids = Some(self.classes.iter().flat_map(named).collect());
        } else if topic == self.topics.segments {
            let table: SegmentTable = message.decode().map_err(error)?;
            let ids = self.ids.clone().unwrap_or_default();
            let scores = table.segments.iter().filter(|s| ids.contains(&s.category_id)).map(|s| s.score);
            // An unknown score is negative.
            let known = scores.filter(|score| *score >= 0.0);
            if let Some(lowest) = known.min_by(f32::total_cmp) {
                self.lowest_score.insert(table.header.stamp.into(), lowest);
            }
        } else if topic == self.topics.class {
            let image: Image<'_> = message.decode().map_err(error)?;
            self.mask(&image).map_err(error)?;
        }
        Ok(())
    }

    fn mask(&mut self, image: &Image<'_>) -> Result<(), String> {
        let ids = self.ids.as_ref().ok_or("a mask before the layer's category table")?;
        let size = (image.width as usize, image.height as usize);
        if *self.size.get_or_insert(size) != size || size.0 > usize::from(u16::MAX) || size.1 > usize::from(u16::MAX) {
            return Err(format!("{}x{} pixels: masks must have one size, below 65536", size.0, size.1));
        }
        let pixels = image.pixels_u16().map_err(|error| error.to_string())?;
        let area = Area::new(&pixels, size.0, &|class| ids.contains(&class));
        let void = self.last.pixels_where(&pixels, size.0, &|class| class == panoptic::VOID_CLASS);
        let void = (void, self.last.pixels());
        let unknown = Area::squares(&pixels, size.0, SQUARE_PX, &|class| class == panoptic::VOID_CLASS);
        let [people, unknown] = [&area, &unknown].map(Area::packed);
        let (people, unknown) =
            (people.map_err(|error| error.to_string())?, unknown.map_err(|error| error.to_string())?);
        let touches_border = area.touches_border(size, 2);
        self.last = area;
        self.seen.insert(image.header.stamp.into(), Seen { people, unknown, void, touches_border });
        Ok(())
    }

    /// Size of the masks.
    pub fn size(&self) -> Option<(usize, usize)> {
        self.size
    }

    fn pixels(&self, frame: &Frame) -> usize {
        self.seen.get(&frame.stamp).map_or(0, |seen| seen.people.pixels())
    }

    /// The nearest frame with people on one side, at most `reach` away: its distance.
    fn nearest(&self, frames: &[Frame], at: usize, reach: usize, step: isize) -> Option<usize> {
        (1..=reach).find(|distance| {
            let other = at.checked_add_signed(step * *distance as isize);
            other.and_then(|other| frames.get(other)).is_some_and(|frame| self.pixels(frame) > 0)
        })
    }

    /// What is redacted in a frame: its people and those of the frames around, grown by the margin and by what they may have
    /// moved since. Where nobody is seen, the nearest frames with people on both sides stand in. Where there are people at all,
    /// what no class claims as well.
    pub fn cover(&self, frames: &[Frame], at: usize, options: &RedactOptions<'_>) -> io::Result<Cover> {
        let size = self.size.unwrap_or_default();
        let mut used: BTreeSet<usize> =
            (at.saturating_sub(options.neighbours)..=(at + options.neighbours).min(frames.len() - 1)).collect();
        let mut margin = options.margin_px;
        if self.pixels(&frames[at]) == 0 {
            margin *= 2;
            used.extend(self.nearest(frames, at, options.bridge, -1).map(|distance| at - distance));
            used.extend(self.nearest(frames, at, options.bridge, 1).map(|distance| at + distance));
        }
        let grown = used.into_iter().filter_map(|other| {
            let seen = self.seen.get(&frames[other].stamp).filter(|seen| seen.people.pixels() > 0)?;
            let radius = margin + options.motion_px * other.abs_diff(at);
            Some(seen.people.area().map(|area| (area, radius)))
        });
        let mut grown = grown.collect::<io::Result<Vec<_>>>()?;
        if options.cover_unknown && !grown.is_empty() {
            grown.extend(self.unknown(frames, at, options)?.into_iter().map(|area| (area.unfolded(SQUARE_PX), 0)));
        }
        Ok(Cover::of(size, &grown))
    }

    /// What no class claims in a frame; without a mask, in the nearest ones that have one.
    fn unknown(&self, frames: &[Frame], at: usize, options: &RedactOptions<'_>) -> io::Result<Vec<Area>> {
        let seen = |other: usize| self.seen.get(&frames.get(other)?.stamp);
        let nearest =
            |step: isize| (1..=options.bridge.max(1)).find_map(|d| seen(at.checked_add_signed(step * d as isize)?));
        let stand_in = || [nearest(-1), nearest(1)].into_iter().flatten().collect();
        let used: Vec<&Seen> = seen(at).map_or_else(stand_in, |seen| vec![seen]);
        used.into_iter().map(|seen| seen.unknown.area()).collect()
    }

    /// Every frame in doubt.
    pub fn doubts(&self, frames: &[Frame], options: &RedactOptions<'_>) -> Vec<Doubt> {
        let mut doubts: BTreeMap<usize, BTreeSet<Reason>> = BTreeMap::new();
        for at in 0..frames.len() {
            let reasons = self.reasons(frames, at, options);
            if !reasons.is_empty() {
                doubts.insert(at, reasons);
            }
            for other in self.after_vanishing(frames, at, options) {
                doubts.entry(other).or_default().insert(Reason::Vanished);
            }
        }
        let doubt = |(frame, reasons): (usize, BTreeSet<Reason>)| {
            let bridged = !reasons.contains(&Reason::Vanished) && self.is_bridged(frames, frame, options);
            Doubt { frame, stamp: frames[frame].stamp, reasons, bridged }
        };
        doubts.into_iter().map(doubt).collect()
    }

    fn reasons(&self, frames: &[Frame], at: usize, options: &RedactOptions<'_>) -> BTreeSet<Reason> {
        let mut reasons = BTreeSet::new();
        let reach = options.bridge.max(1);
        let [before, after] = [-1, 1].map(|step| self.nearest(frames, at, reach, step));
        let (starts, ends) = (at < reach, at + reach >= frames.len());
        let pixels = self.pixels(&frames[at]);
        if pixels == 0 && (before.is_some() || starts) && (after.is_some() || ends) && (before.or(after)).is_some() {
            reasons.insert(Reason::Missing);
        }
        let Some(seen) = self.seen.get(&frames[at].stamp) else {
            reasons.insert(Reason::NoMask);
            return reasons;
        };
        if let (Some(before), Some(after)) = (before, after) {
            let around = self.pixels(&frames[at - before]).min(self.pixels(&frames[at + after]));
            if pixels > 0 && (pixels as f64) < AREA_DROP * around as f64 {
                reasons.insert(Reason::AreaDrop);
            }
        }
        if self.lowest_score.get(&frames[at].stamp).is_some_and(|score| *score < LOW_SCORE) {
            reasons.insert(Reason::LowScore);
        }
        if seen.void.0 as f64 > VOID_SHARE * seen.void.1 as f64 {
            reasons.insert(Reason::Void);
        }
        reasons
    }

    /// The frames behind (or before) this one in which somebody should still be seen, though nobody is for longer than can
    /// be bridged.
    fn after_vanishing(&self, frames: &[Frame], at: usize, options: &RedactOptions<'_>) -> Vec<usize> {
        let Some(seen) = self.seen.get(&frames[at].stamp) else { return Vec::new() };
        let (width, height) = self.size.unwrap_or_default();
        let is_small = (seen.people.pixels() as f64) < SMALL_SHARE * (width * height) as f64;
        if seen.touches_border || is_small {
            return Vec::new();
        }
        let mut unseen = Vec::new();
        for step in [-1_isize, 1] {
            let reach = options.bridge.max(1);
            let others = (1..=reach).map_while(|distance| at.checked_add_signed(step * distance as isize));
            let others: Vec<usize> = others.take_while(|other| *other < frames.len()).collect();
            // A log that ends before is no sign of vanishing.
            if others.len() == reach && others.iter().all(|other| self.pixels(&frames[*other]) == 0) {
                unseen.extend(others);
            }
        }
        unseen
    }

    /// Whether frames around stand in for this one: masks on both sides, or on one at an end of the log.
    fn is_bridged(&self, frames: &[Frame], at: usize, options: &RedactOptions<'_>) -> bool {
        let has_mask = |step: isize| {
            let mut others = (1..=options.bridge).map_while(|d| at.checked_add_signed(step * d as isize));
            let at_end = if step < 0 { at < options.bridge } else { at + options.bridge >= frames.len() };
            let near = others.find(|other| frames.get(*other).is_some_and(|f| self.seen.contains_key(&f.stamp)));
            (near.is_some(), near.is_some() || at_end)
        };
        let [before, after] = [has_mask(-1), has_mask(1)];
        (before.0 || after.0) && before.1 && after.1
    }
}
