//! When a region moves otherwise than the background.

use serde::{Deserialize, Serialize};

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
