//! Picture files at the border of a folder.

use schemas::Stamp;
use schemas::calibration::CameraModel;
use schemas::msg::{encoding, format};

use super::ExportError;
use crate::log::EncodedImage;

/// Depth that colourised pictures show, from red to blue; metres.
const NEAR_M: f64 = 0.3;
const FAR_M: f64 = 8.0;

/// A picture file and its extension: the log's own bytes, or a PNG of raw pixels.
pub(super) fn file(
    stamp: Stamp,
    image: EncodedImage,
    camera: &CameraModel,
) -> Result<(&'static str, Vec<u8>), ExportError> {
    match image.format.as_str() {
        format::PNG => Ok(("png", image.bytes)),
        format::JPEG | "jpg" => Ok(("jpg", image.bytes)),
        encoding::RGB8 => Ok(("png", rgb8(stamp, camera.width, camera.height, &image.bytes)?)),
        other => Err(ExportError::Picture { stamp, reason: format!("format `{other}` is neither png nor jpeg") }),
    }
}

/// An 8-bit RGB PNG.
pub(super) fn rgb8(stamp: Stamp, width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, ExportError> {
    encode(width, height, png::ColorType::Rgb, png::BitDepth::Eight, pixels).map_err(|e| failed(stamp, &e))
}

/// A 16-bit grey PNG.
pub(super) fn gray16(stamp: Stamp, width: u32, pixels: &[u16]) -> Result<Vec<u8>, ExportError> {
    let height = pixels.len().checked_div(width as usize).unwrap_or(0) as u32;
    let bytes: Vec<u8> = pixels.iter().flat_map(|p| p.to_be_bytes()).collect();
    encode(width, height, png::ColorType::Grayscale, png::BitDepth::Sixteen, &bytes).map_err(|e| failed(stamp, &e))
}

fn failed(stamp: Stamp, error: &png::EncodingError) -> ExportError {
    ExportError::Picture { stamp, reason: error.to_string() }
}

/// Fast rather than small; always the same bytes.
fn encode(
    width: u32,
    height: u32,
    color: png::ColorType,
    depth: png::BitDepth,
    pixels: &[u8],
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(pixels)?;
    writer.finish()?;
    Ok(bytes)
}

/// A colour for a category: neighbouring ids look different, void is black, and no id ever changes its colour.
pub(crate) fn category_color(id: u16) -> [u8; 3] {
    if id == schemas::panoptic::VOID_CLASS {
        return [0; 3];
    }
    // Steps of the golden ratio around the colour wheel, in two brightnesses.
    let hue = (u32::from(id) * 949) % 1536;
    let (sector, rise) = (hue / 256, (hue % 256) as u8);
    let full = match sector {
        0 => [255, rise, 0],
        1 => [255 - rise, 255, 0],
        2 => [0, 255, rise],
        3 => [0, 255 - rise, 255],
        4 => [rise, 0, 255],
        _ => [255, 0, 255 - rise],
    };
    let dark = u16::from(id.is_multiple_of(2));
    full.map(|v: u8| ((u16::from(v) * (3 - dark) + 64 * 3) / 4).min(255) as u8)
}

/// Red is near, blue far, black unknown.
pub(crate) fn depth_color(metres: f64) -> [u8; 3] {
    if metres <= 0.0 {
        return [0; 3];
    }
    let far = ((metres - NEAR_M) / (FAR_M - NEAR_M)).clamp(0.0, 1.0);
    let hue = (far * 1023.0) as u32; // four of the wheel's six sectors
    let rise = (hue % 256) as u8;
    match hue / 256 {
        0 => [255, rise, 0],
        1 => [255 - rise, 255, 0],
        2 => [0, 255, rise],
        _ => [0, 255 - rise, 255],
    }
}

/// RGB pixels to draw on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Canvas {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue; rows joined.
    pub data: Vec<u8>,
}

impl Canvas {
    /// One colour everywhere.
    pub fn new(width: usize, height: usize, color: [u8; 3]) -> Self {
        Self { width, height, data: color.repeat(width * height) }
    }

    /// Draws `source` shrunk (by averaging) into the box at (`x`, `y`) of `width` x `height` pixels, as far as it fits.
    pub fn draw(&mut self, source: &Self, x: usize, y: usize, width: usize, height: usize) {
        for row in 0..height.min(self.height.saturating_sub(y)) {
            for column in 0..width.min(self.width.saturating_sub(x)) {
                let to = ((y + row) * self.width + x + column) * 3;
                let rows = row * source.height / height
                    ..((row + 1) * source.height / height).max(row * source.height / height + 1);
                let from = column * source.width / width;
                let columns = from..((column + 1) * source.width / width).max(from + 1);
                let mut sums = [0_u32; 3];
                let mut count = 0;
                for r in rows.clone().take_while(|r| *r < source.height) {
                    for c in columns.clone().take_while(|c| *c < source.width) {
                        let at = (r * source.width + c) * 3;
                        for (sum, value) in sums.iter_mut().zip(&source.data[at..at + 3]) {
                            *sum += u32::from(*value);
                        }
                        count += 1;
                    }
                }
                for (channel, sum) in sums.iter().enumerate().filter(|_| count > 0) {
                    self.data[to + channel] = ((sum + count / 2) / count) as u8;
                }
            }
        }
    }

    /// As a PNG file.
    ///
    /// # Errors
    /// Sizes that do not fit the pixels.
    pub fn to_png(&self) -> Result<Vec<u8>, ExportError> {
        rgb8(Stamp(0), self.width as u32, self.height as u32, &self.data)
    }
}
