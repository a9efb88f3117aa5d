//! What stands in space: the camera, the map, its graph, and the way so far.

use std::collections::BTreeMap;

use rrd::{
    At, Clear, Lines3d, Pinhole, Points3d, Radius, Rgba, Rotation, RrdError, RrdWriter, Transform, ViewCoordinates,
};
use slam::map::{KeyFrame, Map, MapPoint};
use slam::report::{FrameReport, KeypointClass};
use slam_math::{KeyFrameId, MapId, Se3};
use slam_vision::Camera;

use super::style::{self, PointState};

/// Distance at which the camera's picture floats before it, metres.
const PICTURE_DISTANCE_M: f32 = 0.35;
/// Length of a keyframe's pyramid, metres.
const KEYFRAME_SIZE_M: f64 = 0.06;
/// Frames a piece of the trajectory. A frame logs its piece anew, so short pieces keep the file linear in its length.
const PIECE_FRAMES: usize = 64;
/// Observations from which a point counts as settled, one with depth counting twice.
const SETTLED_WEIGHT: u32 = 8;

/// Axes of the world: the first camera's.
pub fn log_static(file: &mut RrdWriter) -> Result<(), RrdError> {
    file.log("/world", At::Static, &ViewCoordinates::RightDownForward)
}

/// What has been drawn so far.
#[derive(Default)]
pub struct World {
    tracked: Option<bool>,
    map: Option<MapId>,
    /// Camera centres of the current piece of the trajectory.
    piece: Vec<[f32; 3]>,
    pieces: usize,
    /// [`Map::corrections`] of the last frame.
    corrections: u32,
    /// Where keyframes were drawn last.
    keyframes: BTreeMap<KeyFrameId, [f32; 3]>,
    /// Whether lines of a correction stand there.
    shows_correction: bool,
}

impl World {
    /// Logs one frame.
    pub fn log(
        &mut self,
        file: &mut RrdWriter,
        at: At,
        report: &FrameReport,
        map: &Map,
        camera: &Camera,
    ) -> Result<(), RrdError> {
        let new_map = self.map != Some(report.map);
        if new_map {
            // Maps have no common frame: the way through the last one means nothing in this one.
            self.map = Some(report.map);
            self.end_piece();
            file.log("/world/trajectory/estimated", at, &Clear { recursive: true })?;
        }
        self.log_camera(file, at, report, camera)?;
        self.log_path(file, at, report.camera_from_world.as_ref())?;
        log_tracked(file, at, report, map)?;
        let counts = &report.counts;
        let edits = counts.points_created + counts.points_culled + counts.points_fused + counts.ba_outliers;
        let corrected = std::mem::replace(&mut self.corrections, map.corrections()) != map.corrections();
        if report.new_keyframe.is_some() || edits > 0 || new_map || corrected || self.shows_correction {
            log_points(file, at, report.map, map)?;
            log_keyframes(file, at, report.map, map, camera)?;
            self.log_correction(file, at, report.map, map, corrected)?;
        }
        Ok(())
    }

    /// Lines from where keyframes were to where a correction put them, for one frame.
    fn log_correction(
        &mut self,
        file: &mut RrdWriter,
        at: At,
        active: MapId,
        map: &Map,
        corrected: bool,
    ) -> Result<(), RrdError> {
        let keyframes = map.keyframes().filter(|k| k.map == active);
        let now: BTreeMap<KeyFrameId, [f32; 3]> = keyframes.map(|k| (k.id, point(&k.center()))).collect();
        let before = std::mem::replace(&mut self.keyframes, now);
        if corrected || self.shows_correction {
            let moved = self.keyframes.iter().filter(|_| corrected);
            let moved =
                moved.filter_map(|(id, to)| before.get(id).filter(|from| *from != to).map(|from| vec![*from, *to]));
            let strips: Vec<_> = moved.collect();
            let lines = Lines3d { strips: &strips, colors: &[style::ORANGE], radii: &[Radius::Ui(1.5)] };
            file.log("/world/corrections", at, &lines)?;
        }
        self.shows_correction = corrected;
        Ok(())
    }

    /// The frustum stays where the camera was last seen while the track is lost, in red.
    fn log_camera(
        &mut self,
        file: &mut RrdWriter,
        at: At,
        report: &FrameReport,
        camera: &Camera,
    ) -> Result<(), RrdError> {
        let tracked = report.camera_from_world.is_some();
        if self.tracked != Some(tracked) {
            self.tracked = Some(tracked);
            let pinhole = Pinhole {
                fx: camera.fx,
                fy: camera.fy,
                // The slam counts from the centre of the first pixel, the viewer from its corner.
                cx: camera.cx + 0.5,
                cy: camera.cy + 0.5,
                width: camera.width,
                height: camera.height,
                image_plane_distance: PICTURE_DISTANCE_M,
                color: Some(if tracked { style::GREEN } else { [255, 40, 40, 255] }),
            };
            file.log("/world/camera", at, &pinhole)?;
        }
        let Some(camera_from_world) = &report.camera_from_world else { return Ok(()) };
        file.log("/world/camera", at, &transform(&camera_from_world.inverse()))
    }

    /// Adds the camera's centre to the line; a lost frame ends the piece, so that the gap shows.
    fn log_path(&mut self, file: &mut RrdWriter, at: At, camera_from_world: Option<&Se3>) -> Result<(), RrdError> {
        let Some(camera_from_world) = camera_from_world else {
            self.end_piece();
            return Ok(());
        };
        let center = point(&camera_from_world.inverse().translation);
        if self.piece.len() == PIECE_FRAMES {
            // The next piece begins where this one ends.
            self.piece.drain(..PIECE_FRAMES - 1);
            self.pieces += 1;
        }
        self.piece.push(center);
        let entity = format!("/world/trajectory/estimated/{:04}", self.pieces);
        let strips = [self.piece.clone()];
        file.log(&entity, at, &Lines3d { strips: &strips, colors: &[style::BLUE], radii: &[Radius::Ui(2.0)] })
    }

    fn end_piece(&mut self) {
        self.pieces += usize::from(!self.piece.is_empty());
        self.piece.clear();
    }
}

/// `world_from_entity` as the viewer takes it.
pub fn transform(world_from_entity: &Se3) -> Transform {
    let t = &world_from_entity.translation;
    Transform { translation: [t.x, t.y, t.z], rotation: Rotation::Quaternion(world_from_entity.quaternion_xyzw()) }
}

/// A point as the viewer stores it.
pub fn point(position: &nalgebra::Vector3<f64>) -> [f32; 3] {
    [position.x as f32, position.y as f32, position.z as f32]
}

/// Map points seen in this frame.
fn log_tracked(file: &mut RrdWriter, at: At, report: &FrameReport, map: &Map) -> Result<(), RrdError> {
    let seen = report.keypoints.iter().filter_map(|keypoint| keypoint.point);
    let current = seen.filter_map(|id| map.current_point(id)).filter_map(|id| map.point(id));
    let positions: Vec<[f32; 3]> = current.map(|p| point(&p.position)).collect();
    let points =
        Points3d { positions: &positions, colors: &[style::GREEN], radii: &[Radius::Ui(2.5)], ..Points3d::default() };
    file.log("/world/map/tracked", at, &points)
}

fn state(point: &MapPoint) -> PointState {
    if point.doubts > 0 {
        PointState::Doubted
    } else if point.weight() < SETTLED_WEIGHT {
        PointState::Young
    } else {
        match point.class {
            KeypointClass::Thing => PointState::OnThing,
            KeypointClass::Unknown => PointState::OnUnknown,
            KeypointClass::Stuff | KeypointClass::Person => PointState::Settled,
        }
    }
}

/// All points of the active map.
fn log_points(file: &mut RrdWriter, at: At, active: MapId, map: &Map) -> Result<(), RrdError> {
    let points: Vec<&MapPoint> = map.points().filter(|p| p.map == active).collect();
    let positions: Vec<[f32; 3]> = points.iter().map(|p| point(&p.position)).collect();
    let class_ids: Vec<u16> = points.iter().map(|p| state(p) as u16).collect();
    let points =
        Points3d { positions: &positions, class_ids: &class_ids, radii: &[Radius::Ui(1.8)], ..Points3d::default() };
    file.log("/world/map/points", at, &points)
}

/// Keyframes as small pyramids, and a line between each two that share points: the stronger, the more opaque.
fn log_keyframes(file: &mut RrdWriter, at: At, active: MapId, map: &Map, camera: &Camera) -> Result<(), RrdError> {
    let keyframes: Vec<&KeyFrame> = map.keyframes().filter(|k| k.map == active).collect();
    let pyramids: Vec<Vec<[f32; 3]>> = keyframes.iter().map(|k| pyramid(k, camera)).collect();
    let pyramids = Lines3d { strips: &pyramids, colors: &[[120, 170, 255, 220]], radii: &[Radius::Ui(0.8)] };
    file.log("/world/keyframes", at, &pyramids)?;

    let mut edges = Vec::new();
    let mut colors: Vec<Rgba> = Vec::new();
    let mut loops = Vec::new();
    for keyframe in keyframes {
        for other in keyframe.loops.iter().filter(|other| **other > keyframe.id).filter_map(|id| map.keyframe(*id)) {
            loops.push(vec![point(&keyframe.center()), point(&other.center())]);
        }
        for &(other, shared) in &keyframe.covisible {
            // Each edge is known to both ends: draw it from the older one.
            let Some(other) = map.keyframe(other).filter(|other| other.id > keyframe.id) else { continue };
            edges.push(vec![point(&keyframe.center()), point(&other.center())]);
            colors.push([90, 220, 200, (30 + shared / 2).min(220) as u8]);
        }
    }
    file.log("/world/loops", at, &Lines3d { strips: &loops, colors: &[style::LOOP], radii: &[Radius::Ui(2.5)] })?;
    file.log("/world/covisibility", at, &Lines3d { strips: &edges, colors: &colors, radii: &[Radius::Ui(0.6)] })
}

/// A pyramid from the camera's centre to the corners of its picture, in one stroke.
fn pyramid(keyframe: &KeyFrame, camera: &Camera) -> Vec<[f32; 3]> {
    let world_from_camera = keyframe.camera_from_world.inverse();
    let corner = |x: f64, y: f64| {
        let ray = nalgebra::Vector3::new((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1.0);
        point(&world_from_camera.transform(&(ray * KEYFRAME_SIZE_M)))
    };
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let (apex, a, b, c, d) =
        (point(&world_from_camera.translation), corner(0.0, 0.0), corner(w, 0.0), corner(w, h), corner(0.0, h));
    vec![a, b, c, d, a, apex, b, c, apex, d]
}
