//! What is done after the last frame.

use serde::{Deserialize, Serialize};

use super::ranges::Check;

sections! {
    /// After the last frame.
    FinalConfig {
        /// Find the whole path again in the whole map.
        enabled: bool,
        /// Iterations of bundle adjustment in a round at most.
        iterations: u32,
        /// Rounds of bundle adjustment, each with the observations that fit by then.
        rounds: u32,
        /// Factors on the information of measured depth to try, ascending.
        depth_weights: Vec<f64>,
        /// Share by which pixels may fit worse than under the best of them.
        depth_slack: f64,
        /// Frames whose matches are remembered, the newest.
        max_frames: usize,
        /// Matches remembered of a frame.
        max_matches: usize,
        /// Matches, and inliers among them, that a frame's new pose needs.
        min_inliers: usize,
    }
}

impl FinalConfig {
    pub(super) fn checks(&self) -> [Check; 7] {
        let f = self;
        [
            ("final.iterations", f64::from(f.iterations), (1..=1000).contains(&f.iterations), "1 to 1000"),
            ("final.rounds", f64::from(f.rounds), (1..=100).contains(&f.rounds), "1 to 100"),
            (
                "final.depth_weights",
                f.depth_weights.len() as f64,
                !f.depth_weights.is_empty() && f.depth_weights.iter().all(|w| *w > 0.0 && *w <= 1e6),
                "at least one factor, all in (0, 1000000]",
            ),
            ("final.depth_slack", f.depth_slack, (0.0..=1.0).contains(&f.depth_slack), "0 to 1"),
            ("final.max_frames", f.max_frames as f64, f.max_frames <= 10_000_000, "0 to 10000000"),
            ("final.max_matches", f.max_matches as f64, f.max_matches <= 65_535, "0 to 65535"),
            ("final.min_inliers", f.min_inliers as f64, f.min_inliers >= 6, "numbers from 6"),
        ]
    }
}
