//! The covisibility graph and the spanning tree.

use slam_math::KeyFrameId;

use super::Map;

/// Shared points from which two keyframes are neighbours (ORB-SLAM, section III-D).
const MIN_SHARED: u32 = 15;

impl Map {
    /// Counts shared points of a keyframe anew and links both sides; a keyframe without a parent gets one.
    pub(super) fn connect(&mut self, id: KeyFrameId) -> bool {
        let Some(keyframe) = self.keyframe(id) else { return false };
        let mut shared = vec![0u32; self.keyframes.next_index()];
        for point in keyframe.points.iter().flatten().filter_map(|p| self.point(*p)) {
            for sighting in &point.seen_in {
                shared[sighting.keyframe.index()] += 1;
            }
        }
        shared[id.index()] = 0;
        let others = shared.iter().enumerate().filter(|(_, weight)| **weight > 0);
        let mut edges: Vec<_> = others.map(|(other, weight)| (KeyFrameId::from(other), *weight)).collect();
        sort_edges(&mut edges);
        let keep = edges.iter().filter(|(_, weight)| *weight >= MIN_SHARED).count();
        edges.truncate(keep.max(1));

        let before = std::mem::take(&mut self.keyframe_mut(id).covisible);
        for (other, _) in before.iter().filter(|(other, _)| !edges.iter().any(|(id, _)| id == other)) {
            if let Some(other) = self.keyframes.get_mut(other.index()) {
                other.covisible.retain(|(back, _)| *back != id);
            }
        }
        for (other, weight) in &edges {
            let covisible = &mut self.keyframe_mut(*other).covisible;
            covisible.retain(|(back, _)| *back != id);
            covisible.push((id, *weight));
            sort_edges(covisible);
        }
        // Only an older keyframe that does not hang on this one can be the parent: that keeps the tree a tree.
        let parent =
            edges.iter().map(|(other, _)| *other).find(|other| *other < id && self.root_of(*other) != Some(id));
        let keyframe = self.keyframe_mut(id);
        keyframe.covisible = edges.into();
        if let (None, Some(parent)) = (keyframe.parent, parent) {
            keyframe.parent = Some(parent);
            self.add_child(parent, id);
        }
        true
    }

    /// Removes a keyframe from graph and tree; its children go to its parent.
    pub(super) fn remove_keyframe(&mut self, id: KeyFrameId) -> bool {
        let Some(keyframe) = self.keyframe(id).cloned() else { return false };
        // The first keyframe of a map is the gauge and the root; it stays. So do the ends of a loop: the edge between
        // them can't be found again.
        let Some(parent) = keyframe.parent.filter(|_| keyframe.loops.is_empty()) else { return false };
        let Some(parent_pose) = self.keyframe(parent).map(|p| p.camera_from_world) else { return false };
        for point in keyframe.points.iter().flatten() {
            self.unobserve(*point, id);
        }
        for (other, _) in &keyframe.covisible {
            if let Some(other) = self.keyframes.get_mut(other.index()) {
                other.covisible.retain(|(back, _)| *back != id);
            }
        }
        for child in &keyframe.children {
            self.keyframe_mut(*child).parent = Some(parent);
            self.add_child(parent, *child);
        }
        self.keyframe_mut(parent).children.retain(|child| *child != id);
        self.removed.insert(id, (parent, keyframe.camera_from_world * parent_pose.inverse()));
        self.keyframes.remove(id.index())
    }

    /// The keyframe without a parent that a live keyframe hangs on, at last.
    fn root_of(&self, id: KeyFrameId) -> Option<KeyFrameId> {
        let mut keyframe = self.keyframe(id)?;
        while let Some(parent) = keyframe.parent {
            keyframe = self.keyframe(parent)?;
        }
        Some(keyframe.id)
    }

    /// Hangs the whole tree of one keyframe on another tree: the way from `child` up to its root turns round, so that
    /// `child` becomes the top, under `parent`. Removed keyframes stand for the ancestor that took their place.
    pub(super) fn hang(&mut self, child: KeyFrameId, parent: KeyFrameId) {
        let (Some(child), Some(parent)) = (self.heir_of(child), self.heir_of(parent)) else { return };
        if self.root_of(child) == self.root_of(parent) {
            return;
        }
        let (mut id, mut above) = (child, Some(parent));
        while let Some(new_parent) = above {
            let old_parent = self.keyframe_mut(id).parent.replace(new_parent);
            if let Some(old) = old_parent {
                self.keyframe_mut(old).children.retain(|c| *c != id);
            }
            self.add_child(new_parent, id);
            above = old_parent.map(|_| id);
            id = old_parent.unwrap_or(id);
        }
    }

    /// The live keyframe that a keyframe is, or that took its place in the tree.
    fn heir_of(&self, id: KeyFrameId) -> Option<KeyFrameId> {
        let mut id = id;
        while self.keyframe(id).is_none() {
            id = self.removed.get(&id)?.0;
        }
        Some(id)
    }

    /// Links two keyframes of the same place that drift had parted; such a keyframe is kept.
    pub(super) fn link_loop(&mut self, a: KeyFrameId, b: KeyFrameId) -> bool {
        if a == b || self.keyframe(a).is_none() || self.keyframe(b).is_none() {
            return false;
        }
        for (from, to) in [(a, b), (b, a)] {
            let loops = &mut self.keyframe_mut(from).loops;
            if let Err(position) = loops.binary_search(&to) {
                loops.insert(position, to);
            }
        }
        true
    }

    fn add_child(&mut self, parent: KeyFrameId, child: KeyFrameId) {
        let children = &mut self.keyframe_mut(parent).children;
        if let Err(position) = children.binary_search(&child) {
            children.insert(position, child);
        }
    }
}

fn sort_edges(edges: &mut [(KeyFrameId, u32)]) {
    edges.sort_unstable_by_key(|(id, weight)| (std::cmp::Reverse(*weight), *id));
}
