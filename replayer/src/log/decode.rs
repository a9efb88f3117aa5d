//! From bytes to pixels: pure, so that any thread may do it ahead of time.

use std::io::Cursor;

use image::ImageDecoder;
use schemas::alignment::Aligner;
use schemas::calibration::CameraModel;
use schemas::msg::{Image, Segment, SegmentTable, encoding, format};
use schemas::{Stamp, panoptic};
use zune_core::bytestream::ZCursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

use super::RawFrame;
use super::open::decoded;

/// A colour picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue; rows joined.
    pub data: Vec<u8>,
}

/// A depth image registered to the colour picture, of the same size.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthPixels {
    /// Its own stamp.
    pub stamp: Stamp,
    /// Row-major depth along the optical axis; 0 = no measurement.
    pub units: Vec<u16>,
    /// Value of one metre.
    pub units_per_metre: f64,
}

/// Labels of the colour picture, of the same size.
#[derive(Debug, Clone, PartialEq)]
pub struct MaskPixels {
    /// Category id a pixel, 0 = unknown.
    pub class: Vec<u16>,
    /// Segment id a pixel, 0 = unknown.
    pub instance: Vec<u16>,
    /// Ids ascending.
    pub segments: Vec<Segment>,
}

/// Pixels of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodedFrame {
    /// Position on the timeline.
    pub index: usize,
    /// Of the colour picture.
    pub stamp: Stamp,
    /// The colour picture, in the camera's size.
    pub rgb: RgbImage,
    /// The right picture of a stereo camera, in the same size.
    pub right: Option<RgbImage>,
    /// Paired depth.
    pub depth: Option<DepthPixels>,
    /// Segmentation of the timeline's layer.
    pub mask: Option<MaskPixels>,
}

/// A frame's bytes could not be decoded.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("frame {index} at {stamp} s: {reason}")]
pub struct DecodeError {
    /// Position on the timeline.
    pub index: usize,
    /// Of the colour picture.
    pub stamp: Stamp,
    /// Which image, and what is wrong with it.
    pub reason: String,
}

/// Decodes a frame. Every image must have the camera's size.
///
/// # Errors
/// A damaged or unsupported picture, or another size.
pub fn decode(raw: &RawFrame, camera: &CameraModel) -> Result<DecodedFrame, DecodeError> {
    let error = |reason| DecodeError { index: raw.index, stamp: raw.stamp, reason };
    let size = (camera.width as usize, camera.height as usize);
    let data = color(&raw.color.format, &raw.color.bytes, size).map_err(|r| error(format!("colour picture: {r}")))?;
    let right = match &raw.right {
        None => None,
        Some(image) => {
            let data = color(&image.format, &image.bytes, size).map_err(|r| error(format!("right picture: {r}")))?;
            Some(RgbImage { width: size.0, height: size.1, data })
        }
    };
    let depth = match &raw.depth {
        None => None,
        Some(message) => {
            let depth = match &raw.aligner {
                None => pixels(message, size),
                Some(aligner) => registered(message, aligner),
            };
            let (stamp, units) = depth.map_err(|r| error(format!("depth image: {r}")))?;
            Some(DepthPixels { stamp, units, units_per_metre: raw.units_per_metre })
        }
    };
    let mask = mask_of(raw, camera).map_err(error)?;
    let rgb = RgbImage { width: size.0, height: size.1, data };
    Ok(DecodedFrame { index: raw.index, stamp: raw.stamp, rgb, right, depth, mask })
}

/// A frame's labels alone.
pub(crate) fn mask_of(raw: &RawFrame, camera: &CameraModel) -> Result<Option<MaskPixels>, String> {
    raw.mask.as_ref().map(|messages| mask(messages, (camera.width as usize, camera.height as usize))).transpose()
}

impl MaskPixels {
    /// The first pixel or segment that breaks the rules of masks; `categories` are the layer's ids, ascending.
    pub(crate) fn contradiction(&self, categories: &[u16]) -> Option<String> {
        let unknown = self.segments.iter().find(|s| categories.binary_search(&s.category_id).is_err());
        if let Some(segment) = unknown {
            return Some(format!("segment {} has category {}, which the layer lacks", segment.id, segment.category_id));
        }
        let mut last = (panoptic::VOID_INSTANCE, panoptic::VOID_CLASS); // a run of equal pixels is looked up once
        for (pixel, (&instance, &class)) in self.instance.iter().zip(&self.class).enumerate() {
            if (instance, class) == last {
                continue;
            }
            last = (instance, class);
            let segment =
                self.segments.binary_search_by_key(&instance, |s| s.id).ok().map(|i| self.segments[i].category_id);
            let void = instance == panoptic::VOID_INSTANCE && class == panoptic::VOID_CLASS;
            if !void && segment != Some(class) {
                return Some(format!(
                    "pixel {pixel} has class {class} and segment {instance}, which the table tells otherwise"
                ));
            }
        }
        None
    }
}

pub(crate) fn mask([class, instance, segments]: &[Vec<u8>; 3], size: (usize, usize)) -> Result<MaskPixels, String> {
    let (_, class) = pixels(class, size).map_err(|r| format!("class image: {r}"))?;
    let (_, instance) = pixels(instance, size).map_err(|r| format!("instance image: {r}"))?;
    let mut segments = decoded::<SegmentTable>(segments).map_err(|r| format!("segment table: {r}"))?.segments;
    segments.sort_by_key(|segment| segment.id);
    if let Some(pair) = segments.windows(2).find(|pair| pair[0].id == pair[1].id) {
        return Err(format!("segment table: id {} stands twice", pair[0].id));
    }
    Ok(MaskPixels { class, instance, segments })
}

/// Pixels of a depth, class or instance image.
pub(crate) fn pixels(message: &[u8], size: (usize, usize)) -> Result<(Stamp, Vec<u16>), String> {
    let image: Image<'_> = decoded(message)?;
    check_size((image.width as usize, image.height as usize), size)?;
    Ok((image.header.stamp.into(), image.pixels_u16().map_err(|error| error.to_string())?))
}

/// Native depth as the colour camera sees it.
fn registered(message: &[u8], aligner: &Aligner) -> Result<(Stamp, Vec<u16>), String> {
    let image: Image<'_> = decoded(message)?;
    let native = image.pixels_u16().map_err(|error| error.to_string())?;
    let units = aligner.align(&native).map_err(|error| error.to_string())?;
    Ok((image.header.stamp.into(), units))
}

fn check_size(found: (usize, usize), wanted: (usize, usize)) -> Result<(), String> {
    if found == wanted {
        return Ok(());
    }
    Err(format!("{}x{} pixels where the calibration says {}x{}", found.0, found.1, wanted.0, wanted.1))
}

/// RGB bytes of a picture file. The size is checked before pixels are allocated.
pub(crate) fn color(kind: &str, bytes: &[u8], size: (usize, usize)) -> Result<Vec<u8>, String> {
    match kind {
        format::PNG => png(bytes, size),
        encoding::RGB8 if bytes.len() == size.0 * size.1 * 3 => Ok(bytes.to_vec()),
        encoding::RGB8 => Err(format!("{} bytes of raw pixels where {}x{}x3 are needed", bytes.len(), size.0, size.1)),
        format::JPEG | "jpg" => jpeg(bytes, size),
        other => Err(format!("format `{other}` is not known (png, jpeg)")),
    }
}

fn png(bytes: &[u8], size: (usize, usize)) -> Result<Vec<u8>, String> {
    let text = |error: image::ImageError| error.to_string();
    let decoder = image::codecs::png::PngDecoder::new(Cursor::new(bytes)).map_err(text)?;
    let (width, height) = decoder.dimensions();
    check_size((width as usize, height as usize), size)?;
    Ok(image::DynamicImage::from_decoder(decoder).map_err(text)?.into_rgb8().into_raw())
}

fn jpeg(bytes: &[u8], size: (usize, usize)) -> Result<Vec<u8>, String> {
    // Kernels chosen by the CPU are off by the crate's features, see the workspace's Cargo.toml: the same pixels everywhere.
    let options = DecoderOptions::new_safe().set_use_unsafe(false).jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|error| format!("{error:?}"))?;
    check_size(decoder.dimensions().unwrap_or_default(), size)?;
    let pixels = decoder.decode().map_err(|error| format!("{error:?}"))?;
    if pixels.len() != size.0 * size.1 * 3 {
        return Err(format!("{} bytes of pixels where {} are needed", pixels.len(), size.0 * size.1 * 3));
    }
    Ok(pixels)
}
