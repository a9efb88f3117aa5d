//! Bundle adjustment of a whole map, or of the seam of two.

use std::collections::BTreeMap;

use nalgebra::Vector3;
use slam_math::{KeyFrameId, MapId, MapPointId, Sim3};
use slam_optimize::{BaObservation, BaOptions, BaPose, BaProblem, BaReport, global_bundle_adjust};

use super::seam::correction;
use crate::context::Context;
use crate::map::{Map, MapEdit, MapPoint};

/// Adjusts all keyframes and points of a part of the atlas, its root held. One edit, or none when there is nothing to
/// adjust or nothing sensible comes out.
#[must_use]
pub fn global_adjustment(ctx: &Context, map: &Map, part: MapId) -> Option<MapEdit> {
    let keyframes: Vec<KeyFrameId> = map.keyframes().filter(|k| k.map == part).map(|k| k.id).collect();
    let points: Vec<MapPointId> = map.points().filter(|p| p.map == part).map(|p| p.id).collect();
    let adjusted =
        Adjustment::new(ctx, map, keyframes, |id| map.keyframe(id).is_some_and(|k| k.parent.is_none()), points);
    let options = BaOptions { iterations: ctx.config.looping.global_iterations, ..BaOptions::default() };
    let (poses, positions, _) = adjusted.solve(&options)?;
    Some(MapEdit::Correct(Box::new(correction(map, &poses, &positions))))
}

/// What [`adjust_part`] did.
#[derive(Debug, Clone)]
pub struct Adjusted {
    /// One correction of the map.
    pub edit: MapEdit,
    /// Keyframes that took part.
    pub keyframes: usize,
    /// Points that took part.
    pub points: usize,
    /// Costs, iterations, and which observations do not fit.
    pub report: BaReport,
}

/// The same with the points that `takes_part` says, and to whatever end `options` say.
#[must_use]
pub fn adjust_part(
    ctx: &Context,
    map: &Map,
    part: MapId,
    options: &BaOptions,
    takes_part: impl Fn(&MapPoint) -> bool,
) -> Option<Adjusted> {
    let keyframes: Vec<KeyFrameId> = map.keyframes().filter(|k| k.map == part).map(|k| k.id).collect();
    let points: Vec<MapPointId> = map.points().filter(|p| p.map == part && takes_part(p)).map(|p| p.id).collect();
    let counts = (keyframes.len(), points.len());
    let is_root = |id| map.keyframe(id).is_some_and(|k| k.parent.is_none());
    let (poses, positions, report) = Adjustment::new(ctx, map, keyframes, is_root, points).solve(options)?;
    let edit = MapEdit::Correct(Box::new(correction(map, &poses, &positions)));
    Some(Adjusted { edit, keyframes: counts.0, points: counts.1, report })
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
    #[expect(clippy::type_complexity, reason = "poses, positions and a report")]
    pub fn solve(
        mut self,
        options: &BaOptions,
    ) -> Option<(BTreeMap<KeyFrameId, Sim3>, BTreeMap<MapPointId, Vector3<f64>>, BaReport)> {
        let problem = &mut self.problem;
        if options.iterations == 0 || problem.observations.is_empty() || problem.poses.iter().all(|p| p.fixed) {
            return None;
        }
        // A keyframe that nothing ties to the others stays where it is.
        let report = loop {
            match global_bundle_adjust(problem, options) {
                Ok(done) => break done.ba,
                Err(loose) => problem.poses[loose.pose].fixed = true,
            }
        };
        let finite = problem.poses.iter().all(|p| p.camera_from_world.is_finite())
            && problem.points.iter().all(|p| p.iter().all(|v| v.is_finite()));
        let poses = problem.poses.iter().map(|p| Sim3::from(p.camera_from_world));
        let poses = self.keyframes.iter().copied().zip(poses).collect();
        finite.then(|| (poses, self.points.into_iter().zip(self.problem.points.iter().copied()).collect(), report))
    }
}
