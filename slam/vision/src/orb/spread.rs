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

/// Keeps at most `quota` corners, spread over the image, sorted by (y, x).
///
/// The rectangles of a quadtree are split level by level, within a level the fullest first (ties: upper, then left
/// one first), until there are `quota` of them or each holds one corner. The best corner of each stays: highest score,
/// then smallest y, then x. The last split may give up to three corners too many: the weakest of the smallest
/// rectangles go, where corners crowd.
pub(super) fn spread(corners: &mut Vec<Corner>, width: usize, height: usize, quota: usize) {
    let mut nodes = roots(corners, width as u32, height as u32);
    let rank = |nodes: &[Node], index: usize| {
        let node = &nodes[index];
        (Reverse(node.depth), node.end - node.first, Reverse(node.y), Reverse(node.x), index)
    };
    let mut open: BinaryHeap<_> = (0..nodes.len()).map(|index| rank(&nodes, index)).collect();
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
                open.push(rank(&nodes, nodes.len() - 1));
            }
        }
        // A split rectangle keeps no corners of its own.
        nodes[index].end = nodes[index].first;
    }
    let best = |node: &Node| {
        let corner = corners[node.first..node.end].iter().copied().max_by_key(strength)?;
        Some((node.depth, Reverse(strength(&corner)), corner))
    };
    let mut kept: Vec<_> = nodes.iter().filter_map(best).collect();
    kept.sort_unstable_by_key(|&(depth, weakness, _)| (depth, weakness));
    kept.truncate(quota);
    *corners = kept.into_iter().map(|(.., corner)| corner).collect();
    corners.sort_unstable_by_key(|corner| (corner.y, corner.x));
}

/// Shares `quota` among groups of `counts` corners in proportion to `shares` (0 to 1). What a group cannot use goes to the
/// others; the last of them takes what rounding leaves.
pub(super) fn share_out(quota: usize, counts: &[usize], shares: &[f64]) -> Vec<usize> {
    let mut given = vec![0; counts.len()];
    let mut waiting: Vec<usize> = (0..counts.len()).filter(|group| counts[*group] > 0).collect();
    let mut left = quota;
    while !waiting.is_empty() {
        let total: f64 = waiting.iter().map(|group| shares[*group]).sum();
        // Groups without any area (all shares 0) are as good as each other.
        let part = |group: usize| if total > 0.0 { shares[group] / total } else { 1.0 / waiting.len() as f64 };
        let fair: Vec<usize> = waiting.iter().map(|group| (left as f64 * part(*group)).round() as usize).collect();
        let (poor, rich): (Vec<_>, Vec<_>) =
            waiting.iter().zip(&fair).partition(|(group, fair)| counts[**group] <= **fair);
        if poor.is_empty() {
            for (group, fair) in rich {
                given[*group] = (*fair).min(left);
                left -= given[*group];
            }
            let last = waiting[waiting.len() - 1];
            given[last] = (given[last] + left).min(counts[last]);
            break;
        }
        for (group, _) in &poor {
            given[**group] = counts[**group].min(left);
            left -= given[**group];
        }
        waiting = rich.into_iter().map(|(group, _)| *group).collect();
    }
    given
}

/// Total order: the score, then the upper, then the left corner.
fn strength(corner: &Corner) -> (u8, Reverse<u32>, Reverse<u32>) {
    (corner.score, Reverse(corner.y), Reverse(corner.x))
}

/// As many about square rectangles side by side as a landscape image holds, at least one.
fn roots(corners: &mut [Corner], width: u32, height: u32) -> Vec<Node> {
    let count = ((2 * width + height) / (2 * height)).max(1);
    let step = width.div_ceil(count);
    let mut first = 0;
    (0..count)
        .map(|k| {
            let x = k * step;
            let end = first + partition(&mut corners[first..], |corner| corner.x < x + step);
            let node = Node { depth: 0, x, y: 0, width: step, height, first, end };
            first = end;
            node
        })
        .collect()
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
        for (width, height) in [(640, 480), (64, 480), (1000, 50)] {
            let all = corners(3000, width, height);
            for quota in [0, 1, 2, 7, 100, 217, 2000, 5000] {
                let (mut kept, mut reversed) = (all.clone(), all.iter().rev().copied().collect());
                spread(&mut kept, width, height, quota);
                spread(&mut reversed, width, height, quota);
                assert_eq!(kept, reversed);
                assert_eq!(kept.len(), quota.min(all.len()), "{width} x {height}, quota {quota}");
                assert!(kept.iter().all(|corner| all.contains(corner)));
            }
        }
    }

    #[test]
    fn a_quota_is_shared_by_area_and_what_one_group_lacks_goes_to_the_others() {
        assert_eq!(share_out(100, &[500, 500], &[0.3, 0.7]), [30, 70]);
        assert_eq!(share_out(100, &[10, 500], &[0.3, 0.7]), [10, 90]);
        assert_eq!(share_out(100, &[10, 20, 500], &[0.6, 0.3, 0.1]), [10, 20, 70]);
        assert_eq!(share_out(100, &[10, 20], &[0.5, 0.5]), [10, 20], "all there is");
        assert_eq!(share_out(7, &[50, 50], &[0.0, 0.0]).iter().sum::<usize>(), 7);
        assert_eq!(share_out(100, &[0, 0], &[0.5, 0.5]), [0, 0]);
        for quota in 0..40 {
            let given = share_out(quota, &[9, 9, 9], &[0.31, 0.33, 0.36]);
            assert_eq!(given.iter().sum::<usize>(), quota.min(27), "{given:?}");
            assert!(given.iter().all(|n| *n <= 9));
        }
    }

    #[test]
    fn a_crowd_in_one_place_leaves_the_rest_of_the_image_its_share() {
        let mut all = corners(5000, 60, 60);
        all.iter_mut().for_each(|corner| corner.score = 9);
        let lonely: Vec<Corner> =
            (0..40).map(|i| Corner { x: 110 + i % 8 * 64, y: 80 + i / 8 * 80, score: 1 }).collect();
        all.extend(&lonely);
        spread(&mut all, 640, 480, 200);
        assert!(lonely.iter().all(|corner| all.contains(corner)), "weak corners on their own stay");
        assert_eq!(all.len(), 200);
    }
}
