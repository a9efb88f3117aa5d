//! What is planted: the same options make a recording and tell what must be found in it.

use recorder::realsense::{FrameHeader, TimestampDomain, VideoMode};
use std::error::Error;
use std::path::PathBuf;

/// Options in words; every verb takes the same ones.
#[derive(Debug, Clone)]
pub struct Plan {
    pub scenario: String,
    pub seconds: f64,
    pub mode: VideoMode,
    pub serial: Option<String>,
    /// Where a simulated Vicon listens, and the subject that carries the camera.
    pub vicon: Option<(String, String)>,
    /// Where rendered pictures are kept for the next time.
    pub pictures: Option<PathBuf>,
    /// Coefficients of the colour camera's lens.
    pub lens: [f32; 5],
    faults: Vec<Fault>,
}

/// One planted fault.
#[derive(Debug, Clone)]
enum Fault {
    Drop { stream: String, first: u64, last: u64 },
    SystemTime(String),
    NoMetadata(String),
    Usb(String),
    Wrap { after_s: f64 },
    Drift { ppm: f64 },
}

impl Plan {
    /// From `OPTION VALUE` pairs.
    pub fn new(mut arguments: impl Iterator<Item = String>) -> Result<Self, Box<dyn Error>> {
        let mode = VideoMode { width: 640, height: 480, rate_hz: 30 };
        let scenario = "handheld".to_owned();
        let mut plan = Self {
            scenario,
            seconds: 9.0,
            mode,
            serial: None,
            vicon: None,
            pictures: None,
            lens: [0.0; 5],
            faults: Vec::new(),
        };
        while let Some(option) = arguments.next() {
            let value = arguments.next().ok_or_else(|| format!("{option} needs a value"))?;
            match option.as_str() {
                "scenario" => plan.scenario = value,
                "seconds" => plan.seconds = value.parse()?,
                "mode" => plan.mode = value.parse()?,
                "pictures" => plan.pictures = Some(value.into()),
                "serial" => plan.serial = Some(value),
                "vicon" => {
                    let (subject, address) = value.split_once('@').ok_or("vicon is written NAME@HOST:PORT")?;
                    plan.vicon = Some((address.to_owned(), subject.to_owned()));
                }
                "drop" => {
                    let parts =
                        value.split_once(':').and_then(|(stream, range)| Some((stream, range.split_once('-')?)));
                    let (stream, (first, last)) = parts.ok_or("drop is written color:100-104")?;
                    let (first, last) = (first.parse()?, last.parse()?);
                    plan.faults.push(Fault::Drop { stream: stream.to_owned(), first, last });
                }
                "system-time" => plan.faults.push(Fault::SystemTime(value)),
                "no-metadata" => plan.faults.push(Fault::NoMetadata(value)),
                "lens" => {
                    let numbers: Vec<f32> = value.split(',').map(str::parse).collect::<Result<_, _>>()?;
                    plan.lens = numbers.try_into().map_err(|_| "lens is written K1,K2,P1,P2,K3")?;
                }
                "usb" => plan.faults.push(Fault::Usb(value)),
                "wrap" => plan.faults.push(Fault::Wrap { after_s: value.parse()? }),
                "drift" => plan.faults.push(Fault::Drift { ppm: value.parse()? }),
                other => return Err(format!("there is no option `{other}`").into()),
            }
        }
        Ok(plan)
    }

    /// What the camera says about its link, if that is planted.
    pub fn usb(&self) -> Option<String> {
        self.faults.iter().find_map(|fault| if let Fault::Usb(usb) = fault { Some(usb.clone()) } else { None })
    }

    /// What the device's clock shows, microseconds since its start, without wraps.
    pub fn device_us(&self, since_start_ns: i64) -> i64 {
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

    /// The header as the faulty camera gives it; `None`: the frame never comes.
    pub fn plant(&self, mut header: FrameHeader) -> Option<FrameHeader> {
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
