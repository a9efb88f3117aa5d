//! A log of the synthetic world: what a recording of it would hold.

use fixtures::{Intrinsics, LabelImage, RenderedFrame, World, WorldConfig};
use recorder::picture::encode_rgb8;
use recorder::{Beside, LayerSpec, LogOptions, Mask, RgbdLog, RgbdSpec, WriteError};
use schemas::calibration::{CameraModel, Distortion};
use schemas::msg::{Category, SCORE_UNKNOWN, Segment, format};
use schemas::stereo::StereoModel;
use schemas::{Stamp, topics};
use slam::{DepthImage, FrameInput, PanopticMask, Sensor, Setup};
use slam_math::FrameId;
use slam_vision::{Camera, gray_from_rgb};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Writes the whole sequence: colour as PNG, depth (the right picture instead where the world has a second camera), labels
/// as a network would give them, ground truth from the motion capture system, whose clock and hand-eye transform are known here. `edit` may change a frame before it is written;
/// `progress` hears (frames done, frames in all).
///
/// # Errors
/// The log exists already and `force` is false, or the file system refuses.
pub fn write_log(
    world: &World,
    name: &str,
    path: &Path,
    force: bool,
    edit: &mut dyn FnMut(&mut RenderedFrame),
    progress: &mut dyn FnMut(usize, usize),
) -> Result<u64, WriteError> {
    let options = LogOptions { force, ..LogOptions::default() };
    let mut log = RgbdLog::create(path, &options, &spec(world, name)?)?;
    match write_frames(&mut log, world, edit, progress) {
        Ok(()) => log.finish(),
        Err(error) => {
            log.discard();
            Err(error)
        }
    }
}

fn spec(world: &World, name: &str) -> Result<RgbdSpec, WriteError> {
    let c = world.camera();
    let camera = CameraModel {
        width: c.width,
        height: c.height,
        fx: c.fx_px,
        fy: c.fy_px,
        cx: c.cx_px,
        cy: c.cy_px,
        distortion: Distortion::None,
    };
    let categories = world.categories().iter();
    let categories = categories.map(|c| Category { id: c.id, name: c.name.to_owned(), is_thing: c.is_thing });
    let right_m = world.config().right_camera_m;
    let stereo = (right_m > 0.0).then(|| StereoModel::of_rectified(camera, right_m * c.fx_px)).transpose();
    let stereo = stereo.map_err(|error| WriteError::Invalid(error.to_string()))?;
    Ok(RgbdSpec {
        beside: stereo.map_or(Beside::Depth, Beside::Right),
        depth_units_per_metre: world.config().depth_units_per_metre.to_string(),
        layers: vec![LayerSpec {
            name: topics::DEFAULT_LAYER.to_owned(),
            origin: "rendered, with the errors of a network".to_owned(),
            categories: categories.collect(),
        }],
        ..RgbdSpec::new("synthetic", name, camera)
    })
}

fn write_frames(
    log: &mut RgbdLog,
    world: &World,
    edit: &mut dyn FnMut(&mut RenderedFrame),
    progress: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let mocap = &world.config().mocap_noise;
    let body_from_camera = mocap.body_from_camera();
    let samples = world.mocap();
    let mut poses = samples
        .iter()
        .filter_map(|s| Some((s.stamp_ns - mocap.clock_offset_ns, s.world_from_body? * body_from_camera)))
        .peekable();
    let (width, height) = (world.camera().width, world.camera().height);
    for index in 0..=world.len() {
        let is_frame = index < world.len();
        let until = if is_frame { world.stamp_ns(index) } else { i64::MAX };
        while let Some((stamp, pose)) = poses.next_if(|(stamp, _)| *stamp <= until) {
            log.ground_truth(Stamp(stamp), pose.translation.into(), pose.quaternion_xyzw())?;
        }
        if !is_frame {
            break;
        }
        let mut frame = world.frame(index);
        edit(&mut frame);
        let stamp = Stamp(frame.stamp_ns);
        log.log().flush_if_due(stamp)?;
        let png = |rgb: &[u8]| encode_rgb8(width, height, rgb).map_err(|error| WriteError::Invalid(error.to_string()));
        log.color(stamp, format::PNG, &png(&frame.rgb)?)?;
        match &frame.right_rgb {
            Some(rgb) => log.right(stamp, format::PNG, &png(rgb)?)?,
            None => log.depth(stamp, &frame.depth_units)?,
        }
        log.mask(0, stamp, &mask(&frame.panoptic, width))?;
        progress(index as usize + 1, world.len() as usize);
    }
    Ok(())
}

/// The labels in the log's form.
fn mask(labels: &LabelImage, width: u32) -> Mask {
    let categories: BTreeMap<u16, u16> = labels.segments.iter().map(|s| (s.id, s.category_id)).collect();
    // By segment: left, top, right, bottom, pixels.
    let mut extents: BTreeMap<u16, (u32, u32, u32, u32, u32)> = BTreeMap::new();
    for (row, ids) in labels.ids.chunks(width as usize).enumerate() {
        for (column, id) in ids.iter().enumerate() {
            let (x, y) = (column as u32, row as u32);
            let e = extents.entry(*id).or_insert((x, y, x, y, 0));
            *e = (e.0.min(x), e.1, e.2.max(x), y, e.4 + 1);
        }
    }
    let segments = categories.iter().filter_map(|(id, category_id)| {
        let (left, top, right, bottom, area) = *extents.get(id)?;
        Some(Segment {
            id: *id,
            category_id: *category_id,
            score: SCORE_UNKNOWN,
            x: left,
            y: top,
            width: right - left + 1,
            height: bottom - top + 1,
            area,
            is_crowd: false,
        })
    });
    let segments = segments.collect();
    let class = labels.ids.iter().map(|id| categories.get(id).copied().unwrap_or(0)).collect();
    Mask { class, instance: labels.ids.clone(), segments }
}

/// Ten seconds of the demo's room and cast at 320 x 240, as the slam takes them.
///
/// # Errors
/// Never for this world; a message of the renderer if it refuses.
pub fn small_sequence() -> anyhow::Result<(Vec<FrameInput>, Setup)> {
    let camera = Intrinsics { width: 320, height: 240, fx_px: 262.5, fy_px: 262.5, cx_px: 159.5, cy_px: 119.5 };
    let world = WorldConfig { camera, texels_per_metre: 160.0, frame_count: 300, ..fixtures::scenario::demo() };
    let world = World::new(&world)?;
    let (width, height) = (camera.width as usize, camera.height as usize);
    let input = |index| {
        let RenderedFrame { stamp_ns, rgb, depth_units, panoptic, .. } = world.frame(index);
        let metres_per_unit = 1.0 / world.config().depth_units_per_metre;
        let segments = panoptic.segments.iter();
        let segments = segments.map(|s| slam::Segment { id: s.id, category: s.category_id, score: 1.0 }).collect();
        Ok(FrameInput {
            id: FrameId(index),
            stamp: slam_math::Stamp(stamp_ns),
            gray: gray_from_rgb(&rgb, width, height)?,
            right: None,
            depth: Some(Arc::new(DepthImage { width, height, units: depth_units, metres_per_unit })),
            panoptic: Some(Arc::new(PanopticMask { width, height, ids: panoptic.ids, segments })),
        })
    };
    let categories = world.categories().iter();
    let categories = categories.map(|c| slam::Category { id: c.id, name: c.name.into(), is_thing: c.is_thing });
    let Intrinsics { width, height, fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy } = camera;
    let camera = Camera { fx, fy, cx, cy, width, height, distortion: slam_vision::Distortion::None };
    let setup = Setup { camera, sensor: Sensor::Rgbd, categories: categories.collect() };
    Ok(((0..world.len()).map(input).collect::<anyhow::Result<_>>()?, setup))
}
