//! When a region moves otherwise than the background.

use serde::{Deserialize, Serialize};

use super::ranges::Check;

sections! {
    /// Regions against the background by matched map points.
    ConsensusConfig {
        /// Matches on background from which it fixes a pose.
        min_background: u32,
        /// Share of them that must agree with each other.
        min_inlier_share: f64,
        /// Matches from which a region is asked.
        min_matches: u32,
        /// Squared Mahalanobis distance, six degrees of freedom, from which a region disagrees.
        max_chi2: f64,
        /// Common error of neighbouring map points along each axis, share of the scene's depth.
        position_share: f64,
        /// The same as a turn, radians.
        rotation_rad: f64,
        /// Frames in a row from which a region that disagrees moves.
        frames: u32,
    }
}

impl ConsensusConfig {
    pub(super) fn checks(&self) -> [Check; 4] {
        let c = self;
        let share = "0 to 1";
        let within = |v: f64| (0.0..=1.0).contains(&v);
        [
            ("panoptic.consensus.min_inlier_share", c.min_inlier_share, within(c.min_inlier_share), share),
            ("panoptic.consensus.max_chi2", c.max_chi2, c.max_chi2 > 0.0, "numbers greater than 0"),
            ("panoptic.consensus.position_share", c.position_share, within(c.position_share), share),
            ("panoptic.consensus.rotation_rad", c.rotation_rad, within(c.rotation_rad), share),
        ]
    }
}
