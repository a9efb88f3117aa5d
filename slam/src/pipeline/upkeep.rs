//! What a tracked frame does to the map: doubts, and now and then a keyframe.

use slam_math::{KeyFrameId, MapId};

use super::step::Step;
use super::{JobKind, doubts};
use crate::map::MapEdit;
use crate::mapping::{create_points_from_depth, insert_keyframe};
use crate::panoptic::FrameFilter;
use crate::tracking::keyframe_needed;

impl Step<'_> {
    pub(super) fn insert(&mut self, map: MapId) -> (KeyFrameId, u32) {
        let frame = self.frame.clone();
        let (id, created) = self.edit(|ctx, editor, young| {
            let id = insert_keyframe(editor, &frame, map);
            let matched: Vec<_> = frame.matches().map(|(_, id)| id).collect();
            for point in matched {
                editor.refresh(ctx, point);
            }
            let created = create_points_from_depth(ctx, editor, young, id);
            editor.apply(MapEdit::Connect(id));
            (id, created)
        });
        if let Some(keyframe) = self.slam.map.keyframe(id) {
            self.frame.points = keyframe.points.clone();
        }
        self.slam.remember_place(id);
        self.frame.refer_to(id, &self.slam.map);
        self.slam.tracker.last_keyframe = self.frame.id;
        self.new_keyframe = Some(id);
        self.counts.points_created += created;
        (id, created)
    }

    /// Map upkeep after a tracked frame, and a keyframe when one is due.
    pub(super) fn map_frame(&mut self, filter: &FrameFilter) {
        if let Some(local) = self.slam.last_local.take() {
            let (input, frame) = (self.input, self.frame.clone());
            self.counts.points_culled +=
                self.edit(|ctx, editor, _| doubts::doubt_points(ctx, editor, input, filter, &frame, &local));
        }
        if self.new_keyframe.is_some() || !self.slam.schedule.is_idle(JobKind::Mapping) {
            return;
        }
        let before = self.ctx.config.relocalization.frames_before_keyframe;
        if self.slam.tracker.relocalized_at.is_some_and(|at| self.frame.id.0 - at.0 < before) {
            return;
        }
        let (map, last_keyframe) = (&self.slam.map, self.slam.tracker.last_keyframe);
        if keyframe_needed(&self.ctx, map, &self.frame, self.counts.inliers, last_keyframe).is_none() {
            return;
        }
        let (id, _) = self.insert(self.slam.tracker.active);
        self.mapping_due = Some(id);
    }
}
