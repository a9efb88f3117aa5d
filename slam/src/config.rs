//! Every constant of the slam. The defaults are the text of `default.toml`, which documents each of them; a user's
//! file overrides single keys, unknown keys are refused.

use serde::{Deserialize, Serialize};
use slam_math::float;

/// The defaults with their documentation, as `pslam config` prints them.
pub const DEFAULT_TOML: &str = include_str!("default.toml");

/// Names of the built-in presets: the rows of the paper's ablation, and the paper's own rule.
pub const PRESETS: [&str; 6] = ["full", "none", "people", "people+things", "people+unknown", "paper"];

/// Why a configuration was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The text is not TOML, or a key is unknown or of the wrong type.
    #[error("configuration: {0}")]
    Syntax(String),
    /// There is no preset of this name.
    #[error("there is no preset {name:?}; choose one of {known}")]
    Preset {
        /// What was asked for.
        name: String,
        /// What there is.
        known: String,
    },
    /// A value is outside its range.
    #[error("configuration: {key} = {value} is outside {range}")]
    Range {
        /// Key with its section.
        key: String,
        /// The refused value.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
}

macro_rules! sections {
    ($($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            $($(#[$field_doc])* pub $field: $type,)*
        }
    )*};
}

mod consensus;
mod features;
mod offline;
mod ranges;
mod sensors;

pub use consensus::ConsensusConfig;
pub use offline::FinalConfig;
pub use sensors::{MonocularConfig, SensorChoice, SensorConfig, StereoConfig};

sections! {
    /// The whole configuration, a section a stage.
    Config {
        /// Seed of every random draw.
        seed: u64,
        /// ORB features.
        orb: OrbSection,
        /// Where depth comes from, and the depth image.
        sensor: SensorConfig,
        /// Depth from two pictures.
        stereo: StereoConfig,
        /// The start with one picture at a time.
        monocular: MonocularConfig,
        /// Frame to map tracking.
        tracking: TrackingConfig,
        /// When a frame becomes a keyframe.
        keyframes: KeyframeConfig,
        /// Local mapping.
        mapping: MappingConfig,
        /// Background jobs.
        jobs: JobsConfig,
        /// After the track is lost.
        relocalization: RelocalizationConfig,
        /// Loops and the joining of maps.
        looping: LoopingConfig,
        /// The panoptic filter.
        panoptic: PanopticConfig,
        /// After the last frame.
        r#final: FinalConfig,
    }

    /// ORB features.
    OrbSection {
        /// Keypoints per picture.
        features: usize,
        /// Ratio between pyramid levels.
        scale_factor: f64,
        /// Pyramid levels.
        levels: usize,
        /// First FAST threshold, grey levels.
        fast_threshold: u8,
        /// FAST threshold where the first one finds nothing.
        fast_threshold_min: u8,
    }

    /// Frame to map tracking.
    TrackingConfig {
        /// Keypoints needed to start a map.
        min_init_keypoints: u32,
        /// Search radius of the motion model at level 0, pixels.
        motion_radius_px: f64,
        /// Matches below which the search window is doubled once.
        min_motion_matches: u32,
        /// Inliers for the motion model or reference keyframe step to count.
        min_step_inliers: u32,
        /// Inliers for a frame to be tracked.
        min_inliers: u32,
        /// Inliers for a frame to be tracked right after relocalisation.
        min_inliers_after_relocalization: u32,
        /// Frames after a relocalisation with the stricter rules.
        recent_relocalization_frames: u32,
        /// Search radius factor of local points.
        local_radius: f64,
        /// Hamming distance of a good match.
        hamming_high: u32,
        /// Hamming distance of a sure match.
        hamming_low: u32,
        /// Best over second best distance.
        ratio: f64,
        /// Keyframes of the local map at most.
        local_keyframes: usize,
        /// Inliers below which more keypoints are admitted.
        good_inliers: u32,
        /// Standard deviation of the position above which more keypoints are admitted, share of the scene's depth.
        good_sigma_share: f64,
        /// Keyframes that must observe a point before it vouches for keypoints of an unconfirmed region ...
        established_keyframes: u32,
        /// ... and frames that must have found it.
        established_frames: u32,
    }

    /// When a frame becomes a keyframe.
    KeyframeConfig {
        /// Frames between keyframes at least.
        min_interval: u32,
        /// Share of the reference keyframe's points below which a keyframe is due.
        tracked_share: f64,
        /// The same while the map has one keyframe.
        tracked_share_start: f64,
        /// Close points tracked below which a keyframe is due ...
        min_close_tracked: u32,
        /// ... or share of the close keypoints that are tracked ...
        min_close_share: f64,
        /// ... if so many close ones could be added.
        min_close_untracked: u32,
    }

    /// Local mapping.
    MappingConfig {
        /// Neighbours for triangulation and fusion.
        neighbours: usize,
        /// Second-order neighbours for fusion.
        second_neighbours: usize,
        /// Found ratio below which a young point is removed.
        min_found_ratio: f64,
        /// Weight that a young point needs.
        min_weight: u32,
        /// Keyframes for which a point is young.
        young_keyframes: u32,
        /// Fusion radius at level 0, pixels.
        fuse_radius: f64,
        /// Share of a keyframe's points seen elsewhere that makes it redundant.
        redundant_share: f64,
        /// Keyframes of local BA at most.
        ba_keyframes: usize,
        /// Iterations of local BA.
        ba_iterations: usize,
        /// Keyframes from one local BA to the next.
        ba_every: u32,
        /// Evidence of being gone after which a point is removed, frames.
        max_doubts: u32,
    }

    /// Background jobs: how many frames after its submission the result of a job takes effect.
    JobsConfig {
        /// Local mapping.
        mapping_lag_frames: u32,
        /// Search for loops, and their correction.
        loop_lag_frames: u32,
        /// Adjustment of a whole map after a correction.
        global_lag_frames: u32,
    }

    /// After the track is lost.
    RelocalizationConfig {
        /// Keypoints that a picture must have to be tried.
        min_keypoints: u32,
        /// Keyframes tried per frame.
        candidates: usize,
        /// Matches to try a candidate.
        min_matches: usize,
        /// RANSAC draws at most.
        iterations: usize,
        /// Inliers to accept.
        min_inliers: u32,
        /// Frames lost with a usable picture before a new map is started.
        frames_before_new_map: u32,
        /// Share of the points that should be visible that must be inliers.
        min_found_share: f64,
        /// Frames that must be tracked after it before one becomes a keyframe.
        frames_before_keyframe: u32,
    }

    /// Loops and the joining of maps.
    LoopingConfig {
        /// Close loops within a map. Maps are joined in any case.
        enabled: bool,
        /// File with a vocabulary of binary words to find places by, for whoever makes the slam; empty: none.
        vocabulary: String,
        /// Score by words, as a share of that of the best neighbour, below which a keyframe is no candidate.
        min_word_share: f64,
        /// Keyframes that a map needs before it is searched for loops.
        min_keyframes: usize,
        /// Places verified per keyframe, of the own map and of others each.
        candidates: usize,
        /// Votes below this share of the best place's are no candidate.
        min_vote_share: f64,
        /// The same after adding the votes of a place's neighbours.
        min_accumulated_share: f64,
        /// Covisible keyframes that make up a place.
        place_keyframes: usize,
        /// Descriptor matches to try a candidate.
        min_matches: usize,
        /// RANSAC draws at most.
        iterations: u32,
        /// Inliers of RANSAC to go on.
        min_inliers: usize,
        /// Search radius of the first guided search at level 0, pixels.
        radius_px: f64,
        /// Search radius of the second one, pixels.
        radius_refined_px: f64,
        /// Hamming distance in the guided searches.
        hamming: u32,
        /// Matches of the first guided search to go on.
        min_projected: usize,
        /// Inliers of the refined pose to go on.
        min_refined: usize,
        /// Matches of the second guided search to accept a place.
        min_final: usize,
        /// Share of the place's points that should be visible and must be found.
        min_found_share: f64,
        /// Matches for another keyframe to agree with a place.
        min_agreeing: usize,
        /// Keyframes that must agree with a place.
        coincidences: u32,
        /// Keyframes in a row that may disagree before a place is given up.
        max_misses: u32,
        /// Shared points from which an edge belongs to the essential graph.
        essential_weight: u32,
        /// Iterations on the essential graph.
        graph_iterations: u32,
        /// Keyframes on each side of the seam that are adjusted when maps are joined.
        weld_keyframes: usize,
        /// Iterations of global bundle adjustment; 0 leaves it out.
        global_iterations: u32,
    }

    /// The panoptic filter.
    PanopticConfig {
        /// Filter people a priori.
        people: bool,
        /// Judge Things.
        things: bool,
        /// Judge unknown areas.
        unknown: bool,
        /// How motion is judged.
        rule: Rule,
        /// Names of the categories that are filtered a priori.
        people_names: Vec<String>,
        /// Keypoints on Stuff at least, share of all; people get none. 0: labels change no keypoint.
        stuff_floor: f64,
        /// Short-term association.
        association: AssociationConfig,
        /// The paper's epipolar rule, and the recorded epipolar residuals.
        epipolar: EpipolarConfig,
        /// Regions against the background by matched map points.
        consensus: ConsensusConfig,
        /// The geometric rule.
        motion: MotionConfig,
    }

    /// Short-term association of regions.
    AssociationConfig {
        /// Intersection over union from which two masks are one object.
        min_iou: f64,
    }

    /// Fundamental matrix and epipolar distance.
    EpipolarConfig {
        /// Stuff matches needed for a fundamental matrix.
        min_matches: usize,
        /// RANSAC threshold, pixels.
        ransac_px: f64,
        /// RANSAC confidence.
        confidence: f64,
        /// RANSAC draws at most.
        iterations: usize,
        /// Epipolar distance from which a keypoint moves, pixels.
        distance_px: f64,
        /// Search radius for matches with the last frame, pixels; 0 = whole picture.
        radius_px: f64,
    }

    /// The geometric rule.
    MotionConfig {
        /// Ages of the frames that are compared with, frames.
        history_frames: Vec<u32>,
        /// Constant part of the free-space margin, metres.
        free_space_m: f64,
        /// Part of the free-space margin in sigmas of the depth noise.
        free_space_sigmas: f64,
        /// Share of tested samples in free space from which a region moves.
        free_space_share: f64,
        /// Samples in free space needed.
        min_samples: u32,
        /// Residual of a keypoint match from which it moved, sigmas.
        moved_sigmas: f64,
        /// Search radius for keypoint matches in older frames, pixels.
        search_px: f64,
        /// Share of the tested keypoints of a static region that seem to have moved.
        false_moved_share: f64,
        /// Standard deviations above that share from which a region moves.
        moved_confidence: f64,
        /// Consecutive frames in which keypoints alone say so from which a region moves.
        moved_frames: u32,
        /// Moved keypoints needed.
        min_moved: u32,
        /// Frames with static evidence that confirm a new region.
        confirm_frames: u32,
        /// Frames with static evidence that re-admit a region that moved.
        readmit_frames: u32,
        /// Frames with dynamic evidence that take a static region out.
        suspect_frames: u32,
        /// Margin around people and movers, pixels.
        border_px: u32,
        /// What is added to it for an octave of scale s: s - 1 times this, pixels.
        corner_px: f64,
        /// Depth step that parts two unknown areas, share of the depth.
        depth_step_share: f64,
    }
}

/// How motion is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rule {
    /// Distance to epipolar lines, per keypoint, as in the paper (section III-B).
    Paper,
    /// 3-D residuals and free space under the camera's motion, per region with hysteresis.
    Geometric,
}

impl MotionConfig {
    /// Number of moved keypoints among `keypoints` that false matches do not explain, when `around` is the share that seems
    /// to have moved of what surely stands still.
    #[must_use]
    pub fn too_many_moved(&self, keypoints: u32, around: f64) -> f64 {
        let (n, p) = (f64::from(keypoints), float::max(self.false_moved_share, around));
        n * p + self.moved_confidence * (n * p * (1.0 - p)).sqrt()
    }
}

impl Default for Config {
    fn default() -> Self {
        toml::from_str(DEFAULT_TOML).expect("default.toml is checked by a test")
    }
}

impl Config {
    /// The defaults with the keys of a TOML text replaced.
    ///
    /// # Errors
    /// Syntax errors, unknown keys, values of the wrong type or out of range.
    pub fn from_toml(text: &str) -> Result<Self, ConfigError> {
        Self::default().with_toml(text)
    }

    /// This configuration with the keys of a TOML text replaced.
    ///
    /// # Errors
    /// As [`from_toml`](Self::from_toml).
    pub fn with_toml(&self, text: &str) -> Result<Self, ConfigError> {
        let syntax = |e: &dyn std::fmt::Display| ConfigError::Syntax(e.to_string());
        let overlay: toml::Table = toml::from_str(text).map_err(|e| syntax(&e))?;
        let mut base = toml::Table::try_from(self).map_err(|e| syntax(&e))?;
        merge(&mut base, overlay);
        let config: Self = base.try_into().map_err(|e| syntax(&e))?;
        config.validate()?;
        Ok(config)
    }

    /// A built-in preset, see [`PRESETS`].
    ///
    /// # Errors
    /// When there is none of this name.
    pub fn preset(name: &str) -> Result<Self, ConfigError> {
        let mut config = Self::default();
        let p = &mut config.panoptic;
        (p.people, p.things, p.unknown) = match name {
            "full" | "paper" => (true, true, true),
            "none" => (false, false, false),
            "people" => (true, false, false),
            "people+things" => (true, true, false),
            "people+unknown" => (true, false, true),
            _ => return Err(ConfigError::Preset { name: name.into(), known: PRESETS.join(", ") }),
        };
        // Neither the paper's extractor nor one without a filter knows of labels.
        if matches!(name, "none" | "paper") {
            p.stuff_floor = 0.0;
        }
        if name == "paper" {
            p.rule = Rule::Paper;
            p.epipolar.radius_px = 0.0;
        }
        Ok(config)
    }

    /// The configuration as TOML with every key.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("plain tables and numbers")
    }
}

fn merge(base: &mut toml::Table, overlay: toml::Table) {
    for (key, value) in overlay {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(table)) => merge(inner, table),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests;
