//! What goes in and what comes out.

use schemas::Stamp;
use schemas::msg::{Category, Segment};
use schemas::panoptic::{VOID_CLASS, VOID_INSTANCE};

/// A colour picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Its stamp in the log.
    pub stamp: Stamp,
    /// Its number among the pictures of its log, from 0.
    pub index: usize,
    /// Columns, above 0.
    pub width: usize,
    /// Rows, above 0.
    pub height: usize,
    /// Red, green, blue; rows joined; `width * height * 3` bytes.
    pub rgb: Vec<u8>,
}

/// Labels of one picture, rows joined; see [`schemas::panoptic`] for void.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// Category id a pixel, 0 = void.
    pub class: Vec<u16>,
    /// Segment id a pixel, 0 = void.
    pub instance: Vec<u16>,
    /// The segments, ids ascending.
    pub segments: Vec<Segment>,
}

/// What is known of a segment before its pixels are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Claim {
    pub category_id: u16,
    pub score: f32,
}

impl Mask {
    /// A mask from the number of the claim that each pixel belongs to, 0 = none, n = `claims[n - 1]`. Claims without a pixel
    /// vanish and the others are numbered anew, in order; boxes and areas are counted.
    pub(crate) fn from_claims(owner: &[u16], width: usize, claims: &[Claim]) -> Self {
        let mut boxes = vec![[usize::MAX, usize::MAX, 0, 0]; claims.len()];
        let mut areas = vec![0_u32; claims.len()];
        for (at, &number) in owner.iter().enumerate() {
            let Some(claim) = usize::from(number).checked_sub(1) else { continue };
            let (x, y) = (at % width, at / width);
            let [left, top, right, bottom] = &mut boxes[claim];
            (*left, *top, *right, *bottom) = ((*left).min(x), (*top).min(y), (*right).max(x), (*bottom).max(y));
            areas[claim] += 1;
        }
        let mut segments = Vec::new();
        let mut label = vec![(VOID_CLASS, VOID_INSTANCE)];
        for ((claim, [left, top, right, bottom]), area) in claims.iter().zip(boxes).zip(areas) {
            if area == 0 {
                label.push((VOID_CLASS, VOID_INSTANCE));
                continue;
            }
            let id = segments.len() as u16 + 1;
            label.push((claim.category_id, id));
            segments.push(Segment {
                id,
                category_id: claim.category_id,
                score: claim.score,
                x: left as u32,
                y: top as u32,
                width: (right - left + 1) as u32,
                height: (bottom - top + 1) as u32,
                area,
                is_crowd: false,
            });
        }
        let (class, instance) = owner.iter().map(|&number| label[usize::from(number)]).unzip();
        Self { class, instance, segments }
    }

    /// The segment with this id.
    #[must_use]
    pub fn segment(&self, id: u16) -> Option<&Segment> {
        self.segments.binary_search_by_key(&id, |segment| segment.id).ok().map(|at| &self.segments[at])
    }
}

/// Categories of several tables as one: ids ascending, each once.
///
/// # Errors
/// An id with two meanings, in words.
pub(crate) fn united(tables: impl IntoIterator<Item = Category>) -> Result<Vec<Category>, String> {
    let mut all: Vec<Category> = tables.into_iter().collect();
    all.sort_by(|a, b| (a.id, &a.name, a.is_thing).cmp(&(b.id, &b.name, b.is_thing)));
    all.dedup();
    match all.windows(2).find(|pair| pair[0].id == pair[1].id) {
        None => Ok(all),
        Some([a, b, ..]) => Err(format!(
            "category {} is `{}` ({}) and `{}` ({}): give each its own id, and each id one role",
            a.id,
            a.name,
            role(a),
            b.name,
            role(b)
        )),
        Some(_) => unreachable!("windows of two"),
    }
}

fn role(category: &Category) -> &'static str {
    if category.is_thing { "thing" } else { "stuff" }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_counted_from_their_pixels() {
        let claims = [7, 8, 9].map(|category_id| Claim { category_id, score: 0.5 });
        let mask = Mask::from_claims(&[0, 1, 1, 3, 1, 0], 3, &claims);
        assert_eq!(mask.instance, [0, 1, 1, 2, 1, 0]);
        assert_eq!(mask.class, [0, 7, 7, 9, 7, 0]);
        let boxes: Vec<_> = mask.segments.iter().map(|s| (s.id, s.x, s.y, s.width, s.height, s.area)).collect();
        assert_eq!(boxes, [(1, 1, 0, 2, 2, 3), (2, 0, 1, 1, 1, 1)]);
        assert_eq!(mask.segment(2).unwrap().category_id, 9);
        assert!(mask.segment(3).is_none());
    }

    #[test]
    fn an_id_has_one_meaning() {
        let wall = Category { id: 1, name: "wall".to_owned(), is_thing: false };
        let cup = Category { id: 1, name: "cup".to_owned(), is_thing: true };
        assert_eq!(united([wall.clone(), wall.clone()]).unwrap().len(), 1);
        assert!(united([wall, cup]).unwrap_err().contains("category 1"));
    }
}
