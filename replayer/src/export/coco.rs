//! COCO panoptic labels: one PNG a picture with `id = R + 256 G + 65536 B`, one JSON a layer.

use std::collections::BTreeMap;

use schemas::Stamp;
use schemas::topics;
use serde_json::{Value, json};

use super::source::Source;
use super::{ExportError, Item, Kind, Layout, category_color, picture, yaml};
use crate::OutputFolder;
use crate::log::MaskPixels;

/// The label files of all layers; other layouts hold them beside their pictures.
pub(super) struct LayerFiles {
    /// Folder of the pictures, as the JSON names it.
    pictures: &'static str,
    /// By stamp: the picture's file.
    files: BTreeMap<Stamp, String>,
    /// By layer and stamp: its segments.
    annotations: BTreeMap<String, BTreeMap<Stamp, Value>>,
}

/// Folder of a layer's PNG files; its JSON has the same name and an extension.
pub(super) fn layer_folder(layer: &str) -> String {
    if layer == topics::DEFAULT_LAYER { "panoptic".to_owned() } else { format!("panoptic_{layer}") }
}

impl LayerFiles {
    pub fn new(source: &Source<'_>, pictures: &'static str) -> Self {
        let annotations = source.layers.iter().map(|layer| (layer.clone(), BTreeMap::new())).collect();
        Self { pictures, files: BTreeMap::new(), annotations }
    }

    /// Remembers where a picture is, by the name that the folder's lists give it.
    pub fn picture(&mut self, stamp: Stamp, name: &str) {
        self.files.insert(stamp, name.strip_prefix(self.pictures).unwrap_or(name).trim_start_matches('/').to_owned());
    }

    pub fn mask(
        &mut self,
        layer: &str,
        stamp: Stamp,
        mask: &MaskPixels,
        folder: &OutputFolder,
        source: &Source<'_>,
    ) -> Result<(), ExportError> {
        let rgb: Vec<u8> = mask.instance.iter().flat_map(|id| [*id as u8, (id >> 8) as u8, 0]).collect();
        let (width, height) = (source.camera.width, source.camera.height);
        let name = format!("{}/{}.png", layer_folder(layer), stamp.to_decimal9());
        folder.write(&name, &picture::rgb8(stamp, width, height, &rgb)?)?;
        let segments: Vec<Value> = mask.segments.iter().map(segment).collect();
        self.annotations.entry(layer.to_owned()).or_default().insert(stamp, Value::Array(segments));
        Ok(())
    }

    pub fn finish(&self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        for (layer, annotations) in &self.annotations {
            let text = self.json(layer, annotations, source).to_string() + "\n";
            folder.write(&format!("{}.json", layer_folder(layer)), text.as_bytes())?;
        }
        Ok(())
    }

    fn json(&self, layer: &str, annotations: &BTreeMap<Stamp, Value>, source: &Source<'_>) -> Value {
        let (width, height) = (source.camera.width, source.camera.height);
        // COCO counts from 1, so that 0 is never an id.
        let ids: BTreeMap<Stamp, usize> = self.files.keys().enumerate().map(|(i, stamp)| (*stamp, i + 1)).collect();
        let image = |(stamp, file): (&Stamp, &String)| json!({"id": ids[stamp], "file_name": file, "width": width, "height": height, "stamp_ns": stamp.0});
        let annotation = |(stamp, segments): (&Stamp, &Value)| {
            let id = ids.get(stamp).copied().unwrap_or(0);
            json!({"id": id, "image_id": id, "file_name": format!("{}.png", stamp.to_decimal9()), "segments_info": segments})
        };
        let category = |c: &schemas::msg::Category| {
            let kind = if c.is_thing { "thing" } else { "stuff" };
            let (is_thing, color) = (u8::from(c.is_thing), category_color(c.id));
            json!({"id": c.id, "name": c.name, "supercategory": kind, "isthing": is_thing, "color": color})
        };
        json!({
            "info": {"description": format!("{} layer {layer}", source.name()), "version": "1"},
            "licenses": [],
            "images": self.files.iter().map(image).collect::<Vec<_>>(),
            "annotations": annotations.iter().map(annotation).collect::<Vec<_>>(),
            "categories": source.log.categories(layer).iter().map(category).collect::<Vec<_>>(),
        })
    }
}

fn segment(s: &schemas::msg::Segment) -> Value {
    let mut value = json!({
        "id": s.id, "category_id": s.category_id, "area": s.area,
        "bbox": [s.x, s.y, s.width, s.height], "iscrowd": u8::from(s.is_crowd),
    });
    // `SCORE_UNKNOWN` is below zero.
    if s.score >= 0.0 {
        value["score"] = json!(s.score);
    }
    value
}

/// Pictures and labels alone.
pub(super) struct Coco {
    layers: LayerFiles,
}

impl Coco {
    pub fn new(source: &Source<'_>) -> Result<Self, ExportError> {
        if source.layers.is_empty() {
            return Err(ExportError::Refused("the log has no segmentation: annotate it first".to_owned()));
        }
        Ok(Self { layers: LayerFiles::new(source, "images") })
    }
}

impl Layout for Coco {
    fn holds(&self, kind: Kind) -> bool {
        matches!(kind, Kind::Color | Kind::Mask)
    }

    fn take(&mut self, item: Item<'_>, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        match item {
            Item::Color(stamp, image) => {
                let (extension, bytes) = picture::file(stamp, image, &source.camera)?;
                let name = format!("images/{}.{extension}", stamp.to_decimal9());
                folder.write(&name, &bytes)?;
                self.layers.picture(stamp, &name);
                Ok(())
            }
            Item::Mask(layer, stamp, mask) => self.layers.mask(layer, stamp, &mask, folder, source),
            _ => Ok(()),
        }
    }

    fn finish(&mut self, folder: &OutputFolder, source: &Source<'_>) -> Result<(), ExportError> {
        folder.write("camera.yaml", yaml::ros_camera(&source.camera, None).as_bytes())?;
        self.layers.finish(folder, source)
    }
}
