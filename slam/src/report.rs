//! What the slam says about one frame: every intermediate state, in plain values.

use serde::{Deserialize, Serialize};
use slam_math::{Buffer, Digest, FrameId, KeyFrameId, MapId, MapPointId, Se3, Stamp};
use smallvec::SmallVec;

/// Tracking state after a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum TrackingState {
    /// No map yet.
    #[default]
    NotInitialized,
    /// The pose is known.
    Ok,
    /// Lost a moment ago; relocalisation is tried on every frame.
    RecentlyLost,
    /// Lost for long; a new map is started as soon as a picture allows.
    Lost,
}

/// What a keypoint lies on, by the segmentation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u8)]
pub enum KeypointClass {
    /// On Stuff: the unmovable background.
    Stuff,
    /// On a countable object.
    Thing,
    /// On no segment.
    Unknown,
    /// On a person.
    Person,
}

impl KeypointClass {
    /// What a point lies on that is seen as both: not on the background unless both say so, since a label's border is where views
    /// disagree. Of two others the first.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        if self == Self::Stuff { other } else { self }
    }
}

/// What the panoptic filter decided about a keypoint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Verdict {
    /// Used for tracking and mapping.
    Static,
    /// On a person: filtered a priori.
    Person,
    /// On a Thing that moves.
    ThingDynamic,
    /// On a Thing that has not been confirmed as static yet.
    ThingNew,
    /// On an unknown area that moves.
    UnknownDynamic,
    /// On an unknown area that has not been confirmed as static yet.
    UnknownNew,
    /// Next to a person or a mover: its patch holds pixels of both.
    Border,
    /// Its surface stands where free space was seen a moment ago.
    FreeSpace,
}

impl Verdict {
    /// All verdicts, in the order of their numbers.
    pub const ALL: [Self; 8] = [
        Self::Static,
        Self::Person,
        Self::ThingDynamic,
        Self::ThingNew,
        Self::UnknownDynamic,
        Self::UnknownNew,
        Self::Border,
        Self::FreeSpace,
    ];

    /// Short name for tables and viewers.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Person => "person",
            Self::ThingDynamic => "thing, dynamic",
            Self::ThingNew => "thing, new",
            Self::UnknownDynamic => "unknown, dynamic",
            Self::UnknownNew => "unknown, new",
            Self::Border => "border of a mover",
            Self::FreeSpace => "in free space",
        }
    }

    /// True when the filter says that the surface moves (not merely "not confirmed yet").
    #[must_use]
    pub fn is_dynamic(self) -> bool {
        matches!(self, Self::Person | Self::ThingDynamic | Self::UnknownDynamic | Self::FreeSpace)
    }
}

/// One keypoint of a frame with everything that was decided about it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeypointReport {
    /// Position in the picture as recorded (distorted), pixels.
    pub pixel: [f64; 2],
    /// Pyramid level.
    pub octave: u8,
    /// Depth in metres; 0 = none.
    pub depth_m: f64,
    /// What it lies on.
    pub class: KeypointClass,
    /// The filter's decision.
    pub verdict: Verdict,
    /// Distance to the epipolar line of its match in the last frame, pixels; NaN when unmatched or without F.
    pub epipolar_px: f64,
    /// Residual under the static hypothesis in sigmas; NaN when it was not tested.
    pub motion_sigmas: f64,
    /// Whether a map point lies on it that has stood still for long.
    pub is_vouched: bool,
    /// The map point it is matched to after tracking.
    pub point: Option<MapPointId>,
}

/// State of a tracked region of the picture (a Thing, a person, or a connected unknown area).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[repr(u8)]
pub enum RegionState {
    /// Not confirmed yet: filtered.
    New,
    /// Confirmed static: used.
    Static,
    /// Moves: filtered.
    Dynamic,
    /// A person: filtered a priori.
    Person,
}

/// One region of the picture and what is known about its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegionReport {
    /// Track id, stable over frames.
    pub track: u32,
    /// Category; 0 = unknown.
    pub category: u16,
    /// Bounding box `[x, y, width, height]`, pixels.
    pub bbox: [f64; 4],
    /// Area in pixels.
    pub area_px: u32,
    /// State after this frame.
    pub state: RegionState,
    /// Frames since the track began.
    pub age_frames: u32,
    /// Share of tested depth samples that stand in formerly free space.
    pub free_space_share: f64,
    /// Share of tested keypoints that moved.
    pub moved_share: f64,
    /// Depth samples tested.
    pub samples: u32,
    /// Keypoints tested.
    pub keypoints: u32,
    /// Whether its matched map points, all together, move otherwise than the background.
    pub disagrees: bool,
    /// Of its keypoints, those on which a map point lies that has stood still for long.
    pub vouched: u32,
}

/// How the keypoints for tracking were chosen, in falling order of preference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
#[repr(u8)]
pub enum Selection {
    /// Only keypoints judged static.
    #[default]
    Static,
    /// Too few: those not confirmed yet as well.
    WithUnconfirmed,
    /// Still too few: those beside people and movers as well.
    WithBorders,
    /// Still too few: everything but people.
    AllButPeople,
    /// No label is believed.
    Everything,
}

impl Selection {
    /// All selections in falling order of preference.
    pub const ALL: [Self; 5] =
        [Self::Static, Self::WithUnconfirmed, Self::WithBorders, Self::AllButPeople, Self::Everything];
}

/// The fundamental matrix between the last frame and this one (the paper's section III-B).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpipolarReport {
    /// Stuff matches offered to RANSAC.
    pub matches: u32,
    /// Inliers.
    pub inliers: u32,
    /// True when the matrix explains nothing (still camera or one plane) and was not used.
    pub degenerate: bool,
    /// Row-major `F`, `current^T F last = 0`; zeros when there is none.
    pub matrix: [f64; 9],
}

/// Numbers of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Keypoints found.
    pub keypoints: u32,
    /// Keypoints with the verdict static.
    pub static_keypoints: u32,
    /// Matches of the motion model (or reference keyframe) step.
    pub motion_matches: u32,
    /// Matches after local-map search.
    pub local_matches: u32,
    /// Inliers of the final pose.
    pub inliers: u32,
    /// Points of the local map offered to the search.
    pub local_points: u32,
    /// Keyframes alive.
    pub keyframes: u32,
    /// Map points alive.
    pub map_points: u32,
    /// Map points created in this frame.
    pub points_created: u32,
    /// Map points removed in this frame.
    pub points_culled: u32,
    /// Map points fused in this frame.
    pub points_fused: u32,
    /// Observations dropped by local BA.
    pub ba_outliers: u32,
}

/// Stages of a frame, in order. Each gets a digest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Stage {
    /// Keypoints, descriptors and their depth.
    Features,
    /// Region tracks and states.
    Regions,
    /// Keypoint verdicts and residuals.
    Verdicts,
    /// Keypoint to map point matches.
    Matches,
    /// Camera pose and tracking state.
    Pose,
    /// Edits of the map, in order.
    Map,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 6] = [Self::Features, Self::Regions, Self::Verdicts, Self::Matches, Self::Pose, Self::Map];

    /// Name used in records.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Features => "features",
            Self::Regions => "regions",
            Self::Verdicts => "verdicts",
            Self::Matches => "matches",
            Self::Pose => "pose",
            Self::Map => "map",
        }
    }
}

/// Digest of one stage with the field values it covers.
#[derive(Debug, Clone, PartialEq)]
pub struct StageRecord {
    /// Which stage.
    pub stage: Stage,
    /// Digest per field, in a fixed order: a difference names the field.
    pub fields: SmallVec<[FieldRecord; 6]>,
}

/// Digest of one field of a stage.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldRecord {
    /// Name of the field.
    pub name: &'static str,
    /// Digest over its canonical bytes.
    pub digest: Digest,
    /// A value a person can read: the number itself, or a count.
    pub value: FieldValue,
}

/// What a field comes to, for people.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldValue {
    /// Nothing but the digest.
    None,
    /// A number of things.
    Count(u64),
    /// Whether the camera's place is known.
    State(TrackingState),
    /// How keypoints were chosen.
    Selection(Selection),
    /// Rows of `[rotation | translation]`, `camera_from_world`.
    Pose(Option<[f64; 12]>),
    /// A keyframe.
    KeyFrame(Option<KeyFrameId>),
}

impl std::fmt::Display for FieldValue {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::None => Ok(()),
            Self::Count(count) => write!(f, "{count}"),
            Self::State(state) => write!(f, "{state:?}"),
            Self::Selection(selection) => write!(f, "{selection:?}"),
            Self::Pose(Some(rows)) => write!(f, "{rows:?}"),
            Self::Pose(None) => f.write_str("none"),
            Self::KeyFrame(keyframe) => write!(f, "{keyframe:?}"),
        }
    }
}

/// Something worth a line in the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Event {
    /// True for what a user should look at.
    pub warning: bool,
    /// The message.
    pub text: String,
}

/// Everything about one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameReport {
    /// Which frame.
    pub id: FrameId,
    /// Its sensor time.
    pub stamp: Stamp,
    /// Tracking state after the frame.
    pub state: TrackingState,
    /// The active map.
    pub map: MapId,
    /// Camera pose, when tracked.
    pub camera_from_world: Option<Se3>,
    /// Reference keyframe, when tracked.
    pub reference: Option<KeyFrameId>,
    /// The keyframe made from this frame, if any.
    pub new_keyframe: Option<KeyFrameId>,
    /// How keypoints were chosen for tracking.
    pub selection: Selection,
    /// Keypoints.
    pub keypoints: Buffer<KeypointReport>,
    /// Regions.
    pub regions: Buffer<RegionReport>,
    /// Row-major region index per 4 x 4 pixel cell (`u16::MAX` = background), width and height in cells.
    pub region_cells: (usize, usize, Buffer<u16>),
    /// Fundamental matrix.
    pub epipolar: Option<EpipolarReport>,
    /// Numbers.
    pub counts: Counts,
    /// What happened.
    pub events: Vec<Event>,
    /// Digests.
    pub records: Buffer<StageRecord>,
}

/// What the final stage did to one part of the atlas and its frames.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinalReport {
    /// Which part.
    pub map: u32,
    /// Keyframes adjusted.
    pub keyframes: usize,
    /// Map points adjusted.
    pub points: usize,
    /// Observations of these points by those keyframes.
    pub observations: usize,
    /// Of them, those that do not fit in the end and have no say.
    pub outliers: usize,
    /// Factor on the information of measured depth, as it was found out.
    pub depth_weight: f64,
    /// Linear solves of bundle adjustment.
    pub iterations: u32,
    /// Robust cost (squared normalised residuals) of the observations before and after.
    pub cost: [f64; 2],
    /// Frames whose pose was found again in the adjusted map. Keyframes are not among them: they were adjusted.
    pub refined: usize,
    /// Frames that keep their place relative to a keyframe, as too few of their matches are left or the new pose did not fit
    /// better.
    pub kept: usize,
}
