//! COCO panoptic labels: one PNG a picture with `id = R + 256 G + 65536 B`, and one JSON file that tells each id's category.

use super::{ImportError, PanopticSource, Repairs, read_file};
use crate::picture::decode_rgb8;
use crate::{LayerSpec, Mask};
use schemas::msg::{Category, SCORE_UNKNOWN, Segment};
use schemas::panoptic::{VOID_CLASS, VOID_INSTANCE};
use schemas::topics;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

#[derive(Deserialize)]
struct CocoFile {
    annotations: Vec<Annotation>,
    categories: Vec<CocoCategory>,
    #[serde(default)]
    images: Vec<CocoImage>,
}

#[derive(Deserialize)]
struct CocoImage {
    id: serde_json::Value,
    file_name: String,
}

#[derive(Deserialize)]
struct Annotation {
    #[serde(default)]
    image_id: serde_json::Value,
    file_name: String,
    segments_info: Vec<SegmentInfo>,
}

#[derive(Deserialize)]
struct SegmentInfo {
    id: u32,
    category_id: u32,
    area: Option<f64>,
    score: Option<f32>,
    #[serde(default)]
    iscrowd: u8,
}

#[derive(Deserialize)]
struct CocoCategory {
    id: u32,
    name: String,
    #[serde(default)]
    isthing: serde_json::Value,
}

/// The labels of a folder, ready to be read picture by picture.
pub struct Labels {
    dir: PathBuf,
    json: PathBuf,
    /// What goes into the log's head.
    pub layer: LayerSpec,
    annotations: Vec<Annotation>,
    /// Annotation index by the stem of the picture's name.
    by_stem: BTreeMap<String, usize>,
}

impl Labels {
    /// Reads the JSON file.
    pub fn open(source: &PanopticSource) -> Result<Self, ImportError> {
        let json = find_json(source)?;
        let file: CocoFile = serde_json::from_slice(&read_file(&json, "")?)
            .map_err(|error| ImportError::content(&json, format!("not COCO panoptic: {error}")))?;
        let categories = file.categories.iter().map(|category| {
            let id = u16::try_from(category.id).ok().filter(|id| *id != VOID_CLASS);
            let reason = "category ids must be 1 to 65535 (0 is void): renumber them";
            let id = id.ok_or_else(|| ImportError::content(&json, format!("category {}: {reason}", category.id)))?;
            let is_thing = category.isthing.as_bool().unwrap_or_else(|| category.isthing.as_u64() == Some(1));
            Ok(Category { id, name: category.name.clone(), is_thing })
        });
        let categories = categories.collect::<Result<_, ImportError>>()?;
        let image_names: BTreeMap<String, &str> =
            file.images.iter().map(|image| (image.id.to_string(), image.file_name.as_str())).collect();
        let mut by_stem = BTreeMap::new();
        for (index, annotation) in file.annotations.iter().enumerate() {
            let image_name = image_names.get(&annotation.image_id.to_string()).copied();
            by_stem.insert(stem(image_name.unwrap_or(&annotation.file_name)).to_owned(), index);
            by_stem.entry(stem(&annotation.file_name).to_owned()).or_insert(index);
        }
        let folder = source.dir.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let layer =
            LayerSpec { name: source.layer.clone(), origin: format!("COCO panoptic, folder {folder}"), categories };
        if !topics::is_layer_name(&layer.name) {
            return Err(ImportError::content(&source.dir, format!("`{}` cannot name a layer", layer.name)));
        }
        Ok(Self { dir: source.dir.clone(), json, layer, annotations: file.annotations, by_stem })
    }

    /// The annotation of a picture, by its name without folder and extension.
    pub fn find(&self, picture: &str) -> Option<usize> {
        self.by_stem.get(stem(picture)).copied()
    }

    /// Names of pictures without folder and extension, with their annotation.
    pub fn stems(&self) -> Vec<(String, usize)> {
        self.by_stem.iter().map(|(stem, index)| (stem.clone(), *index)).collect()
    }

    /// Annotations in the file.
    pub fn len(&self) -> usize {
        self.annotations.len()
    }

    /// Reads one mask of the wanted size.
    pub fn mask(&self, index: usize, size: (u32, u32), repairs: &mut Repairs) -> Result<Mask, ImportError> {
        let annotation = &self.annotations[index];
        let path = self.dir.join(&annotation.file_name);
        let bytes = read_file(&path, &format!(" (named in {})", self.json.display()))?;
        let decoded = decode_rgb8(&bytes).map_err(|source| ImportError::Picture { path: path.clone(), source })?;
        let (width, height, pixels) = decoded;
        if (width, height) != size {
            let message = format!("{width}x{height} pixels, the camera has {}x{}", size.0, size.1);
            return Err(ImportError::content(&path, message));
        }
        let known = self.numbered_segments(annotation, &path, repairs)?;
        Ok(rasterise(&pixels, width, &known, annotation, repairs))
    }

    /// The annotation's segments by source id, with ids that fit 16 bits: the source's own, or 1, 2, 3, ... in their order
    /// if one of them does not fit.
    fn numbered_segments(
        &self,
        annotation: &Annotation,
        path: &Path,
        repairs: &mut Repairs,
    ) -> Result<Vec<(u32, Segment)>, ImportError> {
        let mut infos: Vec<&SegmentInfo> = annotation.segments_info.iter().collect();
        infos.sort_by_key(|info| info.id);
        let bad = |message: String| ImportError::content(&self.json, format!("{}: {message}", annotation.file_name));
        if let Some(pair) = infos.windows(2).find(|pair| pair[0].id == pair[1].id) {
            return Err(bad(format!("segment id {} is listed twice", pair[0].id)));
        }
        if infos.first().is_some_and(|info| info.id == 0) {
            return Err(bad("segment id 0 is listed, but means void".to_owned()));
        }
        let renumber = infos.last().is_some_and(|info| info.id > u32::from(u16::MAX));
        if renumber {
            repairs.count("mask with segment ids above 65535 renumbered from 1");
        }
        let mut known = Vec::with_capacity(infos.len());
        for (index, info) in infos.into_iter().enumerate() {
            let id = if renumber { index as u32 + 1 } else { info.id };
            let id = u16::try_from(id).map_err(|_| ImportError::content(path, "more than 65535 segments"))?;
            let category = self.layer.categories.iter().find(|category| u32::from(category.id) == info.category_id);
            let Some(category) = category else {
                return Err(bad(format!(
                    "segment {} has category {}, which is not in the table",
                    info.id, info.category_id
                )));
            };
            let score = info.score.filter(|score| (0.0..=1.0).contains(score)).unwrap_or(SCORE_UNKNOWN);
            let is_crowd = info.iscrowd != 0;
            known.push((info.id, Segment { id, category_id: category.id, score, is_crowd, ..Segment::default() }));
        }
        Ok(known)
    }
}

/// Turns source ids into class and instance images; boxes and areas are counted from the pixels.
fn rasterise(
    pixels: &[u8],
    width: u32,
    known: &[(u32, Segment)],
    annotation: &Annotation,
    repairs: &mut Repairs,
) -> Mask {
    let count = pixels.len() / 3;
    let mut mask = Mask { class: Vec::with_capacity(count), instance: Vec::with_capacity(count), segments: Vec::new() };
    let mut boxes = vec![[u32::MAX, u32::MAX, 0, 0]; known.len()];
    let mut areas = vec![0_u32; known.len()];
    let (mut last_id, mut last) = (0, None);
    let mut unlisted = 0;
    for (at, rgb) in pixels.chunks_exact(3).enumerate() {
        let id = u32::from(rgb[0]) + (u32::from(rgb[1]) << 8) + (u32::from(rgb[2]) << 16);
        if id != last_id {
            last = known.binary_search_by_key(&id, |(source, _)| *source).ok();
            last_id = id;
        }
        let Some(index) = last else {
            unlisted += u64::from(id != 0);
            mask.class.push(VOID_CLASS);
            mask.instance.push(VOID_INSTANCE);
            continue;
        };
        let (x, y) = (at as u32 % width, at as u32 / width);
        let [left, top, right, bottom] = &mut boxes[index];
        (*left, *top, *right, *bottom) = ((*left).min(x), (*top).min(y), (*right).max(x), (*bottom).max(y));
        areas[index] += 1;
        mask.class.push(known[index].1.category_id);
        mask.instance.push(known[index].1.id);
    }
    repairs.add("mask pixel with an id that the JSON does not list made void", unlisted);
    for (((source, segment), area), [left, top, right, bottom]) in known.iter().zip(areas).zip(boxes) {
        let told = annotation.segments_info.iter().find(|info| info.id == *source).and_then(|info| info.area);
        if told.is_some_and(|told| told != f64::from(area)) {
            repairs.count("segment area differs from the JSON, counted from the pixels");
        }
        let mut segment = Segment { area, ..*segment };
        if area > 0 {
            (segment.x, segment.y) = (left, top);
            (segment.width, segment.height) = (right - left + 1, bottom - top + 1);
        }
        mask.segments.push(segment);
    }
    mask
}

fn find_json(source: &PanopticSource) -> Result<PathBuf, ImportError> {
    if let Some(json) = &source.json {
        return Ok(json.clone());
    }
    let candidates = [
        source.dir.with_extension("json"),
        source.dir.join("panoptic.json"),
        source.dir.parent().unwrap_or(Path::new("")).join("panoptic.json"),
    ];
    let found = candidates.iter().find(|path| path.is_file()).cloned();
    let names: Vec<String> = candidates.iter().map(|path| path.display().to_string()).collect();
    found.ok_or_else(|| ImportError::content(&source.dir, format!("no label table: looked for {}", names.join(", "))))
}

/// A file name without folders and extension. Names are stamps (`1600000006.666667.png`): only the last dot counts.
fn stem(name: &str) -> &str {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    match name.rsplit_once('.') {
        Some((stem, extension)) if extension.bytes().any(|b| b.is_ascii_alphabetic()) => stem,
        _ => name,
    }
}
