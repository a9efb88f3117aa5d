//! What can be shown: one struct a kind, made of plain slices. Empty optional slices mean "the viewer's default".

mod camera;
mod plot;
mod shapes2d;
mod shapes3d;
mod text;

pub use camera::{
    ClassIds, Colormap, EncodedDepthImage, EncodedImage, ImageCodec, Pinhole, Rotation, SegmentationImage, Transform,
    ViewCoordinates,
};
pub use plot::{Scalars, SeriesLines};
pub use shapes2d::{Boxes2d, Lines2d, Points2d};
pub use shapes3d::{Lines3d, Points3d};
pub use text::{AnnotationContext, Class, Clear, Level, TextDocument, TextLog};

use re_sdk_types::{SerializedComponentBatch, components, datatypes};

use crate::RrdError;

/// Colour: sRGB and straight alpha, 0 to 255 each.
pub type Rgba = [u8; 4];

/// Half the width of a line or point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Radius {
    /// On the screen, in UI points: the same size at every zoom.
    Ui(f32),
    /// In units of the scene: metres in 3D, pixels in 2D.
    Scene(f32),
}

/// Anything [`crate::RrdWriter::log`] takes. Implemented by the structs of this crate only.
pub trait Content: sealed::Components {}

impl<T: sealed::Components> Content for T {}

pub(crate) mod sealed {
    use re_sdk_types::SerializedComponentBatch;

    use crate::RrdError;

    pub trait Components {
        /// The viewer's components for one row; `entity` is for error messages.
        fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError>;
    }
}

/// Columns of an archetype. Empty ones are left out except the first, the items themselves: an empty column is not a
/// missing one to the viewer (an empty colour column hides the colours of the classes).
fn serialized(archetype: &dyn re_sdk_types::AsComponents) -> Vec<SerializedComponentBatch> {
    let columns = archetype.as_serialized_batches();
    columns.into_iter().enumerate().filter(|(i, column)| *i == 0 || !column.array.is_empty()).map(|(_, c)| c).collect()
}

fn color(rgba: &Rgba) -> components::Color {
    let [r, g, b, a] = *rgba;
    components::Color::from_unmultiplied_rgba(r, g, b, a)
}

/// The viewer tells the two kinds of radius apart by the sign.
fn radius(radius: &Radius) -> components::Radius {
    components::Radius(datatypes::Float32(match radius {
        Radius::Ui(points) => -points.abs(),
        Radius::Scene(units) => units.abs(),
    }))
}

/// A per-item array must be empty (default), of length 1 (same for all) or of the number of items.
fn check_len(entity: &str, what: &'static str, got: usize, expected: usize) -> Result<(), RrdError> {
    if got <= 1 || got == expected {
        return Ok(());
    }
    Err(RrdError::Length { entity: entity.to_owned(), what, got, expected })
}
