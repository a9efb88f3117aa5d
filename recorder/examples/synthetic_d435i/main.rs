//! A D435i in the synthetic world, inside the real librealsense: recorded, played, live, and compared with what was fed.
//!
//! `PSLAM_LIBREALSENSE=PATH cargo run --release -p recorder --example synthetic_d435i -- VERB PATH [OPTION VALUE] ...`
//!
//! | verb | does |
//! |---|---|
//! | `file OUT` | records with librealsense's own recorder: `.bag` with version 2.54 - 2.57, `.db3` from 2.58 |
//! | `live LOG` | records with ours what librealsense's software device gives, in real time; prints the verdict as JSON |
//! | `compare LOG` | every pixel and every metadata value of the log is what was fed, and nothing is missing but what was dropped |
//! | `truth OUT` | where the camera goes, as a TUM trajectory file: for `pslam sim` |
//!
//! | option | value |
//! |---|---|
//! | `scenario` | `handheld` (default: much turning, for clocks and hand-eye), `demo`, `static`, `robots` or `tiny` |
//! | `seconds` | length |
//! | `mode` | size and rate of colour and depth, `640x480@30` |
//! | `pictures` | a file that keeps the rendered pictures for the next time |
//! | `serial` | serial number |
//! | `vicon` | `NAME@HOST:PORT`: `live` records this subject too |
//! | `drop` | `color:100-104`: frames that never come; their counters are missing |
//! | `system-time` | `depth`: that stream has host stamps and no metadata |
//! | `no-metadata` | `color`: that stream has no metadata |
//! | `usb` | `2.1`: what the camera says about its link |
//! | `wrap` | seconds after the start at which the device's 32-bit microsecond counter begins again |
//! | `lens` | `K1,K2,P1,P2,K3`: how the colour camera's lens bends its pictures (librealsense's inverse Brown-Conrady) |
//! | `drift` | how much faster than the world the device's clock runs, parts per million |
//!
//! Colour and depth have different fields of view and stand, like the inertial unit, at the same point. At most
//! [`sensors::RENDERED_S`] seconds are rendered; then the camera goes back the way it came, and so on. The number of a
//! frame stands in its first pixels, so that no two frames are the same.

mod compare;
mod lens;
mod live;
#[path = "../../tests/realsense_support/log.rs"]
#[allow(clippy::unwrap_used, reason = "a test's support: it fails by panicking")]
mod log;
mod plan;
mod sensors;

use plan::Plan;
use recorder::realsense::{Library, Sample, SoftwareCamera, SoftwareSpec};
use sensors::Rig;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Trajectory poses a second; the hand sways with up to 2.3 Hz.
const TRUTH_HZ: i64 = 500;
/// The trajectory goes on for so long after the last picture, seconds: a recording ends a little later.
const TRUTH_MORE_S: i64 = 30;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: synthetic_d435i file|live|compare|truth PATH [OPTION VALUE] ...";
    let (verb, path) = (arguments.next().ok_or(usage)?, PathBuf::from(arguments.next().ok_or(usage)?));
    let plan = Plan::new(arguments)?;
    match verb.as_str() {
        "file" => file(&path, &plan),
        "live" => live::record(&path, &plan),
        "compare" => compare::compare(&path, &plan),
        "truth" => truth(&path, &plan),
        _ => Err(usage.into()),
    }
}

/// The camera, and what it sees.
fn camera(plan: &Plan) -> Result<(Library, SoftwareCamera, Rig), Box<dyn Error>> {
    let library = Library::load(None)?;
    let rig = Rig::new(plan)?;
    let mut spec = SoftwareSpec::d435i(plan.mode, plan.mode);
    rig.calibrate(&mut spec);
    spec.serial = plan.serial.clone().unwrap_or(spec.serial);
    spec.usb = plan.usb().unwrap_or(spec.usb);
    let camera = SoftwareCamera::new(&library, &spec)?;
    rig.prepare();
    Ok((library, camera, rig))
}

/// In real time: librealsense's recorder stamps by the clock, and a player follows those stamps.
fn file(out: &Path, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let (library, camera, rig) = camera(plan)?;
    let recording = camera.record(out, false)?;
    let mut count = 0;
    rig.in_real_time(plan, &mut |sample| {
        count += 1;
        Ok(camera.feed(&sample)?)
    })?;
    drop(recording);
    println!("{}: {count} samples, librealsense {}", out.display(), library.version());
    Ok(())
}

fn truth(out: &Path, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let rig = Rig::new(plan)?;
    if plan.pictures.is_some() {
        rig.prepare();
    }
    let last = (plan.seconds * TRUTH_HZ as f64) as i64 + TRUTH_MORE_S * TRUTH_HZ;
    let mut text = "# time x y z qx qy qz qw\n".to_owned();
    for index in 0..=last {
        let at_ns = index * 1_000_000_000 / TRUTH_HZ;
        let pose = rig.world_from_camera(at_ns);
        let ([x, y, z], [qx, qy, qz, qw]): ([f64; 3], _) = (pose.translation.into(), pose.quaternion_xyzw());
        writeln!(text, "{}.{:09} {x} {y} {z} {qx} {qy} {qz} {qw}", at_ns / 1_000_000_000, at_ns % 1_000_000_000)?;
    }
    Ok(std::fs::write(out, text)?)
}

/// The sample as the faulty camera gives it; `None`: it never comes.
fn planted(plan: &Plan, mut sample: Sample) -> Option<Sample> {
    match &mut sample {
        Sample::Frame(frame) => frame.header = plan.plant(frame.header.clone())?,
        Sample::Motion(motion) => motion.header = plan.plant(motion.header.clone())?,
        Sample::Unreadable { .. } => {}
    }
    Some(sample)
}
