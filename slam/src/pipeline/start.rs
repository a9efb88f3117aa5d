//! The first map, and every map after it.

use slam_math::{KeyFrameId, MapId, Se3};

use super::step::Step;
use super::{JobKind, Slam, Work};
use crate::mapping::{YoungPoints, insert_two_views};
use crate::panoptic::FrameFilter;
use crate::report::Selection;
use crate::tracking::{Start, TwoViews, offer_view};

impl Step<'_> {
    /// Starts a map at this frame, if it allows.
    pub(super) fn initialize(&mut self, filter: &FrameFilter) -> bool {
        // Nothing has been judged yet, so nothing is condemned: the map begins with all but people. Without depth a mover would be
        // part of the geometry that everything else hangs on.
        self.selection = if self.ctx.is_monocular() { Selection::Static } else { Selection::WithUnconfirmed };
        self.frame.usable = filter.admitted(&self.ctx, self.selection);
        // No keyframe while local mapping is at work: neither expects the other.
        let may_start = self.slam.schedule.is_idle(JobKind::Mapping);
        let started = if self.ctx.is_monocular() {
            may_start && self.start_from_two_views()
        } else {
            may_start && self.start_from_depth()
        };
        self.observer.done(Work::Predict);
        started
    }

    fn start_from_depth(&mut self) -> bool {
        let obs = &self.frame.obs;
        let n = (0..obs.len()).filter(|i| self.frame.usable[*i] && obs.depth(*i).is_some()).count() as u32;
        if n < self.ctx.config.tracking.min_init_keypoints {
            return false;
        }
        let map = self.new_map();
        self.frame.camera_from_world = Se3::identity();
        self.insert(map);
        self.counts.inliers = self.frame.match_count();
        self.event(map.0 > 0, format!("{map} started with {n} keypoints"));
        true
    }

    fn start_from_two_views(&mut self) -> bool {
        match offer_view(&self.ctx, &mut self.slam.first_view, &self.frame) {
            Start::Unusable | Start::First => false,
            Start::NotYet(failure) => {
                self.event(false, format!("no map yet: {failure}"));
                false
            }
            Start::Done(views) => {
                self.insert_views(&views);
                true
            }
        }
    }

    fn insert_views(&mut self, views: &TwoViews) {
        let map = self.new_map();
        let mut frame = self.frame.clone();
        let ids = self.edit(|ctx, editor, _| insert_two_views(ctx, editor, views, &mut frame, map));
        self.frame = frame;
        for id in ids {
            self.slam.remember_place(id);
        }
        let [first, second] = ids;
        if let Some(keyframe) = self.slam.map.keyframe(second) {
            self.frame.points = keyframe.points.clone();
        }
        self.frame.refer_to(second, &self.slam.map);
        self.slam.tracker.last_keyframe = self.frame.id;
        self.new_keyframe = Some(second);
        self.mapping_due = Some(second);
        let n = self.frame.match_count();
        (self.counts.inliers, self.counts.points_created) = (n, n);
        let older = views.first.id;
        self.event(map.0 > 0, format!("{map} started with {n} points of {first}, which is {older}, and {second}"));
    }

    /// A new part of the atlas becomes the active one.
    fn new_map(&mut self) -> MapId {
        let map = self.slam.tracker.next_map;
        self.slam.tracker.next_map = MapId(map.0 + 1);
        self.slam.tracker.active = map;
        // Points of the part that was left are off probation: nobody looks at them, and they may be found again.
        self.slam.young = YoungPoints::default();
        map
    }
}

impl Slam {
    /// The keyframe can be recognised from now on.
    pub(super) fn remember_place(&mut self, id: KeyFrameId) {
        let Some(keyframe) = self.map.keyframe(id) else { return };
        let usable = (0..keyframe.obs.len()).filter(|i| keyframe.usable[*i]);
        let keypoints: Vec<_> = usable.map(|i| (i as u32, keyframe.obs.descriptor[i])).collect();
        self.places.add(id.0, &keypoints);
    }
}
