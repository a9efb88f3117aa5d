//! Some topics of a log.

use super::{Channel, Edit, EditError, Output};
use schemas::metadata;
use schemas::topics::LayerTopics;
use std::collections::BTreeMap;

/// Keeps the topics that a rule names, and what describes them.
pub struct Filter<'a> {
    /// Whether a topic stays.
    pub keeps: &'a dyn Fn(&str) -> bool,
}

impl Edit for Filter<'_> {
    fn topic(&mut self, channel: &Channel) -> Result<Option<String>, EditError> {
        Ok((self.keeps)(&channel.topic).then(|| channel.topic.clone()))
    }

    fn metadata(&mut self, name: &str, values: BTreeMap<String, String>, out: &mut Output) -> Result<(), EditError> {
        if self.keeps_record(name) { out.keep_metadata(name, values) } else { Ok(()) }
    }
}

impl Filter<'_> {
    /// The description of a segmentation layer goes with its topics.
    pub(super) fn keeps_record(&self, name: &str) -> bool {
        let Some(layer) = name.strip_prefix(metadata::SEGMENTATION_PREFIX) else { return true };
        let LayerTopics { categories, label_info, class, instance, segments } = LayerTopics::new(layer);
        [categories, label_info, class, instance, segments].iter().any(|topic| (self.keeps)(topic))
    }
}
