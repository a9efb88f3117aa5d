//! Evidence of motion under the camera's own motion: surfaces in space that was free a moment ago, and keypoints that
//! are not where the static world would have them.

use nalgebra::Vector3;
use slam_math::{Buffer, FrameId, float};
use slam_vision::nearest_two;
use smallvec::smallvec;

use super::association::Vote;
use super::{Few, FrameFilter, NO_REGION, RegionKind, Remembered, Tracked, ground, rays};
use crate::config::MotionConfig;
use crate::context::Context;
use crate::input::{DepthImage, Sensor};
use crate::matching::project;
use crate::observation::{Observation, round_to_pixel};
use crate::report::{KeypointClass, Verdict};

/// Every second cell is sampled in both directions: a sample each 8 pixels.
pub(super) const SAMPLE_STRIDE: usize = 2;
/// Half side of the window in which an older depth is looked up, pixels: covers the error of pose and borders.
const WINDOW: i64 = 2;
/// Localisation noise of a keypoint at level 0, pixels (0.3-1 px by slam-anatomy, section 12.2).
pub(super) const KEYPOINT_SIGMA_PX: f64 = 0.7;
/// Every so manyth keypoint on Stuff is searched too, to see how many seem to move that do not.
const STUFF_STRIDE: usize = 4;
/// Keypoints on Stuff found again that tell more than the configured share.
const MIN_STUFF_KEYPOINTS: u32 = 20;
/// Samples that must agree with an older frame for a static vote, as a share of those tested.
const CONSISTENT_SHARE: f64 = 0.5;

/// The frame that is judged.
pub(super) struct Now<'a> {
    pub id: FrameId,
    pub depth: Option<&'a DepthImage>,
    pub obs: &'a Observation,
    pub tracked: &'a Tracked<'a>,
    /// Older frames that are looked up for [`ground`] alone.
    pub anchors: Few<&'a Remembered>,
}

/// What was counted about one region against one older frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Count {
    /// Depth samples that could be compared.
    pub samples: u32,
    /// Samples where the older frame saw farther: the surface stands in formerly free space.
    pub free: u32,
    /// Samples where the older frame saw the same surface.
    pub consistent: u32,
    /// Those of them that are [`ground`]: they say nothing about what else the label covers.
    pub ground: u32,
    /// Keypoints found again.
    pub keypoints: u32,
    /// Keypoints found elsewhere than the static world would have them.
    pub moved: u32,
}

impl Count {
    /// Share of the keypoints that moved; 0 where so few were found that it means nothing.
    fn moved_share(&self) -> f64 {
        if self.keypoints < MIN_STUFF_KEYPOINTS { 0.0 } else { f64::from(self.moved) / f64::from(self.keypoints) }
    }
}

/// Evidence about a region: a count per compared frame, youngest first.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Evidence {
    /// Counts.
    pub counts: Few<Count>,
}

impl Evidence {
    /// Largest share of free-space samples over the compared frames.
    #[must_use]
    pub fn free_space_share(&self) -> f64 {
        self.largest(|c| (c.free, c.samples - c.ground))
    }

    /// Largest share of moved keypoints over the compared frames.
    #[must_use]
    pub fn moved_share(&self) -> f64 {
        self.largest(|c| (c.moved, c.keypoints))
    }

    fn largest(&self, pair: impl Fn(&Count) -> (u32, u32)) -> f64 {
        self.counts
            .iter()
            .map(pair)
            .filter(|(_, n)| *n > 0)
            .fold(0.0, |largest, (part, whole)| float::max(largest, f64::from(part) / f64::from(whole)))
    }

    /// What these counts say, `stuff` being those of the surroundings. With depth images the oldest frame must agree, since slow motion shows there first; few
    /// keypoints are found again after so long, so without them it is the oldest frame with enough of those.
    pub(super) fn vote(&self, config: &MotionConfig, stuff: &Self, by_keypoints: bool) -> Vote {
        let in_free_space = |c: &Count| {
            let others = f64::from(c.samples - c.ground);
            c.free >= config.min_samples && f64::from(c.free) >= config.free_space_share * others
        };
        let moved = |(c, stuff): (&Count, &Count)| {
            c.moved >= config.min_moved && f64::from(c.moved) >= config.too_many_moved(c.keypoints, stuff.moved_share())
        };
        let same = |c: &Count| {
            c.samples >= config.min_samples && f64::from(c.consistent) >= CONSISTENT_SHARE * f64::from(c.samples)
        };
        let enough = |c: &&Count| !by_keypoints || c.samples >= config.min_samples;
        let has_moved = self.counts.iter().zip(&stuff.counts).any(moved);
        if self.counts.iter().any(in_free_space) || (has_moved && by_keypoints) {
            Vote::Dynamic
        } else if has_moved {
            Vote::Moved
        } else if self.counts.iter().rev().find(enough).is_some_and(same) {
            Vote::Static
        } else {
            Vote::Silent
        }
    }
}

/// Fills `frame.evidence` and `frame.motion_sigmas`, and finds what is ground and what stands in free space.
pub(super) fn gather(ctx: &Context, now: &Now<'_>, older: &[&Remembered], frame: &mut FrameFilter) {
    for evidence in frame.evidence.iter_mut().chain([&mut frame.stuff]) {
        evidence.counts = smallvec![Count::default(); older.len()];
    }
    ground::keep_blind(frame);
    if let Some(depth) = now.depth {
        count_samples(ctx, now, depth, older, frame);
    }
    frame.keypoint_ground = ground::keypoints(ctx, now, older, frame);
    frame.in_free_space = keypoints_in_free_space(ctx, now, older, frame);
    let world_from_camera = now.tracked.camera_from_world.inverse();
    let by_depth = ctx.sensor == Sensor::Rgbd;
    let mut nearby = ctx.buffers.empty();
    for i in 0..now.obs.len() {
        let is_searched = match frame.class[i] {
            KeypointClass::Person => false,
            KeypointClass::Stuff => i.is_multiple_of(STUFF_STRIDE) && frame.verdict[i] == Verdict::Static,
            KeypointClass::Thing | KeypointClass::Unknown => frame.region[i].is_some() && !frame.keypoint_ground[i],
        };
        if !is_searched {
            continue;
        }
        // Depth of a stereo camera is good where it is close.
        let depth = now.obs.depth(i).filter(|z| by_depth || *z < ctx.close_m);
        let in_world = depth.map(|z| world_from_camera.transform(&ctx.camera.unproject(now.obs.pixel[i], z)));
        for (age, then) in older.iter().enumerate() {
            let sigmas = match (in_world, now.tracked.scene_depth) {
                (Some(in_world), _) => keypoint_residual(ctx, now, i, &in_world, then, &mut nearby),
                (None, Some(scene)) if !by_depth => {
                    rays::residual(ctx, now.obs, i, now.tracked.camera_from_world, scene, then, &mut nearby)
                }
                _ => None,
            };
            let Some(sigmas) = sigmas else { continue };
            frame.motion_sigmas[i] = sigmas;
            let evidence = frame.region[i].map_or(&mut frame.stuff, |region| &mut frame.evidence[region]);
            let count = &mut evidence.counts[age];
            let moved = u32::from(sigmas > ctx.config.panoptic.motion.moved_sigmas);
            (count.keypoints, count.moved) = (count.keypoints + 1, count.moved + moved);
            if !by_depth {
                // Keypoints are all there is: they stand for the samples of a depth image.
                (count.samples, count.consistent) = (count.samples + 1, count.consistent + 1 - moved);
            }
        }
    }
}

fn count_samples(ctx: &Context, now: &Now<'_>, depth: &DepthImage, older: &[&Remembered], frame: &mut FrameFilter) {
    let world_from_camera = now.tracked.camera_from_world.inverse();
    let mut seen = Few::new();
    for row in (0..frame.regions.height).step_by(SAMPLE_STRIDE) {
        for column in (0..frame.regions.width).step_by(SAMPLE_STRIDE) {
            let cell = row * frame.regions.width + column;
            let region = frame.regions.cell[cell];
            if region == NO_REGION && !frame.block(cell).any(|cell| frame.is_in_doubt(cell)) {
                continue;
            }
            let (x, y) = frame.regions.center(cell);
            let Some(z) = depth.metres(x, y).filter(|z| *z <= ctx.config.sensor.max_depth_m) else { continue };
            let pixel = ctx.camera.undistort([x as f64, y as f64]);
            let in_world = world_from_camera.transform(&ctx.camera.unproject(pixel, z));
            seen.clear();
            seen.extend(older.iter().map(|then| compare(ctx, then, &in_world)));
            let kind = frame.regions.list.get(usize::from(region)).map(|region| region.kind);
            let is_ground = kind != Some(RegionKind::Person) && ground::stood_at(ctx, now, &in_world, &seen);
            if is_ground {
                frame.mark_ground(cell);
            }
            let Some(evidence) = frame.evidence.get_mut(usize::from(region)) else { continue };
            for (count, seen) in evidence.counts.iter_mut().zip(&seen) {
                let Some(seen) = seen else { continue };
                count.samples += 1;
                match seen {
                    Seen::Farther => count.free += 1,
                    Seen::Same { .. } => {
                        (count.consistent, count.ground) = (count.consistent + 1, count.ground + u32::from(is_ground));
                    }
                }
            }
        }
    }
}

/// What an older frame saw in the direction of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Seen {
    /// Only farther surfaces: the point's place was free.
    Farther,
    /// A surface at the point.
    Same {
        /// It was background.
        ground: bool,
    },
}

/// Looks a point up in an older depth image. `None` when it was out of sight, hidden, or nothing was measured.
pub(super) fn compare(ctx: &Context, then: &Remembered, in_world: &Vector3<f64>) -> Option<Seen> {
    let depth = then.depth.as_deref()?;
    let (pixel, expected) = project(&ctx.camera, &then.camera_from_world, in_world)?;
    let raw = ctx.camera.distort(pixel);
    let (cx, cy) = (round_to_pixel(raw[0]), round_to_pixel(raw[1]));
    if then.shows_ground(ctx, [cx, cy], expected) {
        return Some(Seen::Same { ground: true });
    }
    let margin = ctx.free_space_margin(expected);
    let (mut measured, mut farther) = (0, 0);
    for y in cy - WINDOW..=cy + WINDOW {
        for x in cx - WINDOW..=cx + WINDOW {
            let Some(z) = depth.metres(x, y) else { continue };
            if (z - expected).abs() <= margin {
                return Some(Seen::Same { ground: false });
            }
            measured += 1;
            farther += u32::from(z > expected);
        }
    }
    // Half the window must have been measured: a hole is no free space.
    let window = (2 * WINDOW + 1) * (2 * WINDOW + 1);
    (measured * 2 > window && farther as i64 == measured).then_some(Seen::Farther)
}

/// How far keypoint `i` is from where the static world would have it in an older frame, in sigmas of pixel and depth
/// noise; `None` when it is not found again. `nearby` is scratch.
fn keypoint_residual(
    ctx: &Context,
    now: &Now<'_>,
    i: usize,
    in_world: &Vector3<f64>,
    then: &Remembered,
    nearby: &mut Vec<u32>,
) -> Option<f64> {
    let (pixel, expected) = project(&ctx.camera, &then.camera_from_world, in_world)?;
    let j = find_again(ctx, now.obs, i, pixel, then, nearby)?;
    let sigma_px = KEYPOINT_SIGMA_PX * ctx.scales[usize::from(now.obs.octave[i])];
    let (dx, dy) = (then.obs.pixel[j][0] - pixel[0], then.obs.pixel[j][1] - pixel[1]);
    // The sigmas of the pose are over three axes; the older one is taken to be as uncertain.
    let along_axis = now.tracked.position_sigma_m * now.tracked.position_sigma_m / 3.0;
    let turn = now.tracked.rotation_sigma_rad * now.tracked.rotation_sigma_rad / 3.0;
    let pose_px2 = ctx.pinhole.fx * ctx.pinhole.fx * (along_axis / (expected * expected) + turn);
    let mut chi2 = (dx * dx + dy * dy) / (2.0 * (sigma_px * sigma_px + pose_px2));
    if let Some(z) = then.obs.depth(j) {
        let sigma = ctx.depth_sigma(z);
        chi2 += (z - expected) * (z - expected) / (2.0 * (sigma * sigma + along_axis));
    }
    Some(chi2.sqrt())
}

/// The keypoint of an older frame near a pixel that surely looks like keypoint `i`, wherever the geometry wants it.
/// `nearby` is scratch.
pub(super) fn find_again(
    ctx: &Context,
    obs: &Observation,
    i: usize,
    pixel: [f64; 2],
    then: &Remembered,
    nearby: &mut Vec<u32>,
) -> Option<usize> {
    let octave = obs.octave[i];
    let radius = ctx.config.panoptic.motion.search_px;
    then.obs.grid.query(pixel, radius, octave.saturating_sub(1), octave + 1, nearby);
    nearby.retain(|j| then.class[*j as usize] != KeypointClass::Person);
    let [first, second] = nearest_two(&obs.descriptor[i], &then.obs.descriptor, nearby);
    let t = &ctx.config.tracking;
    if first.distance > t.hamming_low || f64::from(first.distance) > t.ratio * f64::from(second.distance) {
        return None;
    }
    Some(first.index as usize)
}

/// Keypoints that stand in formerly free space by their own depth, whatever their label says: what the segmentation missed.
/// Whoever is filtered as a person is not asked. Only with both tests of movers on.
fn keypoints_in_free_space(ctx: &Context, now: &Now<'_>, older: &[&Remembered], frame: &FrameFilter) -> Buffer<bool> {
    debug_assert!(older.iter().all(|then| then.id < now.id));
    let p = &ctx.config.panoptic;
    let is_asked = |i: usize| p.things && p.unknown && !(p.people && frame.class[i] == KeypointClass::Person);
    let world_from_camera = now.tracked.camera_from_world.inverse();
    let one = |i: usize| {
        let depth = now.obs.depth(i).filter(|_| is_asked(i));
        let in_world = depth.map(|z| world_from_camera.transform(&ctx.camera.unproject(now.obs.pixel[i], z)));
        let was_free = |point: &Vector3<f64>| older.iter().any(|then| compare(ctx, then, point) == Some(Seen::Farther));
        in_world.as_ref().is_some_and(was_free)
    };
    ctx.buffers.collect((0..now.obs.len()).map(one))
}
