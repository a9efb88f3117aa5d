//! End-to-end panoptic networks that give class logits and mask logits a query (DETR, MaskFormer, Mask2Former).

use crate::description::{Activation, Merge, Model, NoObject};
use crate::grid::{Between, bilinear, on_grid};
use crate::mask::{Claim, Mask};
use crate::tensor::argmax;
use crate::{Placement, Tensor};
use schemas::msg::Category;
use schemas::panoptic::VOID_CLASS;

/// A query that found something.
struct Found<'a> {
    /// None for a class that is ignored.
    category: Option<&'a Category>,
    score: f32,
    logits: &'a [f32],
}

/// The picture's labels: each pixel belongs to the query with the largest product of score and mask probability, if that
/// probability is at least one half; a query that keeps too little of its own mask is dropped; stuff of one class is one
/// segment.
pub fn panoptic(
    model: &Model,
    classes: &Tensor,
    masks: &Tensor,
    placement: &Placement,
    (width, height): (usize, usize),
) -> Result<Mask, String> {
    let wanted = "a panoptic-queries model gives [1, queries, classes (+ 1)] and [1, queries, h, w]";
    let shapes = || format!("outputs have shapes {:?} and {:?}; {wanted}", classes.shape, masks.shape);
    let (Some([queries, logits]), Some([planes, rows, columns])) = (classes.extents(), masks.extents()) else {
        return Err(shapes());
    };
    let real = logits - usize::from(model.description.output.no_object != NoObject::None);
    if queries != planes || real == 0 {
        return Err(shapes());
    }
    if let Some(channel) = model.channels.iter().find(|channel| channel.index >= real) {
        return Err(format!("has {real} classes, but class {} is described", channel.index));
    }
    let found: Vec<Found<'_>> = (0..queries)
        .filter_map(|query| {
            let (class, score) = class_of(model, &classes.data[query * logits..][..logits])?;
            let category =
                model.channels.iter().find(|channel| channel.index == class).map(|channel| &channel.category);
            let logits = &masks.data[query * rows * columns..][..rows * columns];
            (score >= model.description.merge.score).then_some(Found { category, score, logits })
        })
        .collect();
    let input = &model.description.input;
    let align = model.description.output.align_corners;
    let axis = |axis: usize, pixels: usize, input: usize, points: usize| -> Vec<Between> {
        let place = |at: usize| on_grid(placement.to_input(axis, at as f32), input, points, align);
        (0..pixels).map(|at| Between::new(place(at), points)).collect()
    };
    let (xs, ys) = (axis(0, width, input.width, columns), axis(1, height, input.height, rows));
    let owner = owners(&found, &xs, &ys, columns, model.description.merge.visible);
    Ok(labelled(&model.description.merge, &found, owner, width))
}

/// The likeliest class of a query and its score; none if that is "no object".
fn class_of(model: &Model, logits: &[f32]) -> Option<(usize, f32)> {
    let output = &model.description.output;
    let (best, top) = argmax(logits.iter().copied())?;
    let score = match output.activation {
        Activation::None => top,
        Activation::Sigmoid => sigmoid(top),
        Activation::Softmax => 1.0 / logits.iter().map(|logit| libm::expf(logit - top)).sum::<f32>(),
    };
    let class = match output.no_object {
        NoObject::Last if best + 1 == logits.len() => return None,
        NoObject::First => best.checked_sub(1)?,
        NoObject::Last | NoObject::None => best,
    };
    Some((class, score))
}

fn sigmoid(logit: f32) -> f32 {
    1.0 / (1.0 + libm::expf(-logit))
}

/// For each pixel the number of its query plus one; 0 for none.
fn owners(found: &[Found<'_>], xs: &[Between], ys: &[Between], columns: usize, visible: f32) -> Vec<u16> {
    let mut owner = Vec::with_capacity(xs.len() * ys.len());
    let mut own = vec![0_u32; found.len()]; // pixels of the query's mask, whoever gets them
    let mut won = vec![0_u32; found.len()];
    for y in ys {
        for x in xs {
            let mut best = (0_u16, 0.0, false);
            for (number, query) in found.iter().enumerate() {
                let probability = sigmoid(bilinear(query.logits, columns, *x, *y));
                let inside = probability >= 0.5;
                own[number] += u32::from(inside);
                if query.score * probability > best.1 {
                    best = (number as u16 + 1, query.score * probability, inside);
                }
            }
            let (number, _, inside) = best;
            if inside {
                won[usize::from(number) - 1] += 1;
            }
            owner.push(if inside { number } else { 0 });
        }
    }
    let hidden = |number: u16| {
        let query = usize::from(number) - 1;
        (won[query] as f32) < visible * own[query] as f32
    };
    owner.iter_mut().filter(|number| **number > 0 && hidden(**number)).for_each(|number| *number = 0);
    owner
}

/// Stuff becomes one segment a class; ignored classes and segments that are too small become void.
fn labelled(merge: &Merge, found: &[Found<'_>], mut owner: Vec<u16>, width: usize) -> Mask {
    let is_stuff = |query: &Found<'_>| query.category.is_some_and(|category| !category.is_thing);
    let first_of_class = |number: usize| {
        let query = &found[number];
        let same = |other: &Found<'_>| is_stuff(query) && other.category == query.category;
        found.iter().position(same).unwrap_or(number)
    };
    let heads: Vec<usize> = (0..found.len()).map(first_of_class).collect();
    let mut areas = vec![0_u32; found.len()];
    let member = |number: u16| usize::from(number).checked_sub(1);
    owner.iter().filter_map(|number| member(*number)).for_each(|query| areas[heads[query]] += 1);
    let kept = |query: usize| {
        let head = heads[query];
        let least = if is_stuff(&found[head]) { merge.stuff_area } else { merge.thing_area };
        found[head].category.is_some() && areas[head] >= least
    };
    for number in &mut owner {
        if let Some(query) = member(*number) {
            *number = if kept(query) { heads[query] as u16 + 1 } else { 0 };
        }
    }
    let id = |query: &Found<'_>| query.category.map_or(VOID_CLASS, |category| category.id);
    let claim = |query: &Found<'_>| Claim { category_id: id(query), score: query.score };
    Mask::from_claims(&owner, width, &found.iter().map(claim).collect::<Vec<_>>())
}
