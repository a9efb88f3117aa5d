//! What a model file takes and gives: a TOML beside it (`docs/segmentation.md` explains every key).

use crate::SegmentError;
use schemas::msg::Category;
use schemas::panoptic::{PERSON, VOID_CLASS};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// A model as described.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Description {
    /// Name and training data, for people and the log's record.
    pub name: String,
    /// Licence of the weights, as an SPDX expression if there is one.
    pub licence: String,
    /// The model file, relative to the description.
    pub model: PathBuf,
    /// BLAKE3 of the model file; a file with another one is refused. Left away: any file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub blake3: Option<String>,
    /// What its outputs mean.
    pub kind: Kind,
    /// The input tensor.
    pub input: Input,
    /// The output tensors.
    pub output: Outputs,
    /// What counts.
    #[serde(default)]
    pub merge: Merge,
    /// What the outputs' channels mean.
    pub classes: Classes,
}

/// What a model's outputs mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Boxes with mask coefficients `[1, 4 + classes + coefficients, anchors]` and prototypes `[1, coefficients, h, w]`.
    UltralyticsSeg,
    /// Scores a class and pixel, `[1, classes, h, w]`.
    Semantic,
    /// Class logits a query `[1, queries, classes (+ 1)]` and mask logits `[1, queries, h, w]`: DETR, MaskFormer, Mask2Former.
    PanopticQueries,
}

/// How a picture becomes the input tensor `[1, 3, height, width]`: value = (level / divisor - mean) / std.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Input {
    /// Name in the model.
    pub tensor: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What happens to other proportions.
    pub fit: Fit,
    /// Level around a letterboxed picture.
    pub pad: u8,
    /// Blue first.
    pub bgr: bool,
    /// By which levels 0..255 are divided.
    pub divisor: f32,
    /// By channel, after division.
    pub mean: [f32; 3],
    /// By channel, after division.
    pub std: [f32; 3],
}

impl Default for Input {
    fn default() -> Self {
        let (width, height) = (0, 0);
        let (mean, std) = ([0.0; 3], [1.0; 3]);
        Self {
            tensor: String::new(),
            width,
            height,
            fit: Fit::Letterbox,
            pad: 114,
            bgr: false,
            divisor: 255.0,
            mean,
            std,
        }
    }
}

/// What happens to pictures of other proportions than the input.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Fit {
    /// They are scaled by one factor, centred and padded.
    Letterbox,
    /// They are stretched.
    Stretch,
}

/// The output tensors; which are needed depends on [`Kind`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Outputs {
    /// `ultralytics-seg`: boxes. `semantic`: scores. `panoptic-queries`: class logits.
    pub scores: String,
    /// `ultralytics-seg`: prototypes. `panoptic-queries`: mask logits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub masks: Option<String>,
    /// Whether the outermost points of an output grid lie on the outermost pixels of the input, not half a cell inside.
    pub align_corners: bool,
    /// `panoptic-queries`: where the class "no object" stands.
    pub no_object: NoObject,
    /// `panoptic-queries`: how logits become scores.
    pub activation: Activation,
}

/// Where the class "no object" stands among a query's logits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum NoObject {
    /// Behind the classes.
    #[default]
    Last,
    /// In front of them.
    First,
    /// There is none.
    None,
}

/// How a query's logits become scores.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Activation {
    /// Over all classes together.
    #[default]
    Softmax,
    /// Each class alone.
    Sigmoid,
    /// They are scores already.
    None,
}

/// What counts as a thing or as stuff.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Merge {
    /// Least score of an instance or query.
    pub score: f32,
    /// Of two boxes of one class that overlap more (intersection over union), the better one stays.
    pub iou: f32,
    /// Least part of its pixels that a thing keeps where better ones lie over it.
    pub visible: f32,
    /// Least pixels of a thing.
    pub thing_area: u32,
    /// Least pixels of stuff in a picture.
    pub stuff_area: u32,
    /// `semantic`: a pixel is void, not stuff, where the logarithm of the odds of all stuff channels together against all others
    /// together is less than this: ln 9 = 2.2 means nine to one. 0 asks only that the best channel is stuff.
    pub stuff_margin: f32,
    /// `semantic`: a pixel is void, not stuff, where a person's logit is less than this below the best one.
    pub person_margin: f32,
}

impl Default for Merge {
    fn default() -> Self {
        Self {
            score: 0.5,
            iou: 0.6,
            visible: 0.5,
            thing_area: 200,
            stuff_area: 2000,
            stuff_margin: 0.0,
            person_margin: 0.0,
        }
    }
}

/// What the outputs' channels mean, by their number from 0 ("no object" not counted): category id and name in the log.
/// Channels that stand nowhere are ignored: their pixels are void.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Classes {
    /// Countable things.
    pub thing: BTreeMap<String, (u16, String)>,
    /// Stuff.
    pub stuff: BTreeMap<String, (u16, String)>,
    /// Channels of people, whom stuff never covers.
    pub person: Vec<usize>,
}

/// A category and its channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Number in the output.
    pub index: usize,
    /// What the log says.
    pub category: Category,
}

/// A description that was read and makes sense, with its files.
#[derive(Debug, Clone)]
pub struct Model {
    /// Where the description stands.
    pub toml: PathBuf,
    /// What it says.
    pub description: Description,
    /// Where the model stands.
    pub file: PathBuf,
    /// BLAKE3 of the model file, 64 hexadecimal digits.
    pub blake3: String,
    /// Channels with a category, by number.
    pub channels: Vec<Channel>,
}

impl Model {
    /// Reads a description and hashes its model, which stands beside it, or else in `folder`.
    ///
    /// # Errors
    /// A file that cannot be read, a description that makes no sense, another model than it names.
    pub fn read(toml: &Path, folder: Option<&Path>) -> Result<Self, SegmentError> {
        let io = |path: &Path| {
            let path = path.to_owned();
            move |source| SegmentError::Io { path, source }
        };
        let wrong = |reason: String| SegmentError::Description { path: toml.to_owned(), reason };
        if toml.extension().is_some_and(|extension| extension == "onnx") {
            return Err(wrong("is a model: give the TOML that describes it, see docs/segmentation.md".to_owned()));
        }
        let text = fs::read_to_string(toml).map_err(io(toml))?;
        let description: Description = toml::from_str(&text).map_err(|error| wrong(error.to_string()))?;
        let channels = description.channels().map_err(wrong)?;
        description.check().map_err(wrong)?;
        let beside = toml.parent().unwrap_or(Path::new("")).join(&description.model);
        let elsewhere = folder.map(|folder| folder.join(&description.model)).filter(|_| !beside.is_file());
        let file = elsewhere.unwrap_or(beside);
        let bytes = fs::read(&file).map_err(io(&file))?;
        let blake3 = blake3::hash(&bytes).to_hex().to_string();
        if let Some(wanted) = description.blake3.as_ref().filter(|wanted| **wanted != blake3) {
            let file = file.display();
            return Err(wrong(format!("is about a model with blake3 {wanted}; {file} has {blake3}")));
        }
        Ok(Self { toml: toml.to_owned(), description, file, blake3, channels })
    }
}

impl Description {
    fn channels(&self) -> Result<Vec<Channel>, String> {
        let rows = self.classes.thing.iter().map(|row| (row, true));
        let rows = rows.chain(self.classes.stuff.iter().map(|row| (row, false)));
        let channels = rows.map(|((index, (id, name)), is_thing)| {
            let index = index.parse().map_err(|_| format!("class `{index}` is no number of an output channel"))?;
            if *id == VOID_CLASS {
                return Err(format!("class {index} `{name}` has category id 0, which is void: give it another"));
            }
            if !is_thing && (name == PERSON || self.classes.person.contains(&index)) {
                return Err(format!("class {index} `{name}` is stuff, but people are never stuff"));
            }
            Ok(Channel { index, category: Category { id: *id, name: name.clone(), is_thing } })
        });
        let mut channels = channels.collect::<Result<Vec<_>, _>>()?;
        channels.sort_by_key(|channel| channel.index);
        match channels.windows(2).find(|pair| pair[0].index == pair[1].index) {
            Some(pair) => Err(format!("class {} is both a thing and stuff", pair[0].index)),
            None if channels.is_empty() => Err("no class is a thing or stuff".to_owned()),
            None => Ok(channels),
        }
    }

    fn check(&self) -> Result<(), String> {
        let Input { width, height, divisor, mean, std, .. } = &self.input;
        let say = |what: &str| Err(what.to_owned());
        if ![*width, *height].iter().all(|extent| (1..=1 << 14).contains(extent)) {
            return say("input: width and height must be 1 to 16384");
        }
        if !mean.iter().all(|v| v.is_finite()) || !std.iter().chain([divisor]).all(|v| v.is_finite() && *v != 0.0) {
            return say("input: mean, std and divisor must be finite, std and divisor not 0");
        }
        if self.input.tensor.is_empty() || self.output.scores.is_empty() {
            return say("input.tensor and output.scores must name the model's tensors");
        }
        if self.kind != Kind::Semantic && self.output.masks.is_none() {
            return say("output.masks must name the tensor of the masks");
        }
        if self.kind == Kind::UltralyticsSeg && !self.classes.stuff.is_empty() {
            return say("an instance network has things only");
        }
        if self.kind == Kind::Semantic && !self.classes.thing.is_empty() {
            return say("a semantic network has stuff only: it cannot tell things apart");
        }
        let Merge { score, iou, visible, stuff_margin, person_margin, .. } = self.merge;
        if ![score, iou, visible].iter().all(|part| (0.0..=1.0).contains(part))
            || ![stuff_margin, person_margin].iter().all(|margin| (0.0..=f32::MAX).contains(margin))
        {
            return say("merge: score, iou and visible are 0 to 1, margins are not negative");
        }
        Ok(())
    }

    /// The names of the outputs in the order in which the kind wants them.
    #[must_use]
    pub fn outputs(&self) -> Vec<&str> {
        let masks = self.output.masks.iter().filter(|_| self.kind != Kind::Semantic);
        std::iter::once(self.output.scores.as_str()).chain(masks.map(String::as_str)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = r#"
        name = "small"
        licence = "MIT"
        model = "small.onnx"
        kind = "semantic"
        input = { tensor = "x", width = 8, height = 6 }
        output = { scores = "y" }
        [classes]
        person = [2]
        stuff = { 0 = [9, "wall"], 10 = [3, "floor"] }
    "#;

    fn read(text: &str) -> Result<Model, String> {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("small.onnx"), b"model").unwrap();
        let toml = folder.path().join("small.toml");
        fs::write(&toml, text).unwrap();
        Model::read(&toml, None).map_err(|error| error.to_string())
    }

    #[test]
    fn a_description_has_defaults_and_hashes() {
        let model = read(TEXT).unwrap();
        assert_eq!(model.blake3, blake3::hash(b"model").to_hex().to_string());
        assert_eq!(model.description.input.divisor, 255.0);
        let ids: Vec<_> = model.channels.iter().map(|c| (c.index, c.category.id, c.category.is_thing)).collect();
        assert_eq!(ids, [(0, 9, false), (10, 3, false)]);
        let again: Description = toml::from_str(&toml::to_string(&model.description).unwrap()).unwrap();
        assert_eq!(again, model.description);
    }

    #[test]
    fn nonsense_is_refused_with_the_reason() {
        let refused = |from: &str, to: &str, reason: &str| {
            assert!(TEXT.contains(from), "{from}");
            let error = read(&TEXT.replace(from, to)).unwrap_err();
            assert!(error.contains("small.toml") && error.contains(reason), "{error}");
        };
        refused("width = 8", "width = 0", "1 to 16384");
        refused("[9, \"wall\"]", "[0, \"wall\"]", "which is void");
        refused("[9, \"wall\"]", "[9, \"person\"]", "never stuff");
        refused("person = [2]", "person = [10]", "never stuff");
        refused("0 = [9", "a = [9", "no number");
        refused("\"semantic\"", "\"ultralytics-seg\"", "output.masks");
        refused("\"semantic\"", "\"other\"", "unknown variant");
        refused("model = ", "blake3 = \"00\"\nmodel = ", "blake3 00");
        refused("stuff = {", "thing = {", "stuff only");
        refused("licence", "license", "unknown field");
    }

    #[test]
    fn a_model_is_not_its_description() {
        assert!(Model::read(Path::new("x.onnx"), None).unwrap_err().to_string().contains("give the TOML"));
    }
}
