//! Which keyframes have the words of a query?

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{Node, Vocabulary};
use crate::Descriptor;
use crate::place::spread;

/// Inverted index over the words of keyframes; takes 12 bytes a descriptor (at most 500 a keyframe).
///
/// Stands in for [`PlaceIndex`](crate::PlaceIndex); what it depends on is the vocabulary and what is stored, not the order
/// in which it was added.
#[derive(Debug, Clone)]
pub struct WordIndex {
    vocabulary: Arc<Vocabulary>,
    /// Keyframe id -> what it holds.
    keyframes: BTreeMap<u32, Stored>,
    /// Word -> (keyframe, keypoint), ascending.
    postings: Vec<Vec<(u32, u32)>>,
}

#[derive(Debug, Clone)]
struct Stored {
    /// The words of its descriptors, those twice there twice.
    words: Vec<u32>,
    /// Sum of their weights.
    weight: f64,
}

impl WordIndex {
    /// An empty index.
    #[must_use]
    pub fn new(vocabulary: Arc<Vocabulary>) -> Self {
        let postings = vec![Vec::new(); vocabulary.len()];
        Self { vocabulary, keyframes: BTreeMap::new(), postings }
    }

    /// Number of keyframes in the index.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keyframes.len()
    }

    /// Whether the index holds no keyframe.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keyframes.is_empty()
    }

    /// Stores descriptors of a keyframe (ids count up: a query takes 16 bytes for each below the largest), each with the
    /// number of its keypoint, in place of what the same id held before. At most 500, spread evenly, are kept.
    pub fn add(&mut self, keyframe_id: u32, keypoints: &[(u32, Descriptor)]) {
        self.remove(keyframe_id);
        let mut stored = Stored { words: Vec::new(), weight: 0.0 };
        for (keypoint, descriptor) in spread(keypoints) {
            let Node { word, weight, .. } = *self.vocabulary.leaf(descriptor);
            if weight > 0.0 {
                let postings = &mut self.postings[word as usize];
                let place = postings.partition_point(|posting| *posting < (keyframe_id, *keypoint));
                postings.insert(place, (keyframe_id, *keypoint));
                stored.words.push(word);
                stored.weight += weight;
            }
        }
        self.keyframes.insert(keyframe_id, stored);
    }

    /// Forgets a keyframe; false when it was not there.
    pub fn remove(&mut self, keyframe_id: u32) -> bool {
        let Some(Stored { mut words, .. }) = self.keyframes.remove(&keyframe_id) else { return false };
        words.sort_unstable();
        words.dedup();
        for word in words {
            let postings = &mut self.postings[word as usize];
            let from = postings.partition_point(|(keyframe, _)| *keyframe < keyframe_id);
            let to = postings.partition_point(|(keyframe, _)| *keyframe <= keyframe_id);
            postings.drain(from..to);
        }
        true
    }

    /// The keyframes that share most with `descriptors`: (id, [score](crate::bag_score) of the two bags), best first,
    /// equal scores by ascending id. Keyframes without a common word are left out. At most 500 of the query's
    /// descriptors, spread evenly, count.
    ///
    /// `votes(keyframe, keypoint)` says whether a stored keypoint may vote: one that may not adds nothing to the score,
    /// though its keyframe is weighed as if it did.
    #[must_use]
    pub fn query(
        &self,
        descriptors: &[Descriptor],
        max_results: usize,
        votes: impl Fn(u32, u32) -> bool,
    ) -> Vec<(u32, f64)> {
        let ids = self.keyframes.last_key_value().map_or(0, |(id, _)| *id as usize + 1);
        let mut inverse_weight = vec![0.0; ids];
        for (id, stored) in self.keyframes.iter().filter(|(_, stored)| stored.weight > 0.0) {
            inverse_weight[*id as usize] = 1.0 / stored.weight;
        }
        let mut scores = vec![0.0; ids];
        for (word, share) in self.vocabulary.bag(spread(descriptors)) {
            let weight = self.vocabulary.entry(word).map_or(0.0, |(_, weight)| weight);
            for of_keyframe in self.postings[word as usize].chunk_by(|a, b| a.0 == b.0) {
                let keyframe = of_keyframe[0].0;
                let count = of_keyframe.iter().filter(|(_, keypoint)| votes(keyframe, *keypoint)).count();
                let theirs = count as f64 * weight * inverse_weight[keyframe as usize];
                scores[keyframe as usize] += slam_math::float::min(share, theirs);
            }
        }
        let mut ranked: Vec<(u32, f64)> = (0..).zip(scores).filter(|(_, score)| *score > 0.0).collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        ranked.truncate(max_results);
        ranked
    }
}
