//! Whether a region moves as the background does, by matched map points: what is condemned, and what is not.

use nalgebra::Vector3;
use slam::Config;
use slam::context::Context;
use slam::observation::Observation;
use slam::panoptic::{Consensus, FrameFilter, Matched, Region, RegionKind, Regions, consensus};
use slam::report::KeypointClass;
use slam_math::{Rng, Se3};
use slam_vision::KeypointGrid;

use crate::support::{camera, context, descriptor, observation, on_background};

/// Pyramid level of all keypoints.
const OCTAVE: u8 = 4;
/// Noise on that level, pixels.
const SIGMA_PX: f64 = 1.4;
/// Keypoints on the region.
const ON_REGION: u32 = 80;

/// A picture of one region before a background, with noise on pixels and depths. The camera stands at the world's origin.
#[derive(Clone, Copy)]
struct Picture {
    seed: u64,
    background: u32,
    /// Where the background is: its middle and half its size, metres.
    around: ([f64; 3], [f64; 3]),
    /// How far the region has gone since its points were mapped, metres.
    motion_m: [f64; 3],
    /// How many of the region's matches are wrong, and by how much at most, pixels.
    mismatches: u32,
    off_px: f64,
}

/// A room all around, and a region that stands still.
const ROOM: Picture = Picture {
    seed: 0,
    background: 150,
    around: ([0.0, 0.0, 2.5], [1.2, 0.9, 1.0]),
    motion_m: [0.0; 3],
    mismatches: 0,
    off_px: 30.0,
};

/// Where a region has gone that moves slowly away: no farther than one and a half sigmas of a single depth.
const SLOWLY: [f64; 3] = [0.0, 0.0, 0.13];

impl Picture {
    /// Points in the world, and where and how far away they are seen: those of the background first.
    fn points(&self, ctx: &Context) -> Vec<(Vector3<f64>, [f64; 2], f64)> {
        let k = camera();
        let mut rng = Rng::at(self.seed, 0, 0, 0);
        let mut seen = |point: Vector3<f64>, off_px: Option<[f64; 2]>| {
            let [x, y] = off_px.unwrap_or_else(|| [SIGMA_PX * rng.normal(), SIGMA_PX * rng.normal()]);
            let pixel = [k.fx * point[0] / point[2] + k.cx + x, k.fy * point[1] / point[2] + k.cy + y];
            (pixel, point[2] + ctx.depth_sigma(point[2]) * rng.normal())
        };
        let mut place = Rng::at(self.seed, 1, 0, 0);
        let mut within = |(middle, half): ([f64; 3], [f64; 3])| {
            Vector3::from_fn(|axis, _| middle[axis] + half[axis] * (2.0 * place.uniform() - 1.0))
        };
        let mut points = Vec::new();
        for _ in 0..self.background {
            let point = within(self.around);
            let (pixel, depth_m) = seen(point, None);
            points.push((point, pixel, depth_m));
        }
        for i in 0..ON_REGION {
            let point = within(([0.1, 0.0, 2.0], [0.3, 0.3, 0.1]));
            let mut place = Rng::at(self.seed, 2, i, 0);
            let off = [(); 2].map(|()| self.off_px * (2.0 * place.uniform() - 1.0));
            let (pixel, depth_m) = seen(point + Vector3::from(self.motion_m), (i < self.mismatches).then_some(off));
            points.push((point, pixel, depth_m));
        }
        points
    }

    fn taken(&self) -> (Context, Observation, Vec<Matched>, FrameFilter) {
        let ctx = context(&Config::default());
        let points = self.points(&ctx);
        let n = points.len();
        let pixels: Vec<[f64; 2]> = points.iter().map(|(_, pixel, _)| *pixel).collect();
        let descriptors: Vec<_> = (0..n as u32).map(|i| descriptor(0, i)).collect();
        let grid = KeypointGrid::build(&pixels, &vec![OCTAVE; n], camera().undistorted_bounds(), &ctx.buffers);
        let (octave, depth_m) = (vec![OCTAVE; n].into(), points.iter().map(|(.., depth_m)| *depth_m).collect());
        let obs = Observation { octave, depth_m, grid, ..observation(&pixels, &descriptors) };
        let mut filter = on_background(n);
        let (kind, extent) = (RegionKind::Thing, [0; 4]);
        let region = Region { kind, segment: 1, category: 62, blind: false, cells: 1, extent };
        filter.regions = Regions { list: vec![region].into(), ..Regions::default() };
        for i in self.background as usize..n {
            (filter.class[i], filter.region[i]) = (KeypointClass::Thing, Some(0));
        }
        let matches = points.iter().zip(0..).map(|((point, ..), i)| (i, *point)).collect();
        (ctx, obs, matches, filter)
    }

    fn judged(&self) -> Option<Consensus> {
        let (ctx, obs, matches, filter) = self.taken();
        consensus(&ctx, &obs, &matches, &Se3::identity(), &filter)
    }

    /// How many of so many pictures find that the region disagrees; `None` counts as no.
    fn disagreeing(self, pictures: u64) -> usize {
        let condemns = |seed: &u64| Self { seed: *seed, ..self }.judged().is_some_and(|found| found.disagrees[0]);
        (0..pictures).filter(condemns).count()
    }
}

#[test]
fn a_region_that_stands_as_the_background_does_agrees() {
    assert!(ROOM.judged().is_some(), "the background fixes a pose");
    // The gate leaves one in ten thousand.
    assert_eq!(ROOM.disagreeing(100), 0);
}

#[test]
fn all_keypoints_together_show_a_slow_motion_that_none_of_them_shows() {
    let slow = Picture { motion_m: SLOWLY, ..ROOM };
    let (ctx, obs, matches, _) = slow.taken();
    let fits = |(i, point): &&Matched| ctx.fits(&obs, *i as usize, point);
    let single = matches.iter().skip(slow.background as usize).filter(fits).count();
    assert!(single * 4 >= ON_REGION as usize * 3, "only {single} of {ON_REGION} would pass for still points");
    let found = slow.disagreeing(100);
    assert!(found >= 98, "{found} of 100");
    let aside = Picture { motion_m: [0.08, 0.0, 0.0], ..ROOM }.disagreeing(100);
    assert!(aside >= 98, "{aside} of 100");
}

#[test]
fn the_pose_is_that_of_the_background_however_many_keypoints_move() {
    let few = Picture { background: 20, motion_m: [0.2, 0.0, 0.0], ..ROOM };
    for seed in 0..20 {
        let found = Picture { seed, ..few }.judged().expect("twenty fix a pose");
        let off_m = found.camera_from_world.translation.norm();
        assert!(off_m < 0.06, "picture {seed}: {off_m} m");
    }
}

#[test]
fn a_background_that_fixes_the_pose_poorly_condemns_nothing() {
    // A few points far away in one part of the picture: where the camera stands is anybody's guess.
    let far = Picture { background: 24, around: ([-2.4, -1.6, 6.0], [0.5, 0.5, 0.2]), ..ROOM };
    let aside = [0.08, 0.0, 0.0];
    for motion_m in [[0.0; 3], SLOWLY, aside] {
        let moving = Picture { motion_m, ..far };
        assert!(moving.judged().is_some(), "it is asked all the same");
        assert_eq!(moving.disagreeing(100), 0, "{motion_m:?}");
    }
}

#[test]
fn too_little_background_is_not_asked() {
    let least = Config::default().panoptic.consensus.min_background;
    let moving = Picture { motion_m: SLOWLY, ..ROOM };
    assert!(Picture { background: least - 1, ..moving }.judged().is_none());
    assert!(Picture { background: least + 5, ..moving }.judged().is_some());
}

#[test]
fn mismatches_are_no_motion() {
    // Most are wrong: what is left agrees on nothing.
    assert_eq!(Picture { mismatches: ON_REGION, ..ROOM }.disagreeing(100), 0);
    assert_eq!(Picture { mismatches: ON_REGION * 3 / 5, ..ROOM }.disagreeing(100), 0);
    // Some are wrong: the others stand still, and would show it if they did not.
    assert_eq!(Picture { mismatches: ON_REGION / 4, ..ROOM }.disagreeing(100), 0);
    let moving = Picture { mismatches: ON_REGION / 4, motion_m: [0.0, 0.0, 0.2], ..ROOM }.disagreeing(100);
    assert!(moving >= 98, "{moving} of 100");
}

#[test]
fn a_few_matches_say_nothing_about_a_region() {
    let (ctx, obs, mut matches, filter) = Picture { motion_m: [0.2, 0.0, 0.0], ..ROOM }.taken();
    let least = ctx.config.panoptic.consensus.min_matches as usize;
    let mut disagrees = |own: usize| {
        matches.truncate(ROOM.background as usize + own);
        consensus(&ctx, &obs, &matches, &Se3::identity(), &filter).unwrap().disagrees[0]
    };
    assert!(disagrees(ON_REGION as usize));
    assert!(!disagrees(least - 1));
}

#[test]
fn what_lies_on_ground_is_background_under_any_label() {
    let (ctx, obs, matches, mut filter) = Picture { motion_m: [0.0, 0.0, 0.2], ..ROOM }.taken();
    assert!(consensus(&ctx, &obs, &matches, &Se3::identity(), &filter).unwrap().disagrees[0]);
    let region = ROOM.background as usize..obs.len();
    region.for_each(|i| filter.keypoint_ground[i] = true);
    assert!(!consensus(&ctx, &obs, &matches, &Se3::identity(), &filter).unwrap().disagrees[0], "nobody is asked");
}
