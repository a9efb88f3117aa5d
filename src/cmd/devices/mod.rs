//! `pslam devices`: what could be recorded.

mod cameras;

use crate::{Outcome, Usage, stdout};
use cameras::Cameras;
use recorder::mocap::udp::{UdpOptions, UdpSource};
use recorder::mocap::vicon::{ViconOptions, ViconSource};
use recorder::mocap::vrpn::{VrpnOptions, VrpnSource};
use recorder::mocap::{MocapSource, Survey, survey};
use recorder::realsense::Library;
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Devices {
    /// librealsense2.so, or the library in the Python wheel pyrealsense2.
    #[arg(long, value_name = "PATH")]
    librealsense: Option<PathBuf>,
    /// Show this recording of librealsense (.bag, .db3) as a camera.
    #[arg(long, value_name = "FILE")]
    play: Option<PathBuf>,
    /// A Vicon DataStream server whose subjects are to be listed.
    #[arg(long, value_name = "HOST[:PORT]")]
    vicon: Vec<String>,
    /// A VRPN server; tcp://HOST[:PORT] without call-back.
    #[arg(long, value_name = "[tcp://]HOST[:PORT]")]
    vrpn: Vec<String>,
    /// An address of this computer to which Tracker sends its UDP object stream.
    #[arg(long, value_name = "ADDR[:PORT]")]
    udp: Vec<String>,
    /// How long to look at each motion capture system, seconds.
    #[arg(long, value_name = "S", default_value = "1")]
    wait: f64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What was found.
#[derive(Debug, Serialize)]
struct Found {
    /// Absent without librealsense.
    realsense: Option<Cameras>,
    /// Motion capture systems that were asked for.
    mocap: Vec<Survey>,
}

impl Devices {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let sources = self.sources();
        let cameras = Cameras::look(self.librealsense.as_deref(), self.play.as_deref())?;
        if sources.is_empty() && cameras.is_none() {
            // Nothing else to look at: the library's absence is the answer.
            Library::load(self.librealsense.as_deref())?;
        }
        if !(0.05..=600.0).contains(&self.wait) {
            return Err(Usage(format!("--wait {} is not between 0.05 and 600", self.wait)).into());
        }
        let moment = Duration::from_secs_f64(self.wait);
        let surveys = sources.into_iter().map(|mut source| survey(source.as_mut(), moment));
        let found = Found { realsense: cameras, mocap: surveys.collect::<Result<_, _>>()? };
        stdout::either(self.json, "devices/1", &found)?;
        Ok(Outcome::Good)
    }

    fn sources(&self) -> Vec<Box<dyn MocapSource>> {
        let mut sources: Vec<Box<dyn MocapSource>> = Vec::new();
        sources.extend(self.vicon.iter().map(|a| Box::new(ViconSource::new(ViconOptions::new(a))) as Box<_>));
        sources.extend(self.vrpn.iter().map(|a| Box::new(VrpnSource::new(VrpnOptions::new(a))) as Box<_>));
        let udp = |a: &String| UdpSource::new(UdpOptions { listen: a.clone(), subjects: Vec::new() });
        sources.extend(self.udp.iter().map(|a| Box::new(udp(a)) as Box<_>));
        sources
    }
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.realsense {
            Some(cameras) => write!(f, "{cameras}")?,
            None => writeln!(f, "no cameras: librealsense is not installed")?,
        }
        for system in &self.mocap {
            let told = |number: Option<f64>, unit: &str| number.map_or("?".to_owned(), |n| format!("{n:.1} {unit}"));
            let rate = told(system.rate_hz, "Hz");
            let latency = told(system.latency_s.map(|s| s * 1e3), "ms");
            let lost = system.lost_frames.map_or("?".to_owned(), |lost| lost.to_string());
            writeln!(f, "{}: {rate}, latency {latency}, {} frames, {lost} lost", system.source, system.frames)?;
            for body in &system.bodies {
                let seen = 100.0 * f64::from(body.seen_frames) / f64::from(system.frames);
                let quality = body.quality.map_or("?".to_owned(), |quality| format!("{quality:.2}"));
                writeln!(f, "  {}/{}: seen in {seen:.0} %, quality {quality}", body.subject, body.segment)?;
            }
        }
        Ok(())
    }
}
