//! Bundle adjustment of the whole atlas, to its end.

use slam_math::MapId;
use slam_optimize::BaOptions;

use super::Trusted;
use crate::context::Context;
use crate::looping::{Adjusted, adjust_part};
use crate::map::Map;
use crate::report::FinalReport;

/// Adjusts each part of the atlas by itself, its first keyframe held. Returns what was done, by part.
pub fn adjust(ctx: &Context, map: &mut Map, trusted: Trusted<'_>) -> Vec<FinalReport> {
    let mut parts: Vec<MapId> = map.keyframes().map(|keyframe| keyframe.map).collect();
    parts.sort_unstable();
    parts.dedup();
    parts.into_iter().map(|part| adjust_one(ctx, map, part, trusted)).collect()
}

fn adjust_one(ctx: &Context, map: &mut Map, part: MapId, trusted: Trusted<'_>) -> FinalReport {
    let c = &ctx.config.r#final;
    let options = BaOptions {
        rounds: c.rounds,
        robust_rounds: c.rounds,
        iterations: c.iterations,
        relative_decrease: RELATIVE_DECREASE,
        ..BaOptions::default()
    };
    let mut report = FinalReport { map: part.0, depth_weight: ctx.depth_weight, ..FinalReport::default() };
    let Some(Adjusted { edit, keyframes, points, report: ba }) = adjust_part(ctx, map, part, &options, trusted) else {
        return report;
    };
    map.apply(&edit);
    report.keyframes = keyframes;
    report.points = points;
    report.observations = ba.outlier.len();
    report.outliers = ba.outlier.iter().filter(|outlier| **outlier).count();
    report.iterations = ba.iterations;
    report.cost = [ba.initial_cost, ba.final_cost];
    report
}

/// A round ends when the cost decreases by less than this share of itself.
const RELATIVE_DECREASE: f64 = 1e-4;
