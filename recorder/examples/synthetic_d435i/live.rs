//! From librealsense's software device into a log, in real time, by the way that a camera's frames go.

use crate::camera;
use crate::plan::Plan;
use recorder::capture::{
    Allowed, CameraSetup, CameraSource, Encoding, Limits, MotionCapture, Pace, RecordOptions, Source, SystemClock,
    record as record_all,
};
use recorder::mocap::vicon::{ViconOptions, ViconSource};
use recorder::realsense::{CameraError, Finding, Wish};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The camera is opened and the motion capture connected before the first frame.
const HEAD_START: Duration = Duration::from_secs(1);

pub fn record(out: &Path, plan: &Plan) -> Result<(), Box<dyn Error>> {
    let (library, software, rig) = camera(plan)?;
    let opened = software.camera()?;
    let wish = Wish { color: Some(plan.mode), depth: Some(plan.mode), imu: true };
    let selection = opened.select(&wish)?;
    let findings: Vec<String> = selection.findings.iter().map(Finding::to_string).collect();
    findings.iter().for_each(|finding| eprintln!("finding: {finding}"));
    let names = (0..64).map(|number| (number, library.metadata_name(number)));
    let setup = CameraSetup {
        library: format!("librealsense {}", library.version()),
        device: opened.describe()?,
        calibration: Arc::new(opened.calibration(&selection.profiles)?),
        attribute_names: names.take_while(|(_, name)| name != "UNKNOWN").collect(),
    };
    let again = Box::new(|| Err(CameraError::NoCamera));
    let mut sources: Vec<Box<dyn Source>> = vec![Box::new(CameraSource::new((opened, setup), again, Pace::Camera))];
    if let Some((address, subject)) = &plan.vicon {
        let subjects = vec![subject.clone()];
        let options = ViconOptions { subjects: subjects.clone(), ..ViconOptions::new(address) };
        sources.push(Box::new(MotionCapture::new(Box::new(ViconSource::new(options)), &subjects)));
    }
    let options = RecordOptions {
        path: out.to_owned(),
        force: false,
        flush_interval: Duration::from_secs(1),
        duration: None,
        reserve_bytes: 100_000_000,
        encoding: Encoding::Auto,
        synchronise: true,
        allowed: Allowed::default(),
        limits: Limits::default(),
        onlookers: Vec::new(),
        labelling: None,
        program: "synthetic_d435i".to_owned(),
        asked: [("findings".to_owned(), findings.join("; "))].into(),
    };
    let stop = AtomicBool::new(false);
    let (fed, verdict) = std::thread::scope(|scope| {
        let recording = scope.spawn(|| {
            let stopped = || stop.load(Ordering::Relaxed);
            record_all(sources, &options, Arc::new(SystemClock), &stopped, &mut |status| eprintln!("{status}"))
        });
        std::thread::sleep(HEAD_START);
        let fed = rig.in_real_time(plan, &mut |sample| Ok(software.feed(&sample)?)).map_err(|error| error.to_string());
        stop.store(true, Ordering::Relaxed);
        (fed, recording.join())
    });
    fed?;
    let verdict = verdict.map_err(|_| "the recording failed")??;
    println!("{}", serde_json::to_string(&verdict)?);
    Ok(())
}
