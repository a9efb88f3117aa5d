//! What is wrong with depth in the same way everywhere, as a linear fit to what is left between depth and pixels.
//!
//! A measured depth minus the one that pixels have is, to first order,
//!
//! ```text
//! offset + scale z - shift . slope - delay (dz/dt - slope . du/dt)
//! ```
//!
//! with the depth z, its slope in the depth image, and how fast z and the pixel u of that point change as the camera moves: a
//! depth picture that lies too far right shows each pixel what is to the left of it, and one that comes late shows what was there
//! before. Pixels know distances to a factor only, so the scale is each keyframe's own and is told to nobody.
//!
//! Residuals of one keyframe, and of the keyframes around it, err together (by the poses), so the spread within the fit says
//! little about its error. It is found by leaving out one stretch of the run after the other (a block jackknife: Kuensch,
//! Annals of Statistics 1989).

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};
use slam_math::float;

/// Unknowns: offset, shift to the right, shift down, delay.
const UNKNOWNS: usize = 4;
const PAIRS: usize = UNKNOWNS * (UNKNOWNS + 1) / 2;
/// Stretches of the run at most. When there are more, two neighbours become one: memory is bounded, and they stay of one length.
const BLOCKS: usize = 16;
/// Keyframes from which on the jackknife means something. A sequence of 9 s has 15 to 40.
const MIN_KEYFRAMES: u32 = 16;
/// Comparisons that a keyframe must have, or its own scale takes all that they say.
const MIN_RESIDUALS: f64 = 15.0;
/// Residuals from which on they say anything.
const MIN_COUNT: f64 = 300.0;
/// One comparison of depth with pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Measured depth minus that by pixels, metres.
    pub difference_m: f64,
    /// Its standard deviation, metres.
    pub sigma_m: f64,
    /// Measured depth, metres.
    pub depth_m: f64,
    /// How the depth image changes here to the right and down, metres a pixel.
    pub slope: [f64; 2],
    /// How fast the depth of this point changes, metres a second.
    pub depth_rate: f64,
    /// How fast its pixel moves, pixels a second.
    pub pixel_rate: [f64; 2],
}

impl Residual {
    fn row(&self) -> SVector<f64, UNKNOWNS> {
        let [gx, gy] = self.slope;
        let rate = self.depth_rate - gx * self.pixel_rate[0] - gy * self.pixel_rate[1];
        SVector::from([1.0, -gx, -gy, -rate])
    }
}

/// Normal equations of one stretch of the run.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Normal {
    /// Residuals.
    count: f64,
    /// Keyframes they come from.
    keyframes: u32,
    /// Upper triangle, row after row.
    information: [f64; PAIRS],
    pull: [f64; UNKNOWNS],
}

impl Normal {
    /// Those of one keyframe, whatever its scale.
    #[must_use]
    pub fn of(residuals: &[Residual]) -> Self {
        let mut normal = Self { keyframes: 1, ..Self::default() };
        let (mut along, mut depths, mut pull) = (SVector::<f64, UNKNOWNS>::zeros(), 0.0, 0.0);
        for residual in residuals {
            let weight = 1.0 / (residual.sigma_m * residual.sigma_m);
            let row = residual.row();
            normal.push(&row, residual.difference_m, weight);
            along += row * (weight * residual.depth_m);
            depths += weight * residual.depth_m * residual.depth_m;
            pull += weight * residual.depth_m * residual.difference_m;
        }
        if normal.count < MIN_RESIDUALS {
            return Self::default();
        }
        // What the scale of the keyframe could explain as well is taken out (Schur complement).
        let count = normal.count;
        normal.push(&(along / depths), pull / depths, -depths);
        Self { count, ..normal }
    }

    fn push(&mut self, row: &SVector<f64, UNKNOWNS>, value: f64, weight: f64) {
        let mut k = 0;
        for i in 0..UNKNOWNS {
            for j in i..UNKNOWNS {
                self.information[k] += weight * row[i] * row[j];
                k += 1;
            }
            self.pull[i] += weight * row[i] * value;
        }
        self.count += 1.0;
    }

    fn add(&mut self, other: &Self, sign: f64) {
        self.count += sign * other.count;
        self.keyframes += other.keyframes;
        self.information.iter_mut().zip(&other.information).for_each(|(a, b)| *a += sign * b);
        self.pull.iter_mut().zip(&other.pull).for_each(|(a, b)| *a += sign * b);
    }

    fn solve(&self) -> Option<SVector<f64, UNKNOWNS>> {
        let mut matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut k = 0;
        for i in 0..UNKNOWNS {
            for j in i..UNKNOWNS {
                (matrix[(i, j)], matrix[(j, i)]) = (self.information[k], self.information[k]);
                k += 1;
            }
        }
        // Unknowns differ in size by their units; with ones on the diagonal Cholesky finds what can't be told apart.
        let size = matrix.diagonal().map(f64::sqrt);
        if size.iter().any(|size| *size <= 0.0) {
            return None;
        }
        let scaled = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_fn(|i, j| matrix[(i, j)] / (size[i] * size[j]));
        let pull = SVector::<f64, UNKNOWNS>::from(self.pull).component_div(&size);
        Some(scaled.cholesky()?.solve(&pull).component_div(&size))
    }
}

/// A number with its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimated {
    /// The number.
    pub value: f64,
    /// Standard error.
    pub sigma: f64,
}

impl Estimated {
    /// Whether it is other than nothing beyond doubt, and large enough to matter.
    #[must_use]
    pub fn is_told(&self, sigmas: f64, least: f64) -> bool {
        self.value.abs() > sigmas * self.sigma && self.value.abs() > least
    }
}

/// Standard errors from which on a number is told: there are three times four of them in a run, and few stretches.
const TOLD_SIGMAS: f64 = 4.0;
/// Less is not told, as rendered worlds without any such fault show up to half as much and more: -2.6 px in one (demo with an
/// offset), 41 mm for a while in another (unseen 2), 13 ms. Windows of a short run share most of their keyframes, and the
/// standard error doesn't know what all have in common.
const TOLD_SHIFT_PX: f64 = 3.0;
const TOLD_OFFSET_M: f64 = 0.05;
const TOLD_DELAY_S: f64 = 0.03;

impl Miscalibration {
    /// What a user should know, each with a number that stays the same.
    pub fn told(&self) -> impl Iterator<Item = (u8, String)> {
        let Self { offset_m, shift_right_px, shift_down_px, delay_s, .. } = *self;
        let one = |number: u8, what: Estimated, least, factor: f64, words: [&str; 2], unit| {
            let side = words[usize::from(what.value < 0.0)];
            let (size, sigma) = (factor * what.value.abs(), factor * what.sigma);
            let text = format!("depth {side} by {size:.1} {unit}, give or take {sigma:.1} {unit}");
            what.is_told(TOLD_SIGMAS, least).then_some((number, text))
        };
        let sides = [
            ["lies too far right against colour", "lies too far left against colour"],
            ["lies too far down against colour", "lies too far up against colour"],
        ];
        [
            one(0, offset_m, TOLD_OFFSET_M, 1e3, ["is too long", "is too short"], "mm"),
            one(1, shift_right_px, TOLD_SHIFT_PX, 1.0, sides[0], "px"),
            one(2, shift_down_px, TOLD_SHIFT_PX, 1.0, sides[1], "px"),
            one(3, delay_s, TOLD_DELAY_S, 1e3, ["is older than colour", "is newer than colour"], "ms"),
        ]
        .into_iter()
        .flatten()
    }
}

/// What the fit says.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Miscalibration {
    /// Comparisons it comes from.
    pub comparisons: f64,
    /// Added to every depth, metres.
    pub offset_m: Estimated,
    /// By which the depth picture lies too far right, pixels.
    pub shift_right_px: Estimated,
    /// By which it lies too far down, pixels.
    pub shift_down_px: Estimated,
    /// By which depth is older than the picture, seconds.
    pub delay_s: Estimated,
}

impl std::fmt::Display for Miscalibration {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let one = |what: Estimated, factor: f64| format!("{:.1} +- {:.1}", factor * what.value, factor * what.sigma);
        write!(
            f,
            "offset {} mm, shift against colour {} px right and {} px down, delay {} ms, by {} comparisons with pixels",
            one(self.offset_m, 1e3),
            one(self.shift_right_px, 1.0),
            one(self.shift_down_px, 1.0),
            one(self.delay_s, 1e3),
            self.comparisons
        )
    }
}

/// The whole run so far, stretch by stretch.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct DepthFit {
    blocks: [Normal; BLOCKS],
    used: u32,
    /// Keyframes of a full stretch, less one.
    longer_by: u32,
}

impl DepthFit {
    /// Adds a keyframe.
    pub fn add(&mut self, keyframe: &Normal) {
        if keyframe.count == 0.0 {
            return;
        }
        let last = (self.used as usize).checked_sub(1);
        match last.filter(|last| self.blocks[*last].keyframes <= self.longer_by) {
            Some(last) => self.blocks[last].add(keyframe, 1.0),
            None => {
                if self.used as usize == BLOCKS {
                    self.halve();
                }
                self.blocks[self.used as usize] = *keyframe;
                self.used += 1;
            }
        }
    }

    /// Two neighbours become one stretch.
    fn halve(&mut self) {
        for i in 0..BLOCKS / 2 {
            let mut both = self.blocks[2 * i];
            both.add(&self.blocks[2 * i + 1], 1.0);
            self.blocks[i] = both;
        }
        self.blocks[BLOCKS / 2..].fill(Normal::default());
        self.used = (BLOCKS / 2) as u32;
        self.longer_by = 2 * self.longer_by + 1;
    }

    /// What all stretches say, and by their disagreement how surely. None while they are too few, or can't tell the
    /// unknowns apart.
    #[must_use]
    pub fn solve(&self) -> Option<Miscalibration> {
        let blocks = &self.blocks[..self.used as usize];
        let mut all = Normal::default();
        blocks.iter().for_each(|block| all.add(block, 1.0));
        if all.keyframes < MIN_KEYFRAMES || all.count < MIN_COUNT {
            return None;
        }
        let values = all.solve()?;
        let (mut mean, mut squares) = (SVector::<f64, UNKNOWNS>::zeros(), SVector::<f64, UNKNOWNS>::zeros());
        for block in blocks {
            let mut rest = all;
            rest.add(block, -1.0);
            let without = rest.solve()? - values;
            mean += without;
            squares += without.component_mul(&without);
        }
        let n = blocks.len() as f64;
        let mean = mean / n;
        let variance = (squares - mean.component_mul(&mean) * n) * ((n - 1.0) / n);
        let told = |i: usize| Estimated { value: values[i], sigma: float::max(0.0, variance[i]).sqrt() };
        Some(Miscalibration {
            comparisons: all.count,
            offset_m: told(0),
            shift_right_px: told(1),
            shift_down_px: told(2),
            delay_s: told(3),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use slam_math::Rng;

    /// Keyframes of a camera whose depth is wrong in all four ways, each with a scale of its own.
    fn run(keyframes: u32, wrong: [f64; UNKNOWNS]) -> DepthFit {
        let mut fit = DepthFit::default();
        for keyframe in 0..keyframes {
            let mut rng = Rng::at(1, keyframe, 0, 0);
            let scale = 0.02 * rng.normal();
            let residuals: Vec<Residual> = (0..60)
                .map(|_| {
                    let mut residual = Residual {
                        difference_m: 0.0,
                        sigma_m: 0.01,
                        depth_m: 1.0 + 3.0 * rng.uniform(),
                        slope: [0.008 * rng.normal(), 0.008 * rng.normal()],
                        depth_rate: 0.2 * rng.normal(),
                        pixel_rate: [100.0 * rng.normal(), 100.0 * rng.normal()],
                    };
                    let explained = residual.row().dot(&SVector::from(wrong));
                    residual.difference_m = explained + scale * residual.depth_m + 0.01 * rng.normal();
                    residual
                })
                .collect();
            fit.add(&Normal::of(&residuals));
        }
        fit
    }

    #[test]
    fn what_is_wrong_is_found_within_its_error_and_told() {
        let wrong = [0.08, 5.0, -4.0, 0.05];
        let found = run(100, wrong).solve().unwrap();
        let all = [found.offset_m, found.shift_right_px, found.shift_down_px, found.delay_s];
        for (estimated, wrong) in all.iter().zip(wrong) {
            assert!((estimated.value - wrong).abs() < 4.0 * estimated.sigma, "{estimated:?} for {wrong}");
            assert!(estimated.sigma < wrong.abs() / 5.0, "{estimated:?} for {wrong}");
        }
        let told: Vec<_> = found.told().collect();
        assert_eq!(told.iter().map(|(number, _)| *number).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert!(told[1].1.starts_with("depth lies too far right against colour by 5.0"), "{}", told[1].1);
        assert!(told[2].1.starts_with("depth lies too far up against colour by 4.0"), "{}", told[2].1);
    }

    #[test]
    fn nothing_wrong_is_not_told() {
        let found = run(100, [0.0; UNKNOWNS]).solve().unwrap();
        assert_eq!(found.told().count(), 0, "{found:?}");
        assert!(found.offset_m.sigma > 0.0 && found.offset_m.value.abs() < 4.0 * found.offset_m.sigma, "{found:?}");
    }

    #[test]
    fn a_scale_alone_is_no_fault_and_a_short_run_says_nothing() {
        assert_eq!(run(MIN_KEYFRAMES - 1, [0.03, 2.0, 0.0, 0.0]).solve(), None);
        let few = [Residual {
            difference_m: 1.0,
            sigma_m: 0.01,
            depth_m: 1.0,
            slope: [0.0; 2],
            depth_rate: 0.0,
            pixel_rate: [0.0; 2],
        }; 3];
        let mut fit = DepthFit::default();
        fit.add(&Normal::of(&few));
        assert_eq!(fit, DepthFit::default(), "a keyframe with few comparisons has no say");
    }

    #[test]
    fn memory_is_bounded_and_no_keyframe_is_lost() {
        let fit = run(500, [0.0; UNKNOWNS]);
        assert!(fit.used as usize <= BLOCKS);
        assert_eq!(fit.blocks.iter().map(|block| block.keyframes).sum::<u32>(), 500);
        assert_eq!(fit.solve().unwrap().comparisons, 500.0 * 60.0);
    }
}
