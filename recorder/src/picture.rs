//! PNG and JPEG files at the border of a log: checked when they come in, never changed more than needed.

use std::io::Cursor;
use zune_core::colorspace::ColorSpace;
use zune_core::options::DecoderOptions;
use zune_jpeg::JpegDecoder;

/// Larger pictures are refused before their pixels are allocated.
const MAX_PIXELS: u64 = 1 << 27;
/// A JPEG's end marker is looked for in this many last bytes; some cameras append a little after it.
const JPEG_TAIL_BYTES: usize = 1024;

/// Why a picture file is no picture that can be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PictureError {
    /// Neither a PNG nor a JPEG.
    #[error("starts like neither PNG nor JPEG: the file is damaged or of another kind")]
    Unknown,
    /// The decoder's complaint.
    #[error("cannot be decoded: {0}")]
    Damaged(String),
    /// A pixel layout other than the wanted one.
    #[error("has {found}, wanted {wanted}")]
    Layout {
        /// Layout of the file.
        found: String,
        /// Layouts that can be used.
        wanted: &'static str,
    },
}

/// A colour picture as it goes into the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorFile {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `png` or `jpeg`, see [`schemas::msg::format`].
    pub format: &'static str,
    /// The file: the source's own bytes, or a PNG with the same pixels if those are not 8-bit RGB.
    pub bytes: Vec<u8>,
    /// Whether the bytes are not the source's.
    pub reencoded: bool,
}

/// Checks a colour picture by decoding it whole. JPEG and 8-bit RGB PNG stay as they are; 8-bit grey, palette and
/// RGBA PNG become RGB (alpha is dropped).
///
/// # Errors
/// A damaged file, or 16 bits a channel.
pub fn color_file(bytes: Vec<u8>) -> Result<ColorFile, PictureError> {
    checked_file(bytes, &[png::ColorType::Rgb])
}

/// The same for the picture of a camera that may be grey: 8-bit grey PNG stay as they are too.
///
/// # Errors
/// As [`color_file`].
pub fn gray_or_color_file(bytes: Vec<u8>) -> Result<ColorFile, PictureError> {
    checked_file(bytes, &[png::ColorType::Rgb, png::ColorType::Grayscale])
}

/// `kept` are the pixel layouts of PNG files that need no change.
fn checked_file(bytes: Vec<u8>, kept: &[png::ColorType]) -> Result<ColorFile, PictureError> {
    if bytes.starts_with(&[0xFF, 0xD8]) {
        let (width, height) = check_jpeg(&bytes)?;
        return Ok(ColorFile { width, height, format: schemas::msg::format::JPEG, bytes, reencoded: false });
    }
    let png = decode_png(&bytes)?;
    if png.depth != png::BitDepth::Eight {
        let wanted = "8 bits a channel";
        return Err(PictureError::Layout { found: format!("{:?} bits a channel", png.depth), wanted });
    }
    let (width, height) = (png.width, png.height);
    let reencoded = !kept.contains(&png.source_color);
    let bytes = if reencoded { encode_rgb8(width, height, &png.rgb8())? } else { bytes };
    Ok(ColorFile { width, height, format: schemas::msg::format::PNG, bytes, reencoded })
}

/// Reads 16-bit single-channel pixels: width, height, pixels.
///
/// # Errors
/// A damaged file, or another layout (8-bit depth has lost its millimetres).
pub fn decode_gray16(bytes: &[u8]) -> Result<(u32, u32, Vec<u16>), PictureError> {
    let png = decode_png(bytes)?;
    if (png.color, png.depth) != (png::ColorType::Grayscale, png::BitDepth::Sixteen) {
        let found = format!("{:?}, {:?} bits a channel", png.color, png.depth);
        return Err(PictureError::Layout { found, wanted: "16-bit greyscale" });
    }
    let pixels = png.pixels.chunks_exact(2).map(|p| u16::from_be_bytes([p[0], p[1]])).collect();
    Ok((png.width, png.height, pixels))
}

/// Reads single-channel labels of 8 or 16 bits: width, height, values.
///
/// # Errors
/// A damaged file, or another layout.
pub fn decode_gray(bytes: &[u8]) -> Result<(u32, u32, Vec<u16>), PictureError> {
    let png = decode_png(bytes)?;
    match (png.source_color, png.depth) {
        (png::ColorType::Grayscale, png::BitDepth::Eight) => {
            Ok((png.width, png.height, png.pixels.into_iter().map(u16::from).collect()))
        }
        (png::ColorType::Grayscale, png::BitDepth::Sixteen) => decode_gray16(bytes),
        (color, depth) => {
            let found = format!("{color:?}, {depth:?} bits a channel");
            Err(PictureError::Layout { found, wanted: "8- or 16-bit greyscale" })
        }
    }
}

/// Reads 8-bit RGB pixels: width, height, bytes.
///
/// # Errors
/// A damaged file, or another layout.
pub fn decode_rgb8(bytes: &[u8]) -> Result<(u32, u32, Vec<u8>), PictureError> {
    let png = decode_png(bytes)?;
    if (png.color, png.depth) != (png::ColorType::Rgb, png::BitDepth::Eight) {
        let found = format!("{:?}, {:?} bits a channel", png.color, png.depth);
        return Err(PictureError::Layout { found, wanted: "8-bit RGB" });
    }
    Ok((png.width, png.height, png.pixels))
}

/// 8-bit pixels of a colour or grey picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ColorPixels {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Values a pixel: 3 (RGB) or 1 (grey).
    pub channels: usize,
    /// Rows joined.
    pub data: Vec<u8>,
}

/// Reads a PNG or JPEG as every reader of a log does: the same pixels everywhere. JPEG is RGB, alpha is dropped.
///
/// # Errors
/// A damaged file, or 16 bits a channel.
pub fn decode_color(bytes: &[u8]) -> Result<ColorPixels, PictureError> {
    if bytes.starts_with(&[0xFF, 0xD8]) {
        let (width, height) = check_jpeg(bytes)?;
        let options = DecoderOptions::new_safe().set_use_unsafe(false).jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
        let data = decoder.decode().map_err(|error| PictureError::Damaged(format!("{error:?}")))?;
        return Ok(ColorPixels { width, height, channels: 3, data });
    }
    let png = decode_png(bytes)?;
    if png.depth != png::BitDepth::Eight {
        let wanted = "8 bits a channel";
        return Err(PictureError::Layout { found: format!("{:?} bits a channel", png.depth), wanted });
    }
    let (width, height) = (png.width, png.height);
    let gray = png.color == png::ColorType::Grayscale;
    let (channels, data) = if gray { (1, png.pixels) } else { (3, png.rgb8()) };
    Ok(ColorPixels { width, height, channels, data })
}

/// A PNG of them, fast rather than small.
///
/// # Errors
/// Sizes that do not fit the pixels.
pub fn encode_color(pixels: &ColorPixels) -> Result<Vec<u8>, PictureError> {
    let encode = if pixels.channels == 1 { encode_gray8 } else { encode_rgb8 };
    encode(pixels.width, pixels.height, &pixels.data)
}

/// An 8-bit grey PNG, fast rather than small.
///
/// # Errors
/// Sizes that do not fit the pixels.
pub fn encode_gray8(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, PictureError> {
    encode_png(width, height, png::ColorType::Grayscale, png::BitDepth::Eight, pixels, Packing::Fast)
}

/// An 8-bit RGB PNG, fast rather than small.
///
/// # Errors
/// Sizes that do not fit the pixels.
pub fn encode_rgb8(width: u32, height: u32, pixels: &[u8]) -> Result<Vec<u8>, PictureError> {
    pack_rgb8(width, height, pixels, Packing::Fast)
}

/// How a PNG is packed. Its pixels are the same in all cases.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// Compressed, fast rather than small.
    Fast,
    /// Not compressed: the pixels as they are between checksums.
    Stored,
}

/// An 8-bit RGB PNG.
///
/// # Errors
/// Sizes that do not fit the pixels.
pub fn pack_rgb8(width: u32, height: u32, pixels: &[u8], packing: Packing) -> Result<Vec<u8>, PictureError> {
    encode_png(width, height, png::ColorType::Rgb, png::BitDepth::Eight, pixels, packing)
}

/// A 16-bit greyscale PNG, fast rather than small.
///
/// # Errors
/// Sizes that do not fit the pixels.
pub fn encode_gray16(width: u32, height: u32, pixels: &[u16]) -> Result<Vec<u8>, PictureError> {
    let bytes: Vec<u8> = pixels.iter().flat_map(|p| p.to_be_bytes()).collect();
    encode_png(width, height, png::ColorType::Grayscale, png::BitDepth::Sixteen, &bytes, Packing::Fast)
}

fn encode_png(
    width: u32,
    height: u32,
    color: png::ColorType,
    depth: png::BitDepth,
    pixels: &[u8],
    packing: Packing,
) -> Result<Vec<u8>, PictureError> {
    let damaged = |error: png::EncodingError| PictureError::Damaged(error.to_string());
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.set_compression(match packing {
        Packing::Fast => png::Compression::Fast,
        Packing::Stored => png::Compression::NoCompression,
    });
    let mut writer = encoder.write_header().map_err(damaged)?;
    writer.write_image_data(pixels).map_err(damaged)?;
    writer.finish().map_err(damaged)?;
    Ok(bytes)
}

/// A decoded PNG: palettes and less than 8 bits are expanded.
struct Png {
    width: u32,
    height: u32,
    source_color: png::ColorType,
    color: png::ColorType,
    depth: png::BitDepth,
    pixels: Vec<u8>,
}

impl Png {
    fn rgb8(&self) -> Vec<u8> {
        let rgb = |channels: usize, pick: fn(&[u8]) -> [u8; 3]| -> Vec<u8> {
            self.pixels.chunks_exact(channels).flat_map(pick).collect()
        };
        match self.color {
            png::ColorType::Grayscale => rgb(1, |p| [p[0]; 3]),
            png::ColorType::GrayscaleAlpha => rgb(2, |p| [p[0]; 3]),
            png::ColorType::Rgba => rgb(4, |p| [p[0], p[1], p[2]]),
            png::ColorType::Rgb | png::ColorType::Indexed => self.pixels.clone(),
        }
    }
}

fn decode_png(bytes: &[u8]) -> Result<Png, PictureError> {
    if !bytes.starts_with(b"\x89PNG") {
        return Err(PictureError::Unknown);
    }
    let damaged = |error: png::DecodingError| PictureError::Damaged(error.to_string());
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = (reader.info().width, reader.info().height);
    let source_color = reader.info().color_type;
    let too_large = || PictureError::Damaged(format!("{width}x{height} pixels are more than {MAX_PIXELS}"));
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(too_large());
    }
    let mut pixels = vec![0; reader.output_buffer_size().ok_or_else(too_large)?];
    let frame = reader.next_frame(&mut pixels).map_err(damaged)?;
    reader.finish().map_err(damaged)?;
    pixels.truncate(frame.buffer_size());
    Ok(Png { width, height, source_color, color: frame.color_type, depth: frame.bit_depth, pixels })
}

/// Decodes a JPEG to see that it can be; the decoder fills up truncated files, so the end marker is asked for as well.
fn check_jpeg(bytes: &[u8]) -> Result<(u32, u32), PictureError> {
    let tail = &bytes[bytes.len().saturating_sub(JPEG_TAIL_BYTES)..];
    if !tail.windows(2).any(|pair| pair == [0xFF, 0xD9]) {
        return Err(PictureError::Damaged("the JPEG's end marker is missing: the file is cut".to_owned()));
    }
    let options = DecoderOptions::default().set_max_width(1 << 16).set_max_height(1 << 16);
    let mut decoder = JpegDecoder::new_with_options(Cursor::new(bytes), options);
    decoder.decode().map_err(|error| PictureError::Damaged(format!("{error:?}")))?;
    let info = decoder.info().ok_or(PictureError::Unknown)?;
    Ok((info.width.into(), info.height.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_kinds_keep_their_pixels() {
        let rgb: Vec<u8> = (0..2 * 3 * 3).collect();
        let file = encode_rgb8(2, 3, &rgb).unwrap();
        let kept = color_file(file.clone()).unwrap();
        assert_eq!((kept.width, kept.height, kept.reencoded, &kept.bytes), (2, 3, false, &file));
        assert_eq!(decode_rgb8(&file).unwrap(), (2, 3, rgb));

        let gray = encode_png(2, 1, png::ColorType::Grayscale, png::BitDepth::Eight, &[7, 200], Packing::Fast).unwrap();
        let kept = color_file(gray.clone()).unwrap();
        assert!(kept.reencoded);
        assert_eq!(decode_rgb8(&kept.bytes).unwrap().2, [7, 7, 7, 200, 200, 200]);
        assert_eq!(gray_or_color_file(gray.clone()).unwrap().bytes, gray);
        assert!(matches!(decode_gray16(&gray), Err(PictureError::Layout { .. })), "8-bit depth must be refused");

        let depth = encode_gray16(2, 1, &[1, 0xABCD]).unwrap();
        assert_eq!(decode_gray16(&depth).unwrap(), (2, 1, vec![1, 0xABCD]));
        assert!(matches!(color_file(depth), Err(PictureError::Layout { .. })));
    }

    #[test]
    fn damaged_files_are_errors() {
        let file = encode_rgb8(16, 16, &[9; 16 * 16 * 3]).unwrap();
        for cut in 0..file.len() {
            assert!(color_file(file[..cut].to_vec()).is_err(), "cut at {cut} of {}", file.len());
        }
        assert_eq!(color_file(b"GIF89a".to_vec()), Err(PictureError::Unknown));
        assert!(color_file(vec![0xFF, 0xD8, 0xFF, 0xD9]).is_err());
    }
}
