//! The segmenter that runs networks.

use crate::compose::{ThingRule, compose};
use crate::description::{Kind, Model};
use crate::mask::united;
use crate::{Engine, Mask, Picture, Placement, Runtime, SegmentError, Segmenter};
use crate::{instances, preprocess, queries, semantic};
use schemas::msg::Category;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Networks that belong together, read but not loaded.
#[derive(Debug, Clone)]
pub struct NetworkSpec {
    /// In the order in which they were given.
    pub models: Vec<Model>,
    /// Of all of them, ids ascending.
    pub categories: Vec<Category>,
}

impl NetworkSpec {
    /// Reads descriptions: any number of instance and semantic networks, or one end-to-end panoptic one. Models stand beside
    /// their descriptions, or else in `folder`.
    ///
    /// # Errors
    /// See [`Model::read`]; networks that do not go together.
    pub fn read(descriptions: &[PathBuf], folder: Option<&Path>) -> Result<Self, SegmentError> {
        let models = descriptions.iter().map(|path| Model::read(path, folder)).collect::<Result<Vec<_>, _>>()?;
        let Some(last) = models.last() else {
            return Err(SegmentError::Runtime("no model was given".to_owned()));
        };
        let wrong = |reason: String| SegmentError::Description { path: last.toml.clone(), reason };
        if models.len() > 1 && models.iter().any(|model| model.description.kind == Kind::PanopticQueries) {
            return Err(wrong("an end-to-end panoptic network goes alone, but there are others".to_owned()));
        }
        let categories = models.iter().flat_map(|model| model.channels.iter().map(|channel| channel.category.clone()));
        let categories = united(categories).map_err(wrong)?;
        Ok(Self { models, categories })
    }
}

/// Loaded networks. Parallel callers load one each.
pub struct Network {
    spec: Arc<NetworkSpec>,
    /// One a model.
    engines: Vec<Box<dyn Engine>>,
}

impl Network {
    /// Loads them.
    ///
    /// # Errors
    /// See [`Runtime::load`].
    pub fn load(spec: &Arc<NetworkSpec>, runtime: &Runtime) -> Result<Self, SegmentError> {
        let engines = spec.models.iter().map(|model| runtime.load(model)).collect::<Result<_, _>>()?;
        Ok(Self { spec: Arc::clone(spec), engines })
    }
}

impl Segmenter for Network {
    fn segment(&mut self, picture: &Picture) -> Result<Option<Mask>, SegmentError> {
        let size = (picture.width, picture.height);
        if size.0 == 0 || size.1 == 0 || picture.rgb.len() != size.0 * size.1 * 3 {
            let bytes = picture.rgb.len();
            return Err(SegmentError::Picture(format!("{bytes} bytes are no RGB picture of {}x{}", size.0, size.1)));
        }
        let (mut things, mut stuffs) = (Vec::new(), Vec::new());
        for (model, engine) in self.spec.models.iter().zip(&mut self.engines) {
            let wrong = |reason: String| SegmentError::Model { model: model.file.clone(), reason };
            let description = &model.description;
            let placement = Placement::new(&description.input, size.0, size.1);
            let input = preprocess::input_tensor(&description.input, picture, &placement);
            let outputs = engine.run(input).map_err(wrong)?;
            match (description.kind, outputs.as_slice()) {
                (Kind::UltralyticsSeg, [boxes, prototypes]) => {
                    let merge = &description.merge;
                    let rule = ThingRule { least_area: merge.thing_area, visible: merge.visible };
                    let found = instances::instances(model, boxes, prototypes, &placement, size).map_err(wrong)?;
                    things.extend(found.into_iter().map(|instance| (instance, rule)));
                }
                (Kind::Semantic, [scores]) => {
                    stuffs.push(semantic::stuff(model, scores, &placement, size).map_err(wrong)?);
                }
                (Kind::PanopticQueries, [classes, masks]) => {
                    return queries::panoptic(model, classes, masks, &placement, size).map(Some).map_err(wrong);
                }
                (kind, outputs) => return Err(wrong(format!("{} outputs for {kind:?}", outputs.len()))),
            }
        }
        Ok(Some(compose(size.0, size.1, things, &stuffs)))
    }

    fn categories(&self) -> &[Category] {
        &self.spec.categories
    }
}
