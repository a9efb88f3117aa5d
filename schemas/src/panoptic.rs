//! What labels mean, for everybody who reads or writes masks.
//!
//! Void: class 0 and instance 0 mean *unknown* (no segment claims the pixel), not background. A pixel is void in both
//! images or in neither. Every segment, Thing or Stuff, has an instance id above 0, unique in its frame only: nothing
//! promises that the same object keeps its id in the next frame.

use crate::msg::{Category, CategoryTable, LabelInfo, VisionClass};

/// Class id of pixels that no segment claims.
pub const VOID_CLASS: u16 = 0;
/// Instance id of pixels that no segment claims.
pub const VOID_INSTANCE: u16 = 0;
/// Name of the category that is a priori taken to move.
pub const PERSON: &str = "person";

/// Ids of all categories with this name.
pub fn ids_by_name<'c>(categories: &'c [Category], name: &'c str) -> impl Iterator<Item = u16> + 'c {
    categories.iter().filter(move |category| category.name == name).map(|category| category.id)
}

/// The same names for tools that only know `vision_msgs`.
#[must_use]
pub fn label_info(table: &CategoryTable) -> LabelInfo {
    let class_map = table.categories.iter();
    let class_map = class_map.map(|c| VisionClass { class_id: c.id, class_name: c.name.clone() }).collect();
    LabelInfo { header: table.header.clone(), class_map, threshold: 0.0 }
}
