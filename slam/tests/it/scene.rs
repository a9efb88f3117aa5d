//! Little scenes: a textured wall, boxes in front of it, a camera that looks along z and may shift. Depth, labels and
//! keypoints are exact.

use std::sync::Arc;

use nalgebra::Vector3;
use slam::context::Context;
use slam::observation::Observation;
use slam::panoptic::{FrameFilter, PanopticFilter, Tracked};
use slam::report::{RegionState, Verdict};
use slam::{Config, FrameInput, Sensor};
use slam_math::{Buffers, Se3};
use slam_vision::Features;

use crate::support::{HEIGHT, WIDTH, blank, camera, context, context_of, depth, descriptor, mask};

pub const PERSON: u16 = 1;
pub const SUITCASE: u16 = 33;
pub const CHAIR: u16 = 62;
pub const SHELF: u16 = 156;
pub const WALL: u16 = 199;

/// Distance of the wall, metres.
const WALL_M: f64 = 3.0;

/// An upright board facing the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    /// Which object: its keypoints look the same wherever it is.
    pub object: u32,
    /// Middle in the world, metres.
    pub centre: [f64; 3],
    /// Half width and half height, metres.
    pub half: [f64; 2],
    /// Segment id and category; `None` is claimed by no segment.
    pub label: Option<(u16, u16)>,
}

impl Board {
    /// 0.8 m wide and high, 2 m in front of the world's origin.
    pub fn new(object: u32, label: Option<(u16, u16)>) -> Self {
        Self { object, centre: [0.0, 0.0, 2.0], half: [0.4, 0.4], label }
    }

    pub fn at(self, centre: [f64; 3]) -> Self {
        Self { centre, ..self }
    }

    /// Keypoints in the world: a lattice of 8 x 8.
    fn points(&self) -> impl Iterator<Item = Vector3<f64>> {
        let (c, h) = (self.centre, self.half);
        (0..64).map(move |i| {
            let share = |k: i32| (f64::from(k) - 3.5) / 4.2;
            Vector3::new(c[0] + share(i % 8) * h[0], c[1] + share(i / 8) * h[1], c[2])
        })
    }
}

/// What the camera films, and the filter that watches.
pub struct Film {
    pub ctx: Context,
    filter: PanopticFilter,
    next: u32,
    /// Camera centre in the world.
    pub camera_m: [f64; 3],
    /// Without masks everything is background.
    pub with_mask: bool,
    /// An object whose surface the depth sensor does not see.
    pub unmeasured: Option<u32>,
}

/// What tracking tells the filter about a frame beyond the pose.
#[derive(Debug, Clone, Copy, Default)]
pub struct Told {
    /// So many keypoints on no region are matched with a map point ...
    pub matched_on_background: usize,
    /// ... and so many on regions.
    pub matched_on_regions: usize,
    /// So many keypoints on regions are vouched for.
    pub vouched: usize,
    /// Whether all regions disagree with the background.
    pub disagrees: bool,
}

/// One frame and what the filter said.
pub struct Shown {
    pub obs: Arc<Observation>,
    pub filter: FrameFilter,
}

impl Film {
    pub fn new(config: &Config) -> Self {
        let filter = PanopticFilter::default();
        Self { ctx: context(config), filter, next: 0, camera_m: [0.0; 3], with_mask: true, unmeasured: None }
    }

    /// A film by a camera without depth.
    pub fn monocular(config: &Config) -> Self {
        Self { ctx: context_of(config, Sensor::Monocular), ..Self::new(config) }
    }

    pub fn pose(&self) -> Se3 {
        Se3 { translation: -Vector3::from(self.camera_m), ..Se3::identity() }
    }

    /// Films the boards before the wall; the camera's pose is known, and no map.
    pub fn show(&mut self, boards: &[Board]) -> Shown {
        self.show_told(boards, Told::default())
    }

    /// The same with what tracking knows by the map.
    pub fn show_told(&mut self, boards: &[Board], told: Told) -> Shown {
        let input = self.input(boards);
        let obs = Arc::new(Observation::new(
            self.keypoints(boards),
            &input,
            &camera(),
            &self.ctx.config.sensor,
            &Buffers::default(),
        ));
        let pose = self.pose();
        let mut filter = self.filter.label(&self.ctx, &input, &obs);
        let first = |n: usize, on_region: bool| {
            let mut left = n;
            let mut take = |region: &Option<usize>| {
                let takes = left > 0 && region.is_some() == on_region;
                left -= usize::from(takes);
                takes
            };
            let taken: Vec<bool> = filter.region.iter().map(&mut take).collect();
            assert_eq!(left, 0, "there are not that many keypoints");
            taken
        };
        let on_background = first(told.matched_on_background, false);
        let mut matched = first(told.matched_on_regions, true);
        matched.iter_mut().zip(on_background).for_each(|(matched, also)| *matched |= also);
        let (vouched, disagrees) = (first(told.vouched, true), vec![told.disagrees; filter.tracks.len()]);
        let tracked = Tracked {
            camera_from_world: &pose,
            position_sigma_m: 0.0,
            rotation_sigma_rad: 0.0,
            scene_depth: Some(WALL_M),
            matched: &matched,
            vouched: &vouched,
            disagrees: &disagrees,
        };
        self.filter.judge(&self.ctx, &input, &obs, &tracked, &mut filter);
        self.filter.remember(&self.ctx, &input, &obs, Some(&pose), &filter);
        self.next += 1;
        Shown { obs, filter }
    }

    pub fn show_for(&mut self, frames: u32, boards: &[Board]) -> Shown {
        (1..frames).for_each(|_| drop(self.show(boards)));
        self.show(boards)
    }

    /// What a pixel sees: depth in metres and the index of the board.
    fn look(&self, boards: &[Board], pixel: [f64; 2]) -> (f64, Option<usize>) {
        let k = camera();
        let ray = [(pixel[0] - k.cx) / k.fx, (pixel[1] - k.cy) / k.fy];
        let hit = |board: &Board| {
            let z = board.centre[2] - self.camera_m[2];
            let inside = (0..2).all(|i| (self.camera_m[i] + ray[i] * z - board.centre[i]).abs() <= board.half[i]);
            (z > 0.0 && inside).then_some(z)
        };
        let hits = boards.iter().enumerate().filter_map(|(i, board)| hit(board).map(|z| (z, Some(i))));
        hits.fold((WALL_M - self.camera_m[2], None), |nearest, hit| if hit.0 < nearest.0 { hit } else { nearest })
    }

    fn input(&self, boards: &[Board]) -> FrameInput {
        let (mut units, mut ids) = (Vec::new(), Vec::new());
        for i in 0..WIDTH * HEIGHT {
            let (z, board) = self.look(boards, [(i % WIDTH) as f64, (i / WIDTH) as f64]);
            let measured = board.is_none_or(|b| self.unmeasured != Some(boards[b].object));
            units.push(if measured { (z * 1000.0 + 0.5) as u16 } else { 0 });
            ids.push(board.map_or(100, |b| boards[b].label.map_or(0, |(id, _)| id)));
        }
        let mut segments: Vec<(u16, u16)> = boards.iter().filter_map(|b| b.label).collect();
        segments.push((100, WALL));
        segments.sort_unstable();
        segments.dedup();
        let panoptic = self.with_mask.then(|| mask(ids, &segments));
        let depth = (self.ctx.sensor == Sensor::Rgbd).then(|| depth(units));
        FrameInput { depth, panoptic, ..blank(self.next, 0) }
    }

    fn keypoints(&self, boards: &[Board]) -> Features {
        let on_wall = (0..30 * 22).map(|i| {
            let lattice = [f64::from(i % 30) - 14.5, f64::from(i / 30) - 10.5];
            (0, i as u32, Vector3::new(lattice[0] * 0.14, lattice[1] * 0.14, WALL_M))
        });
        let on_board = |b: &Board| {
            let object = b.object;
            b.points().zip(0..).map(move |(p, i)| (object, i, p)).collect::<Vec<_>>()
        };
        let mut features = Features::default();
        for (object, index, point) in on_wall.chain(boards.iter().flat_map(on_board)) {
            let in_camera = self.pose().transform(&point);
            let Some(pixel) = camera().project(in_camera) else { continue };
            let visible = (self.look(boards, pixel).0 - in_camera[2]).abs() < 1e-6;
            if visible && pixel[0] >= 0.0 && pixel[1] >= 0.0 && pixel[0] < 319.0 && pixel[1] < 239.0 {
                features.pixel.push(pixel.map(|v| v as f32));
                features.octave.push(0);
                features.angle.push(0.0);
                features.response.push(50);
                features.descriptor.push(descriptor(object, index));
            }
        }
        features
    }
}

impl Shown {
    /// States of all regions, in their order.
    pub fn states(&self) -> Vec<RegionState> {
        self.filter.tracks.iter().map(|t| t.state).collect()
    }

    /// Verdicts of keypoints inside a rectangle `[x0, y0, x1, y1]` of pixels, each once.
    pub fn verdicts(&self, rectangle: [f64; 4]) -> Vec<Verdict> {
        let [x0, y0, x1, y1] = rectangle;
        let inside = |p: &[f64; 2]| p[0] >= x0 && p[1] >= y0 && p[0] <= x1 && p[1] <= y1;
        let pairs = self.obs.raw_pixel.iter().zip(&self.filter.verdict);
        let mut verdicts: Vec<Verdict> = pairs.filter(|(p, _)| inside(p)).map(|(_, v)| *v).collect();
        verdicts.sort_by_key(|v| *v as u8);
        verdicts.dedup();
        verdicts
    }

    /// Verdicts of the keypoints well inside a board of half size 0.4 m at 2 m, seen from the origin.
    pub fn in_the_middle(&self) -> Vec<Verdict> {
        self.verdicts([130.0, 90.0, 190.0, 150.0])
    }

    /// Verdicts at the left rim of the picture.
    pub fn at_the_rim(&self) -> Vec<Verdict> {
        self.verdicts([0.0, 0.0, 60.0, 240.0])
    }
}
