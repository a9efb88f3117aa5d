//! Depth from a rectified pair: the same corner on the same row of both pictures (Mur-Artal and Tardos, ORB-SLAM2, T-RO
//! 2017, section III-A). Descriptors find the partner, windows of grey values the fraction of a pixel.

use slam_math::{Buffer, Buffers};

use crate::orb::{Features, Pyramid};
use crate::{GrayImage, hamming};

/// Limits of the search for partners.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoOptions {
    /// Largest Hamming distance.
    pub hamming: u32,
    /// Rows may differ by this on level 0, pixels; more on coarser levels.
    pub row_px: f64,
    /// Half side of the compared window, pixels of the level.
    pub window_px: usize,
    /// How far the window slides to either side, pixels of the level.
    pub slide_px: usize,
    /// Partners whose windows differ by more than this times the median are dropped.
    pub outlier_factor: f64,
    /// Largest disparity, pixels.
    pub max_disparity_px: f64,
}

/// One picture of a pair.
pub(crate) struct View<'a> {
    pub features: &'a Features,
    pub image: &'a GrayImage,
    pub pyramid: &'a Pyramid,
}

impl View<'_> {
    fn level(&self, octave: u8) -> &GrayImage {
        self.pyramid.computed(self.image, usize::from(octave))
    }
}

/// Disparity of each left feature, pixels of the picture, greater than 0; `None` without a sure partner.
pub(crate) fn match_rows(
    left: &View<'_>,
    right: &View<'_>,
    scales: &[f64],
    options: &StereoOptions,
    buffers: &Buffers,
) -> Buffer<Option<f64>> {
    let rows = Rows::new(right, scales, options.row_px, buffers);
    let mut found: Buffer<Option<(f64, u32)>> = buffers.empty();
    for i in 0..left.features.len() {
        let partner = rows.partner(left.features, right.features, i, options);
        found.push(partner.and_then(|j| slide(left, right, i, j, options)));
    }
    let mut costs: Buffer<u32> = buffers.collect(found.iter().flatten().map(|(_, cost)| *cost));
    if costs.is_empty() {
        return buffers.filled(found.len(), None);
    }
    let middle = costs.len() / 2;
    let limit = options.outlier_factor * f64::from(*costs.select_nth_unstable(middle).1);
    let sure = |f: &Option<(f64, u32)>| f.filter(|(_, cost)| f64::from(*cost) <= limit).map(|(disparity, _)| disparity);
    buffers.collect(found.iter().map(sure))
}

/// Right features by the rows on which their partner may lie.
struct Rows {
    /// Row `y` owns `features[starts[y]..starts[y + 1]]`, ascending.
    starts: Buffer<usize>,
    features: Buffer<u32>,
}

impl Rows {
    fn new(right: &View<'_>, scales: &[f64], row_px: f64, buffers: &Buffers) -> Self {
        let height = right.image.height;
        let band = |j: usize| {
            let reach = row_px * scales[usize::from(right.features.octave[j])];
            let y = f64::from(right.features.pixel[j][1]);
            // Casts saturate: above the picture is row 0.
            let (first, last) = ((y - reach).ceil() as usize, (y + reach).floor() as usize);
            first..(last + 1).min(height)
        };
        let mut starts = buffers.filled(height + 1, 0);
        for j in 0..right.features.len() {
            band(j).for_each(|row| starts[row + 1] += 1);
        }
        for row in 0..height {
            starts[row + 1] += starts[row];
        }
        let mut next = starts.clone();
        let mut features = buffers.filled(starts[height], 0);
        for j in 0..right.features.len() {
            for row in band(j) {
                features[next[row]] = j as u32;
                next[row] += 1;
            }
        }
        Self { starts, features }
    }

    /// The right feature that looks most like left feature `i`: on its row, on its level or the next ones, not to the
    /// right of it. Ties go to the smaller index.
    fn partner(&self, left: &Features, right: &Features, i: usize, options: &StereoOptions) -> Option<usize> {
        let [x, y] = left.pixel[i].map(f64::from);
        let row = (y + 0.5).floor() as usize;
        let candidates = self.features.get(*self.starts.get(row)?..*self.starts.get(row + 1)?)?;
        let mut best = (options.hamming + 1, 0);
        for &j in candidates {
            let j = j as usize;
            let disparity = x - f64::from(right.pixel[j][0]);
            let near_level = left.octave[i].abs_diff(right.octave[j]) <= 1;
            if !near_level || disparity < 0.0 || disparity > options.max_disparity_px {
                continue;
            }
            let distance = hamming(&left.descriptor[i], &right.descriptor[j]);
            if distance < best.0 {
                best = (distance, j);
            }
        }
        (best.0 <= options.hamming).then_some(best.1)
    }
}

/// Slides a window of the left level along the row of the right one around the partner, and takes the vertex of the
/// parabola through the least difference and its neighbours. Returns disparity and least difference.
fn slide(left: &View<'_>, right: &View<'_>, i: usize, j: usize, options: &StereoOptions) -> Option<(f64, u32)> {
    let octave = left.features.octave[i];
    let (a, b) = (left.level(octave), right.level(octave));
    let ratio = left.image.width as f64 / a.width as f64;
    // The level pixel in which a position of the picture lies.
    let on_level = |pixel: f32, ratio: f64| ((f64::from(pixel) + 0.5) / ratio).floor() as i64;
    let [x, y] = left.features.pixel[i];
    let (x_left, row) = (on_level(x, ratio), on_level(y, left.image.height as f64 / a.height as f64));
    let x_right = on_level(right.features.pixel[j][0], ratio);
    let (w, reach) = (options.window_px as i64, options.slide_px as i64);
    let inside = |x: i64, reach: i64| x - reach - w >= 0 && x + reach + w < a.width as i64;
    if row - w < 0 || row + w >= a.height as i64 || !inside(x_left, 0) || !inside(x_right, reach) {
        return None;
    }
    let cost = |shift: i64| difference(a, b, [x_left, x_right + shift], row, w);
    let best = (-reach..=reach).map(|shift| (cost(shift), shift)).min()?;
    if best.1.abs() == reach {
        return None;
    }
    let [before, at, after] = [best.1 - 1, best.1, best.1 + 1].map(|shift| f64::from(cost(shift)));
    let curvature = before + after - 2.0 * at;
    let offset = if curvature > 0.0 { (before - after) / (2.0 * curvature) } else { 0.0 };
    // Both pictures have one scale, so positions on the level differ as on the picture but for the ratio.
    let disparity = ((x_left - x_right - best.1) as f64 - offset) * ratio;
    (disparity > 0.0 && disparity <= options.max_disparity_px).then_some((disparity, best.0))
}

/// Sum of absolute differences of two windows of half side `w`, each taken against its own mean: the cameras may expose
/// differently. In units of `1 / pixels` grey levels, which keeps the sum whole.
fn difference(a: &GrayImage, b: &GrayImage, x: [i64; 2], row: i64, w: i64) -> u32 {
    let line = |image: &GrayImage, x: i64, y: i64| -> std::ops::Range<usize> {
        let start = y as usize * image.width + (x - w) as usize;
        start..start + (2 * w + 1) as usize
    };
    let mut sums = [0i32; 2];
    for y in row - w..=row + w {
        sums[0] += a.data[line(a, x[0], y)].iter().map(|v| i32::from(*v)).sum::<i32>();
        sums[1] += b.data[line(b, x[1], y)].iter().map(|v| i32::from(*v)).sum::<i32>();
    }
    let (pixels, step) = ((2 * w + 1) as i32 * (2 * w + 1) as i32, sums[0] - sums[1]);
    let mut total = 0;
    for y in row - w..=row + w {
        let pairs = a.data[line(a, x[0], y)].iter().zip(&b.data[line(b, x[1], y)]);
        total += pairs.map(|(p, q)| ((i32::from(*p) - i32::from(*q)) * pixels - step).unsigned_abs()).sum::<u32>();
    }
    total
}
