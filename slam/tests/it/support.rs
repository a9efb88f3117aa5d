//! What several tests need: observations made by hand, and frames of synthetic worlds.

use std::sync::Arc;

use fixtures::{Intrinsics, RenderedFrame, World, WorldConfig};
use slam::context::Context;
use slam::observation::Observation;
use slam::panoptic::{Evidence, FrameFilter, Regions};
use slam::report::{KeypointClass, Verdict};
use slam::{
    Category, Config, DepthImage, FrameInput, FrameReport, Inline, PanopticMask, Segment, Sensor, Setup, Slam,
    SlamError, Unobserved,
};
use slam_math::{Buffer, Buffers, FrameId, Rng, Stamp};
use slam_vision::{Camera, Descriptor, Distortion, Features, GrayImage, KeypointGrid, Workspace, gray_from_rgb};

pub const WIDTH: usize = 320;
pub const HEIGHT: usize = 240;

pub fn camera() -> Camera {
    Camera {
        fx: 262.5,
        fy: 262.5,
        cx: 159.5,
        cy: 119.5,
        width: WIDTH as u32,
        height: HEIGHT as u32,
        distortion: Distortion::None,
    }
}

pub fn category(id: u16, name: &str, is_thing: bool) -> Category {
    Category { id, name: name.into(), is_thing }
}

pub fn setup() -> Setup {
    let categories = fixtures::categories().iter().map(|c| category(c.id, c.name, c.is_thing)).collect();
    Setup { camera: camera(), sensor: Sensor::Rgbd, categories }
}

pub fn context(config: &Config) -> Context {
    context_of(config, Sensor::Rgbd)
}

pub fn context_of(config: &Config, sensor: Sensor) -> Context {
    let scales: Vec<f64> = std::iter::successors(Some(1.0), |s| Some(s * 1.2)).take(8).collect();
    Context::new(config, &Setup { sensor, ..setup() }, &scales)
}

/// A descriptor like no other.
pub fn descriptor(object: u32, index: u32) -> Descriptor {
    let mut rng = Rng::at(7, object, 0, index);
    std::array::from_fn(|_| rng.next_u64())
}

/// Keypoints at pixels of level 0, with depth 2 m and these descriptors.
pub fn observation(pixels: &[[f64; 2]], descriptors: &[Descriptor]) -> Observation {
    let n = pixels.len();
    Observation {
        raw_pixel: pixels.to_vec().into(),
        pixel: pixels.to_vec().into(),
        octave: vec![0; n].into(),
        angle: vec![0.0; n].into(),
        descriptor: descriptors.to_vec().into(),
        depth_m: vec![2.0; n].into(),
        label: vec![0; n].into(),
        grid: KeypointGrid::build(pixels, &vec![0; n], camera().undistorted_bounds(), &Buffers::default()),
    }
}

pub fn features(pixels: &[[f32; 2]]) -> Features {
    let n = pixels.len();
    Features {
        pixel: pixels.to_vec().into(),
        octave: vec![0; n].into(),
        angle: vec![0.0; n].into(),
        response: vec![50; n].into(),
        descriptor: (0..n).map(|i| descriptor(0, i as u32)).collect(),
    }
}

/// A frame without depth and mask.
pub fn blank(id: u32, grey: u8) -> FrameInput {
    let gray = GrayImage::new(WIDTH, HEIGHT, grey);
    FrameInput {
        id: FrameId(id),
        stamp: Stamp(i64::from(id) * 33_000_000),
        gray,
        right: None,
        depth: None,
        panoptic: None,
    }
}

/// A frame with so many keypoints, all of them on background, about which nothing else is known.
pub fn on_background(keypoints: usize) -> FrameFilter {
    FrameFilter {
        class: vec![KeypointClass::Stuff; keypoints].into(),
        region: vec![None; keypoints].into(),
        verdict: vec![Verdict::Static; keypoints].into(),
        motion_sigmas: vec![f64::NAN; keypoints].into(),
        regions: Regions::default(),
        tracks: Buffer::default(),
        evidence: Buffer::default(),
        stuff: Evidence::default(),
        ground: Buffer::default(),
        keypoint_ground: vec![false; keypoints].into(),
        memory: Buffer::default(),
        epipolar: None,
        epipolar_px: vec![f64::NAN; keypoints].into(),
        in_free_space: Buffer::default(),
        vouched: Buffer::default(),
        disagrees: Buffer::default(),
    }
}

/// Depth in millimetres.
pub fn depth(units: Vec<u16>) -> Arc<DepthImage> {
    Arc::new(DepthImage { width: WIDTH, height: HEIGHT, units, metres_per_unit: 0.001 })
}

pub fn mask(ids: Vec<u16>, segments: &[(u16, u16)]) -> Arc<PanopticMask> {
    let segments = segments.iter().map(|(id, category)| Segment { id: *id, category: *category, score: 1.0 }).collect();
    Arc::new(PanopticMask { width: WIDTH, height: HEIGHT, ids, segments })
}

/// The furnished room at a quarter of the pixels. The camera's curve has whole cycles a sequence, so a shorter sequence
/// gets a smaller curve.
pub fn room(frame_count: u32) -> WorldConfig {
    let mut world = fixtures::scenario::static_room();
    let share = 2.0 * f64::from(frame_count) / f64::from(world.frame_count);
    let path = &mut world.camera_path;
    path.amplitude_m.iter_mut().chain(&mut path.look_amplitude_m).for_each(|metres| *metres *= share);
    path.sway_m *= share;
    path.sway_rad *= share;
    let camera = Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 159.5, cy_px: 119.5 };
    WorldConfig { camera, texels_per_metre: 160.0, frame_count, ..world }
}

pub fn input_of(frame: &RenderedFrame, id: u32) -> FrameInput {
    let segments: Vec<(u16, u16)> = frame.panoptic.segments.iter().map(|s| (s.id, s.category_id)).collect();
    FrameInput {
        id: FrameId(id),
        stamp: Stamp(frame.stamp_ns),
        gray: gray_from_rgb(&frame.rgb, WIDTH, HEIGHT).unwrap(),
        right: frame.right_rgb.as_ref().map(|rgb| gray_from_rgb(rgb, WIDTH, HEIGHT).unwrap()),
        depth: Some(depth(frame.depth_units.clone())),
        panoptic: Some(mask(frame.panoptic.ids.clone(), &segments)),
    }
}

/// Frames of a world in this order, numbered anew.
pub fn inputs(world: &WorldConfig, frames: impl IntoIterator<Item = u32>) -> Vec<FrameInput> {
    let world = World::new(world).unwrap();
    frames.into_iter().zip(0..).map(|(frame, id)| input_of(&world.frame(frame), id)).collect()
}

pub fn feed(slam: &mut Slam, input: &FrameInput) -> Result<FrameReport, SlamError> {
    let obs = slam.front_end().clone().observe(input, &mut Workspace::default())?;
    slam.step(input, Arc::new(obs), &mut Inline, &mut Unobserved)
}

pub fn run(config: &Config, inputs: &[FrameInput]) -> (Slam, Vec<FrameReport>) {
    let mut slam = Slam::new(config, &setup()).unwrap();
    let reports = inputs.iter().map(|input| feed(&mut slam, input).unwrap()).collect();
    slam.settle(&mut Inline).unwrap();
    (slam, reports)
}
