//! Labels that somebody else made, as files: no network runs.

use super::AnnotateError;
use crate::import::{Labels, PanopticSource, Repairs};
use crate::picture::decode_gray;
use schemas::Stamp;
use schemas::msg::{Category, SCORE_UNKNOWN, Segment};
use schemas::panoptic::VOID_CLASS;
use segment::{Mask, Picture, SegmentError, Segmenter};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Where they are.
#[derive(Debug, Clone)]
pub enum ReadySource {
    /// COCO panoptic PNG files and their JSON.
    Coco(PanopticSource),
    /// A folder with `categories.json` (`[{"id": 1, "name": "person", "isthing": 1}, ...]`), `class/` and, for things to be told
    /// apart, `instance/`: grey PNG files of 8 or 16 bits, 0 = void.
    Images(PathBuf),
}

impl ReadySource {
    /// What stands in a folder: a folder `class` means images, anything else COCO panoptic.
    #[must_use]
    pub fn of(folder: &Path) -> Self {
        if folder.join("class").is_dir() {
            Self::Images(folder.to_owned())
        } else {
            Self::Coco(PanopticSource::new(folder))
        }
    }
}

/// Ready labels, found by the picture's stamp (file names in seconds with a fraction, or in nanoseconds) or by its number from
/// 0 (shorter whole numbers). A picture without a file stays without labels.
#[derive(Clone)]
pub struct ReadyMasks(Arc<Inner>);

struct Inner {
    files: Files,
    categories: Vec<Category>,
    by_stamp: BTreeMap<Stamp, usize>,
    by_index: BTreeMap<usize, usize>,
}

enum Files {
    Coco(Labels),
    Images(Vec<Images>),
}

struct Images {
    class: PathBuf,
    instance: Option<PathBuf>,
}

#[derive(Deserialize)]
struct Row {
    id: u16,
    name: String,
    #[serde(default)]
    isthing: u8,
}

impl ReadyMasks {
    /// Reads the tables and the names of the files.
    ///
    /// # Errors
    /// Files that cannot be read or hold no table.
    pub fn open(source: &ReadySource) -> Result<Self, AnnotateError> {
        let (files, categories, names) = match source {
            ReadySource::Coco(source) => {
                let labels = Labels::open(source).map_err(|error| SegmentError::Picture(error.to_string()))?;
                let (categories, names) = (labels.layer.categories.clone(), labels.stems());
                (Files::Coco(labels), categories, names)
            }
            ReadySource::Images(folder) => images(folder)?,
        };
        let mut inner = Inner { files, categories, by_stamp: BTreeMap::new(), by_index: BTreeMap::new() };
        inner.categories.sort_by_key(|category| category.id);
        for (name, number) in names {
            match name_of(&name) {
                Some(Name::Stamp(stamp)) => drop(inner.by_stamp.insert(stamp, number)),
                Some(Name::Index(index)) => drop(inner.by_index.insert(index, number)),
                None => {}
            }
        }
        if inner.by_stamp.is_empty() && inner.by_index.is_empty() {
            let what =
                "no file is named by a stamp (1600000006.666667, 1403715273262142976) or by a picture's number from 0";
            return Err(SegmentError::Picture(format!("ready masks: {what}")).into());
        }
        Ok(Self(Arc::new(inner)))
    }

    /// All categories, ids ascending.
    #[must_use]
    pub fn categories(&self) -> &[Category] {
        &self.0.categories
    }
}

impl Segmenter for ReadyMasks {
    fn segment(&mut self, picture: &Picture) -> Result<Option<Mask>, SegmentError> {
        let inner = &self.0;
        let found = inner.by_stamp.get(&picture.stamp).or_else(|| inner.by_index.get(&picture.index));
        let Some(&number) = found else { return Ok(None) };
        let size = (picture.width as u32, picture.height as u32);
        match &inner.files {
            Files::Coco(labels) => {
                let mask = labels.mask(number, size, &mut Repairs::default());
                mask.map(Some).map_err(|error| SegmentError::Picture(error.to_string()))
            }
            Files::Images(files) => files[number].read(size, &inner.categories).map(Some),
        }
    }

    fn categories(&self) -> &[Category] {
        &self.0.categories
    }
}

enum Name {
    Stamp(Stamp),
    Index(usize),
}

/// What a file's name without its extension means.
fn name_of(stem: &str) -> Option<Name> {
    const STAMP_DIGITS: usize = 16;
    if !stem.bytes().all(|b| b.is_ascii_digit() || b == b'.') {
        return None;
    }
    match stem.len() >= STAMP_DIGITS && !stem.contains('.') {
        true => stem.parse().ok().map(|ns| Name::Stamp(Stamp(ns))),
        false if stem.contains('.') => Stamp::from_decimal(stem).ok().map(Name::Stamp),
        false => stem.parse().ok().map(Name::Index),
    }
}

type Listing = (Files, Vec<Category>, Vec<(String, usize)>);

fn images(folder: &Path) -> Result<Listing, SegmentError> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| SegmentError::Io { path, source }
    };
    let json = folder.join("categories.json");
    let rows: Vec<Row> = serde_json::from_slice(&fs::read(&json).map_err(io(&json))?)
        .map_err(|error| SegmentError::Description { path: json.clone(), reason: error.to_string() })?;
    let categories = rows.into_iter().map(|r| Category { id: r.id, name: r.name, is_thing: r.isthing != 0 }).collect();
    let classes = folder.join("class");
    let mut paths = Vec::new();
    for entry in fs::read_dir(&classes).map_err(io(&classes))? {
        paths.push(entry.map_err(io(&classes))?.path());
    }
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "png"));
    paths.sort();
    let (mut files, mut names) = (Vec::new(), Vec::new());
    for class in paths {
        let instance = class.file_name().map(|name| folder.join("instance").join(name)).filter(|path| path.is_file());
        names.push((class.file_stem().unwrap_or_default().to_string_lossy().into_owned(), files.len()));
        files.push(Images { class, instance });
    }
    Ok((Files::Images(files), categories, names))
}

impl Images {
    /// Segments are pairs of class and instance, numbered in order of class, then instance.
    fn read(&self, size: (u32, u32), categories: &[Category]) -> Result<Mask, SegmentError> {
        let gray = |path: &Path| {
            let wrong = |reason: String| SegmentError::Picture(format!("{}: {reason}", path.display()));
            let bytes = fs::read(path).map_err(|source| SegmentError::Io { path: path.to_owned(), source })?;
            let (width, height, pixels) = decode_gray(&bytes).map_err(|error| wrong(error.to_string()))?;
            if (width, height) != size {
                return Err(wrong(format!("{width}x{height} pixels, the picture has {}x{}", size.0, size.1)));
            }
            Ok(pixels)
        };
        let class = gray(&self.class)?;
        let instance = self.instance.as_deref().map(gray).transpose()?.unwrap_or_else(|| class.clone());
        let wrong = |reason: String| SegmentError::Picture(format!("{}: {reason}", self.class.display()));
        let mut found: BTreeMap<(u16, u16), Segment> = BTreeMap::new();
        for (at, (&class, &instance)) in class.iter().zip(&instance).enumerate().filter(|(_, (c, _))| **c != VOID_CLASS)
        {
            let (x, y) = (at as u32 % size.0, at as u32 / size.0);
            let segment = found.entry((class, instance)).or_insert(Segment { x, y, ..Segment::default() });
            let (right, bottom) = ((segment.x + segment.width).max(x + 1), y + 1);
            (segment.x, segment.width) = (segment.x.min(x), right - segment.x.min(x));
            segment.height = bottom - segment.y;
            segment.area += 1;
        }
        if found.len() > usize::from(u16::MAX) {
            return Err(wrong(format!("{} segments, 65535 are possible", found.len())));
        }
        for (number, ((class, _), segment)) in found.iter_mut().enumerate() {
            if categories.binary_search_by_key(class, |category| category.id).is_err() {
                return Err(wrong(format!("class {class} is not in categories.json")));
            }
            (segment.id, segment.category_id, segment.score) = (number as u16 + 1, *class, SCORE_UNKNOWN);
        }
        let id = |(class, instance): (&u16, &u16)| found.get(&(*class, *instance)).map_or(0, |segment| segment.id);
        let ids = class.iter().zip(&instance).map(id).collect();
        Ok(Mask { instance: ids, segments: found.into_values().collect(), class })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{encode_gray8, encode_gray16};

    fn picture(stamp: i64, index: usize) -> Picture {
        Picture { stamp: Stamp(stamp), index, width: 3, height: 2, rgb: vec![0; 18] }
    }

    #[test]
    fn a_folder_of_class_and_instance_images() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("class")).unwrap();
        fs::create_dir_all(at("instance")).unwrap();
        let table = r#"[{"id": 9, "name": "wall"}, {"id": 1, "name": "person", "isthing": 1}]"#;
        fs::write(at("categories.json"), table).unwrap();
        fs::write(at("class/000001.png"), encode_gray8(3, 2, &[1, 1, 0, 9, 1, 9]).unwrap()).unwrap();
        fs::write(at("instance/000001.png"), encode_gray16(3, 2, &[400, 500, 7, 0, 500, 0]).unwrap()).unwrap();
        fs::write(at("class/0.5.png"), encode_gray8(3, 2, &[9; 6]).unwrap()).unwrap();
        fs::write(at("class/2.5.png"), encode_gray8(3, 2, &[8; 6]).unwrap()).unwrap();
        let mut ready = ReadyMasks::open(&ReadySource::of(folder.path())).unwrap();
        assert_eq!(ready.categories().iter().map(|c| c.id).collect::<Vec<_>>(), [1, 9]);
        let mask = ready.segment(&picture(0, 1)).unwrap().unwrap();
        assert_eq!(mask.instance, [1, 2, 0, 3, 2, 3]);
        let boxes: Vec<_> =
            mask.segments.iter().map(|s| (s.category_id, s.x, s.y, s.width, s.height, s.area)).collect();
        assert_eq!(boxes, [(1, 0, 0, 1, 1, 1), (1, 1, 0, 1, 2, 2), (9, 0, 1, 3, 1, 2)]);
        assert_eq!(ready.segment(&picture(500_000_000, 0)).unwrap().unwrap().segments.len(), 1);
        assert_eq!(ready.segment(&picture(1, 0)).unwrap(), None);
        let error = ready.segment(&picture(2_500_000_000, 0)).unwrap_err().to_string();
        assert!(error.contains("class 8 is not in categories.json"), "{error}");
    }
}
