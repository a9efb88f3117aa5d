//! Networks that give scores a class and pixel.

use crate::compose::Stuff;
use crate::description::Model;
use crate::grid::{Between, bilinear, on_grid};
use crate::tensor::argmax;
use crate::{Placement, Tensor};

/// Each pixel's category; none where its class is ignored, or where a person is too likely. Channels of one category are one.
pub fn stuff(
    model: &Model,
    scores: &Tensor,
    placement: &Placement,
    (width, height): (usize, usize),
) -> Result<Stuff, String> {
    let Some([classes, rows, columns]) = scores.extents() else {
        return Err(format!("output has shape {:?}; a semantic model gives [1, classes, h, w]", scores.shape));
    };
    let described = model.channels.iter().map(|channel| channel.index).chain(model.description.classes.person.clone());
    if let Some(index) = described.into_iter().find(|index| *index >= classes) {
        return Err(format!("has {classes} classes, but class {index} is described"));
    }
    let input = &model.description.input;
    let align = model.description.output.align_corners;
    let axis = |axis: usize, pixels: usize, input: usize, points: usize| -> Vec<Between> {
        let place = |at: usize| on_grid(placement.to_input(axis, at as f32), input, points, align);
        (0..pixels).map(|at| Between::new(place(at), points)).collect()
    };
    let (xs, ys) = (axis(0, width, input.width, columns), axis(1, height, input.height, rows));
    let mut labels = vec![0_u16; classes];
    let mut categories: Vec<u16> = model.channels.iter().map(|channel| channel.category.id).collect();
    categories.sort_unstable();
    categories.dedup();
    for channel in &model.channels {
        labels[channel.index] = categories.partition_point(|id| *id < channel.category.id) as u16 + 1;
    }
    let merge = &model.description.merge;
    let margin = |class: usize| {
        let is_person = model.description.classes.person.contains(&class);
        (labels[class] == 0).then_some(if is_person { merge.person_margin } else { 0.0 })
    };
    let margins: Vec<Option<f32>> = (0..classes).map(margin).collect();
    let stillness = (merge.stuff_margin > 0.0).then(|| stillness(&scores.data, columns * rows, &labels));
    let is_still = |x: Between, y: Between| {
        stillness.as_ref().is_none_or(|plane| bilinear(plane, columns, x, y) >= merge.stuff_margin)
    };
    let cells = Cells { scores: &scores.data, columns, rows, margins: &margins };
    let mut found = Vec::with_capacity(width * height);
    for y in &ys {
        let mut cell = None;
        for x in &xs {
            if cell.as_ref().is_none_or(|(low, high, _)| (*low, *high) != (x.low, x.high)) {
                cell = Some((x.low, x.high, cells.rivals([x.low, x.high], [y.low, y.high])));
            }
            let rivals = cell.as_ref().map_or(&[][..], |(.., rivals)| rivals);
            let class = label(rivals, *x, *y).filter(|class| labels[*class] != 0 && is_still(*x, *y));
            found.push(class.map_or(0, |class| labels[class]));
        }
    }
    Ok(Stuff { labels: found, categories, least_area: merge.stuff_area })
}

/// By grid point, the logarithm of the odds that it is stuff of any kind: whether it is table or floor is another question, and
/// a network that cannot tell those apart has no doubt that the thing stands still.
fn stillness(scores: &[f32], plane: usize, labels: &[u16]) -> Vec<f32> {
    let odds = |at: usize| {
        let score = |class: usize| scores[class * plane + at];
        let highest = (0..labels.len()).map(score).fold(f32::NEG_INFINITY, |a, b| if b > a { b } else { a });
        let mut sums = [0.0_f32; 2];
        for (class, label) in labels.iter().enumerate() {
            sums[usize::from(*label != 0)] += libm::expf(score(class) - highest);
        }
        // Without a finite score nothing is known; without an ignored channel everything is stuff.
        libm::logf(sums[1]) - libm::logf(sums[0])
    };
    (0..plane).map(odds).collect()
}

/// A class that may win or object somewhere in a cell, with its scores at the four corners.
struct Rival {
    class: usize,
    /// How far it must be behind for another class to win; none for stuff.
    margin: Option<f32>,
    corners: [f32; 4],
}

struct Cells<'a> {
    scores: &'a [f32],
    columns: usize,
    rows: usize,
    /// By class, as in [`Rival`].
    margins: &'a [Option<f32>],
}

impl Cells<'_> {
    /// The classes that may win or object between these grid points: all but those that a winner of a corner leaves behind by
    /// their margin at all four (and so everywhere between). It saves interpolating all 150 classes at each pixel.
    fn rivals(&self, xs: [usize; 2], ys: [usize; 2]) -> Vec<Rival> {
        let plane = self.columns * self.rows;
        let corners = [(xs[0], ys[0]), (xs[1], ys[0]), (xs[0], ys[1]), (xs[1], ys[1])];
        let corners = corners.map(|(x, y)| y * self.columns + x);
        let scores = |class: usize| corners.map(|at| self.scores[class * plane + at]);
        let classes = self.margins.len();
        let winners = corners.map(|at| argmax((0..classes).map(|class| self.scores[class * plane + at])));
        let winners = winners.map(|winner| winner.map(|(class, _)| class));
        let left_behind = |class: usize| {
            let (own, margin) = (scores(class), self.margins[class].unwrap_or(0.0));
            let beats = |winner: usize| scores(winner).iter().zip(own).all(|(w, o)| *w >= o + margin);
            !winners.contains(&Some(class)) && winners.iter().flatten().any(|winner| beats(*winner))
        };
        let rival = |class: usize| Rival { class, margin: self.margins[class], corners: scores(class) };
        (0..classes).filter(|class| !left_behind(*class)).map(rival).collect()
    }
}

/// The class of one pixel; none where another one that is no stuff is too near behind it.
fn label(rivals: &[Rival], x: Between, y: Between) -> Option<usize> {
    let score = |rival: &Rival| {
        let [a, b, c, d] = rival.corners;
        y.mix(x.mix(a, b), x.mix(c, d))
    };
    let scores = || rivals.iter().map(score);
    let (place, best) = argmax(scores())?;
    let objects = |(rival, score): (&Rival, f32)| rival.margin.is_some_and(|margin| score > best - margin);
    (!rivals.iter().zip(scores()).any(objects)).then(|| rivals[place].class)
}
