//! Writes a RealSense recording of the synthetic world with librealsense's own recorder: `.bag` with version 2.54 - 2.57,
//! `.db3` from 2.58.
//!
//! `PSLAM_LIBREALSENSE=PATH cargo run --release -p recorder --example make_recording -- OUT [OPTION VALUE] ...`
//!
//! | option | value |
//! |---|---|
//! | `scenario` | `demo`, `static`, `robots` or `tiny` |
//! | `seconds` | length |
//! | `mode` | size and rate of colour and depth, `640x480@30` |
//! | `serial` | serial number |
//! | `drop` | `color:100-104`: frames that never come; their counters are missing |
//! | `system-time` | `depth`: that stream has host stamps and no metadata |
//! | `no-metadata` | `color`: that stream has no metadata |
//! | `usb` | `2.1`: what the camera says about its link |
//! | `wrap` | seconds after the start at which the device's 32-bit microsecond counter begins again |
//! | `drift` | how much faster than the world the device's clock runs, parts per million |
//!
//! Colour and depth have different fields of view and stand, like the inertial unit, at the same point.

mod sensors;

use recorder::realsense::{
    FrameHeader, Library, Sample, SoftwareCamera, SoftwareSpec, StreamId, StreamKind, TimestampDomain, VideoMode,
};
use sensors::Rig;
use std::error::Error;
use std::path::PathBuf;

struct Plan {
    out: PathBuf,
    scenario: String,
    seconds: f64,
    mode: VideoMode,
    serial: Option<String>,
    faults: Vec<Fault>,
}

/// One planted fault.
enum Fault {
    Drop { stream: String, first: u64, last: u64 },
    SystemTime(String),
    NoMetadata(String),
    Usb(String),
    Wrap { after_s: f64 },
    Drift { ppm: f64 },
}

fn plan() -> Result<Plan, Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().ok_or("usage: make_recording OUT [OPTION VALUE] ...")?.into();
    let mode = VideoMode { width: 640, height: 480, rate_hz: 30 };
    let mut plan = Plan { out, scenario: "demo".to_owned(), seconds: 9.0, mode, serial: None, faults: Vec::new() };
    while let Some(option) = arguments.next() {
        let value = arguments.next().ok_or_else(|| format!("{option} needs a value"))?;
        match option.as_str() {
            "scenario" => plan.scenario = value,
            "seconds" => plan.seconds = value.parse()?,
            "mode" => plan.mode = value.parse()?,
            "serial" => plan.serial = Some(value),
            "drop" => {
                let parts = value.split_once(':').and_then(|(stream, range)| Some((stream, range.split_once('-')?)));
                let (stream, (first, last)) = parts.ok_or("drop is written color:100-104")?;
                let (first, last) = (first.parse()?, last.parse()?);
                plan.faults.push(Fault::Drop { stream: stream.to_owned(), first, last });
            }
            "system-time" => plan.faults.push(Fault::SystemTime(value)),
            "no-metadata" => plan.faults.push(Fault::NoMetadata(value)),
            "usb" => plan.faults.push(Fault::Usb(value)),
            "wrap" => plan.faults.push(Fault::Wrap { after_s: value.parse()? }),
            "drift" => plan.faults.push(Fault::Drift { ppm: value.parse()? }),
            other => return Err(format!("there is no option `{other}`").into()),
        }
    }
    Ok(plan)
}

impl Plan {
    /// What the device's clock shows, microseconds since its start, without wraps.
    fn device_us(&self, since_start_ns: i64) -> i64 {
        let mut us = since_start_ns as f64 * 1e-3;
        let mut start_us = 5_000_000.0;
        for fault in &self.faults {
            match fault {
                Fault::Drift { ppm } => us *= 1.0 + ppm * 1e-6,
                Fault::Wrap { after_s } => start_us = 4_294_967_296.0 - after_s * 1e6,
                _ => {}
            }
        }
        (start_us + us) as i64
    }

    /// The sample as the faulty camera gives it; `None`: not at all.
    fn plant(&self, mut header: FrameHeader) -> Option<FrameHeader> {
        let stream = header.stream.to_string();
        for fault in &self.faults {
            match fault {
                Fault::Drop { stream: s, first, last } if *s == stream && (*first..=*last).contains(&header.number) => {
                    return None;
                }
                Fault::SystemTime(s) if *s == stream => {
                    header.domain = TimestampDomain::SystemTime;
                    header.metadata.clear();
                }
                Fault::NoMetadata(s) if *s == stream => header.metadata.clear(),
                _ => {}
            }
        }
        Some(header)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let plan = plan()?;
    let library = Library::load(None)?;
    let rig = Rig::new(&plan.scenario, plan.mode)?;
    let mut spec = SoftwareSpec::d435i(plan.mode, plan.mode);
    rig.calibrate(&mut spec);
    spec.serial = plan.serial.clone().unwrap_or(spec.serial);
    spec.usb = plan
        .faults
        .iter()
        .find_map(|f| if let Fault::Usb(usb) = f { Some(usb.clone()) } else { None })
        .unwrap_or(spec.usb);
    let camera = SoftwareCamera::new(&library, &spec)?;
    let recording = camera.record(&plan.out, false)?;
    let mut counts = [0_u64; 2];
    rig.samples(plan.seconds, &|since_start_ns| plan.device_us(since_start_ns), &mut |mut sample| {
        let header = match &mut sample {
            Sample::Frame(frame) => &mut frame.header,
            Sample::Motion(motion) => &mut motion.header,
            Sample::Unreadable { .. } => return Ok(()),
        };
        let is_color = header.stream == StreamId::only(StreamKind::Color);
        let Some(planted) = plan.plant(header.clone()) else {
            counts[1] += 1;
            return Ok(());
        };
        *header = planted;
        counts[0] += 1;
        if is_color && header.number % 300 == 0 {
            eprintln!("{} of {:.0} frames", header.number, plan.seconds * f64::from(plan.mode.rate_hz));
        }
        Ok(camera.feed(&sample)?)
    })?;
    drop(recording);
    println!(
        "{}: {} samples, {} dropped, librealsense {}",
        plan.out.display(),
        counts[0],
        counts[1],
        library.version()
    );
    Ok(())
}
