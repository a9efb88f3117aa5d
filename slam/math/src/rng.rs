//! Random numbers by coordinates: a generator is made from (seed, frame, stage, item) where it is used, so no draw
//! depends on who drew before.

/// SplitMix64 (Steele, Lea, Flood 2014), seeded by hashing its coordinates.
#[derive(Debug, Clone)]
pub struct Rng {
    state: u64,
}

const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// A generator for one item of one stage of one frame.
    #[must_use]
    pub fn at(seed: u64, frame: u32, stage: u32, item: u32) -> Self {
        let mut state = mix(seed.wrapping_add(GOLDEN_GAMMA));
        for coordinate in [frame, stage, item] {
            state = mix(state.wrapping_add(GOLDEN_GAMMA) ^ u64::from(coordinate));
        }
        Self { state }
    }

    /// 64 uniform bits.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN_GAMMA);
        mix(self.state)
    }

    /// Uniform integer in `0..bound` (`bound` > 0), by multiplication: the bias is below 2^-32 for small bounds.
    pub fn below(&mut self, bound: usize) -> usize {
        ((u128::from(self.next_u64()) * bound as u128) >> 64) as usize
    }

    /// Uniform in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Standard normal by the polar form of Box-Muller.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * crate::float::ln(1.0 - self.uniform())).sqrt();
        radius * crate::float::cos(2.0 * std::f64::consts::PI * self.uniform())
    }

    /// `N` distinct indices below `len`, in draw order; `None` when there are fewer than `N`.
    pub fn sample<const N: usize>(&mut self, len: usize) -> Option<[usize; N]> {
        if len < N {
            return None;
        }
        let mut out = [0; N];
        for i in 0..N {
            out[i] = loop {
                let candidate = self.below(len);
                if !out[..i].contains(&candidate) {
                    break candidate;
                }
            };
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_decide_the_stream() {
        let draw = |f, s, i| Rng::at(1, f, s, i).next_u64();
        assert_eq!(draw(3, 1, 2), draw(3, 1, 2));
        let streams = [draw(0, 0, 0), draw(1, 0, 0), draw(0, 1, 0), draw(0, 0, 1), Rng::at(2, 0, 0, 0).next_u64()];
        for (i, a) in streams.iter().enumerate() {
            assert!(!streams[..i].contains(a));
        }
    }

    #[test]
    fn samples_are_distinct_and_cover_the_range() {
        let mut seen = [false; 6];
        let mut rng = Rng::at(7, 0, 0, 0);
        for _ in 0..100 {
            let s: [usize; 4] = rng.sample(6).unwrap();
            for (i, a) in s.iter().enumerate() {
                assert!(!s[..i].contains(a));
                seen[*a] = true;
            }
        }
        assert_eq!(seen, [true; 6]);
        assert_eq!(rng.sample::<4>(3), None);
    }

    #[test]
    fn normal_has_unit_variance() {
        let mut rng = Rng::at(7, 0, 0, 0);
        let draws: Vec<f64> = (0..20_000).map(|_| rng.normal()).collect();
        let mean = draws.iter().sum::<f64>() / 20_000.0;
        let variance = draws.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
    }
}
