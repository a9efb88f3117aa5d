//! Bundle adjustment of a whole map, or of the seam of two.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use slam_math::{KeyFrameId, MapId, MapPointId, Sim3};
use slam_optimize::{BaObservation, BaOptions, BaPose, BaProblem, global_bundle_adjust};

use super::seam::correction;
use crate::context::Context;
use crate::map::{Map, MapEdit};

/// Adjusts all keyframes and points of a part of the atlas, its root held. One edit, or none when there is nothing to
/// adjust or nothing sensible comes out.
#[must_use]
pub fn global_adjustment(ctx: &Context, map: &Map, part: MapId) -> Option<MapEdit> {
    let keyframes: Vec<KeyFrameId> = map.keyframes().filter(|k| k.map == part).map(|k| k.id).collect();
    let points: Vec<MapPointId> = map.points().filter(|p| p.map == part).map(|p| p.id).collect();
    let adjusted =
        Adjustment::new(ctx, map, keyframes, |id| map.keyframe(id).is_some_and(|k| k.parent.is_none()), points);
    let (poses, positions) = adjusted.solve(ctx.config.looping.global_iterations)?;
    Some(MapEdit::Correct(Box::new(correction(map, &poses, &positions))))
}

/// Poses and points to be adjusted.
pub(super) struct Adjustment {
    keyframes: Vec<KeyFrameId>,
    points: Vec<MapPointId>,
    problem: BaProblem,
}

impl Adjustment {
    /// Sorted keyframes with what they see of sorted points.
    pub fn new(
        ctx: &Context,
        map: &Map,
        keyframes: Vec<KeyFrameId>,
        fixed: impl Fn(KeyFrameId) -> bool,
        points: Vec<MapPointId>,
    ) -> Self {
        let mut observations = Vec::new();
        let positions = points.iter().filter_map(|id| map.point(*id)).zip(0..).map(|(point, number)| {
            for sighting in &point.seen_in {
                let Ok(pose) = keyframes.binary_search(&sighting.keyframe) else { continue };
                let Some(keyframe) = map.keyframe(sighting.keyframe) else { continue };
                let measurement = ctx.measurement(&keyframe.obs, sighting.index as usize);
                observations.push(BaObservation { pose: pose as u32, point: number, measurement });
            }
            point.position
        });
        let positions: Vec<Vector3<f64>> = positions.collect();
        let poses = keyframes.iter().filter_map(|id| map.keyframe(*id));
        let poses = poses.map(|k| BaPose { camera_from_world: k.camera_from_world, fixed: fixed(k.id) }).collect();
        let problem = BaProblem {
            camera: ctx.pinhole,
            bf: ctx.bf,
            poses,
            points: positions.into(),
            observations: observations.into(),
        };
        Self { keyframes, points, problem }
    }

    /// Where everything is after the adjustment; `None` when there is nothing to adjust, or when a number is not finite.
    #[expect(clippy::type_complexity, reason = "poses and positions")]
    pub fn solve(
        mut self,
        iterations: u32,
    ) -> Option<(BTreeMap<KeyFrameId, Sim3>, BTreeMap<MapPointId, Vector3<f64>>)> {
        let problem = &mut self.problem;
        if iterations == 0 || problem.observations.is_empty() || problem.poses.iter().all(|p| p.fixed) {
            return None;
        }
        let options = BaOptions { iterations, ..BaOptions::default() };
        // A keyframe that nothing ties to the others stays where it is.
        while let Err(loose) = global_bundle_adjust(problem, &options) {
            problem.poses[loose.pose].fixed = true;
        }
        let finite = problem.poses.iter().all(|p| p.camera_from_world.is_finite())
            && problem.points.iter().all(|p| p.iter().all(|v| v.is_finite()));
        let poses = problem.poses.iter().map(|p| Sim3::from(p.camera_from_world));
        let poses = self.keyframes.iter().copied().zip(poses).collect();
        finite.then(|| (poses, self.points.into_iter().zip(self.problem.points.iter().copied()).collect()))
    }
}
