//! Which camera, and how it is set.

use super::asked;
use super::synthetic::Synthetic;
use crate::Usage;
use crate::progress::Progress;
use anyhow::Context as _;
use recorder::capture::{CameraSetup, CameraSource, Pace, Source};
use recorder::realsense::{Camera, CameraError, Context, Finding, Library, VideoMode, Wish};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// Kind of camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// A RealSense camera, or a recording of one with --play.
    Realsense,
    /// A rendered room: to try recording without a camera.
    Synthetic,
    /// None: motion capture alone.
    None,
}

/// Arguments.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Camera")]
pub struct CameraArgs {
    /// Where pictures come from.
    #[arg(long = "source", value_enum, default_value = "realsense")]
    kind: Kind,
    /// Serial number, if several cameras are connected.
    #[arg(long)]
    serial: Option<String>,
    /// Colour, as 640x480@30, or off.
    #[arg(long, value_name = "WxH@FPS", default_value = "640x480@30", value_parser = mode)]
    color: Mode,
    /// Depth, as 640x480@30, or off.
    #[arg(long, value_name = "WxH@FPS", default_value = "640x480@30", value_parser = mode)]
    depth: Mode,
    /// Gyroscope and accelerometer too.
    #[arg(long)]
    imu: bool,
    /// Infrared projector: on or off.
    #[arg(long, value_name = "on|off", value_parser = clap::builder::PossibleValuesParser::new(["on", "off"]))]
    emitter: Option<String>,
    /// Exposure in the camera's own units (depth: microseconds); turns automatic exposure off.
    #[arg(long, value_name = "N", value_parser = number)]
    exposure: Option<f32>,
    /// Preset of the depth camera by its name, as high-accuracy.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    /// Any other option by the library's name, as laser-power=150; may be given several times.
    #[arg(long, value_name = "NAME=VALUE", value_parser = option)]
    option: Vec<(String, f32)>,
    /// librealsense2.so, or the library in the Python wheel pyrealsense2.
    #[arg(long, value_name = "PATH")]
    librealsense: Option<PathBuf>,
    /// Play this recording of librealsense (.bag, .db3) as if it were a camera, at the speed at which it was made.
    #[arg(long, value_name = "FILE")]
    play: Option<PathBuf>,
    /// Play it as fast as it can be taken.
    #[arg(long, requires = "play")]
    unpaced: bool,
    /// Record over a USB 2 link.
    #[arg(long)]
    allow_usb2: bool,
    /// Record the nearest profile if the camera does not offer the one that was asked for.
    #[arg(long)]
    allow_other_profile: bool,
    /// Record frames that this computer stamps, because the camera's metadata does not come through.
    #[arg(long, alias = "allow-system-time")]
    pub allow_missing_metadata: bool,
}

/// A picture stream, or none.
type Mode = Switched<VideoMode>;

/// Something that can be off.
#[derive(Debug, Clone, Copy)]
pub struct Switched<T>(Option<T>);

fn mode(text: &str) -> Result<Mode, String> {
    if text == "off" { Ok(Switched(None)) } else { text.parse().map(|mode| Switched(Some(mode))) }
}

fn number(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|value: &f32| value.is_finite()).ok_or_else(|| format!("`{text}` is not a number"))
}

fn option(text: &str) -> Result<(String, f32), String> {
    let parsed = text.split_once('=').and_then(|(name, value)| Some((name.to_owned(), number(value).ok()?)));
    parsed.ok_or_else(|| format!("`{text}` is not NAME=NUMBER"))
}

impl CameraArgs {
    /// The source; `None` without a camera.
    pub fn source(&self, progress: Progress) -> anyhow::Result<Option<Box<dyn Source>>> {
        self.check()?;
        match self.kind {
            Kind::Realsense => self.realsense().map(Some),
            Kind::Synthetic => Ok(Some(Box::new(Synthetic::new(self.wish(), progress)?))),
            Kind::None => Ok(None),
        }
    }

    /// Refuses what would be passed over in silence.
    fn check(&self) -> Result<(), Usage> {
        if self.kind != Kind::None && self.color.0.is_none() && self.depth.0.is_none() && !self.imu {
            return Err(Usage(
                "colour and depth are off and --imu is not there: --source none records no camera".to_owned(),
            ));
        }
        let of_a_realsense = [
            (self.serial.is_some(), "--serial"),
            (self.emitter.is_some(), "--emitter"),
            (self.exposure.is_some(), "--exposure"),
            (self.preset.is_some(), "--preset"),
            (!self.option.is_empty(), "--option"),
            (self.librealsense.is_some(), "--librealsense"),
            (self.play.is_some(), "--play"),
        ];
        match of_a_realsense.into_iter().find(|(is_given, _)| *is_given) {
            Some((_, name)) if self.kind != Kind::Realsense => {
                Err(Usage(format!("{name} is for a RealSense camera, and --source asks for another")))
            }
            _ => Ok(()),
        }
    }

    fn wish(&self) -> Wish {
        Wish { color: self.color.0, depth: self.depth.0, imu: self.imu }
    }

    /// What was asked for, for the log.
    pub fn asked(&self) -> BTreeMap<String, String> {
        let mode = |mode: &Mode| mode.0.map_or_else(|| "off".to_owned(), |mode| mode.to_string());
        let mut asked = asked(&[
            ("source", format!("{:?}", self.kind).to_lowercase()),
            ("color", mode(&self.color)),
            ("depth", mode(&self.depth)),
            ("imu", self.imu.to_string()),
        ]);
        let set = |value: Option<String>, name: &str| value.map(|value| (name.to_owned(), value));
        asked.extend(set(self.emitter.clone(), "emitter"));
        asked.extend(set(self.exposure.map(|value| value.to_string()), "exposure"));
        asked.extend(set(self.preset.clone(), "preset"));
        asked.extend(self.option.iter().map(|(name, value)| (format!("camera/{name}"), value.to_string())));
        asked
    }

    fn realsense(&self) -> anyhow::Result<Box<dyn Source>> {
        let library = Library::load(self.librealsense.as_deref())?;
        let context = Arc::new(Context::new(&library)?);
        let serial = match &self.play {
            None => self.serial.clone(),
            Some(file) => {
                context.add_recording(file).with_context(|| format!("cannot play {}", file.display()))?;
                context.devices()?.into_iter().find(|device| device.recording.is_some()).map(|device| device.serial)
            }
        };
        let args = self.clone();
        let open = move || args.open(&context, serial.as_deref());
        let (camera, setup, findings) = open()?;
        self.judge(&findings)?;
        let again = move || open().map(|(camera, setup, _)| (camera, setup));
        let pace = match (&self.play, self.unpaced) {
            (None, _) => Pace::Camera,
            (Some(_), false) => Pace::Recorded,
            (Some(_), true) => Pace::Free,
        };
        Ok(Box::new(CameraSource::new((camera, setup), Box::new(again), pace)))
    }

    /// Opens and sets the camera.
    fn open(
        &self,
        context: &Arc<Context>,
        serial: Option<&str>,
    ) -> Result<(Camera, CameraSetup, Vec<Finding>), CameraError> {
        let camera = context.open(serial)?;
        let selection = camera.select(&self.wish())?;
        if !camera.is_playback() {
            self.set(&camera)?;
        }
        let calibration = Arc::new(camera.calibration(&selection.profiles)?);
        let library = context.library();
        // librealsense numbers them from 0 without gaps; beyond the last its name is "UNKNOWN".
        let names = (0..u32::from(u8::MAX)).map(|number| (number, library.metadata_name(number)));
        let setup = CameraSetup {
            library: format!("librealsense {}", library.version()),
            device: camera.describe()?,
            calibration,
            attribute_names: names.take_while(|(_, name)| name != "UNKNOWN").collect(),
        };
        Ok((camera, setup, selection.findings))
    }

    /// Sets what was asked for. The camera's clock is recorded as it is: the library's mapping of it to the host's clock
    /// would follow each step of that one.
    fn set(&self, camera: &Camera) -> Result<(), CameraError> {
        // Old firmware has no such option, and stamps by its own clock then.
        let _ = camera.set_option("Global Time Enabled", 0.0);
        if let Some(word) = &self.preset {
            let value = camera.option_word("Visual Preset", word)?;
            let unknown = || CameraError::Text(format!("the camera knows no preset `{word}`"));
            camera.set_option("Visual Preset", value.ok_or_else(unknown)?)?;
        }
        if let Some(emitter) = &self.emitter {
            camera.set_option("Emitter Enabled", if emitter == "on" { 1.0 } else { 0.0 })?;
        }
        if let Some(exposure) = self.exposure {
            camera.set_option("Enable Auto Exposure", 0.0)?;
            camera.set_option("Exposure", exposure)?;
        }
        for (name, value) in &self.option {
            camera.set_option(name, *value)?;
        }
        Ok(())
    }

    /// Refuses what nobody allowed.
    fn judge(&self, findings: &[Finding]) -> anyhow::Result<()> {
        let allowed = |finding: &Finding| match finding.allowed_by() {
            "--allow-usb2" => self.allow_usb2,
            "--allow-other-profile" => self.allow_other_profile,
            _ => self.allow_missing_metadata,
        };
        match findings.iter().find(|finding| !allowed(finding)) {
            Some(finding) => Err(Usage(format!("{finding}; {} records all the same", finding.allowed_by())).into()),
            None => Ok(()),
        }
    }
}
