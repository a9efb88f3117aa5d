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
    let mut circle = [0; 16];
    for (offset, (x, y)) in circle.iter_mut().zip(CIRCLE) {
        *offset = y * width as isize + x;
    }
    for y in rows.0..rows.1 {
        let (first, end) = (y * width + columns.0, y * width + columns.1);
        if end - first < BLOCK {
            for at in first..end {
                score_block::<1>(image, at, circle, threshold, scores);
            }
            continue;
        }
        for at in (first..end - BLOCK).step_by(BLOCK) {
            score_block::<BLOCK>(image, at, circle, threshold, scores);
        }
        // The last block may overlap the one before it; it then writes the same values again.
        score_block::<BLOCK>(image, end - BLOCK, circle, threshold, scores);
    }
}

/// Keeps of one row of scores those that exceed all eight neighbours, and writes 0 elsewhere; of equal neighbours the
/// first in row-major order wins. The outermost pixels become 0. All slices have the same length, at least 2.
#[inline(always)]
pub(super) fn suppress_row(above: &[u8], row: &[u8], below: &[u8], out: &mut [u8]) {
    let inner = row.len() - 2;
    out[0] = 0;
    out[inner + 1] = 0;
    let [a0, a1, a2] = [&above[..inner], &above[1..][..inner], &above[2..][..inner]];
    let [r0, r1, r2] = [&row[..inner], &row[1..][..inner], &row[2..][..inner]];
    let [b0, b1, b2] = [&below[..inner], &below[1..][..inner], &below[2..][..inner]];
    for (x, out) in out[1..][..inner].iter_mut().enumerate() {
        let earlier = larger(larger(a0[x], a1[x]), larger(a2[x], r0[x]));
        let later = larger(larger(b0[x], b1[x]), larger(b2[x], r2[x]));
        *out = if (r1[x] > earlier) & (r1[x] >= later) { r1[x] } else { 0 };
    }
}

// The loops below are spelt out: closures handed to `array::map` and `array::from_fn` are compiled outside the function
// that enables the wide instructions.

#[inline(always)]
fn score_block<const N: usize>(image: &[u8], at: usize, circle: [isize; 16], threshold: u8, scores: &mut [u8]) {
    let center = Lanes::<N>::load(image, at);
    let mut ring = [center; 16];
    for k in [0, 4, 8, 12] {
        ring[k] = Lanes::load(image, at.wrapping_add_signed(circle[k]));
    }
    // Nine consecutive pixels always cover one of each two opposite pixels, so most blocks end here.
    let brightest = ring[0].max(ring[8]).min(ring[4].max(ring[12])).minus(center);
    let darkest = center.minus(ring[0].min(ring[8]).max(ring[4].min(ring[12])));
    if !brightest.max(darkest).any_above(threshold) {
        Lanes::<N>([0; N]).store(scores, at);
        return;
    }
    for k in 0..16 {
        ring[k] = Lanes::load(image, at.wrapping_add_signed(circle[k]));
    }
    let brighter = weakest_of_best_arc(&ring).minus(center);
    for pixels in &mut ring {
        *pixels = pixels.inverse();
    }
    let darker = weakest_of_best_arc(&ring).minus(center.inverse());
    // A difference of d is more than every threshold up to d - 1.
    let mut score = brighter.max(darker);
    for lane in &mut score.0 {
        *lane = if *lane > threshold { *lane - 1 } else { 0 };
    }
    score.store(scores, at);
}

/// Maximum over the 16 arcs of 9 pixels of the darkest pixel within the arc.
#[inline(always)]
fn weakest_of_best_arc<const N: usize>(ring: &[Lanes<N>; 16]) -> Lanes<N> {
    // Arcs k-1..=k+7 and k..=k+8 share the eight pixels k..=k+7; only odd k are needed to name all arcs.
    let mut fours = [Lanes([0; N]); 8];
    for (i, four) in fours.iter_mut().enumerate() {
        let k = 2 * i + 1;
        *four = ring[k].min(ring[(k + 1) % 16]).min(ring[(k + 2) % 16].min(ring[(k + 3) % 16]));
    }
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

    /// Difference, 0 where it would be negative.
    #[inline(always)]
    fn minus(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = self.0[i].saturating_sub(other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn inverse(mut self) -> Self {
        for i in 0..N {
            self.0[i] = 255 - self.0[i];
        }
        self
    }

    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] };
        }
        self
    }

    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        for i in 0..N {
            self.0[i] = larger(self.0[i], other.0[i]);
        }
        self
    }

    #[inline(always)]
    fn any_above(self, threshold: u8) -> bool {
        let mut any = 0;
        for i in 0..N {
            any |= self.0[i].saturating_sub(threshold);
        }
        any != 0
    }
}

#[inline(always)]
fn larger(a: u8, b: u8) -> u8 {
    if a > b { a } else { b }
}
