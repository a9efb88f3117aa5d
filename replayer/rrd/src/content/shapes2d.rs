//! Shapes in image pixels: (0, 0) is the outer corner of the top left pixel, whose centre is (0.5, 0.5); x right, y down.

use re_sdk_types::SerializedComponentBatch;
use re_sdk_types::archetypes;

use super::{Radius, Rgba, check_len, color, radius, sealed, serialized};
use crate::RrdError;

/// Points in an image.
#[derive(Clone, Copy, Debug, Default)]
pub struct Points2d<'a> {
    /// Pixel coordinates (x, y).
    pub positions: &'a [[f32; 2]],
    /// Colours: none, one for all, or one a point. They win over the colours of `class_ids`.
    pub colors: &'a [Rgba],
    /// Classes of the [`super::AnnotationContext`]: none, one for all, or one a point.
    pub class_ids: &'a [u16],
    /// Radii: none, one for all, or one a point.
    pub radii: &'a [Radius],
    /// Texts: none, one for all, or one a point. Shown beside the points only when there are few of them.
    pub labels: &'a [String],
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for Points2d<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let n = self.positions.len();
        check_len(entity, "colours", self.colors.len(), n)?;
        check_len(entity, "class ids", self.class_ids.len(), n)?;
        check_len(entity, "radii", self.radii.len(), n)?;
        check_len(entity, "labels", self.labels.len(), n)?;
        let mut points = archetypes::Points2D::update_fields()
            .with_positions(self.positions.iter().copied())
            .with_colors(self.colors.iter().map(color))
            .with_class_ids(self.class_ids.iter().copied())
            .with_radii(self.radii.iter().map(radius))
            .with_labels(self.labels.iter().map(String::as_str));
        if let Some(order) = self.draw_order {
            points = points.with_draw_order(order);
        }
        Ok(serialized(&points))
    }
}

/// Axis-aligned rectangles in an image.
#[derive(Clone, Copy, Debug, Default)]
pub struct Boxes2d<'a> {
    /// `[x_min, y_min, width, height]` in pixels.
    pub boxes: &'a [[f32; 4]],
    /// Texts: none, one for all, or one a box. Always shown.
    pub labels: &'a [String],
    /// Classes of the [`super::AnnotationContext`]: none, one for all, or one a box.
    pub class_ids: &'a [u16],
    /// Colours: none, one for all, or one a box. They win over the colours of `class_ids`.
    pub colors: &'a [Rgba],
    /// Half line widths: none, one for all, or one a box.
    pub radii: &'a [Radius],
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for Boxes2d<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let n = self.boxes.len();
        check_len(entity, "labels", self.labels.len(), n)?;
        check_len(entity, "class ids", self.class_ids.len(), n)?;
        check_len(entity, "colours", self.colors.len(), n)?;
        check_len(entity, "radii", self.radii.len(), n)?;
        let mut boxes = archetypes::Boxes2D::update_fields()
            .with_centers(self.boxes.iter().map(|[x, y, w, h]| [x + w / 2.0, y + h / 2.0]))
            .with_half_sizes(self.boxes.iter().map(|[_, _, w, h]| [w / 2.0, h / 2.0]))
            .with_labels(self.labels.iter().map(String::as_str))
            .with_class_ids(self.class_ids.iter().copied())
            .with_colors(self.colors.iter().map(color))
            .with_radii(self.radii.iter().map(radius))
            .with_show_labels(!self.labels.is_empty());
        if let Some(order) = self.draw_order {
            boxes = boxes.with_draw_order(order);
        }
        Ok(serialized(&boxes))
    }
}

/// Polylines in an image.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lines2d<'a> {
    /// Each line's corners in pixels.
    pub strips: &'a [Vec<[f32; 2]>],
    /// Colours: none, one for all, or one a line.
    pub colors: &'a [Rgba],
    /// Half line widths: none, one for all, or one a line.
    pub radii: &'a [Radius],
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for Lines2d<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        check_len(entity, "colours", self.colors.len(), self.strips.len())?;
        check_len(entity, "radii", self.radii.len(), self.strips.len())?;
        let mut lines = archetypes::LineStrips2D::update_fields()
            .with_strips(self.strips.iter().map(|strip| strip.iter().copied()))
            .with_colors(self.colors.iter().map(color))
            .with_radii(self.radii.iter().map(radius));
        if let Some(order) = self.draw_order {
            lines = lines.with_draw_order(order);
        }
        Ok(serialized(&lines))
    }
}
