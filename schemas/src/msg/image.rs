//! Raw and compressed pictures. Pixel data is borrowed when decoded.

use super::Header;
use crate::message::cdr_struct;
use std::borrow::Cow;

/// Values of [`Image::encoding`] that this project writes.
pub mod encoding {
    /// Depth: 16-bit unsigned, one channel; 0 = no measurement.
    pub const DEPTH: &str = "16UC1";
    /// Red, green, blue, 8 bits each.
    pub const RGB8: &str = "rgb8";
    /// Class ids below 256.
    pub const MONO8: &str = "mono8";
    /// Class or instance ids.
    pub const MONO16: &str = "mono16";
}

/// Values of [`CompressedImage::format`] that this project writes.
pub mod format {
    /// Lossless.
    pub const PNG: &str = "png";
    /// Lossy, only when the source already was.
    pub const JPEG: &str = "jpeg";
}

cdr_struct! {
    /// `sensor_msgs/Image`: rows of raw pixels.
    pub struct Image<'a>: "sensor_msgs/msg/Image" {
        /// Stamp and optical frame (x right, y down, z forward).
        pub header: Header,
        /// Rows.
        pub height: u32,
        /// Columns.
        pub width: u32,
        /// Pixel layout, see [`mod@encoding`].
        pub encoding: String,
        /// 1 if 16-bit pixels stand high byte first.
        pub is_bigendian: u8,
        /// Bytes a row.
        pub step: u32,
        /// `step * height` bytes.
        pub data: Cow<'a, [u8]>,
    }
}

cdr_struct! {
    /// `sensor_msgs/CompressedImage`: a picture file's bytes.
    pub struct CompressedImage<'a>: "sensor_msgs/msg/CompressedImage" {
        /// Stamp and optical frame.
        pub header: Header,
        /// File format, see [`mod@format`].
        pub format: String,
        /// The file.
        pub data: Cow<'a, [u8]>,
    }
}

/// Why an image's pixels cannot be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// Another pixel layout than the caller reads.
    #[error("pixels are `{found}`, wanted {wanted}")]
    Encoding {
        /// Layout in the message.
        found: String,
        /// Layouts that the caller reads.
        wanted: &'static str,
    },
    /// Size, step and data do not fit together.
    #[error(
        "{width}x{height} pixels of {pixel_bytes} bytes with {step} bytes a row need {step} * {height} bytes, found {found}"
    )]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Bytes a pixel.
        pixel_bytes: u32,
        /// Bytes a row.
        step: u32,
        /// Bytes present.
        found: usize,
    },
}

impl<'a> Image<'a> {
    /// An image of 8-bit pixels, `width * height` of them in rows.
    #[must_use]
    pub fn from_u8(header: Header, encoding: &str, width: u32, pixels: &'a [u8]) -> Self {
        let height = pixels.len().checked_div(width as usize).unwrap_or(0) as u32;
        let data = Cow::Borrowed(pixels);
        Self { header, height, width, encoding: encoding.to_owned(), is_bigendian: 0, step: width, data }
    }

    /// An image of 16-bit pixels, `width * height` of them in rows; stored little endian.
    #[must_use]
    pub fn from_u16(header: Header, encoding: &str, width: u32, pixels: &[u16]) -> Self {
        let height = pixels.len().checked_div(width as usize).unwrap_or(0) as u32;
        let data = Cow::Owned(pixels.iter().flat_map(|p| p.to_le_bytes()).collect());
        Self { header, height, width, encoding: encoding.to_owned(), is_bigendian: 0, step: width * 2, data }
    }

    /// The pixels of a depth, class or instance image (`16UC1`, `mono16`, `mono8`, `8UC1`), rows joined without padding.
    ///
    /// # Errors
    /// Another layout, or sizes that contradict each other.
    pub fn pixels_u16(&self) -> Result<Vec<u16>, ImageError> {
        let pixel_bytes = match self.encoding.as_str() {
            "16UC1" | "mono16" => 2,
            "8UC1" | "mono8" => 1,
            _ => {
                let wanted = "16UC1, mono16, 8UC1 or mono8";
                return Err(ImageError::Encoding { found: self.encoding.clone(), wanted });
            }
        };
        let row_bytes = self.check_size(pixel_bytes)?;
        let mut pixels = Vec::with_capacity(self.width as usize * self.height as usize);
        for row in self.data.chunks_exact(self.step.max(1) as usize).take(self.height as usize) {
            let row = &row[..row_bytes];
            match (pixel_bytes, self.is_bigendian) {
                (1, _) => pixels.extend(row.iter().map(|p| u16::from(*p))),
                (_, 0) => pixels.extend(row.chunks_exact(2).map(|p| u16::from_le_bytes([p[0], p[1]]))),
                _ => pixels.extend(row.chunks_exact(2).map(|p| u16::from_be_bytes([p[0], p[1]]))),
            }
        }
        Ok(pixels)
    }

    /// Checks that size, step and data agree; returns the bytes of a row without padding.
    fn check_size(&self, pixel_bytes: u32) -> Result<usize, ImageError> {
        let row_bytes = u64::from(self.width) * u64::from(pixel_bytes);
        let total = u64::from(self.step) * u64::from(self.height);
        if row_bytes > u64::from(self.step) || total != self.data.len() as u64 {
            let (width, height, step, found) = (self.width, self.height, self.step, self.data.len());
            return Err(ImageError::Size { width, height, pixel_bytes, step, found });
        }
        Ok(row_bytes as usize)
    }
}
