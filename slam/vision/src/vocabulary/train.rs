//! Training: hierarchical k-means in Hamming space.

use std::collections::VecDeque;

use slam_math::Rng;

use super::{MAX_BRANCHING, MAX_DEPTH, Node, Vocabulary, VocabularyError};
use crate::{Descriptor, hamming};

/// Rounds of k-means at most. The sum of distances falls with each, and nearly all of the gain comes early.
const MAX_ROUNDS: usize = 20;

/// Shape of a tree to train.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VocabularyOptions {
    /// Children of a node at most, 2 to 20.
    pub branching: u32,
    /// Levels below the root at most, 1 to 10; there are at most `branching`^`depth` words.
    pub depth: u32,
    /// Seed of the first centres.
    pub seed: u64,
}

impl Default for VocabularyOptions {
    /// 10,000 words: about 0.5 MB.
    fn default() -> Self {
        Self { branching: 10, depth: 4, seed: 1 }
    }
}

impl Vocabulary {
    /// Trains a tree on the descriptors of pictures; the same pictures in the same order give the same tree.
    ///
    /// A word's weight is ln(pictures / pictures that have it), so a single picture gives weights of 0 only.
    ///
    /// # Errors
    /// Options out of range, or no descriptor at all.
    pub fn train(pictures: &[Vec<Descriptor>], options: &VocabularyOptions) -> Result<Self, VocabularyError> {
        let VocabularyOptions { branching, depth, seed } = *options;
        if !(2..=MAX_BRANCHING).contains(&branching) || !(1..=MAX_DEPTH).contains(&depth) {
            return Err(VocabularyError::Shape { branching, depth });
        }
        let from = |picture: usize| pictures[picture].iter().map(move |d| (picture, *d));
        let all: Vec<(usize, Descriptor)> = (0..pictures.len()).flat_map(from).collect();
        if all.is_empty() {
            return Err(VocabularyError::NothingToTrainOn { pictures: pictures.len() });
        }
        let mut nodes = vec![Node::ROOT];
        let mut open = VecDeque::from([(0, 0, all)]);
        while let Some((id, level, members)) = open.pop_front() {
            let mut rng = Rng::at(seed, id, 0, 0);
            let clusters = if level < depth { cluster(&members, branching as usize, &mut rng) } else { Vec::new() };
            // The root has a child even if all descriptors are equal; elsewhere an only child would say nothing.
            if clusters.len() > usize::from(id != 0) {
                for (descriptor, members) in clusters {
                    open.push_back((nodes.len() as u32, level + 1, members));
                    nodes.push(Node { parent: id, descriptor, ..Node::ROOT });
                }
            } else {
                let mut having: Vec<usize> = members.iter().map(|(picture, _)| *picture).collect();
                having.dedup();
                nodes[id as usize].weight = slam_math::float::ln(pictures.len() as f64 / having.len() as f64);
            }
        }
        Ok(Self::assemble(branching, depth, nodes))
    }
}

/// At most `k` groups with their centres, none empty; members keep their order.
fn cluster(members: &[(usize, Descriptor)], k: usize, rng: &mut Rng) -> Vec<(Descriptor, Vec<(usize, Descriptor)>)> {
    let mut centres = first_centres(members, k, rng);
    let mut nearest = assign(members, &centres);
    for _ in 0..MAX_ROUNDS {
        recentre(members, &nearest, &mut centres);
        let next = assign(members, &centres);
        if next == nearest {
            break;
        }
        nearest = next;
    }
    let mut groups: Vec<_> = centres.into_iter().map(|centre| (centre, Vec::new())).collect();
    for (member, centre) in members.iter().zip(nearest) {
        groups[centre].1.push(*member);
    }
    groups.retain(|(_, members)| !members.is_empty());
    groups
}

/// Centres far apart: each is drawn with a probability proportional to the squared distance to those before (Arthur and
/// Vassilvitskii, "k-means++", SODA 2007). Fewer than `k` when there are fewer different descriptors.
fn first_centres(members: &[(usize, Descriptor)], k: usize, rng: &mut Rng) -> Vec<Descriptor> {
    let mut centres = vec![members[rng.below(members.len())].1];
    let mut squared = vec![u64::MAX; members.len()];
    while centres.len() < k {
        let newest = centres[centres.len() - 1];
        for (squared, (_, member)) in squared.iter_mut().zip(members) {
            let distance = u64::from(hamming(member, &newest));
            *squared = (*squared).min(distance * distance);
        }
        let total: u64 = squared.iter().sum();
        if total == 0 {
            break;
        }
        let mut left = rng.below(total as usize) as u64;
        let drawn = squared.iter().position(|&s| {
            let here = left < s;
            left = left.saturating_sub(s);
            here
        });
        centres.extend(drawn.map(|i| members[i].1));
    }
    centres
}

/// Number of the nearest centre, of equally near ones the first.
fn assign(members: &[(usize, Descriptor)], centres: &[Descriptor]) -> Vec<usize> {
    let nearest = |member: &Descriptor| (0..centres.len()).min_by_key(|&c| hamming(member, &centres[c])).unwrap_or(0);
    members.iter().map(|(_, member)| nearest(member)).collect()
}

/// Puts each centre where the sum of Hamming distances to its members is least: bit by bit what half of them have. A
/// centre without members stays.
fn recentre(members: &[(usize, Descriptor)], nearest: &[usize], centres: &mut [Descriptor]) {
    let mut ones = vec![[0u32; 256]; centres.len()];
    let mut counts = vec![0u32; centres.len()];
    for ((_, member), &centre) in members.iter().zip(nearest) {
        counts[centre] += 1;
        for (bit, ones) in ones[centre].iter_mut().enumerate() {
            *ones += (member[bit / 64] >> (bit % 64) & 1) as u32;
        }
    }
    for ((centre, ones), &count) in centres.iter_mut().zip(&ones).zip(&counts).filter(|(_, count)| **count > 0) {
        *centre = [0; 4];
        for (bit, &ones) in ones.iter().enumerate() {
            centre[bit / 64] |= u64::from(2 * ones >= count) << (bit % 64);
        }
    }
}
