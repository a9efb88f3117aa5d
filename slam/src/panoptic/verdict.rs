//! Keypoint classes and verdicts: the one place where facts become decisions.

use slam_math::Buffer;

use super::association::Vote;
use super::{CELL_PX, CellMemory, FrameFilter, NO_REGION, RegionKind, Regions, Tracked, holds};
use crate::config::{MotionConfig, Rule};
use crate::context::Context;
use crate::input::{FrameInput, Sensor};
use crate::observation::Observation;
use crate::report::{KeypointClass, RegionState, Verdict};

/// Class and region of each keypoint, from its own pixel; the region of an unknown keypoint is its cell's or that of a
/// cell beside it.
pub(super) fn classify(
    ctx: &Context,
    input: &FrameInput,
    obs: &Observation,
    regions: &Regions,
) -> (Buffer<KeypointClass>, Buffer<Option<usize>>) {
    let n = obs.len();
    let (mut class, mut region) = (ctx.buffers.filled(n, KeypointClass::Stuff), ctx.buffers.filled(n, None));
    let Some(mask) = input.panoptic.as_deref() else { return (class, region) };
    let one = |i: usize| match mask.segment(obs.label[i]) {
        None => (KeypointClass::Unknown, unknown_region(regions, obs.raw_pixel[i])),
        Some(segment) => {
            let region = regions.list.iter().position(|r| r.kind != RegionKind::Unknown && r.segment == segment.id);
            let class = if ctx.people.contains(&segment.category) {
                KeypointClass::Person
            } else if region.is_some() {
                KeypointClass::Thing
            } else {
                KeypointClass::Stuff
            };
            (class, region)
        }
    };
    for i in 0..n {
        (class[i], region[i]) = one(i);
    }
    (class, region)
}

fn unknown_region(regions: &Regions, pixel: [f64; 2]) -> Option<usize> {
    let cell = regions.cell_at(pixel)?;
    let (x, y) = ((cell % regions.width) as i64, (cell / regions.width) as i64);
    let around = [(0, 0), (-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
    around.into_iter().find_map(|(dx, dy)| {
        let (x, y) = (x + dx, y + dy);
        let inside = x >= 0 && y >= 0 && x < regions.width as i64 && y < regions.height as i64;
        let region = if inside { regions.cell[y as usize * regions.width + x as usize] } else { NO_REGION };
        let known = regions.list.get(usize::from(region)).filter(|r| r.kind == RegionKind::Unknown);
        known.map(|_| usize::from(region))
    })
}

/// Established points that vouch for a region.
const MIN_VOUCHERS: u32 = 3;
/// Established points against which free space says nothing about a region as a whole: what the network left of a person at its
/// border does not condemn a screen.
const MANY_VOUCHERS: u32 = 8;

/// What the frame says about each region, and with it the region's state.
///
/// The camera's motion is that of most of what is matched. A frame in which more than half of it would be condemned has a poor
/// pose, not a moving world: it condemns nothing.
pub(super) fn update_tracks(ctx: &Context, tracked: &Tracked<'_>, frame: &mut FrameFilter) {
    let config = &ctx.config.panoptic;
    let by_keypoints = ctx.sensor != Sensor::Rgbd;
    let regions = frame.tracks.len();
    let [mut matched, mut vouched] = [ctx.buffers.filled(regions, 0u32), ctx.buffers.filled(regions, 0u32)];
    for (i, region) in frame.region.iter().enumerate() {
        if let Some(region) = *region {
            matched[region] += u32::from(tracked.matched[i]);
            vouched[region] += u32::from(tracked.vouched[i]);
        }
    }
    let needed = |region: usize| match frame.tracks[region].state {
        RegionState::Dynamic => MANY_VOUCHERS,
        _ => MIN_VOUCHERS,
    };
    let vote = |region: usize| {
        if holds(tracked.disagrees, region) {
            return Vote::Disagrees;
        }
        match frame.evidence[region].vote(&config.motion, &frame.stuff, by_keypoints) {
            Vote::Dynamic | Vote::Moved if vouched[region] >= MANY_VOUCHERS => Vote::Silent,
            Vote::Silent | Vote::Static if vouched[region] >= needed(region) => Vote::Vouched,
            vote => vote,
        }
    };
    let votes = ctx.buffers.collect((0..regions).map(vote));
    let condemned = (0..regions).filter(|r| matches!(votes[*r], Vote::Dynamic | Vote::Moved)).map(|r| matched[r]);
    let all = tracked.matched.iter().filter(|matched| **matched).count();
    let is_outvoted = 2 * condemned.sum::<u32>() as usize > all;
    for (track, vote) in frame.tracks.iter_mut().zip(&votes) {
        let is_accused = matches!(vote, Vote::Dynamic | Vote::Moved);
        track.update(config, if is_outvoted && is_accused { Vote::Silent } else { *vote });
    }
}

/// Turns all facts about a frame into verdicts: classes, region states, places, and under the paper's rule epipolar distances.
/// It runs twice a frame. What needs the camera's pose is missing the first time, when tracking asks what it may use; that
/// counts as not seen.
pub(super) fn decide(ctx: &Context, obs: &Observation, frame: &mut FrameFilter) {
    let to_mover = distance_to_movers(ctx, frame);
    let one = |i: usize| {
        let own = match ctx.config.panoptic.rule {
            Rule::Paper => by_epipolar_distance(ctx, frame, i),
            Rule::Geometric => by_region(ctx, frame, i),
        };
        let is_near_mover = || {
            let margin = margin_cells(&ctx.config.panoptic.motion, ctx.scales[usize::from(obs.octave[i])]);
            frame.regions.cell_at(obs.raw_pixel[i]).is_some_and(|cell| f64::from(to_mover[cell]) <= margin)
        };
        match own {
            Verdict::Static if is_near_mover() => Verdict::Border,
            // Its label says background, or a region that is static as a whole.
            Verdict::Static if holds(&frame.in_free_space, i) => Verdict::FreeSpace,
            own => own,
        }
    };
    frame.verdict = ctx.buffers.collect((0..obs.len()).map(one));
}

fn by_region(ctx: &Context, frame: &FrameFilter, i: usize) -> Verdict {
    let p = &ctx.config.panoptic;
    let state = frame.region[i].map_or(RegionState::New, |r| frame.tracks[r].state);
    if frame.keypoint_ground[i] && frame.class[i] != KeypointClass::Person {
        return Verdict::Static;
    }
    let disagrees = frame.region[i].is_some_and(|r| {
        let is_heard_out = state != RegionState::Static || frame.tracks[r].disagreed_streak > 1;
        is_heard_out && frame.disagrees_at(r)
    });
    let state = if disagrees { RegionState::Dynamic } else { state };
    let is_vouched = state == RegionState::New && frame.is_vouched(i);
    match (frame.class[i], state) {
        (KeypointClass::Person, _) if p.people => Verdict::Person,
        (KeypointClass::Thing, RegionState::Dynamic) if p.things => Verdict::ThingDynamic,
        _ if is_vouched => Verdict::Static,
        (KeypointClass::Thing, RegionState::New) if p.things => Verdict::ThingNew,
        (KeypointClass::Unknown, RegionState::Dynamic) if p.unknown => Verdict::UnknownDynamic,
        (KeypointClass::Unknown, RegionState::New) if p.unknown => Verdict::UnknownNew,
        _ => Verdict::Static,
    }
}

/// The paper's rule. Without a fundamental matrix only people are filtered.
fn by_epipolar_distance(ctx: &Context, frame: &FrameFilter, i: usize) -> Verdict {
    let p = &ctx.config.panoptic;
    if frame.class[i] == KeypointClass::Person && p.people {
        return Verdict::Person;
    }
    if frame.epipolar.is_none() {
        return Verdict::Static;
    }
    let distance = frame.epipolar_px[i];
    let is_new = frame.region[i].is_none_or(|r| frame.tracks[r].age == 0);
    match frame.class[i] {
        KeypointClass::Thing if p.things && is_new => Verdict::ThingNew,
        KeypointClass::Thing if p.things && distance > p.epipolar.distance_px => Verdict::ThingDynamic,
        KeypointClass::Unknown if p.unknown && distance.is_nan() => Verdict::UnknownNew,
        KeypointClass::Unknown if p.unknown && distance > p.epipolar.distance_px => Verdict::UnknownDynamic,
        _ => Verdict::Static,
    }
}

/// Margin around movers for keypoints of an octave of this scale, cells.
fn margin_cells(motion: &MotionConfig, scale: f64) -> f64 {
    let pixels = f64::from(motion.border_px) + motion.corner_px * (scale - 1.0);
    (pixels / CELL_PX as f64).ceil()
}

/// A distance that no margin reaches, cells.
const FAR: u16 = 1 << 12;

/// How many cells each cell is from one that is or just was a person or a mover: the larger of the distances along x and along
/// y, at most [`FAR`]. The paper has no margin.
fn distance_to_movers(ctx: &Context, frame: &FrameFilter) -> Buffer<u16> {
    let is_hot = |memory: &CellMemory| ctx.config.panoptic.rule == Rule::Geometric && memory.heat > 0;
    let cells = frame.memory.iter().map(|memory| if is_hot(memory) { 0 } else { FAR });
    let mut distance = ctx.buffers.collect(cells);
    // From the top left, then from the bottom right: the picture turned by half a turn.
    for _ in 0..2 {
        spread_distance(&mut distance, frame.regions.width);
        distance.reverse();
    }
    distance
}

/// Each cell is at most one farther than its neighbours to the left and above.
fn spread_distance(distance: &mut [u16], width: usize) {
    for cell in 0..distance.len() {
        let x = cell % width.max(1);
        let done = [(1, x > 0), (width + 1, x > 0), (width, true), (width - 1, x + 1 < width)];
        let neighbours = done.iter().filter(|(back, inside)| *inside && *back <= cell);
        let nearest = neighbours.map(|(back, _)| distance[cell - back] + 1).min();
        distance[cell] = distance[cell].min(nearest.unwrap_or(FAR));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn distances_are_the_larger_of_both_axes_from_the_nearest_mover() {
        let (width, height) = (9, 6);
        for movers in [vec![(4, 2)], vec![(0, 0), (8, 5)], vec![(8, 0), (3, 3)], vec![]] {
            let is_mover = |x: usize, y: usize| movers.contains(&(x, y));
            let mut found: Vec<u16> =
                (0..width * height).map(|i| if is_mover(i % width, i / width) { 0 } else { FAR }).collect();
            for _ in 0..2 {
                spread_distance(&mut found, width);
                found.reverse();
            }
            for (i, found) in found.iter().enumerate() {
                let to = |(x, y): &(usize, usize)| x.abs_diff(i % width).max(y.abs_diff(i / width)) as u16;
                assert_eq!(*found, movers.iter().map(to).min().unwrap_or(FAR), "{movers:?}, cell {i}");
            }
        }
    }

    #[test]
    fn coarser_octaves_have_a_wider_border() {
        let motion = Config::default().panoptic.motion;
        assert_eq!(margin_cells(&motion, 1.0), 2.0);
        // 8 + 3 x 2.58 = 15.7 px.
        assert_eq!(margin_cells(&motion, 3.58), 4.0);
    }
}
