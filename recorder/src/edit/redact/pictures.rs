//! One message's pictures: its new contents, or none if it stays as it is.

use super::area::Cover;
use super::native::NativeDepth;
use super::pixels::{Method, redact_color, redact_depth};
use crate::edit::RawMessage;
use crate::picture::{decode_color, encode_color};
use schemas::Message;
use schemas::msg::{CompressedImage, Image, encoding, format};
use std::borrow::Cow;

pub type Changed = Result<Option<Vec<u8>>, String>;

fn same_size(found: (usize, usize), wanted: (usize, usize)) -> Result<(), String> {
    if found == wanted {
        return Ok(());
    }
    Err(format!("{}x{} pixels where the masks have {}x{}", found.0, found.1, wanted.0, wanted.1))
}

/// A picture file. Where something is redacted it becomes a PNG: its other pixels are those that a reader of the source gets,
/// also of a JPEG, which cannot be written again without changing them.
pub fn color(message: &RawMessage<'_>, cover: &Cover, method: Method) -> Changed {
    let picture: CompressedImage<'_> = message.decode()?;
    let mut pixels = decode_color(&picture.data).map_err(|error| error.to_string())?;
    same_size((pixels.width as usize, pixels.height as usize), (cover.width, cover.height))?;
    if cover.pixels() == 0 {
        return Ok(None);
    }
    redact_color(&mut pixels.data, pixels.channels, cover, method);
    let data = encode_color(&pixels).map_err(|error| error.to_string())?;
    let picture = CompressedImage { header: picture.header, format: format::PNG.to_owned(), data: Cow::Owned(data) };
    Ok(Some(picture.encode()))
}

/// A picture as plain pixels.
pub fn raw_color(message: &RawMessage<'_>, cover: &Cover, method: Method) -> Changed {
    let mut image: Image<'_> = message.decode()?;
    same_size((image.width as usize, image.height as usize), (cover.width, cover.height))?;
    let (found, wanted) = (image.data.len(), cover.width * cover.height * 3);
    if image.encoding != encoding::RGB8 || found != wanted {
        return Err(format!("{} in {found} bytes, wanted rgb8 in {wanted}", image.encoding));
    }
    if cover.pixels() == 0 {
        return Ok(None);
    }
    redact_color(image.data.to_mut(), 3, cover, method);
    Ok(Some(image.encode()))
}

/// Depth registered to colour.
pub fn depth(message: &RawMessage<'_>, cover: &Cover) -> Changed {
    let image: Image<'_> = message.decode()?;
    same_size((image.width as usize, image.height as usize), (cover.width, cover.height))?;
    without(&image, &|_| cover.flags().to_vec())
}

/// Depth in the depth camera's own frame.
pub fn native_depth(message: &RawMessage<'_>, cover: &Cover, native: Option<&NativeDepth>) -> Changed {
    let native = native.ok_or("native depth without a calibration")?;
    let image: Image<'_> = message.decode()?;
    let (found, (width, height)) = ((image.width as usize, image.height as usize), native.size());
    if found != (width, height) {
        return Err(format!("{}x{} pixels where the calibration says {width}x{height}", found.0, found.1));
    }
    without(&image, &|pixels| native.covered(pixels, cover))
}

fn without(image: &Image<'_>, covered: &dyn Fn(&[u16]) -> Vec<bool>) -> Changed {
    let mut pixels = image.pixels_u16().map_err(|error| error.to_string())?;
    let covered = covered(&pixels);
    if !covered.contains(&true) {
        return Ok(None);
    }
    redact_depth(&mut pixels, &|index| covered.get(index).copied().unwrap_or(true));
    Ok(Some(Image::from_u16(image.header.clone(), &image.encoding, image.width, &pixels).encode()))
}
