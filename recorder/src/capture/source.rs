//! Where measurements come from.

use super::inlet::Inlet;
use super::pace::{Pace, Pacer};
use super::setup::CameraSetup;
use crate::mocap::{Backoff, Link, LinkEvent, MocapSource};
use crate::realsense::{Camera, CameraError, Sink, State, StreamProfile, Streaming};
use schemas::msg::level;
use std::sync::Arc;
use std::time::Duration;

/// How a source's run ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum End {
    /// It was told to stop.
    Stopped,
    /// There is nothing more: the end of a file.
    Finished,
    /// It went away, for this reason; it is run again.
    Lost(String),
}

/// A sensor or a system of sensors.
pub trait Source: Send {
    /// Short name, as `camera`.
    fn name(&self) -> &'static str;

    /// Hands everything to the inlet until the inlet is stopping, there is nothing more, or the source is lost. After a
    /// loss it is called again, with growing pauses.
    fn run(&mut self, inlet: &Inlet) -> End;
}

/// How often a source that waits looks around.
const LOOK: Duration = Duration::from_millis(50);

/// How a camera is opened again.
pub type Open = Box<dyn FnMut() -> Result<(Camera, CameraSetup), CameraError> + Send>;

/// A RealSense camera, or a recording that is played as one.
pub struct CameraSource {
    opened: Option<(Camera, CameraSetup)>,
    again: Open,
    pace: Pace,
}

impl CameraSource {
    /// Streams from an opened camera; after a loss from what `again` opens.
    #[must_use]
    pub fn new(opened: (Camera, CameraSetup), again: Open, pace: Pace) -> Self {
        Self { opened: Some(opened), again, pace }
    }

    fn start(&mut self, inlet: &Inlet) -> Result<(Camera, Streaming), CameraError> {
        let (camera, setup) = match self.opened.take() {
            Some(opened) => opened,
            None => (self.again)()?,
        };
        camera.set_real_time(false)?;
        inlet.camera(&setup);
        let inlet = if self.pace == Pace::Camera { inlet.clone() } else { inlet.patient() };
        let pacer = (self.pace == Pace::Recorded).then(|| Pacer::new(inlet.clock()));
        let sink: Sink = Arc::new(move |mut sample| {
            if let Some(pacer) = &pacer {
                pacer.pace(&mut sample, &|| inlet.is_stopping());
            }
            inlet.sample(sample);
        });
        let profiles: Vec<StreamProfile> = setup.streams().into_iter().map(|(_, profile)| profile).collect();
        let streaming = camera.start(&profiles, &sink)?;
        Ok((camera, streaming))
    }
}

impl Source for CameraSource {
    fn name(&self) -> &'static str {
        "camera"
    }

    fn run(&mut self, inlet: &Inlet) -> End {
        let (_camera, streaming) = match self.start(inlet) {
            Ok(started) => started,
            Err(error) => return End::Lost(error.to_string()),
        };
        while !inlet.is_stopping() {
            std::thread::sleep(LOOK);
            match streaming.state() {
                Ok(State::Running) => {}
                Ok(State::Ended) => return End::Finished,
                Ok(State::Gone) => return End::Lost("it was unplugged or has reset itself".to_owned()),
                Err(error) => return End::Lost(error.to_string()),
            }
        }
        End::Stopped
    }
}

/// A motion capture system. Connects again by itself.
pub struct MotionCapture {
    link: Link,
    name: Arc<str>,
    subjects: Vec<String>,
}

impl MotionCapture {
    /// Follows this system. The verdict names those of `subjects` that were never seen; without any, it says so if nothing
    /// at all was.
    #[must_use]
    pub fn new(source: Box<dyn MocapSource>, subjects: &[String]) -> Self {
        let name = source.describe().into();
        Self { link: Link::new(source, Backoff::default()), name, subjects: subjects.to_vec() }
    }
}

impl Source for MotionCapture {
    fn name(&self) -> &'static str {
        "mocap"
    }

    fn run(&mut self, inlet: &Inlet) -> End {
        inlet.expect_mocap(&self.subjects);
        let mut refused = false;
        while !inlet.is_stopping() {
            match self.link.next(LOOK) {
                LinkEvent::Idle => {}
                LinkEvent::Frame(frame) => inlet.mocap(*frame, &self.name),
                LinkEvent::Connected => {
                    refused = false;
                    inlet.mocap_connected();
                    inlet.event(level::INFO, "mocap.connected", &self.name);
                }
                LinkEvent::Lost(error) => inlet.mocap_lost(&error.to_string()),
                // The first refusal says it all.
                LinkEvent::Refused { error, .. } if !refused => {
                    refused = true;
                    inlet.event(level::WARN, "mocap.refused", &error.to_string());
                }
                LinkEvent::Refused { .. } => {}
            }
        }
        End::Stopped
    }
}
