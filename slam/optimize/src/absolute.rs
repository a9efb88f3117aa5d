//! Rigid motion or similarity between two point clouds with outliers: three points a sample (Umeyama 1991, Horn 1987),
//! refined on what agrees.

use nalgebra::Vector3;
use slam_math::{Rng, Se3, Sim3, align};

use crate::ransac::samples_needed;

/// Refinements of one model; each one must win inliers.
const LOCAL_STEPS: u32 = 5;

/// Budget of [`absolute_orientation_ransac`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AbsoluteOptions {
    /// Probability with which a sample without outliers is drawn before the search ends early.
    pub confidence: f64,
    /// Most samples.
    pub max_iterations: u32,
    /// A motion that fewer pairs agree with is no answer.
    pub min_inliers: usize,
}

impl Default for AbsoluteOptions {
    fn default() -> Self {
        Self { confidence: 0.99, max_iterations: 300, min_inliers: 10 }
    }
}

/// The motion `target_from_source` that most pairs agree with, and who agrees.
///
/// Points are paired by position, metres. `agrees(i, moved)` decides whether pair `i` is an inlier when its source point
/// comes to lie at `moved` in the target frame: compare with `target[i]` by the pair's own noise, or project it. `None`
/// when the slices differ in length or no motion has enough inliers. Pairs with numbers that are not finite are outliers.
#[must_use]
pub fn absolute_orientation_ransac(
    rng: &mut Rng,
    source: &[Vector3<f64>],
    target: &[Vector3<f64>],
    agrees: impl Fn(usize, &Vector3<f64>) -> bool,
    options: &AbsoluteOptions,
) -> Option<(Se3, Vec<bool>)> {
    let agrees = |i: usize, motion: &Sim3| agrees(i, &motion.transform(&source[i]));
    similarity_ransac(rng, source, target, false, agrees, options).map(|(motion, inlier)| (motion.se3, inlier))
}

/// As [`absolute_orientation_ransac`], with the scale free where asked for. `agrees(i, target_from_source)` decides whether
/// pair `i` is an inlier of a similarity.
#[must_use]
pub fn similarity_ransac(
    rng: &mut Rng,
    source: &[Vector3<f64>],
    target: &[Vector3<f64>],
    with_scale: bool,
    agrees: impl Fn(usize, &Sim3) -> bool,
    options: &AbsoluteOptions,
) -> Option<(Sim3, Vec<bool>)> {
    if source.len() != target.len() {
        return None;
    }
    let finite = |p: &Vector3<f64>| p.iter().all(|v| v.is_finite());
    let pairs: Vec<usize> = (0..source.len()).filter(|&i| finite(&source[i]) && finite(&target[i])).collect();
    let search = Search { source, target, pairs: &pairs, with_scale, agrees };
    let mut best: Option<(Sim3, Vec<usize>)> = None;
    let mut needed = options.max_iterations;
    let mut drawn = 0;
    while drawn < needed {
        drawn += 1;
        let sample = rng.sample::<3>(pairs.len())?.map(|i| pairs[i]);
        let Some(model) = search.fit_sample(sample) else { continue };
        let inliers = search.inliers(&model);
        if inliers.len() < 3 || best.as_ref().is_some_and(|(_, most)| inliers.len() <= most.len()) {
            continue;
        }
        let refined = search.refine(model, inliers);
        let share = refined.1.len() as f64 / pairs.len() as f64;
        needed = samples_needed(share, 3, options.confidence, options.max_iterations);
        best = Some(refined);
    }
    let (model, inliers) = best.filter(|(_, inliers)| inliers.len() >= options.min_inliers)?;
    let mut flags = vec![false; source.len()];
    for i in inliers {
        flags[i] = true;
    }
    Some((model, flags))
}

struct Search<'a, F> {
    source: &'a [Vector3<f64>],
    target: &'a [Vector3<f64>],
    /// Pairs that take part.
    pairs: &'a [usize],
    with_scale: bool,
    agrees: F,
}

impl<F: Fn(usize, &Sim3) -> bool> Search<'_, F> {
    /// As [`Search::fit`], without lists: hundreds of samples are tried.
    fn fit_sample(&self, sample: [usize; 3]) -> Option<Sim3> {
        let (source, target) = (sample.map(|i| self.source[i]), sample.map(|i| self.target[i]));
        align::umeyama(&source, &target, self.with_scale).filter(Sim3::is_finite)
    }

    fn fit(&self, pairs: &[usize]) -> Option<Sim3> {
        let source: Vec<_> = pairs.iter().map(|&i| self.source[i]).collect();
        let target: Vec<_> = pairs.iter().map(|&i| self.target[i]).collect();
        align::umeyama(&source, &target, self.with_scale).filter(Sim3::is_finite)
    }

    fn inliers(&self, model: &Sim3) -> Vec<usize> {
        let agree = |i: &usize| (self.agrees)(*i, model);
        self.pairs.iter().copied().filter(agree).collect()
    }

    /// Fits all inliers again as long as that wins more; the last fit that did not lose any is kept.
    fn refine(&self, model: Sim3, inliers: Vec<usize>) -> (Sim3, Vec<usize>) {
        let mut best = (model, inliers);
        for _ in 0..LOCAL_STEPS {
            let Some(model) = self.fit(&best.1) else { break };
            let inliers = self.inliers(&model);
            if inliers.len() < best.1.len() {
                break;
            }
            let settled = inliers == best.1;
            best = (model, inliers);
            if settled {
                break;
            }
        }
        best
    }
}
