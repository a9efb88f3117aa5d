//! Networks that give boxes with mask coefficients and prototypes (YOLO `-seg` exports by Ultralytics).

use crate::description::Model;
use crate::grid::{Between, bilinear, on_grid};
use crate::tensor::argmax;
use crate::{Placement, Tensor};

/// No picture is taken to have more things.
const MAX_INSTANCES: usize = 300;

/// One thing, as found.
#[derive(Debug, Clone, PartialEq)]
pub struct Instance {
    /// Category id in the log.
    pub category_id: u16,
    /// Score 0..=1.
    pub score: f32,
    /// Left, top, right, bottom border in pixels of the picture, as the network gives it (before clipping).
    pub corners: [f32; 4],
    /// Its pixels: row-major numbers in the picture, ascending.
    pub pixels: Vec<u32>,
}

/// A box that passed the score.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    anchor: usize,
    class: usize,
    score: f32,
    /// In input pixels.
    corners: [f32; 4],
}

/// The instances in falling order of score; equal scores in the network's order.
pub fn instances(
    model: &Model,
    boxes: &Tensor,
    prototypes: &Tensor,
    placement: &Placement,
    (width, height): (usize, usize),
) -> Result<Vec<Instance>, String> {
    let shapes = || format!("outputs have shapes {:?} and {:?}", boxes.shape, prototypes.shape);
    let wanted = "an ultralytics-seg model gives [1, 4 + classes + coefficients, anchors] and [1, coefficients, h, w]";
    let (Some([rows, anchors]), Some([coefficients, rows_high, columns])) = (boxes.extents(), prototypes.extents())
    else {
        return Err(format!("{}; {wanted}", shapes()));
    };
    let classes = rows.checked_sub(4 + coefficients).filter(|classes| *classes > 0);
    let Some(classes) = classes else { return Err(format!("{}; {wanted}", shapes())) };
    if let Some(channel) = model.channels.iter().find(|channel| channel.index >= classes) {
        return Err(format!("has {classes} classes, but class {} is described", channel.index));
    }
    let candidates = candidates(model, &boxes.data, anchors, classes);
    let kept = suppressed(candidates, model.description.merge.iou);
    let grid =
        Grid { prototypes, coefficients, columns, rows: rows_high, align: model.description.output.align_corners };
    let instance = |candidate: &Candidate| {
        let category = model.channels.iter().find(|channel| channel.index == candidate.class)?;
        let weights: Vec<f32> =
            (0..coefficients).map(|c| boxes.data[(4 + classes + c) * anchors + candidate.anchor]).collect();
        let pixels = grid.pixels(model, &weights, candidate.corners, placement, (width, height));
        let border = |at: usize| placement.to_picture(at % 2, candidate.corners[at] - 0.5) + 0.5;
        let corners = [border(0), border(1), border(2), border(3)];
        Some(Instance { category_id: category.category.id, score: candidate.score, corners, pixels })
    };
    Ok(kept.iter().filter_map(instance).collect())
}

fn candidates(model: &Model, data: &[f32], anchors: usize, classes: usize) -> Vec<Candidate> {
    let at = |row: usize, anchor: usize| data[row * anchors + anchor];
    let candidate = |anchor: usize| {
        let (class, score) = argmax((0..classes).map(|class| at(4 + class, anchor)))?;
        let [cx, cy, w, h] = [0, 1, 2, 3].map(|row| at(row, anchor));
        let corners = [cx - w / 2.0, cy - h / 2.0, cx + w / 2.0, cy + h / 2.0];
        let sound = corners.iter().all(|v| v.is_finite()) && w > 0.0 && h > 0.0;
        (sound && score >= model.description.merge.score).then_some(Candidate { anchor, class, score, corners })
    };
    (0..anchors).filter_map(candidate).collect()
}

/// Non-maximum suppression within each class.
fn suppressed(mut candidates: Vec<Candidate>, iou: f32) -> Vec<Candidate> {
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.anchor.cmp(&b.anchor)));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        let covered =
            |better: &Candidate| better.class == candidate.class && overlap(&better.corners, &candidate.corners) > iou;
        if kept.len() < MAX_INSTANCES && !kept.iter().any(covered) {
            kept.push(candidate);
        }
    }
    kept
}

/// Intersection over union of two boxes.
fn overlap(a: &[f32; 4], b: &[f32; 4]) -> f32 {
    let larger = |x: f32, y: f32| if x > y { x } else { y };
    let smaller = |x: f32, y: f32| if x < y { x } else { y };
    let area = |c: &[f32; 4]| (c[2] - c[0]) * (c[3] - c[1]);
    let w = larger(0.0, smaller(a[2], b[2]) - larger(a[0], b[0]));
    let h = larger(0.0, smaller(a[3], b[3]) - larger(a[1], b[1]));
    w * h / (area(a) + area(b) - w * h)
}

/// The prototypes and where they lie.
struct Grid<'a> {
    prototypes: &'a Tensor,
    coefficients: usize,
    columns: usize,
    rows: usize,
    align: bool,
}

impl Grid<'_> {
    /// Pixels of the picture inside the box where the weighted prototypes are above 0 (a probability above one half).
    fn pixels(
        &self,
        model: &Model,
        weights: &[f32],
        corners: [f32; 4],
        placement: &Placement,
        (width, height): (usize, usize),
    ) -> Vec<u32> {
        let input = &model.description.input;
        let extents = [(input.width, self.columns, width), (input.height, self.rows, height)];
        // Pixels whose centre is in the box, with their place on the grid.
        let inside = |axis: usize| -> Vec<(usize, Between)> {
            let (input, points, pixels) = extents[axis];
            let place = |at: usize| {
                let u = placement.to_input(axis, at as f32);
                let centre = u + 0.5;
                let between = || Between::new(on_grid(u, input, points, self.align), points);
                (centre >= corners[axis] && centre < corners[axis + 2]).then(|| (at, between()))
            };
            (0..pixels).filter_map(place).collect()
        };
        let (columns, rows) = (inside(0), inside(1));
        let (Some((_, left)), Some((_, top))) = (columns.first(), rows.first()) else { return Vec::new() };
        let (Some((_, right)), Some((_, bottom))) = (columns.last(), rows.last()) else { return Vec::new() };
        let logits = self.logits(weights, [left.low, top.low, right.high, bottom.high]);
        let mut pixels = Vec::new();
        for (y, row) in &rows {
            for (x, column) in &columns {
                if bilinear(&logits, self.columns, *column, *row) > 0.0 {
                    pixels.push((y * width + x) as u32);
                }
            }
        }
        pixels
    }

    /// Weighted prototypes within a window of the grid (its last column and row included), 0 elsewhere.
    fn logits(&self, weights: &[f32], [left, top, right, bottom]: [usize; 4]) -> Vec<f32> {
        let plane = self.columns * self.rows;
        let mut logits = vec![0.0; plane];
        for row in top..=bottom {
            let line = row * self.columns + left..row * self.columns + right + 1;
            for (c, weight) in weights.iter().enumerate().take(self.coefficients) {
                let prototype = &self.prototypes.data[c * plane..][line.clone()];
                for (sum, value) in logits[line.clone()].iter_mut().zip(prototype) {
                    *sum += weight * value;
                }
            }
        }
        logits
    }
}
