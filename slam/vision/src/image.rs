//! Images as plain row-major buffers.

use crate::{Kernels, VisionError};

/// An image without padding: pixel (x, y) is `data[y * width + x]`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Image<T> {
    /// Pixels in a row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` values, row after row.
    pub data: Vec<T>,
}

/// Brightness, 0 (black) to 255 (white).
pub type GrayImage = Image<u8>;

impl<T: Copy> Image<T> {
    /// An image with every pixel set to `fill`.
    #[must_use]
    pub fn new(width: usize, height: usize, fill: T) -> Self {
        Self { width, height, data: vec![fill; width * height] }
    }

    /// Wraps a row-major buffer; it must hold exactly `width * height` values.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Result<Self, VisionError> {
        check_len(width, height, 1, data.len())?;
        Ok(Self { width, height, data })
    }

    /// Row `y`, `width` values. Panics when `y >= height`.
    #[must_use]
    pub fn row(&self, y: usize) -> &[T] {
        &self.data[y * self.width..][..self.width]
    }

    /// The pixel at column `x` of row `y`, or `None` outside the image.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<T> {
        (x < self.width && y < self.height).then(|| self.data[y * self.width + x])
    }

    /// Gives the image a new size; its contents are then arbitrary. Keeps the allocation where it can.
    pub(crate) fn reshape(&mut self, width: usize, height: usize, fill: T) {
        (self.width, self.height) = (width, height);
        self.data.resize(width * height, fill);
    }
}

/// Brightness of a colour image: `rgb` holds 3 bytes a pixel (red, green, blue), row-major, no padding.
///
/// BT.601 weights 0.299, 0.587, 0.114 in 14-bit fixed point, rounded to nearest.
pub fn gray_from_rgb(rgb: &[u8], width: usize, height: usize) -> Result<GrayImage, VisionError> {
    check_len(width, height, 3, rgb.len())?;
    let mut gray = Image::new(width, height, 0);
    Kernels::detect().gray(rgb, &mut gray.data);
    Ok(gray)
}

fn check_len(width: usize, height: usize, channels: usize, found: usize) -> Result<(), VisionError> {
    let expected = width.checked_mul(height).and_then(|n| n.checked_mul(channels)).unwrap_or(usize::MAX);
    if found == expected { Ok(()) } else { Err(VisionError::BufferSize { width, height, expected, found }) }
}
