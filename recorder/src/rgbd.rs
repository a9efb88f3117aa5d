//! A log of a camera, with depth, a second camera or neither: the project's topics, frames and metadata in one place for
//! every writer.

use crate::layer::{Layer, LayerSpec};
use crate::log_writer::{LogOptions, LogWriter, WriteError};
use schemas::calibration::CameraModel;
use schemas::msg::{
    CameraInfo, CompressedImage, Header, Image, Point, Pose, PoseStamped, Quaternion, TFMessage, Transform,
    TransformStamped, Vector3, encoding,
};
use schemas::stereo::StereoModel;
use schemas::topics::{self, frame};
use schemas::{Stamp, metadata, pairing};
use segment::Mask;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// What holds for a whole log.
#[derive(Debug, Clone)]
pub struct RgbdSpec {
    /// Kind of source: `tum`, `synthetic`, ...
    pub kind: String,
    /// Name of the sequence.
    pub name: String,
    /// Version of the writing program, as `pslam 0.1.0`.
    pub program: String,
    /// The colour camera, of a stereo camera the left one, as it records; depth is registered to it.
    pub camera: CameraModel,
    /// What there is beside its pictures.
    pub beside: Beside,
    /// Depth value of one metre, exact decimal text (`5000`, `1000`).
    pub depth_units_per_metre: String,
    /// Colour and depth closer than this are one frame, see [`pairing::associate`].
    pub tolerance_ns: u64,
    /// Segmentation layers.
    pub layers: Vec<LayerSpec>,
}

impl RgbdSpec {
    /// A spec with the field's defaults: depth 5000 per metre, 20 ms, no segmentation.
    #[must_use]
    pub fn new(kind: &str, name: &str, camera: CameraModel) -> Self {
        Self {
            kind: kind.to_owned(),
            name: name.to_owned(),
            program: concat!("pslam ", env!("CARGO_PKG_VERSION")).to_owned(),
            camera,
            beside: Beside::Depth,
            depth_units_per_metre: "5000".to_owned(),
            tolerance_ns: pairing::DEFAULT_TOLERANCE_NS,
            layers: Vec::new(),
        }
    }
}

/// What a camera has beside its pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "there is one a log")]
pub enum Beside {
    /// Depth images.
    Depth,
    /// A second camera.
    Right(StereoModel),
    /// Nothing.
    Nothing,
}

/// An open log of a camera. Calls come in order of their stamps.
pub struct RgbdLog {
    log: LogWriter,
    camera: CameraModel,
    beside: Beside,
    layers: Vec<Layer>,
}

impl RgbdLog {
    /// Starts the log and writes what holds for all of it.
    ///
    /// # Errors
    /// An impossible spec, an existing file, or the file system refuses.
    pub fn create(path: &Path, options: &LogOptions, spec: &RgbdSpec) -> Result<Self, WriteError> {
        let camera = spec.camera.validated().map_err(|error| WriteError::Invalid(error.to_string()))?;
        if let Beside::Right(stereo) = &spec.beside
            && stereo.left != camera
        {
            return Err(WriteError::Invalid("the stereo camera's left camera is not the log's camera".to_owned()));
        }
        check_units(&spec.depth_units_per_metre)?;
        let layers = spec.layers.iter().map(Layer::new).collect::<Result<Vec<_>, _>>()?;
        if let Some(twice) =
            (1..layers.len()).find(|i| layers[..*i].iter().any(|layer| layer.name() == layers[*i].name()))
        {
            return Err(WriteError::Invalid(format!("layer name {} is used twice", layers[twice].name())));
        }
        let mut log = LogWriter::create(path, options)?;
        write_spec(&mut log, spec, &layers)?;
        if spec.beside == Beside::Depth {
            let units = (metadata::DEPTH_UNITS_PER_METRE.to_owned(), spec.depth_units_per_metre.clone());
            log.open_topic::<Image<'_>>(topics::DEPTH, BTreeMap::from([units]))?;
        }
        Ok(Self { log, camera, beside: spec.beside, layers })
    }

    /// A ground-truth pose, `world_from_camera`: metres and a quaternion x, y, z, w.
    ///
    /// # Errors
    /// See [`LogWriter::write`].
    pub fn ground_truth(&mut self, stamp: Stamp, t: [f64; 3], q: [f64; 4]) -> Result<(), WriteError> {
        let header = Header::new(stamp, frame::WORLD)?;
        let orientation = Quaternion { x: q[0], y: q[1], z: q[2], w: q[3] };
        let pose = Pose { position: Point { x: t[0], y: t[1], z: t[2] }, orientation };
        let translation = Vector3 { x: t[0], y: t[1], z: t[2] };
        let transform = Transform { translation, rotation: orientation };
        let edge = TransformStamped { header: header.clone(), child_frame_id: frame::CAMERA.to_owned(), transform };
        self.log.write(topics::GROUND_TRUTH, stamp, &PoseStamped { header, pose })?;
        self.log.write(topics::TF, stamp, &TFMessage { transforms: vec![edge] })
    }

    /// A colour picture file; `format` as in [`schemas::msg::format`]. The caller vouches for its size.
    ///
    /// # Errors
    /// See [`LogWriter::write`].
    pub fn color(&mut self, stamp: Stamp, format: &str, bytes: &[u8]) -> Result<(), WriteError> {
        let info = self.camera_info(stamp)?;
        let message =
            CompressedImage { header: info.header.clone(), format: format.to_owned(), data: Cow::Borrowed(bytes) };
        self.log.write(topics::COLOR_INFO, stamp, &info)?;
        self.log.write(topics::COLOR, stamp, &message)
    }

    /// A picture file of the right camera.
    ///
    /// # Errors
    /// The log was not made for a stereo camera; see [`LogWriter::write`].
    pub fn right(&mut self, stamp: Stamp, format: &str, bytes: &[u8]) -> Result<(), WriteError> {
        let Beside::Right(stereo) = &self.beside else {
            return Err(WriteError::Invalid("a right picture in the log of a single camera".to_owned()));
        };
        let header = Header::new(stamp, frame::RIGHT_CAMERA)?;
        let [_, info] = stereo.to_camera_infos(Header::default(), header.clone());
        let message = CompressedImage { header, format: format.to_owned(), data: Cow::Borrowed(bytes) };
        self.log.write(topics::RIGHT_INFO, stamp, &info)?;
        self.log.write(topics::RIGHT, stamp, &message)
    }

    /// A depth image registered to colour, 0 = no measurement.
    ///
    /// # Errors
    /// A pixel count other than the camera's; see [`LogWriter::write`].
    pub fn depth(&mut self, stamp: Stamp, pixels: &[u16]) -> Result<(), WriteError> {
        self.check_pixels("depth", stamp, pixels.len())?;
        let info = self.camera_info(stamp)?;
        let message = Image::from_u16(info.header.clone(), encoding::DEPTH, self.camera.width, pixels);
        self.log.write(topics::DEPTH_INFO, stamp, &info)?;
        self.log.write(topics::DEPTH, stamp, &message)
    }

    /// The labels of the colour picture with this stamp; `layer` indexes [`RgbdSpec::layers`].
    ///
    /// # Errors
    /// A pixel count other than the camera's, an unknown layer; see [`LogWriter::write`].
    pub fn mask(&mut self, layer: usize, stamp: Stamp, mask: &Mask) -> Result<(), WriteError> {
        self.check_pixels("class mask", stamp, mask.class.len())?;
        self.check_pixels("instance mask", stamp, mask.instance.len())?;
        let Some(layer) = self.layers.get_mut(layer) else {
            return Err(WriteError::Invalid(format!("layer {layer} is not in the log's specification")));
        };
        layer.write(&mut self.log, (stamp, stamp), self.camera.width, mask)
    }

    /// The log underneath, for further topics, metadata, attachments and flushing.
    pub fn log(&mut self) -> &mut LogWriter {
        &mut self.log
    }

    /// Closes the log, see [`LogWriter::finish`].
    ///
    /// # Errors
    /// The file system refuses.
    pub fn finish(self) -> Result<u64, WriteError> {
        self.log.finish()
    }

    /// Gives up, see [`LogWriter::discard`].
    pub fn discard(self) {
        self.log.discard();
    }

    fn camera_info(&self, stamp: Stamp) -> Result<CameraInfo, WriteError> {
        let header = Header::new(stamp, frame::CAMERA)?;
        Ok(match &self.beside {
            Beside::Right(stereo) => stereo.to_camera_infos(header, Header::default())[0].clone(),
            Beside::Depth | Beside::Nothing => self.camera.to_camera_info(header),
        })
    }

    fn check_pixels(&self, what: &'static str, stamp: Stamp, found: usize) -> Result<(), WriteError> {
        let CameraModel { width, height, .. } = self.camera;
        if found as u64 == u64::from(width) * u64::from(height) {
            return Ok(());
        }
        Err(WriteError::Pixels { what, stamp, found, width, height })
    }
}

/// The depth scale must be a positive plain decimal, since it is kept as text.
fn check_units(text: &str) -> Result<(), WriteError> {
    let plain = text.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    match text.parse::<f64>() {
        Ok(value) if plain && value > 0.0 && value.is_finite() => Ok(()),
        _ => Err(WriteError::Invalid(format!("depth scale `{text}` is not a positive decimal number like 5000"))),
    }
}

/// Metadata that a reader needs before the first message.
fn write_spec(log: &mut LogWriter, spec: &RgbdSpec, layers: &[Layer]) -> Result<(), WriteError> {
    let table = |entries: &[(&str, &str)]| -> BTreeMap<String, String> {
        entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect()
    };
    let source = [
        ("kind", spec.kind.as_str()),
        ("name", &spec.name),
        ("program", &spec.program),
        ("log_format", metadata::LOG_FORMAT),
    ];
    log.metadata(metadata::SOURCE, table(&source))?;
    let conventions = [
        ("time", "nanoseconds of the source's own clock; log time = publish time = header stamp"),
        ("world", "fixed frame of the ground truth, metres"),
        ("camera", "colour (left) camera: x right, y down, z forward, pixel centres at whole numbers"),
        ("poses", "PoseStamped and TF: world_from_camera, quaternion x y z w as the source wrote it"),
        match spec.beside {
            Beside::Depth => ("depth", "16UC1 along z, registered to colour, 0 = none; units_per_metre in pslam/depth"),
            Beside::Right(_) => ("depth", "none; both pictures as recorded, R and P of camera_info rectify them"),
            Beside::Nothing => ("depth", "none"),
        },
        ("masks", "class and instance id a pixel, 0 = void = unknown; stamp of the colour picture"),
    ];
    log.metadata(metadata::CONVENTIONS, table(&conventions))?;
    if spec.beside == Beside::Depth {
        let units = (metadata::DEPTH_UNITS_PER_METRE, spec.depth_units_per_metre.as_str());
        log.metadata(metadata::DEPTH, table(&[units, ("registered_to", frame::CAMERA)]))?;
    }
    let tolerance = spec.tolerance_ns.to_string();
    let pairing =
        [(metadata::TOLERANCE_NS, tolerance.as_str()), ("rule", "closest first, each stamp once, strictly nearer")];
    log.metadata(metadata::PAIRING, table(&pairing))?;
    for (layer, LayerSpec { origin, .. }) in layers.iter().zip(&spec.layers) {
        log.metadata(&layer.record_name(), layer.record(origin))?;
    }
    Ok(())
}
