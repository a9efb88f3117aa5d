//! Masks of a redacted log: all that is redacted is one segment of the first redacted class.
//!
//! A replay then treats it as it treats people, and no outline is left that is finer than the redacted area. A layer that
//! does not know the class says that the area is unknown.

use super::RedactOptions;
use super::area::Cover;
use super::pictures::Changed;
use crate::edit::RawMessage;
use schemas::msg::{CategoryTable, Image, SCORE_UNKNOWN, Segment, SegmentTable, encoding};
use schemas::topics::{self, LayerTopics};
use schemas::{Message, Stamp, panoptic};
use std::collections::{BTreeMap, BTreeSet};

/// Segment id of what is redacted; a segment that has it already becomes part of it.
const REDACTED: u16 = u16::MAX;
/// Masks whose segment table is awaited.
const MOST_AWAITED: usize = 1000;

/// Left, upper, right, lower border and pixels of each segment.
type Extents = BTreeMap<u16, [u32; 5]>;

pub struct Masks {
    classes: BTreeSet<String>,
    /// By layer: the id that redacted pixels get.
    class_ids: BTreeMap<String, u16>,
    /// Segments of instance images whose table has not come yet.
    extents: BTreeMap<(String, Stamp), Extents>,
}

impl Masks {
    pub fn new(options: &RedactOptions<'_>) -> Self {
        Self { classes: options.classes.clone(), class_ids: BTreeMap::new(), extents: BTreeMap::new() }
    }

    /// A message of a segmentation layer.
    pub fn redact(&mut self, message: &RawMessage<'_>, stamp: Stamp, cover: &Cover) -> Changed {
        let topic = message.topic();
        let layer = topics::layer_of(topic).unwrap_or_default().to_owned();
        let LayerTopics { categories, class, instance, segments, .. } = LayerTopics::new(&layer);
        if topic == categories {
            let table: CategoryTable = message.decode()?;
            let ids = self.classes.iter().flat_map(|name| panoptic::ids_by_name(&table.categories, name));
            let id = ids.min().unwrap_or(panoptic::VOID_CLASS);
            self.class_ids.insert(layer, id);
            return Ok(None);
        }
        if cover.pixels() == 0 {
            return Ok(None);
        }
        let class_id = *self.class_ids.get(&layer).ok_or("a mask before the layer's category table")?;
        if topic == class {
            image(message, cover, class_id).map(|(data, _)| Some(data))
        } else if topic == instance {
            let id = if class_id == panoptic::VOID_CLASS { panoptic::VOID_INSTANCE } else { REDACTED };
            let (data, pixels) = image(message, cover, id)?;
            if self.extents.len() >= MOST_AWAITED {
                return Err(format!("{MOST_AWAITED} instance images without a segment table"));
            }
            self.extents.insert((layer, stamp), extents(&pixels, cover.width));
            Ok(Some(data))
        } else if topic == segments {
            let extents = self.extents.remove(&(layer, stamp)).ok_or("a segment table before its instance image")?;
            table(message, &extents, class_id).map(Some)
        } else {
            Ok(None)
        }
    }
}

/// The image with `id` where something is redacted, and its pixels.
fn image(message: &RawMessage<'_>, cover: &Cover, id: u16) -> Result<(Vec<u8>, Vec<u16>), String> {
    let image: Image<'_> = message.decode()?;
    let mut pixels = image.pixels_u16().map_err(|error| error.to_string())?;
    if (image.width as usize, pixels.len()) != (cover.width, cover.width * cover.height) {
        return Err(format!("{}x{} pixels where other masks have another size", image.width, image.height));
    }
    pixels.iter_mut().zip(cover.flags()).filter(|(_, covered)| **covered).for_each(|(pixel, _)| *pixel = id);
    let header = image.header.clone();
    let data = if image.encoding == encoding::MONO8 {
        let bytes = pixels.iter().map(|pixel| u8::try_from(*pixel));
        let bytes = bytes.collect::<Result<Vec<_>, _>>().map_err(|_| format!("id {id} does not fit 8 bits"))?;
        Image::from_u8(header, &image.encoding, image.width, &bytes).encode()
    } else {
        Image::from_u16(header, &image.encoding, image.width, &pixels).encode()
    };
    Ok((data, pixels))
}

fn extents(pixels: &[u16], width: usize) -> Extents {
    let mut extents = Extents::new();
    for (index, id) in pixels.iter().enumerate().filter(|(_, id)| **id != panoptic::VOID_INSTANCE) {
        let (x, y) = ((index % width) as u32, (index / width) as u32);
        let [left, upper, right, lower, area] = extents.entry(*id).or_insert([x, y, x, y, 0]);
        (*left, *upper) = ((*left).min(x), (*upper).min(y));
        (*right, *lower, *area) = ((*right).max(x), (*lower).max(y), *area + 1);
    }
    extents
}

/// The segments that are left, with what is left of them, and the redacted one.
fn table(message: &RawMessage<'_>, extents: &Extents, class_id: u16) -> Result<Vec<u8>, String> {
    let mut table: SegmentTable = message.decode()?;
    let redacted = Segment { id: REDACTED, category_id: class_id, score: SCORE_UNKNOWN, ..Segment::default() };
    table.segments.retain(|segment| segment.id != REDACTED);
    table.segments.push(redacted);
    table.segments.retain_mut(|segment| {
        let Some([left, upper, right, lower, area]) = extents.get(&segment.id) else { return false };
        (segment.x, segment.y) = (*left, *upper);
        (segment.width, segment.height, segment.area) = (right - left + 1, lower - upper + 1, *area);
        true
    });
    Ok(table.encode())
}
