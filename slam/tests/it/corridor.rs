//! A long walk round a building, as geometry: landmarks on the walls of a corridor that comes back to its start, and what
//! a depth camera with a systematic error says about them.

use std::f64::consts::FRAC_PI_2;
use std::ops::Range;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use slam::observation::Observation;
use slam::report::StageRecord;
use slam::{Config, Executor, FrameInput, Inline, PanopticMask, Sensor, Setup, Slam, Unobserved};
use slam_math::{Buffers, Rng, Se3, float};
use slam_vision::{Descriptor, KeypointGrid, Vocabulary};

use crate::scene::WALL;
use crate::support::{HEIGHT, WIDTH, blank, camera, descriptor, mask, setup};

/// Sides of the rectangle on which the corridor's middle runs, and the radius of its corners, metres: 60 m round.
const SIDES_M: [f64; 2] = [15.716, 8.0];
const CORNER_M: f64 = 2.0;
/// Length of one round, metres.
pub const ROUND_M: f64 = 60.0;
/// Between landmarks, and how far they are seen, metres.
const SPACING_M: f64 = 0.008;
const SIGHT_M: f64 = 5.0;
/// Keypoints of a picture at most.
const KEYPOINTS: usize = 450;

/// Where the companion is in the picture: left, top, right, bottom, pixels.
const COMPANION: [f64; 4] = [100.0, 30.0, 220.0, 210.0];

/// What is wrong with the sensor.
#[derive(Debug, Clone, Copy)]
pub struct Errors {
    /// Standard deviation of a keypoint, pixels.
    pub pixel_px: f64,
    /// Standard deviation of a depth, share of the depth.
    pub depth_share: f64,
    /// Bits of 256 that differ each time a descriptor is seen.
    pub bits: usize,
}

/// Pose of the corridor's middle after a way of `s` metres: position, and heading from the x axis towards y.
fn middle(s: f64) -> ([f64; 2], f64) {
    let arc = CORNER_M * FRAC_PI_2;
    let (mut at, mut heading, mut left) = ([0.0, 0.0], 0.0, s - (s / ROUND_M).floor() * ROUND_M);
    for side in [SIDES_M[0], SIDES_M[1], SIDES_M[0], SIDES_M[1]] {
        let straight = if left < side { left } else { side };
        at = [at[0] + straight * float::cos(heading), at[1] + straight * float::sin(heading)];
        left -= straight;
        let turn = if left < arc { left } else { arc } / CORNER_M;
        let (from, to) = (heading, heading + turn);
        at[0] += CORNER_M * (float::sin(to) - float::sin(from));
        at[1] += CORNER_M * (float::cos(from) - float::cos(to));
        (heading, left) = (to, left - turn * CORNER_M);
    }
    (at, heading)
}

/// True pose of the camera after a way of `s` metres: it looks ahead, a little to the side.
pub fn world_from_camera(s: f64) -> Se3 {
    let (at, heading) = middle(s);
    let gaze = heading + 0.12 * float::sin(s);
    let (sin, cos) = (float::sin(gaze), float::cos(gaze));
    // Columns: the camera's x to the right, y down, z ahead.
    let rotation = Matrix3::new(sin, 0.0, cos, -cos, 0.0, sin, 0.0, -1.0, 0.0);
    Se3 { rotation, translation: Vector3::new(at[0], at[1], 0.05 * float::sin(1.7 * s)) }
}

/// Landmarks with the way at which they stand.
pub struct Corridor {
    landmarks: Vec<(f64, Vector3<f64>)>,
    errors: Errors,
    /// Somebody who walks ahead of the camera and always looks the same, while the way is in one of these ranges, and the
    /// category that the segmentation gives to them.
    pub companion: Option<(Vec<Range<f64>>, u16)>,
    /// Where depth comes from: a camera that gives it, or nowhere.
    pub sensor: Sensor,
    /// Places are found by its words.
    pub vocabulary: Option<Arc<Vocabulary>>,
}

impl Corridor {
    pub fn new(errors: Errors) -> Self {
        let count = (ROUND_M / SPACING_M) as u32;
        let landmark = |i: u32| {
            let mut rng = Rng::at(11, i, 0, 0);
            let s = f64::from(i) * SPACING_M;
            let ([x, y], heading) = middle(s);
            let side = if i.is_multiple_of(2) { 1.4 } else { -1.4 } * (0.8 + 0.2 * rng.uniform());
            let (nx, ny) = (-float::sin(heading), float::cos(heading));
            (s, Vector3::new(x + side * nx, y + side * ny, 2.4 * rng.uniform() - 1.2))
        };
        Self {
            landmarks: (0..count).map(landmark).collect(),
            errors,
            companion: None,
            sensor: Sensor::Rgbd,
            vocabulary: None,
        }
    }

    /// What the camera sees after a way of `s` metres, as frame `id`.
    pub fn observe(&self, id: u32, s: f64) -> Observation {
        let camera_from_world = world_from_camera(s).inverse();
        let bounds = camera().undistorted_bounds();
        let (mut pixels, mut octaves, mut depths, mut descriptors) = (vec![], vec![], vec![], vec![]);
        let mut labels = vec![];
        let hidden = |[u, v]: [f64; 2]| {
            self.company(s).is_some()
                && (COMPANION[0]..COMPANION[2]).contains(&u)
                && (COMPANION[1]..COMPANION[3]).contains(&v)
        };
        for i in (0..if self.company(s).is_some() { 160 } else { 0 }).map(f64::from) {
            let [column, row] = [(i / 16.0).floor(), i - (i / 16.0).floor() * 16.0];
            pixels.push([COMPANION[0] + 6.0 + 11.0 * column, COMPANION[1] + 5.0 + 11.0 * row]);
            octaves.push(4);
            depths.push(1.5);
            descriptors.push(descriptor(30, i as u32));
            labels.push(1);
        }
        for (index, (way, point)) in (0u32..).zip(&self.landmarks) {
            let ahead = way - s;
            let ahead = ahead - (ahead / ROUND_M).floor() * ROUND_M;
            let p = camera_from_world.transform(point);
            if ahead > SIGHT_M || !(0.4..SIGHT_M).contains(&p[2]) || pixels.len() >= KEYPOINTS {
                continue;
            }
            let mut rng = Rng::at(12, id, 0, index);
            let Some([u, v]) = camera().project(p) else { continue };
            let pixel = [u + rng.normal() * self.errors.pixel_px, v + rng.normal() * self.errors.pixel_px];
            if hidden(pixel) || pixel[0] < 4.0 || pixel[1] < 4.0 || pixel[0] > 315.0 || pixel[1] > 235.0 {
                continue;
            }
            pixels.push(pixel);
            labels.push(100);
            octaves.push((float::ln(SIGHT_M / p[2]) / float::ln(1.2)).clamp(0.0, 7.0) as u8);
            depths.push(p[2] * (1.0 + rng.normal() * self.errors.depth_share));
            descriptors.push(blurred(descriptor(20, index), &mut rng, self.errors.bits));
        }
        let n = pixels.len();
        if self.sensor == Sensor::Monocular {
            depths.fill(0.0);
        }
        Observation {
            raw_pixel: pixels.clone().into(),
            grid: KeypointGrid::build(&pixels, &octaves, bounds, &Buffers::default()),
            pixel: pixels.into(),
            octave: octaves.into(),
            angle: vec![0.0; n].into(),
            descriptor: descriptors.into(),
            depth_m: depths.into(),
            label: labels.into(),
        }
    }

    /// The category of the companion while they are there.
    fn company(&self, s: f64) -> Option<u16> {
        let (ranges, category) = self.companion.as_ref()?;
        ranges.iter().any(|range| range.contains(&s)).then_some(*category)
    }

    /// The frame without its features: the segmentation alone.
    fn input(&self, id: u32, s: f64) -> FrameInput {
        let Some(category) = self.company(s) else { return FrameInput { panoptic: Some(wall()), ..blank(id, 0) } };
        let inside = |i: usize| {
            let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
            (COMPANION[0]..COMPANION[2]).contains(&x) && (COMPANION[1]..COMPANION[3]).contains(&y)
        };
        let ids = (0..WIDTH * HEIGHT).map(|i| if inside(i) { 1 } else { 100 }).collect();
        FrameInput { panoptic: Some(mask(ids, &[(1, category), (100, WALL)])), ..blank(id, 0) }
    }

    /// Walks these ways, a frame each.
    pub fn walk(&self, config: &Config, ways: impl IntoIterator<Item = f64>) -> Walk {
        self.walk_with(config, ways, &mut Inline)
    }

    /// The same with another executor of jobs.
    pub fn walk_with(&self, config: &Config, ways: impl IntoIterator<Item = f64>, executor: &mut dyn Executor) -> Walk {
        let slam = Slam::new(config, &Setup { sensor: self.sensor, ..setup() }).unwrap();
        let slam = slam.with_vocabulary(self.vocabulary.clone());
        let mut walk = Walk { slam, truth: Vec::new(), events: Vec::new(), records: Vec::new() };
        for (id, s) in (0..).zip(ways) {
            let (input, obs) = (self.input(id, s), Arc::new(self.observe(id, s)));
            let report = walk.slam.step(&input, obs, executor, &mut Unobserved).unwrap();
            walk.events.extend(report.events.into_iter().map(|e| format!("frame {id}: {}", e.text)));
            walk.truth.push(world_from_camera(s));
            walk.records.push(report.records.to_vec());
        }
        walk.slam.settle(executor).unwrap();
        walk
    }
}

/// What came out of a walk.
pub struct Walk {
    pub slam: Slam,
    /// `world_from_camera` of each frame.
    pub truth: Vec<Se3>,
    pub events: Vec<String>,
    /// Digests of each frame.
    pub records: Vec<Vec<StageRecord>>,
}

fn wall() -> Arc<PanopticMask> {
    mask(vec![100; WIDTH * HEIGHT], &[(100, WALL)])
}

fn blurred(mut descriptor: Descriptor, rng: &mut Rng, bits: usize) -> Descriptor {
    for _ in 0..bits {
        let bit = rng.below(256);
        descriptor[bit / 64] ^= 1 << (bit % 64);
    }
    descriptor
}
