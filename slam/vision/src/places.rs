//! One index of places, whatever it goes by.

use std::sync::Arc;

use crate::{Descriptor, PlaceIndex, Vocabulary, WordIndex};

/// Which keyframes show the same place as a picture: by descriptors alone, or by the words of a vocabulary.
#[derive(Debug, Clone)]
pub enum Places {
    /// Scores are numbers of descriptors with a counterpart.
    Descriptors(PlaceIndex),
    /// Scores are likenesses of two bags of words, 0 to 1.
    Words(WordIndex),
}

impl Default for Places {
    fn default() -> Self {
        Self::Descriptors(PlaceIndex::new())
    }
}

impl Places {
    /// An empty index of descriptors, or of the words of a vocabulary.
    #[must_use]
    pub fn new(vocabulary: Option<Arc<Vocabulary>>) -> Self {
        vocabulary.map_or_else(Self::default, |vocabulary| Self::Words(WordIndex::new(vocabulary)))
    }

    /// Whether it goes by words.
    #[must_use]
    pub fn has_words(&self) -> bool {
        matches!(self, Self::Words(_))
    }

    /// See [`PlaceIndex::add`].
    pub fn add(&mut self, keyframe_id: u32, keypoints: &[(u32, Descriptor)]) {
        match self {
            Self::Descriptors(index) => index.add(keyframe_id, keypoints),
            Self::Words(index) => index.add(keyframe_id, keypoints),
        }
    }

    /// Forgets a keyframe; false when it was not there.
    pub fn remove(&mut self, keyframe_id: u32) -> bool {
        match self {
            Self::Descriptors(index) => index.remove(keyframe_id),
            Self::Words(index) => index.remove(keyframe_id),
        }
    }

    /// The keyframes that share most with `descriptors`: (id, score), best first, equal scores by ascending id. Keyframes
    /// that share nothing are left out. `votes(keyframe, keypoint)` says whether a stored keypoint may vote.
    #[must_use]
    pub fn query(
        &self,
        descriptors: &[Descriptor],
        max_results: usize,
        votes: impl Fn(u32, u32) -> bool,
    ) -> Vec<(u32, f64)> {
        match self {
            Self::Descriptors(index) => {
                let found = index.query(descriptors, max_results, votes);
                found.into_iter().map(|(id, count)| (id, f64::from(count))).collect()
            }
            Self::Words(index) => index.query(descriptors, max_results, votes),
        }
    }
}
