//! FAST-9 corners (Rosten, Drummond, "Machine learning for high-speed corner detection", ECCV 2006).
//!
//! A pixel is a corner at threshold t when at least 9 consecutive pixels of the 16 on a circle of radius 3 are all
//! brighter, or all darker, than the pixel by more than t. Its score is the largest such t.

/// The circle as (x, y), clockwise from the top.
pub(super) const CIRCLE: [(isize, isize); 16] = [
    (0, -3),
    (1, -3),
    (2, -2),
    (3, -1),
    (3, 0),
    (3, 1),
    (2, 2),
    (1, 3),
    (0, 3),
    (-1, 3),
    (-2, 2),
    (-3, 1),
    (-3, 0),
    (-3, -1),
    (-2, -2),
    (-1, -3),
];

/// Pixels treated at once.
const BLOCK: usize = 32;

/// Writes the score of every corner at `threshold` (at least 1), and 0 for other pixels, into the same place of
/// `scores`. `columns` and `rows` are half-open and at least 3 pixels away from the border of the `width`-wide image.
#[inline(always)]
pub(super) fn scores(
    image: &[u8],
    width: usize,
    columns: (usize, usize),
    rows: (usize, usize),
    threshold: u8,
    scores: &mut [u8],
) {
    let circle = CIRCLE.map(|(x, y)| y * width as isize + x);
    for y in rows.0..rows.1 {
        let (first, end) = (y * width + columns.0, y * width + columns.1);
        if end - first < BLOCK {
            (first..end).for_each(|at| score_block::<1>(image, at, circle, threshold, scores));
            continue;
        }
        for at in (first..end - BLOCK).step_by(BLOCK) {
            score_block::<BLOCK>(image, at, circle, threshold, scores);
        }
        // The last block may overlap the one before it; it then writes the same values again.
        score_block::<BLOCK>(image, end - BLOCK, circle, threshold, scores);
    }
}

#[inline(always)]
fn score_block<const N: usize>(image: &[u8], at: usize, circle: [isize; 16], threshold: u8, scores: &mut [u8]) {
    let load = |k: usize| Lanes::<N>::load(image, at.wrapping_add_signed(circle[k]));
    let center = Lanes::<N>::load(image, at);
    // Nine consecutive pixels always cover one of each two opposite pixels, so most blocks end here.
    let quarters = [0, 4, 8, 12].map(load);
    let needed = |difference: [Lanes<N>; 4]| {
        let [top, right, bottom, left] = difference;
        top.max(bottom).min(right.max(left))
    };
    let brighter = needed(quarters.map(|p| p.minus(center)));
    let darker = needed(quarters.map(|p| center.minus(p)));
    if !brighter.max(darker).any_above(threshold) {
        Lanes::<N>([0; N]).store(scores, at);
        return;
    }
    let ring: [Lanes<N>; 16] = std::array::from_fn(load);
    let brighter = weakest_of_best_arc(std::array::from_fn(|k| ring[k].minus(center)));
    let darker = weakest_of_best_arc(std::array::from_fn(|k| center.minus(ring[k])));
    let mut score = brighter.max(darker);
    for lane in &mut score.0 {
        // A difference of d is more than every threshold up to d - 1.
        *lane = if *lane > threshold { *lane - 1 } else { 0 };
    }
    score.store(scores, at);
}

/// Maximum over the 16 arcs of 9 pixels of the minimum within the arc.
#[inline(always)]
fn weakest_of_best_arc<const N: usize>(ring: [Lanes<N>; 16]) -> Lanes<N> {
    // Arcs k..=k+8 and k-1..=k+7 share the eight pixels k..=k+7; only odd k are needed to name all arcs.
    let pairs: [Lanes<N>; 8] = std::array::from_fn(|i| ring[2 * i + 1].min(ring[(2 * i + 2) % 16]));
    let fours: [Lanes<N>; 8] = std::array::from_fn(|i| pairs[i].min(pairs[(i + 1) % 8]));
    let mut best = Lanes([0; N]);
    for i in 0..8 {
        let eight = fours[i].min(fours[(i + 2) % 8]);
        let ninth = ring[2 * i].max(ring[(2 * i + 9) % 16]);
        best = best.max(eight.min(ninth));
    }
    best
}

/// `N` neighbouring pixels.
#[derive(Clone, Copy)]
struct Lanes<const N: usize>([u8; N]);

impl<const N: usize> Lanes<N> {
    #[inline(always)]
    fn load(image: &[u8], at: usize) -> Self {
        let mut lanes = [0; N];
        lanes.copy_from_slice(&image[at..at + N]);
        Self(lanes)
    }

    #[inline(always)]
    fn store(self, image: &mut [u8], at: usize) {
        image[at..at + N].copy_from_slice(&self.0);
    }

    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(u8, u8) -> u8) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }

    /// Difference, 0 where it would be negative.
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        self.zip(other, u8::saturating_sub)
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }

    #[inline(always)]
    fn any_above(self, threshold: u8) -> bool {
        self.0.iter().fold(0, |any, &lane| any | lane.saturating_sub(threshold)) != 0
    }
}
