//! Shapes in space, in metres.

use re_sdk_types::SerializedComponentBatch;
use re_sdk_types::archetypes;

use super::{Radius, Rgba, check_len, color, radius, sealed, serialized};
use crate::RrdError;

/// Points in space.
#[derive(Clone, Copy, Debug, Default)]
pub struct Points3d<'a> {
    /// Positions in the entity's frame, metres.
    pub positions: &'a [[f32; 3]],
    /// Colours: none, one for all, or one a point. They win over the colours of `class_ids`.
    pub colors: &'a [Rgba],
    /// Classes of the [`super::AnnotationContext`]: none, one for all, or one a point.
    pub class_ids: &'a [u16],
    /// Radii: none, one for all, or one a point.
    pub radii: &'a [Radius],
    /// Texts: none, one for all, or one a point. Shown beside the points only when there are few of them.
    pub labels: &'a [String],
}

impl sealed::Components for Points3d<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let n = self.positions.len();
        check_len(entity, "colours", self.colors.len(), n)?;
        check_len(entity, "class ids", self.class_ids.len(), n)?;
        check_len(entity, "radii", self.radii.len(), n)?;
        check_len(entity, "labels", self.labels.len(), n)?;
        let points = archetypes::Points3D::update_fields()
            .with_positions(self.positions.iter().copied())
            .with_colors(self.colors.iter().map(color))
            .with_class_ids(self.class_ids.iter().copied())
            .with_radii(self.radii.iter().map(radius))
            .with_labels(self.labels.iter().map(String::as_str));
        Ok(serialized(&points))
    }
}

/// Polylines in space.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines3d<'a> {
    /// Each line's corners in the entity's frame, metres.
    pub strips: &'a [Vec<[f32; 3]>],
    /// Colours: none, one for all, or one a line.
    pub colors: &'a [Rgba],
    /// Half line widths: none, one for all, or one a line.
    pub radii: &'a [Radius],
}

impl sealed::Components for Lines3d<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        check_len(entity, "colours", self.colors.len(), self.strips.len())?;
        check_len(entity, "radii", self.radii.len(), self.strips.len())?;
        let lines = archetypes::LineStrips3D::update_fields()
            .with_strips(self.strips.iter().map(|strip| strip.iter().copied()))
            .with_colors(self.colors.iter().map(color))
            .with_radii(self.radii.iter().map(radius));
        Ok(serialized(&lines))
    }
}
