//! A segmentation layer of a log: its description, and its messages in the order in which every writer writes them.

use crate::log_writer::{LogWriter, WriteError};
use schemas::msg::{Category, CategoryTable, Header, Image, SegmentTable, encoding};
use schemas::topics::{self, LayerTopics, frame};
use schemas::{Message, Stamp, metadata, panoptic};
use segment::Mask;
use std::collections::BTreeMap;

/// A segmentation layer.
#[derive(Debug, Clone)]
pub struct LayerSpec {
    /// Name in the topics, usually [`topics::DEFAULT_LAYER`].
    pub name: String,
    /// Where the labels come from, in words (network and weights, or data set).
    pub origin: String,
    /// All categories; ids above 0, each once. Written in ascending order.
    pub categories: Vec<Category>,
}

/// Where messages go. Times are the stamp and the publish time.
pub trait Sink {
    /// What can go wrong.
    type Error: From<WriteError>;

    /// Writes one message.
    fn put<'a, M: Message<'a>>(&mut self, topic: &str, times: (Stamp, Stamp), message: &M) -> Result<(), Self::Error>;
}

/// A log in order of stamps.
impl Sink for LogWriter {
    type Error = WriteError;

    fn put<'a, M: Message<'a>>(&mut self, topic: &str, times: (Stamp, Stamp), message: &M) -> Result<(), WriteError> {
        self.write(topic, times.0, message)
    }
}

/// A layer that is being written.
pub struct Layer {
    topics: LayerTopics,
    name: String,
    categories: Vec<Category>,
    announced: bool,
}

impl Layer {
    /// A layer with a usable name and table.
    pub fn new(spec: &LayerSpec) -> Result<Self, WriteError> {
        let name = &spec.name;
        if !topics::is_layer_name(name) {
            return Err(WriteError::Invalid(format!(
                "layer name `{name}` must be letters, digits and _, a letter first"
            )));
        }
        let mut categories = spec.categories.clone();
        categories.sort_by_key(|category| category.id);
        let duplicate = categories.windows(2).find(|pair| pair[0].id == pair[1].id).map(|pair| pair[0].id);
        let reserved = categories.first().filter(|category| category.id == panoptic::VOID_CLASS).map(|_| 0);
        if let Some(id) = duplicate.or(reserved) {
            return Err(WriteError::Invalid(format!(
                "layer {name}: category id {id} is used twice or is 0, which is void: give each category its own id from 1"
            )));
        }
        Ok(Self { topics: LayerTopics::new(name), name: name.clone(), categories, announced: false })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name of its metadata record.
    pub fn record_name(&self) -> String {
        format!("{}{}", metadata::SEGMENTATION_PREFIX, self.name)
    }

    /// What every layer's record holds.
    pub fn record(&self, origin: &str) -> BTreeMap<String, String> {
        let entries = [("origin", origin), ("void", "0"), ("class_encoding", self.class_encoding())];
        entries.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect()
    }

    /// `mono8` as long as every class id fits.
    fn class_encoding(&self) -> &'static str {
        if self.categories.iter().all(|c| c.id <= u16::from(u8::MAX)) { encoding::MONO8 } else { encoding::MONO16 }
    }

    /// Writes the labels of the colour picture with this stamp; before the first ones, the categories.
    pub fn write<S: Sink>(
        &mut self,
        sink: &mut S,
        times: (Stamp, Stamp),
        width: u32,
        mask: &Mask,
    ) -> Result<(), S::Error> {
        let header = Header::new(times.0, frame::CAMERA).map_err(WriteError::from)?;
        if !self.announced {
            let categories = self.categories.clone();
            let table = CategoryTable { header: header.clone(), layer: self.name.clone(), categories };
            sink.put(&self.topics.categories, times, &table)?;
            sink.put(&self.topics.label_info, times, &panoptic::label_info(&table))?;
            self.announced = true;
        }
        let class_bytes: Vec<u8>;
        let class = if self.class_encoding() == encoding::MONO8 {
            let ids = mask.class.iter().map(|id| u8::try_from(*id));
            let stamp = times.0;
            let unknown =
                |_| WriteError::Invalid(format!("mask at {stamp} s has class ids outside the category table"));
            class_bytes = ids.collect::<Result<_, _>>().map_err(unknown)?;
            Image::from_u8(header.clone(), encoding::MONO8, width, &class_bytes)
        } else {
            Image::from_u16(header.clone(), encoding::MONO16, width, &mask.class)
        };
        sink.put(&self.topics.class, times, &class)?;
        let instance = Image::from_u16(header.clone(), encoding::MONO16, width, &mask.instance);
        sink.put(&self.topics.instance, times, &instance)?;
        let table = SegmentTable { header, layer: self.name.clone(), segments: mask.segments.clone() };
        sink.put(&self.topics.segments, times, &table)
    }
}
