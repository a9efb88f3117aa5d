//! Curves over time.

use re_sdk_types::archetypes;
use re_sdk_types::{SerializedComponentBatch, components};

use super::{Rgba, check_len, color, sealed, serialized};
use crate::RrdError;

/// Values of the curves of one entity at one time; NaN leaves a gap.
#[derive(Clone, Copy, Debug, Default)]
pub struct Scalars<'a> {
    /// One value a curve, in the order of [`SeriesLines::names`].
    pub values: &'a [f64],
}

impl sealed::Components for Scalars<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        Ok(serialized(&archetypes::Scalars::new(self.values.iter().copied())))
    }
}

/// Style of the curves of one entity: log it [`crate::At::Static`] at the same entity.
#[derive(Clone, Copy, Debug, Default)]
pub struct SeriesLines<'a> {
    /// One name a curve.
    pub names: &'a [&'a str],
    /// One colour a curve, or none.
    pub colors: &'a [Rgba],
    /// Line widths in UI points: one a curve, one for all, or none.
    pub widths: &'a [f32],
}

impl sealed::Components for SeriesLines<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        check_len(entity, "colours", self.colors.len(), self.names.len())?;
        check_len(entity, "widths", self.widths.len(), self.names.len())?;
        let lines = archetypes::SeriesLines::update_fields()
            .with_names(self.names.iter().copied())
            .with_colors(self.colors.iter().map(color))
            .with_widths(self.widths.iter().map(|width| components::StrokeWidth((*width).into())));
        Ok(serialized(&lines))
    }
}
