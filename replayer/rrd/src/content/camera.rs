//! Frames, cameras and what they see.

use re_sdk_types::archetypes;
use re_sdk_types::{SerializedComponentBatch, components, datatypes};

use super::{Rgba, color, sealed, serialized};
use crate::RrdError;

/// Which way the axes of an entity point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewCoordinates {
    /// x right, y down, z forward: cameras, and worlds that start at a camera.
    RightDownForward,
    /// Right-handed, z up: mocap rooms and robots.
    RightHandZUp,
}

impl sealed::Components for ViewCoordinates {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        Ok(serialized(&match self {
            Self::RightDownForward => archetypes::ViewCoordinates::RDF(),
            Self::RightHandZUp => archetypes::ViewCoordinates::RIGHT_HAND_Z_UP(),
        }))
    }
}

/// An ideal camera (axes: right, down, forward). Images logged below its entity are drawn on its image plane.
#[derive(Clone, Copy, Debug)]
pub struct Pinhole {
    /// Focal length along x, pixels.
    pub fx: f64,
    /// Focal length along y, pixels.
    pub fy: f64,
    /// Principal point x, pixels.
    pub cx: f64,
    /// Principal point y, pixels.
    pub cy: f64,
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// Distance at which the image plane is drawn, metres.
    pub image_plane_distance: f32,
    /// Colour of the frustum's lines.
    pub color: Option<Rgba>,
}

impl sealed::Components for Pinhole {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        // Columns, not rows.
        let image_from_camera = datatypes::Mat3x3::from([
            [self.fx as f32, 0.0, 0.0],
            [0.0, self.fy as f32, 0.0],
            [self.cx as f32, self.cy as f32, 1.0],
        ]);
        let mut pinhole = archetypes::Pinhole::new(image_from_camera)
            .with_resolution([self.width as f32, self.height as f32])
            .with_camera_xyz(components::ViewCoordinates::RDF)
            .with_image_plane_distance(self.image_plane_distance);
        if let Some(rgba) = &self.color {
            pinhole = pinhole.with_color(color(rgba));
        }
        Ok(serialized(&pinhole))
    }
}

/// A rotation, parent from entity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotation {
    /// Unit quaternion `[x, y, z, w]`.
    Quaternion([f64; 4]),
    /// Rotation matrix, row by row.
    Matrix([[f64; 3]; 3]),
}

/// Pose of an entity in its parent's frame: `parent_from_entity`, for a camera below a world `world_from_camera`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Origin of the entity in the parent's frame, metres.
    pub translation: [f64; 3],
    /// Rotation, parent from entity.
    pub rotation: Rotation,
}

impl sealed::Components for Transform {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let transform = archetypes::Transform3D::update_fields().with_translation(self.translation.map(|x| x as f32));
        Ok(serialized(&match self.rotation {
            Rotation::Quaternion(xyzw) => {
                transform.with_quaternion(datatypes::Quaternion::from_xyzw(xyzw.map(|x| x as f32)))
            }
            Rotation::Matrix(rows) => {
                let columns = [0, 1, 2].map(|column| rows.map(|row| row[column] as f32));
                transform.with_mat3x3(datatypes::Mat3x3::from(columns))
            }
        }))
    }
}

/// How the bytes of an image are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageCodec {
    /// Portable network graphics.
    Png,
    /// JPEG.
    Jpeg,
}

/// A colour or grey image as a file's bytes.
#[derive(Clone, Copy, Debug)]
pub struct EncodedImage<'a> {
    /// The whole file.
    pub bytes: &'a [u8],
    /// What it is.
    pub codec: ImageCodec,
    /// 0 (invisible) to 1 (opaque).
    pub opacity: Option<f32>,
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for EncodedImage<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let media_type = match self.codec {
            ImageCodec::Png => components::MediaType::PNG,
            ImageCodec::Jpeg => components::MediaType::JPEG,
        };
        let mut image = archetypes::EncodedImage::new(self.bytes.to_vec()).with_media_type(media_type);
        if let Some(opacity) = self.opacity {
            image = image.with_opacity(opacity);
        }
        if let Some(order) = self.draw_order {
            image = image.with_draw_order(order);
        }
        Ok(serialized(&image))
    }
}

/// Colours for depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colormap {
    /// Rainbow: most detail.
    Turbo,
    /// Dark blue to yellow, even for the eye.
    Viridis,
    /// Black to white.
    Grayscale,
}

/// A depth image as the bytes of a 16-bit grey PNG. Zero means no measurement.
#[derive(Clone, Copy, Debug)]
pub struct EncodedDepthImage<'a> {
    /// The whole PNG file.
    pub png: &'a [u8],
    /// Pixel value of one metre, e.g. 1000 or 5000.
    pub units_per_metre: f32,
    /// How depth is shown.
    pub colormap: Colormap,
    /// Depths shown by the ends of the colormap, metres; by default the image's own range, which flickers.
    pub range_m: Option<[f32; 2]>,
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for EncodedDepthImage<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let colormap = match self.colormap {
            Colormap::Turbo => components::Colormap::Turbo,
            Colormap::Viridis => components::Colormap::Viridis,
            Colormap::Grayscale => components::Colormap::Grayscale,
        };
        let mut image = archetypes::EncodedDepthImage::new(self.png.to_vec())
            .with_media_type(components::MediaType::PNG)
            .with_meter(self.units_per_metre)
            .with_colormap(colormap);
        if let Some([near, far]) = self.range_m {
            let scale = f64::from(self.units_per_metre);
            image = image.with_depth_range([f64::from(near) * scale, f64::from(far) * scale]);
        }
        if let Some(order) = self.draw_order {
            image = image.with_draw_order(order);
        }
        Ok(serialized(&image))
    }
}

/// Class of every pixel, row by row.
#[derive(Clone, Copy, Debug)]
pub enum ClassIds<'a> {
    /// Up to 256 classes.
    U8(&'a [u8]),
    /// Up to 65536 classes.
    U16(&'a [u16]),
}

/// An image of class ids, coloured by the [`super::AnnotationContext`] above it.
#[derive(Clone, Copy, Debug)]
pub struct SegmentationImage<'a> {
    /// Width, pixels.
    pub width: u32,
    /// Height, pixels.
    pub height: u32,
    /// `width * height` classes.
    pub classes: ClassIds<'a>,
    /// 0 (invisible) to 1 (opaque).
    pub opacity: Option<f32>,
    /// Higher is drawn later, on top.
    pub draw_order: Option<f32>,
}

impl sealed::Components for SegmentationImage<'_> {
    fn components(&self, entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let (bytes, kind, got) = match self.classes {
            ClassIds::U8(ids) => (ids.to_vec(), datatypes::ChannelDatatype::U8, ids.len()),
            ClassIds::U16(ids) => {
                (ids.iter().flat_map(|id| id.to_le_bytes()).collect(), datatypes::ChannelDatatype::U16, ids.len())
            }
        };
        let expected = self.width as usize * self.height as usize;
        if got != expected {
            return Err(RrdError::Length { entity: entity.to_owned(), what: "pixels", got, expected });
        }
        let format = datatypes::ImageFormat::segmentation([self.width, self.height], kind);
        let mut image = archetypes::SegmentationImage::new(bytes, format);
        if let Some(opacity) = self.opacity {
            image = image.with_opacity(opacity);
        }
        if let Some(order) = self.draw_order {
            image = image.with_draw_order(order);
        }
        Ok(serialized(&image))
    }
}
