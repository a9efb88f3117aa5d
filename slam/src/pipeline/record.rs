//! Digests of a frame, stage by stage and field by field.

use slam_math::DigestWriter;
use smallvec::smallvec;

use crate::map::{EditCounts, MapEdit};
use crate::observation::Observation;
use crate::panoptic::FrameFilter;
use crate::report::{Counts, FieldRecord, FieldValue, FrameReport, Stage, StageRecord};

fn field(name: &'static str, value: FieldValue, write: impl FnOnce(&mut DigestWriter)) -> FieldRecord {
    let mut w = DigestWriter::default();
    write(&mut w);
    FieldRecord { name, digest: w.finish(), value }
}

/// The same with a number of things.
fn counted(name: &'static str, count: usize, write: impl FnOnce(&mut DigestWriter)) -> FieldRecord {
    field(name, FieldValue::Count(count as u64), write)
}

/// Facts that hold for some things, with the number of those.
fn marked(name: &'static str, facts: &[bool]) -> FieldRecord {
    let holding = facts.iter().filter(|fact| **fact).count();
    counted(name, holding, |w| facts.iter().for_each(|fact| w.u8(u8::from(*fact))))
}

pub(super) fn features(obs: &Observation) -> StageRecord {
    let fields = smallvec![
        counted("keypoints", obs.len(), |w| obs.digest_keypoints(w)),
        counted("descriptors", obs.len(), |w| obs.descriptor.iter().flatten().for_each(|v| w.u64(*v))),
        counted("depth", obs.depth_m.iter().filter(|z| **z > 0.0).count(), |w| w.f64s(&obs.depth_m)),
    ];
    StageRecord { stage: Stage::Features, fields }
}

pub(super) fn regions(filter: &FrameFilter) -> StageRecord {
    let fields = smallvec![
        counted("cells", filter.regions.list.len(), |w| {
            filter.regions.cell.iter().for_each(|c| w.bytes(&c.to_le_bytes()));
        }),
        counted("tracks", filter.tracks.len(), |w| {
            for t in &filter.tracks {
                let streaks = [t.static_streak, t.dynamic_streak, t.moved_streak, t.disagreed_streak];
                [t.id, t.age].iter().chain(&streaks).for_each(|v| w.u32(*v));
                w.u8(t.state as u8);
            }
        }),
        counted("evidence", filter.evidence.len(), |w| {
            for c in filter.evidence.iter().flat_map(|e| &e.counts) {
                [c.samples, c.free, c.consistent, c.keypoints, c.moved].iter().for_each(|v| w.u32(*v));
            }
        }),
        marked("disagrees", &filter.disagrees),
    ];
    StageRecord { stage: Stage::Regions, fields }
}

pub(super) fn verdicts(filter: &FrameFilter, counts: &Counts) -> StageRecord {
    let fields = smallvec![
        counted("class", filter.class.len(), |w| filter.class.iter().for_each(|c| w.u8(*c as u8))),
        marked("vouched", &filter.vouched),
        marked("in free space", &filter.in_free_space),
        counted("verdict", counts.static_keypoints as usize, |w| filter.verdict.iter().for_each(|v| w.u8(*v as u8))),
        field("motion", FieldValue::None, |w| filter.motion_sigmas.iter().for_each(|v| residual(w, *v))),
        field("epipolar", FieldValue::None, |w| filter.epipolar_px.iter().for_each(|v| residual(w, *v))),
    ];
    StageRecord { stage: Stage::Verdicts, fields }
}

/// NaN stands for "not tested"; its bits are not part of the result.
fn residual(w: &mut DigestWriter, v: f64) {
    w.f64(if v.is_nan() { -1.0 } else { v });
}

pub(super) fn matches(report: &FrameReport) -> StageRecord {
    let points = |w: &mut DigestWriter| {
        report.keypoints.iter().for_each(|k| w.u32(k.point.map_or(u32::MAX, |p| p.0)));
    };
    let c = &report.counts;
    let fields = smallvec![
        counted("motion matches", c.motion_matches as usize, |w| w.u32(c.motion_matches)),
        counted("local matches", c.local_matches as usize, |w| w.u32(c.local_matches)),
        counted("points", c.inliers as usize, points),
    ];
    StageRecord { stage: Stage::Matches, fields }
}

pub(super) fn pose(report: &FrameReport) -> StageRecord {
    let rows = report.camera_from_world.map(|p| p.rows());
    let fields = smallvec![
        field("state", FieldValue::State(report.state), |w| w.u8(report.state as u8)),
        field("selection", FieldValue::Selection(report.selection), |w| w.u8(report.selection as u8)),
        field("camera_from_world", FieldValue::Pose(rows), |w| w.f64s(rows.as_ref().map_or(&[], |r| r.as_slice()))),
        field("reference", FieldValue::KeyFrame(report.reference), |w| {
            w.u32(report.reference.map_or(u32::MAX, |k| k.0));
        }),
    ];
    StageRecord { stage: Stage::Pose, fields }
}

pub(super) fn map(journal: &[MapEdit], edits: EditCounts, counts: &Counts) -> StageRecord {
    let fields = smallvec![
        counted("edits", edits.applied as usize, |w| journal.iter().for_each(|e| e.digest(w))),
        counted("void edits", edits.void as usize, |w| w.u64(edits.void)),
        counted("keyframes", counts.keyframes as usize, |w| w.u32(counts.keyframes)),
        counted("map points", counts.map_points as usize, |w| w.u32(counts.map_points)),
    ];
    StageRecord { stage: Stage::Map, fields }
}
