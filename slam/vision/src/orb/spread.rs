//! Thinning of corners to an even spread over the image.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::corners::Corner;

/// A rectangle of the quadtree and its corners, `corners[first..end]`.
#[derive(Debug, Clone, Copy)]
struct Node {
    depth: u32,
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    first: usize,
    end: usize,
}

/// A rectangle's place in the order of splitting; the greatest goes first.
type Rank = (Reverse<u32>, usize, Reverse<u32>, Reverse<u32>, usize);
/// Of a kept corner, the least first: depth of its rectangle, weakness.
type Standing = (u32, Reverse<Strength>);

/// Buffers that are reused.
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    nodes: Vec<Node>,
    open: BinaryHeap<Rank>,
    kept: Vec<(Standing, Corner)>,
}

/// Keeps at most `quota` corners, spread over the image, sorted by (y, x).
///
/// The rectangles of a quadtree are split level by level, within a level the fullest first (ties: upper, then left
/// one first), until there are `quota` of them or each holds one corner. The best corner of each stays: highest score,
/// then smallest y, then x. The last split may give up to three corners too many: the weakest of the smallest
/// rectangles go, where corners crowd.
pub(super) fn spread(corners: &mut Vec<Corner>, width: usize, height: usize, quota: usize, scratch: &mut Scratch) {
    let Scratch { nodes, open, kept } = scratch;
    nodes.clear();
    nodes.extend(roots(corners, width as u32, height as u32));
    let rank = |nodes: &[Node], index: usize| -> Rank {
        let node = &nodes[index];
        (Reverse(node.depth), node.end - node.first, Reverse(node.y), Reverse(node.x), index)
    };
    open.clear();
    open.extend((0..nodes.len()).map(|index| rank(nodes, index)));
    let mut count = nodes.iter().filter(|node| node.first < node.end).count();
    while count < quota {
        let Some((_, len, _, _, index)) = open.pop() else { break };
        if len < 2 {
            continue;
        }
        count -= 1;
        for child in split(corners, nodes[index]) {
            let is_filled = child.first < child.end;
            nodes.push(child);
            if is_filled {
                count += 1;
                open.push(rank(nodes, nodes.len() - 1));
            }
        }
        // A split rectangle keeps no corners of its own.
        nodes[index].end = nodes[index].first;
    }
    let best = |node: &Node| {
        let corner = corners[node.first..node.end].iter().copied().max_by_key(strength)?;
        Some(((node.depth, Reverse(strength(&corner))), corner))
    };
    kept.clear();
    kept.extend(nodes.iter().filter_map(best));
    kept.sort_unstable_by_key(|(standing, _)| *standing);
    kept.truncate(quota);
    corners.clear();
    corners.extend(kept.iter().map(|(_, corner)| *corner));
    corners.sort_unstable_by_key(|corner| (corner.y, corner.x));
}

/// Total order: the score, then the upper, then the left corner.
type Strength = (u8, Reverse<u32>, Reverse<u32>);

fn strength(corner: &Corner) -> Strength {
    (corner.score, Reverse(corner.y), Reverse(corner.x))
}

/// As many about square rectangles side by side as a landscape image holds, at least one.
fn roots(corners: &mut [Corner], width: u32, height: u32) -> impl Iterator<Item = Node> {
    let count = ((2 * width + height) / (2 * height)).max(1);
    let step = width.div_ceil(count);
    let mut first = 0;
    (0..count).map(move |k| {
        let x = k * step;
        let end = first + partition(&mut corners[first..], |corner| corner.x < x + step);
        let node = Node { depth: 0, x, y: 0, width: step, height, first, end };
        first = end;
        node
    })
}

/// The four quarters of a rectangle; its corners are regrouped in place.
fn split(corners: &mut [Corner], node: Node) -> [Node; 4] {
    let (left, top) = (node.width.div_ceil(2), node.height.div_ceil(2));
    let (x, y) = (node.x + left, node.y + top);
    let middle = node.first + partition(&mut corners[node.first..node.end], |corner| corner.y < y);
    let upper = node.first + partition(&mut corners[node.first..middle], |corner| corner.x < x);
    let lower = middle + partition(&mut corners[middle..node.end], |corner| corner.x < x);
    let (right, bottom) = (node.width - left, node.height - top);
    let depth = node.depth + 1;
    [
        Node { depth, width: left, height: top, first: node.first, end: upper, ..node },
        Node { depth, x, width: right, height: top, first: upper, end: middle, ..node },
        Node { depth, y, width: left, height: bottom, first: middle, end: lower, ..node },
        Node { depth, x, y, width: right, height: bottom, first: lower, end: node.end },
    ]
}

/// Moves the corners that satisfy `goes_first` to the front and counts them.
fn partition(corners: &mut [Corner], goes_first: impl Fn(&Corner) -> bool) -> usize {
    let mut count = 0;
    for i in 0..corners.len() {
        if goes_first(&corners[i]) {
            corners.swap(count, i);
            count += 1;
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::Rng;

    fn corners(count: usize, width: usize, height: usize) -> Vec<Corner> {
        let mut rng = Rng::at(4, 0, 0, 0);
        let mut all: Vec<Corner> = (0..count)
            .map(|_| Corner { x: rng.below(width) as u32, y: rng.below(height) as u32, score: 1 + rng.below(9) as u8 })
            .collect();
        all.sort_unstable_by_key(|corner| (corner.y, corner.x));
        all.dedup_by_key(|corner| (corner.y, corner.x));
        all
    }

    #[test]
    fn keeps_the_quota_whatever_the_order_of_the_corners() {
        let mut scratch = Scratch::default();
        for (width, height) in [(640, 480), (64, 480), (1000, 50)] {
            let all = corners(3000, width, height);
            for quota in [0, 1, 2, 7, 100, 217, 2000, 5000] {
                let (mut kept, mut reversed) = (all.clone(), all.iter().rev().copied().collect());
                spread(&mut kept, width, height, quota, &mut scratch);
                spread(&mut reversed, width, height, quota, &mut Scratch::default());
                assert_eq!(kept, reversed);
                assert_eq!(kept.len(), quota.min(all.len()), "{width} x {height}, quota {quota}");
                assert!(kept.iter().all(|corner| all.contains(corner)));
            }
        }
    }

    #[test]
    fn a_crowd_in_one_place_leaves_the_rest_of_the_image_its_share() {
        let mut all = corners(5000, 60, 60);
        all.iter_mut().for_each(|corner| corner.score = 9);
        let lonely: Vec<Corner> =
            (0..40).map(|i| Corner { x: 110 + i % 8 * 64, y: 80 + i / 8 * 80, score: 1 }).collect();
        all.extend(&lonely);
        spread(&mut all, 640, 480, 200, &mut Scratch::default());
        assert!(lonely.iter().all(|corner| all.contains(corner)), "weak corners on their own stay");
        assert_eq!(all.len(), 200);
    }
}
