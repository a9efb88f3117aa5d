//! Instances and per-pixel classes become one panoptic mask, as in PanopticFPN (Kirillov et al., "Panoptic Feature Pyramid
//! Networks", 2019): things by falling score, each only where no better one lies; then stuff of a least area on what is left;
//! the rest is void, which is this project's *unknown*.

use crate::Instance;
use crate::mask::{Claim, Mask};
use schemas::msg::SCORE_UNKNOWN;

/// Which things stay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThingRule {
    /// Least pixels that are left of a thing.
    pub least_area: u32,
    /// Least part of its pixels that is left of it, 0..=1.
    pub visible: f32,
}

/// What one semantic network says.
#[derive(Debug, Clone, PartialEq)]
pub struct Stuff {
    /// A number a pixel: 0 = none, n = `categories[n - 1]`.
    pub labels: Vec<u16>,
    /// Category ids.
    pub categories: Vec<u16>,
    /// Least pixels of one category in a picture.
    pub least_area: u32,
}

/// One mask of `width * height` pixels. `things` are sorted by falling score by this function (equal scores stay in their
/// order); of several stuffs the first that labels a pixel wins.
#[must_use]
pub fn compose(width: usize, height: usize, mut things: Vec<(Instance, ThingRule)>, stuffs: &[Stuff]) -> Mask {
    let mut owner = vec![0_u16; width * height];
    let mut claims = Vec::new();
    things.sort_by(|(a, _), (b, _)| b.score.total_cmp(&a.score));
    for (thing, rule) in &things {
        let free = || thing.pixels.iter().filter(|at| owner[**at as usize] == 0);
        let left = free().count();
        if left == 0 || left < rule.least_area as usize || (left as f32) < rule.visible * thing.pixels.len() as f32 {
            continue;
        }
        let free: Vec<usize> = free().map(|at| *at as usize).collect();
        claims.push(Claim { category_id: thing.category_id, score: thing.score });
        free.into_iter().for_each(|at| owner[at] = claims.len() as u16);
    }
    for stuff in stuffs {
        cover(&mut owner, &mut claims, stuff);
    }
    Mask::from_claims(&owner, width, &claims)
}

/// Lays stuff on the free pixels, one segment a category.
fn cover(owner: &mut [u16], claims: &mut Vec<Claim>, stuff: &Stuff) {
    let mut areas = vec![0_u32; stuff.categories.len()];
    let free = |owner: u16, label: u16| usize::from(label).checked_sub(1).filter(|_| owner == 0);
    owner.iter().zip(&stuff.labels).filter_map(|(o, l)| free(*o, *l)).for_each(|place| areas[place] += 1);
    let numbers: Vec<u16> = areas
        .iter()
        .zip(&stuff.categories)
        .map(|(&area, &category_id)| {
            if area == 0 || area < stuff.least_area {
                return 0;
            }
            claims.push(Claim { category_id, score: SCORE_UNKNOWN });
            claims.len() as u16
        })
        .collect();
    for (owner, label) in owner.iter_mut().zip(&stuff.labels) {
        if let Some(place) = free(*owner, *label) {
            *owner = numbers[place];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn thing(category_id: u16, score: f32, pixels: &[u32], rule: ThingRule) -> (Instance, ThingRule) {
        (Instance { category_id, score, corners: [0.0; 4], pixels: pixels.to_vec() }, rule)
    }

    #[test]
    fn better_things_lie_over_worse_ones_and_both_over_stuff() {
        let rule = ThingRule { least_area: 2, visible: 0.5 };
        let things = vec![
            thing(1, 0.6, &[0, 1, 2, 3], rule),    // two of four are left
            thing(2, 0.9, &[2, 3], rule),          // the best
            thing(3, 0.5, &[1, 2, 3, 4, 5], rule), // two of five are left: too little of it
            thing(4, 0.4, &[6], rule),             // too small
        ];
        let stuffs = [
            Stuff { labels: vec![1, 1, 1, 1, 1, 1, 2, 0], categories: vec![50, 51], least_area: 2 },
            Stuff { labels: vec![0, 0, 0, 0, 0, 0, 0, 1], categories: vec![60], least_area: 0 },
        ];
        let mask = compose(8, 1, things, &stuffs);
        assert_eq!(mask.class, [1, 1, 2, 2, 50, 50, 0, 60], "one pixel of 51 is too little: unknown");
        assert_eq!(mask.instance, [2, 2, 1, 1, 3, 3, 0, 4]);
        assert_eq!(mask.segments.iter().map(|s| s.score).collect::<Vec<_>>(), [0.9, 0.6, -1.0, -1.0]);
    }
}
