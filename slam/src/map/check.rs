//! What a map promises: every name in it names something that names it back.

use slam_math::KeyFrameId;

use super::{KeyFrame, Map};
use crate::observation::Observation;

/// Something in a map contradicts something else.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the map contradicts itself: {0}")]
pub struct MapProblem(String);

/// An error with a text unless something holds.
fn ensure(holds: bool, problem: impl FnOnce() -> String) -> Result<(), MapProblem> {
    if holds { Ok(()) } else { Err(MapProblem(problem())) }
}

impl Map {
    /// Checks all of it; observations may have `levels` pyramid levels.
    ///
    /// # Errors
    /// The first contradiction.
    pub fn check(&self, levels: usize) -> Result<(), MapProblem> {
        for (index, point) in self.points.iter() {
            ensure(point.id.index() == index, || format!("{} stands at {index}", point.id))?;
            ensure(!point.seen_in.is_empty(), || format!("{} is seen by nobody", point.id))?;
            let sorted = point.seen_in.is_sorted_by(|a, b| a.keyframe < b.keyframe);
            ensure(sorted, || format!("sightings of {} are out of order", point.id))?;
            for s in &point.seen_in {
                let keypoint = self.keyframe(s.keyframe).and_then(|k| k.points.get(s.index as usize));
                let back = keypoint == Some(&Some(point.id));
                ensure(back, || format!("{} is not what keypoint {} of {} sees", point.id, s.index, s.keyframe))?;
            }
        }
        for (index, keyframe) in self.keyframes.iter() {
            ensure(keyframe.id.index() == index, || format!("{} stands at {index}", keyframe.id))?;
            let n = keyframe.obs.len();
            let lengths = [keyframe.points.len(), keyframe.class.len(), keyframe.usable.len()];
            let is_whole = keyframe.obs.is_sound(levels) && lengths.into_iter().all(|len| len == n);
            ensure(is_whole, || format!("the keypoints of {} are incomplete", keyframe.id))?;
            self.check_points_and_edges(keyframe)?;
            self.check_tree(keyframe)?;
        }
        let heirs = self.removed.iter().all(|(id, _)| self.keyframe(*id).is_none() && self.pose_ends(*id));
        ensure(heirs, || "a removed keyframe leads nowhere".to_owned())?;
        let merged = self.merged.iter().all(|(from, to)| from != to && self.point(*from).is_none());
        ensure(merged, || "a merged point is alive".to_owned())
    }

    fn check_points_and_edges(&self, k: &KeyFrame) -> Result<(), MapProblem> {
        for (i, id) in (0u32..).zip(&k.points).filter_map(|(i, p)| p.map(|p| (i, p))) {
            let sighting = self.point(id).and_then(|p| p.sighting(k.id));
            ensure(sighting.is_some_and(|s| u32::from(s.index) == i), || {
                format!("{id} is not seen by keypoint {i} of {}", k.id)
            })?;
        }
        let order = |(id, weight): &(KeyFrameId, u32)| (std::cmp::Reverse(*weight), *id);
        let sorted = k.covisible.is_sorted_by(|a, b| order(a) < order(b));
        ensure(sorted, || format!("neighbours of {} are out of order", k.id))?;
        for (other, weight) in &k.covisible {
            let back = self.keyframe(*other).is_some_and(|o| o.id != k.id && o.covisible.contains(&(k.id, *weight)));
            ensure(back, || format!("the edge of {} and {other} has one end", k.id))?;
        }
        Ok(())
    }

    /// Following parents ends at a root: no cycles.
    fn check_tree(&self, k: &KeyFrame) -> Result<(), MapProblem> {
        let above = std::iter::successors(Some(k.id), |id| self.keyframe(*id).and_then(|k| k.parent));
        let limit = self.keyframe_count();
        ensure(above.take(limit + 1).count() <= limit, || format!("{} hangs on itself", k.id))?;
        let names =
            |id: &KeyFrameId, names_back: &dyn Fn(&KeyFrame) -> bool| self.keyframe(*id).is_some_and(names_back);
        let loops = k.loops.iter().all(|other| names(other, &|o| o.loops.contains(&k.id)));
        ensure(loops, || format!("a loop at {} has one end", k.id))?;
        let parent = k.parent.iter().all(|parent| names(parent, &|p| p.children.contains(&k.id)));
        let children = k.children.iter().all(|child| names(child, &|c| c.parent == Some(k.id)));
        let sorted = k.children.is_sorted_by(|a, b| a < b);
        ensure(parent && children && sorted, || format!("parent and children of {} disagree", k.id))
    }

    /// Whether the heirs of a removed keyframe end at one that never was or lives.
    fn pose_ends(&self, id: KeyFrameId) -> bool {
        let heirs = std::iter::successors(Some(id), |id| self.removed.get(id).map(|(parent, _)| *parent));
        heirs.take(self.removed.len() + 2).count() <= self.removed.len() + 1
    }
}

impl Observation {
    /// Whether all arrays are of one length, no longer than sightings can count, and no level is beyond the last.
    fn is_sound(&self, levels: usize) -> bool {
        let n = self.len();
        let lengths = [self.raw_pixel.len(), self.octave.len(), self.angle.len(), self.descriptor.len()];
        let lengths = lengths.into_iter().chain([self.depth_m.len(), self.label.len()]);
        lengths.into_iter().all(|len| len == n)
            && n <= usize::from(u16::MAX)
            && self.octave.iter().all(|octave| usize::from(*octave) < levels)
            && self.grid.is_of(n)
    }
}
