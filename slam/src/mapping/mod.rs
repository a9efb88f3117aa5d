//! What happens after a keyframe: new points, fusion, bundle adjustment, culling. Everything by counted budgets.

mod create;
mod cull;
mod depth;
mod fuse;
mod local_ba;
mod start;
mod triangulate;
mod witness;

pub use crate::map::Editor;
pub use create::{create_points_from_depth, insert_keyframe};
pub use cull::YoungPoints;
pub use fuse::fuse_into;
pub use start::insert_two_views;

use serde::{Deserialize, Serialize};
use slam_math::KeyFrameId;

use crate::context::Context;
use crate::depth::{DepthFound, DepthView};

/// What local mapping did for one keyframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct MappingCounts {
    /// Points made by triangulation.
    pub triangulated: u32,
    /// Points fused.
    pub fused: u32,
    /// Points culled.
    pub culled: u32,
    /// Observations dropped by bundle adjustment.
    pub ba_outliers: u32,
    /// Keyframes culled.
    pub keyframes_culled: u32,
}

/// Local mapping for a keyframe that is in the map; tells too how its depths compare with what pixels say.
pub fn local_mapping(
    ctx: &Context,
    editor: &mut Editor<'_>,
    young: &mut YoungPoints,
    keyframe: KeyFrameId,
    view: &DepthView,
) -> (MappingCounts, DepthFound) {
    let culled = young.cull(ctx, editor, keyframe);
    let triangulated = triangulate::triangulate_with_neighbours(ctx, editor, young, keyframe);
    let fused = fuse::fuse_with_neighbours(ctx, editor, keyframe);
    let ba_due = local_ba::is_due(ctx, editor.map(), keyframe);
    let ba_outliers = if ba_due { local_ba::local_bundle_adjustment(ctx, editor, keyframe) } else { 0 };
    let model = depth::compare_depths(ctx, editor.map(), keyframe);
    let depth = DepthFound { model, normal: witness::witness(ctx, editor.map(), keyframe, view) };
    let keyframes_culled = cull::cull_keyframes(ctx, editor, keyframe);
    (MappingCounts { triangulated, fused, culled, ba_outliers, keyframes_culled }, depth)
}
