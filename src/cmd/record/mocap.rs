//! Which motion capture system.

use super::asked;
use crate::Usage;
use recorder::capture::{MotionCapture, Source};
use recorder::mocap::MocapSource;
use recorder::mocap::udp::{UdpOptions, UdpSource};
use recorder::mocap::vicon::{ViconOptions, ViconSource};
use recorder::mocap::vrpn::{VrpnOptions, VrpnSource};
use std::collections::BTreeMap;

/// Arguments.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Motion capture")]
pub struct MocapArgs {
    /// Vicon DataStream server; the usual port is 801.
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with_all = ["vrpn", "udp"])]
    vicon: Option<String>,
    /// VRPN server, as tcp://HOST[:PORT] for a plain connection or HOST[:PORT] for VRPN's own way.
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with = "udp")]
    vrpn: Option<String>,
    /// Receive Vicon Tracker's UDP object stream at this address of this computer, as 0.0.0.0:51001.
    #[arg(long, value_name = "ADDRESS[:PORT]")]
    udp: Option<String>,
    /// Only this subject; may be given several times. Default: all.
    #[arg(long, value_name = "NAME")]
    subject: Vec<String>,
    /// Markers too (Vicon).
    #[arg(long, requires = "vicon")]
    markers: bool,
}

impl MocapArgs {
    /// The source; `None` if none was asked for.
    ///
    /// # Errors
    /// Subjects of no system.
    pub fn source(&self) -> Result<Option<Box<dyn Source>>, Usage> {
        let subjects = self.subject.clone();
        let vicon = self.vicon.as_deref().map(|address| -> Box<dyn MocapSource> {
            let markers = self.markers;
            Box::new(ViconSource::new(ViconOptions {
                subjects: subjects.clone(),
                markers,
                ..ViconOptions::new(address)
            }))
        });
        let vrpn = self.vrpn.as_deref().map(|address| -> Box<dyn MocapSource> {
            Box::new(VrpnSource::new(VrpnOptions { subjects: subjects.clone(), ..VrpnOptions::new(address) }))
        });
        let udp = self.udp.as_deref().map(|listen| -> Box<dyn MocapSource> {
            Box::new(UdpSource::new(UdpOptions { listen: listen.to_owned(), subjects: subjects.clone() }))
        });
        match vicon.or(vrpn).or(udp) {
            Some(source) => Ok(Some(Box::new(MotionCapture::new(source, &self.subject)))),
            None if self.subject.is_empty() => Ok(None),
            None => Err(Usage("--subject needs a motion capture system: --vicon, --vrpn or --udp".to_owned())),
        }
    }

    /// What was asked for, for the log.
    pub fn asked(&self) -> BTreeMap<String, String> {
        let kinds = [("vicon", &self.vicon), ("vrpn", &self.vrpn), ("udp", &self.udp)];
        let kinds = kinds.into_iter().filter_map(|(kind, address)| Some((kind, address.clone()?)));
        let mut entries: Vec<(&str, String)> = kinds.collect();
        if !self.subject.is_empty() {
            entries.push(("subject", self.subject.join(", ")));
        }
        asked(&entries)
    }
}
