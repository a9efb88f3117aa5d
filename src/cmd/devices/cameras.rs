//! The cameras of `pslam devices`.

use recorder::realsense::{Context, DeviceDescription, Finding, Library, LoadError, SensorDescription, StreamProfile};
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};

/// What librealsense sees.
#[derive(Debug, Serialize)]
pub struct Cameras {
    /// Version.
    librealsense: String,
    /// Where it was found.
    library: PathBuf,
    /// Cameras, and recordings that stand for one.
    cameras: Vec<Camera>,
}

#[derive(Debug, Serialize)]
struct Camera {
    #[serde(flatten)]
    device: DeviceDescription,
    /// What would keep `pslam record` from recording it.
    finding: Option<Finding>,
}

impl Cameras {
    /// Looks for cameras; `play` is a recording that is to be one. `None`: librealsense is not installed.
    pub fn look(library: Option<&Path>, play: Option<&Path>) -> anyhow::Result<Option<Self>> {
        let library = match Library::load(library) {
            Err(LoadError::NotFound { .. }) if play.is_none() => return Ok(None),
            library => library?,
        };
        let context = Context::new(&library)?;
        if let Some(file) = play {
            context.add_recording(file)?;
        }
        let cameras =
            context.devices()?.into_iter().map(|device| Camera { finding: Finding::of_link(&device), device });
        let (librealsense, path) = (library.version(), library.path().to_owned());
        Ok(Some(Self { librealsense, library: path, cameras: cameras.collect() }))
    }
}

impl fmt::Display for Cameras {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "librealsense {} ({})", self.librealsense, self.library.display())?;
        if self.cameras.is_empty() {
            writeln!(f, "no RealSense camera is connected; docs/recording.md has the udev rules it needs")?;
        }
        self.cameras.iter().try_for_each(|camera| write!(f, "{camera}"))
    }
}

impl fmt::Display for Camera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let DeviceDescription { name, serial, firmware, usb, product_id, recording, .. } = &self.device;
        let told = |text: &Option<String>| text.clone().unwrap_or_else(|| "?".to_owned());
        writeln!(f, "\n{name}")?;
        writeln!(f, "  serial    {serial}")?;
        writeln!(f, "  firmware  {}   product {}   USB {}", told(firmware), told(product_id), told(usb))?;
        if let Some(file) = recording {
            writeln!(f, "  playback  {file}")?;
        }
        if let Some(finding) = &self.finding {
            writeln!(f, "  warning   {finding}")?;
        }
        for SensorDescription { name, profiles, .. } in &self.device.sensors {
            writeln!(f, "  {name}")?;
            for (stream, modes) in modes(profiles) {
                writeln!(f, "    {stream:<10} {}", modes.join(" "))?;
            }
        }
        Ok(())
    }
}

/// Modes of each stream that can be recorded, as they are asked for on the command line; largest first, each once.
fn modes(profiles: &[StreamProfile]) -> Vec<(String, Vec<String>)> {
    let recorded = profiles.iter().filter(|p| p.format.bytes_per_pixel().is_some());
    let mut sorted: Vec<&StreamProfile> = recorded.collect();
    sorted.sort_by_key(|p| (p.stream, std::cmp::Reverse((p.width, p.height, p.rate_hz))));
    let mut streams: Vec<(String, Vec<String>)> = Vec::new();
    for StreamProfile { stream, width, height, rate_hz, .. } in sorted {
        let (stream_name, is_motion) = (stream.to_string(), stream.kind.is_motion());
        let mode = if is_motion { format!("@{rate_hz}") } else { format!("{width}x{height}@{rate_hz}") };
        if streams.last().is_none_or(|(last, _)| *last != stream_name) {
            streams.push((stream_name, Vec::new()));
        }
        if let Some((_, modes)) = streams.last_mut().filter(|(_, modes)| modes.last() != Some(&mode)) {
            modes.push(mode);
        }
    }
    streams
}

#[cfg(test)]
mod tests {
    use super::*;
    use recorder::realsense::{Format, StreamId, StreamKind};

    #[test]
    fn modes_are_told_once_and_in_order() {
        let profile = |kind, format, width: u32, rate_hz| StreamProfile {
            stream: StreamId::only(kind),
            format,
            width,
            height: width * 3 / 4,
            rate_hz,
        };
        let told = modes(&[
            profile(StreamKind::Gyro, Format::MotionXyz32f, 0, 200),
            profile(StreamKind::Color, Format::Rgb8, 640, 30),
            profile(StreamKind::Color, Format::Other(99), 4000, 30),
            profile(StreamKind::Color, Format::Bgr8, 640, 30),
            profile(StreamKind::Color, Format::Rgb8, 1280, 15),
        ]);
        let wanted = [("color", vec!["1280x960@15", "640x480@30"]), ("gyro", vec!["@200"])];
        let wanted = wanted.map(|(stream, modes)| (stream.to_owned(), modes.into_iter().map(str::to_owned).collect()));
        assert_eq!(told, wanted);
    }
}
