//! One frame as a figure: the picture, regions tinted by what they do, keypoints by verdict.

use std::fmt::Write as _;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use jpeg_encoder::{ColorType, Encoder};
use slam::input::Setup;
use slam::report::{RegionReport, RegionState, Verdict};

use super::ReportError;
use super::html::{Key, escape};
use super::moments::Moment;

/// Wider pictures are made smaller.
const MAX_WIDTH: usize = 640;
const JPEG_QUALITY: u8 = 80;
/// Smallest share of the picture whose region gets a name.
const NAMED_SHARE: f64 = 0.015;

/// Okabe and Ito's eight colours, told apart by colour-blind readers too; shapes differ as well.
pub fn verdict_color(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Static => "#009e73",
        Verdict::Person => "#d55e00",
        Verdict::ThingDynamic => "#e69f00",
        Verdict::ThingNew => "#f0e442",
        Verdict::UnknownDynamic => "#cc79a7",
        Verdict::UnknownNew => "#56b4e9",
        Verdict::Border => "#9aa0a8",
        Verdict::FreeSpace => "#0072b2",
    }
}

/// Name, and red, green, blue.
fn region_style(state: RegionState) -> (&'static str, [u8; 3]) {
    match state {
        RegionState::New => ("not confirmed", [0xf0, 0xe4, 0x42]),
        RegionState::Static => ("still", [0x00, 0x9e, 0x73]),
        RegionState::Dynamic => ("moves", [0xe6, 0x9f, 0x00]),
        RegionState::Person => ("person", [0xd5, 0x5e, 0x00]),
    }
}

/// What tints mean.
pub fn region_keys() -> Vec<Key> {
    [RegionState::Person, RegionState::Dynamic, RegionState::New, RegionState::Static]
        .map(|state| {
            let (name, [r, g, b]) = region_style(state);
            Key { name: format!("region: {name}"), color: format!("rgb({r},{g},{b})") }
        })
        .into()
}

/// Picture, tint and keypoints on one another.
///
/// # Errors
/// A picture that cannot be decoded or packed.
pub fn stack(moment: &Moment, setup: &Setup, alt: &str) -> Result<String, ReportError> {
    let wrong = |reason: String| ReportError::Picture { frame: moment.frame, reason };
    let photo = photo(moment).map_err(wrong)?;
    let tint = tint(moment).map_err(wrong)?;
    let (width, height) = moment.size;
    Ok(format!(
        "<div class=\"stack\"><img src=\"data:image/jpeg;base64,{}\" width=\"{width}\" height=\"{height}\" alt=\"{}\">\
         <img class=\"over tint\" src=\"data:image/png;base64,{}\" alt=\"\">\
         <svg class=\"over\" viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">{}{}</svg></div>",
        base64(&photo),
        escape(alt),
        base64(&tint),
        points(moment),
        names(moment, setup),
    ))
}

fn photo(moment: &Moment) -> Result<Vec<u8>, String> {
    let size = (moment.size.0 as usize, moment.size.1 as usize);
    let rgb = match &moment.color {
        Some(color) => crate::log::color_pixels(&color.format, &color.bytes, size)?,
        None => moment.gray.data.iter().flat_map(|v| [*v; 3]).collect(),
    };
    let (rgb, (width, height)) = smaller(rgb, size);
    let packable = |v: usize| u16::try_from(v).map_err(|_| format!("{v} pixels are too many for a JPEG"));
    let mut bytes = Vec::new();
    Encoder::new(&mut bytes, JPEG_QUALITY)
        .encode(&rgb, packable(width)?, packable(height)?, ColorType::Rgb)
        .map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// Means of square blocks, until the picture is narrow enough.
fn smaller(rgb: Vec<u8>, (width, height): (usize, usize)) -> (Vec<u8>, (usize, usize)) {
    let by = width.div_ceil(MAX_WIDTH);
    if by <= 1 {
        return (rgb, (width, height));
    }
    let (small_width, small_height) = (width / by, (height / by).max(1));
    let mut small = Vec::with_capacity(small_width * small_height * 3);
    for y in 0..small_height {
        for x in 0..small_width {
            for channel in 0..3 {
                let block = (0..by * by).map(|i| (y * by + i / by, x * by + i % by));
                let sum: usize =
                    block.map(|(y, x)| usize::from(rgb[(y.min(height - 1) * width + x) * 3 + channel])).sum();
                small.push((sum / (by * by)) as u8);
            }
        }
    }
    (small, (small_width, small_height))
}

/// A pixel a cell of the grid of regions; clear where the background is.
fn tint(moment: &Moment) -> Result<Vec<u8>, String> {
    let (columns, rows, cells) = &moment.region_cells;
    let (columns, rows, cells) = match cells.len() {
        0 => (1, 1, &[u16::MAX][..]),
        n if n == columns * rows => (*columns, *rows, cells.as_slice()),
        n => return Err(format!("{n} cells of regions where {columns} x {rows} are due")),
    };
    let pixel = |cell: &u16| match moment.regions.get(usize::from(*cell)) {
        Some(region) => {
            let [r, g, b] = region_style(region.state).1;
            [r, g, b, 255]
        }
        None => [0; 4],
    };
    let pixels: Vec<u8> = cells.iter().flat_map(pixel).collect();
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(&pixels, columns as u32, rows as u32, ExtendedColorType::Rgba8)
        .map_err(|error| error.to_string())?;
    Ok(bytes)
}

/// A path a verdict: dots for what is used, crosses for what moves, rings for the rest.
fn points(moment: &Moment) -> String {
    let mut text = String::from("<g class=\"points\">");
    for verdict in Verdict::ALL {
        let of_verdict: Vec<_> = moment.keypoints.iter().filter(|keypoint| keypoint.verdict == verdict).collect();
        if of_verdict.is_empty() {
            continue;
        }
        let glyph = match verdict {
            Verdict::Static => "h0",
            verdict if verdict.is_dynamic() => "m-3-3l6 6m0-6l-6 6",
            _ => "m-2.5-2.5h5v5h-5z",
        };
        let width = if verdict == Verdict::Static { 4.0 } else { 1.5 };
        let mut path = String::new();
        for keypoint in of_verdict {
            // The slam counts from the centre of the first pixel.
            let [x, y] = keypoint.pixel.map(|v| v + 0.5);
            let _ = write!(path, "M{x:.0} {y:.0}{glyph}");
        }
        let _ = write!(
            text,
            "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>",
            verdict_color(verdict)
        );
    }
    text.push_str("</g>");
    text
}

/// Category, track and state of the larger regions, above their boxes.
fn names(moment: &Moment, setup: &Setup) -> String {
    let picture_px = f64::from(moment.size.0) * f64::from(moment.size.1);
    let large = |region: &&RegionReport| f64::from(region.area_px) >= NAMED_SHARE * picture_px;
    let mut text = String::from("<g class=\"names\" font-family=\"sans-serif\" font-size=\"14\">");
    for region in moment.regions.iter().filter(large) {
        let [x, y, width, height] = region.bbox;
        let category = category_name(region.category, setup);
        let (state, [r, g, b]) = region_style(region.state);
        let name = if region.state == RegionState::Person {
            format!("{category} {}", region.track)
        } else {
            let against = if region.disagrees { ", against the background" } else { "" };
            format!("{category} {}: {state}{against}", region.track)
        };
        let _ = write!(
            text,
            "<rect x=\"{x:.0}\" y=\"{y:.0}\" width=\"{width:.0}\" height=\"{height:.0}\" fill=\"none\" \
             stroke=\"rgb({r},{g},{b})\" stroke-width=\"1.5\"/><text x=\"{:.0}\" y=\"{:.0}\" fill=\"#fff\" stroke=\"#000\" \
             stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
            x + 4.0,
            slam_math::float::max(y + 17.0, 17.0),
            escape(&name)
        );
    }
    text.push_str("</g>");
    text
}

/// 0 and numbers without a name are unknown.
pub fn category_name(category: u16, setup: &Setup) -> &str {
    let known = setup.categories.iter().find(|known| known.id == category && category != 0);
    known.map_or("unknown", |known| known.name.as_str())
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().fold(0u32, |word, byte| word << 8 | u32::from(*byte)) << (8 * (3 - three.len()));
        for i in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * i) & 63) as usize];
            text.push(if i <= three.len() { char::from(letter) } else { '=' });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_rfc_4648() {
        for (plain, text) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), text);
        }
    }

    #[test]
    fn wide_pictures_are_halved() {
        let (small, size) = smaller(vec![10; 1280 * 4 * 3], (1280, 4));
        assert_eq!((size, small.len(), small[0]), ((640, 2), 640 * 2 * 3, 10));
    }
}
