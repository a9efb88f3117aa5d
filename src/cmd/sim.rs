//! `pslam sim`: a simulated motion capture system.

use crate::{Outcome, Usage, stdout};
use anyhow::Context as _;
use fixtures::{World, scenario};
use recorder::mocap::sim::{Fault, Path, Protocol, Script, SimServer, SimSubject};
use slam_math::Se3;
use std::net::{SocketAddr, ToSocketAddrs as _};
use std::thread::sleep;
use std::time::Duration;

/// Name of the rendered world in place of a file.
const SYNTHETIC: &str = "synthetic";
/// Poses a second that are taken from the rendered world, whose hand sways with up to 2.3 Hz.
const SYNTHETIC_HZ: i64 = 500;
/// How often the end of the script is looked for.
const LOOK: Duration = Duration::from_millis(50);

/// Protocols.
#[derive(Debug, clap::Subcommand)]
pub enum Sim {
    /// Vicon DataStream over TCP, usually on port 801.
    Vicon(System),
    /// VRPN over TCP and by UDP call-back, usually on port 3883.
    Vrpn(System),
    /// The UDP object stream of Vicon's Tracker, sent to an address, usually port 51001.
    Udp(System),
}

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct System {
    /// Where the camera goes: a log with ground truth, a TUM trajectory file, or `synthetic[:SCENE]`.
    source: String,
    /// Name of a subject; NAME=SOURCE gives it a path of its own. May be given several times.
    #[arg(long, value_name = "NAME[=SOURCE]", required = true)]
    subject: Vec<String>,
    /// Where to listen (port 0: any free one), or, with udp, where to send to.
    #[arg(long, value_name = "ADDR[:PORT]", default_value = "127.0.0.1")]
    listen: String,
    /// Frames a second.
    #[arg(long, value_name = "HZ", default_value = "100")]
    rate: f64,
    /// After the end from the start again; without it the program ends with the path.
    #[arg(long = "loop")]
    looped: bool,
    /// What goes wrong; may be given several times.
    #[arg(long, value_name = "NAME", help = faults(), num_args = 1..)]
    fault: Vec<Fault>,
    #[command(flatten)]
    truth: Truth,
}

/// What a test plants and looks for.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Planted truths")]
struct Truth {
    /// Pose of the camera in the marker body: metres and a unit quaternion.
    #[arg(long, value_name = "X,Y,Z,QX,QY,QZ,QW", value_parser = pose, allow_hyphen_values = true)]
    marker_from_camera: Option<Se3>,
    /// By how much the poses lag behind beyond the latency that is told, milliseconds.
    #[arg(long, value_name = "MS", default_value = "0", allow_negative_numbers = true)]
    offset_ms: f64,
    /// By how much the system's clock is too fast, parts per million.
    #[arg(long, value_name = "PPM", default_value = "0", allow_negative_numbers = true)]
    drift_ppm: f64,
    /// Time from capture to sending, milliseconds; told to clients where the protocol can.
    #[arg(long, value_name = "MS", default_value = "5")]
    latency_ms: f64,
    /// When the path begins, nanoseconds of this computer's monotonic clock, so that simulated sensors share one time;
    /// default: now.
    #[arg(long, value_name = "NS")]
    epoch_monotonic_ns: Option<i64>,
}

fn faults() -> String {
    format!("What goes wrong; may be given several times: {}", Fault::ALL.map(|(name, _)| name).join(", "))
}

impl Sim {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        match self {
            Self::Vicon(system) => system.run(Protocol::Vicon, "vicon"),
            Self::Vrpn(system) => system.run(Protocol::Vrpn, "vrpn"),
            Self::Udp(system) => system.run(Protocol::Udp, "udp"),
        }
    }
}

impl System {
    fn run(self, protocol: Protocol, name: &str) -> anyhow::Result<Outcome> {
        let script = self.script()?;
        if let Some(fault) = script.faults.iter().find(|fault| !protocol.can_have(**fault)) {
            return Err(Usage(format!("{name} cannot have the fault `{fault}`")).into());
        }
        let address = address(&self.listen, protocol.default_port())?;
        let faults: Vec<String> = script.faults.iter().map(Fault::to_string).collect();
        let server = SimServer::start(protocol, address, script, self.truth.epoch_monotonic_ns)
            .with_context(|| format!("cannot simulate {name}"))?;
        let subjects = self.subject.len();
        let faults = if faults.is_empty() { String::new() } else { format!(", faults: {}", faults.join(", ")) };
        // The address stands second, for programs that start this one.
        stdout::text(&format!("{name} {} {} Hz, subjects: {subjects}{faults}", server.address(), self.rate))?;
        while !server.is_finished() {
            sleep(LOOK);
        }
        Ok(Outcome::Good)
    }

    fn script(&self) -> anyhow::Result<Script> {
        let path = path(&self.source)?;
        let subjects = self.subject.iter().map(|subject| match subject.split_once('=') {
            Some((name, source)) => Ok(SimSubject { name: name.to_owned(), path: self::path(source)? }),
            None => Ok(SimSubject { name: subject.clone(), path: path.clone() }),
        });
        let script = Script {
            subjects: subjects.collect::<anyhow::Result<_>>()?,
            rate_hz: self.rate,
            looped: self.looped,
            marker_from_camera: self.truth.marker_from_camera.unwrap_or_else(Se3::identity),
            clock_offset_ns: (self.truth.offset_ms * 1e6).round() as i64,
            drift_ppm: self.truth.drift_ppm,
            latency_s: self.truth.latency_ms * 1e-3,
            faults: self.fault.iter().copied().collect(),
        };
        Ok(script.validated().map_err(|error| Usage(error.to_string()))?)
    }
}

/// A pose as people type it; three decimals of the quaternion are enough.
fn pose(text: &str) -> Result<Se3, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    let Ok([x, y, z, qx, qy, qz, qw]) = numbers.as_deref() else {
        return Err("give seven numbers with commas between them".to_owned());
    };
    let length = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    if !length.is_finite() || (length - 1.0).abs() > 1e-2 {
        return Err(format!("the quaternion {qx},{qy},{qz},{qw} has length {length}, not 1"));
    }
    Ok(Se3::from_quaternion([*x, *y, *z], [*qx, *qy, *qz, *qw]))
}

/// The path of a source.
fn path(source: &str) -> anyhow::Result<Path> {
    match source.strip_prefix(SYNTHETIC) {
        Some("") => synthetic("demo"),
        Some(scene) if scene.starts_with(':') => synthetic(&scene[1..]),
        _ => {
            let truth = replayer::read_truth(source.as_ref())?;
            Ok(Path::new(truth.poses.iter().map(|pose| (pose.stamp.0, pose.world_from_camera))))
        }
    }
}

fn synthetic(scene: &str) -> anyhow::Result<Path> {
    let known = scenario::names();
    let config = scenario::by_name(scene);
    let config = config.ok_or_else(|| Usage(format!("there is no scene `{scene}`; choose {known}")))?;
    let world = World::new(&config)?;
    let (first_ns, last_ns) = (world.stamp_ns(0), world.stamp_ns(world.len()));
    let stamps = (0..).map(|k| first_ns + k * 1_000_000_000 / SYNTHETIC_HZ).take_while(|stamp_ns| *stamp_ns <= last_ns);
    Ok(Path::new(stamps.map(|stamp_ns| (stamp_ns, world.world_from_camera(stamp_ns)))))
}

fn address(text: &str, default_port: u16) -> Result<SocketAddr, Usage> {
    let whole = if text.contains(':') { text.to_owned() } else { format!("{text}:{default_port}") };
    let found = whole.to_socket_addrs().ok().and_then(|mut addresses| addresses.next());
    found.ok_or_else(|| Usage(format!("--listen {text} is no address: give ADDR or ADDR:PORT")))
}
