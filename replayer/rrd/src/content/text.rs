//! Text, the meaning of class ids, and wiping.

use re_sdk_types::archetypes;
use re_sdk_types::{SerializedComponentBatch, components, datatypes};

use super::{Rgba, sealed, serialized};
use crate::RrdError;

/// How serious a line of the text log is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Something to know.
    Info,
    /// Something to look at.
    Warn,
    /// Something failed.
    Error,
}

/// A line of the text log.
#[derive(Clone, Copy, Debug)]
pub struct TextLog<'a> {
    /// How serious it is.
    pub level: Level,
    /// One line.
    pub text: &'a str,
}

impl sealed::Components for TextLog<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let level = match self.level {
            Level::Info => components::TextLogLevel::INFO,
            Level::Warn => components::TextLogLevel::WARN,
            Level::Error => components::TextLogLevel::ERROR,
        };
        Ok(serialized(&archetypes::TextLog::new(self.text).with_level(level)))
    }
}

/// A page of text.
#[derive(Clone, Copy, Debug)]
pub struct TextDocument<'a> {
    /// CommonMark.
    pub markdown: &'a str,
}

impl sealed::Components for TextDocument<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        Ok(serialized(&archetypes::TextDocument::from_markdown(self.markdown)))
    }
}

/// Name and colour of one class.
#[derive(Clone, Copy, Debug)]
pub struct Class<'a> {
    /// The id used in segmentation images, points and boxes.
    pub id: u16,
    /// Name shown to the user.
    pub label: &'a str,
    /// Its colour.
    pub color: Rgba,
}

/// What class ids mean, for the entity it is logged at and all below.
#[derive(Clone, Copy, Debug, Default)]
pub struct AnnotationContext<'a> {
    /// All classes.
    pub classes: &'a [Class<'a>],
}

impl sealed::Components for AnnotationContext<'_> {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        let classes = self.classes.iter().map(|class| {
            let [r, g, b, a] = class.color;
            datatypes::ClassDescriptionMapElem::from((
                class.id,
                class.label,
                datatypes::Rgba32::from_unmultiplied_rgba(r, g, b, a),
            ))
        });
        Ok(serialized(&archetypes::AnnotationContext::new(components::AnnotationContext(classes.collect()))))
    }
}

/// Nothing: the entity disappears from this time on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Clear {
    /// Also everything below it.
    pub recursive: bool,
}

impl sealed::Components for Clear {
    fn components(&self, _entity: &str) -> Result<Vec<SerializedComponentBatch>, RrdError> {
        Ok(serialized(&archetypes::Clear::new(self.recursive)))
    }
}
