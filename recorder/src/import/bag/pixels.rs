//! Pictures of other programs' messages as a log holds them.

use crate::picture::{ColorFile, encode_gray8, encode_rgb8, gray_or_color_file};
use schemas::msg::{CompressedImage, Image, format};

/// A picture file of a raw or compressed colour message.
pub fn color(schema: &str, data: &[u8]) -> Result<ColorFile, String> {
    use schemas::Message;
    if schema == CompressedImage::SCHEMA_NAME {
        let message = CompressedImage::decode(data).map_err(|error| error.to_string())?;
        return gray_or_color_file(message.data.into_owned()).map_err(|error| error.to_string());
    }
    let image = Image::decode(data).map_err(|error| error.to_string())?;
    let (width, height) = (image.width, image.height);
    let (channels, order): (usize, &[usize]) = match image.encoding.as_str() {
        "rgb8" => (3, &[0, 1, 2]),
        "bgr8" => (3, &[2, 1, 0]),
        "rgba8" => (4, &[0, 1, 2]),
        "bgra8" => (4, &[2, 1, 0]),
        "mono8" | "8UC1" => (1, &[0]),
        other => return Err(format!("pixels are `{other}`, wanted rgb8, bgr8, rgba8, bgra8 or mono8")),
    };
    let rows = rows(&image, channels)?;
    let pixels: Vec<u8> =
        rows.flat_map(|row| row.chunks_exact(channels)).flat_map(|p| order.iter().map(|at| p[*at])).collect();
    let bytes = if channels == 1 { encode_gray8(width, height, &pixels) } else { encode_rgb8(width, height, &pixels) };
    let bytes = bytes.map_err(|error| error.to_string())?;
    Ok(ColorFile { width, height, format: format::PNG, bytes, reencoded: false })
}

/// A depth image in millimetres.
pub struct Depth {
    /// Columns and rows.
    pub size: (u32, u32),
    pub units: Vec<u16>,
    /// Pixels that 16 bits could not hold.
    pub lost: u64,
}

/// `16UC1` as it is, `32FC1` in metres rounded.
pub fn depth(data: &[u8]) -> Result<Depth, String> {
    use schemas::Message;
    let image = Image::decode(data).map_err(|error| error.to_string())?;
    let size = (image.width, image.height);
    if image.encoding != "32FC1" {
        return image.pixels_u16().map(|units| Depth { size, units, lost: 0 }).map_err(|error| error.to_string());
    }
    let (mut units, mut lost) = (Vec::new(), 0);
    for pixel in rows(&image, 4)?.flat_map(|row| row.chunks_exact(4)) {
        let bytes = [pixel[0], pixel[1], pixel[2], pixel[3]];
        let metres = if image.is_bigendian == 0 { f32::from_le_bytes(bytes) } else { f32::from_be_bytes(bytes) };
        let millimetres = (f64::from(metres) * 1000.0 + 0.5).floor();
        let fits = millimetres <= f64::from(u16::MAX);
        lost += u64::from(metres.is_finite() && !fits);
        // NaN, infinity and what lies behind the camera is no measurement.
        units.push(if fits && millimetres > 0.0 { millimetres as u16 } else { 0 });
    }
    Ok(Depth { size, units, lost })
}

/// Rows without padding.
fn rows<'i>(image: &'i Image<'_>, pixel_bytes: usize) -> Result<impl Iterator<Item = &'i [u8]>, String> {
    let (width, height, step) = (image.width as usize, image.height as usize, image.step as usize);
    let row = width * pixel_bytes;
    if row == 0 || step < row || step.checked_mul(height) != Some(image.data.len()) {
        let bytes = image.data.len();
        return Err(format!(
            "{width}x{height} pixels of {pixel_bytes} bytes with {step} bytes a row do not fit {bytes}"
        ));
    }
    Ok(image.data.chunks_exact(step).map(move |r| &r[..row]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::decode_rgb8;
    use schemas::Message;
    use schemas::msg::Header;
    use std::borrow::Cow;

    fn image(encoding: &str, width: u32, step: u32, data: Vec<u8>) -> Vec<u8> {
        let (header, height) = (Header::default(), data.len() as u32 / step.max(1));
        Image { header, height, width, encoding: encoding.to_owned(), is_bigendian: 0, step, data: Cow::Owned(data) }
            .encode()
    }

    #[test]
    fn channels_and_padding() {
        let bgr = image("bgr8", 2, 7, vec![3, 2, 1, 6, 5, 4, 99]);
        let file = color(Image::SCHEMA_NAME, &bgr).unwrap();
        assert_eq!(decode_rgb8(&file.bytes).unwrap(), (2, 1, vec![1, 2, 3, 4, 5, 6]));
        for (encoding, step) in [("yuv422", 4), ("rgb8", 5)] {
            assert!(color(Image::SCHEMA_NAME, &image(encoding, 2, step, vec![0; step as usize])).is_err());
        }
    }

    #[test]
    fn metres_become_millimetres() {
        let metres = [1.2344_f32, f32::NAN, f32::INFINITY, -1.0, 70.0, 0.0];
        let data = metres.iter().flat_map(|m| m.to_le_bytes()).collect();
        let Depth { size, units, lost } = depth(&image("32FC1", 6, 24, data)).unwrap();
        assert_eq!((size, units, lost), ((6, 1), vec![1234, 0, 0, 0, 0, 0], 1));
    }
}
