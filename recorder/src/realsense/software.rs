//! A synthetic camera inside librealsense: its frames take the library's own way from sensor to sink, and the library's
//! own recorder writes them to a file. For tests, and for people without the hardware.

use super::camera::Camera;
use super::context::CameraError;
use super::library::Library;
use super::raw::{
    self, FedAs, Flow, FrameSink, Handle, MotionStream, Profile, RawExtrinsics, RawMotionIntrinsics, VideoStream,
    required,
};
use super::select::VideoMode;
use super::types::{
    Calibration, Format, FrameHeader, Sample, StreamCalibration, StreamExtrinsics, StreamId, StreamKind, StreamProfile,
};
use super::{OPTION_DEPTH_UNITS, OPTION_EMITTER_ENABLED, OPTION_EXPOSURE, frame, info};
use schemas::alignment::{Extrinsics, Intrinsics, LensModel};
use std::ffi::CString;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// What a synthetic camera says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct SoftwareSpec {
    /// Name.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// USB type descriptor.
    pub usb: String,
    /// Its streams, one profile each.
    pub calibration: Calibration,
}

/// Distance of a D435's colour camera from its left infrared camera, along x; nominal, from the data sheet's drawing.
const COLOR_FROM_DEPTH_M: f32 = 0.015;

impl SoftwareSpec {
    /// A D435i on USB 3.2 with nominal calibration: depth 0.001 m a unit, gyroscope 200 Hz, accelerometer 250 Hz.
    #[must_use]
    pub fn d435i(color: VideoMode, depth: VideoMode) -> Self {
        // Fields of view of 69 and 87 degrees: focal lengths of 0.73 and 0.53 widths.
        let color = video(StreamKind::Color, Format::Rgb8, color, 0.73, LensModel::InverseBrownConrady);
        let depth = video(StreamKind::Depth, Format::Z16, depth, 0.53, LensModel::BrownConrady);
        let streams = vec![depth, color, motion(StreamKind::Gyro, 200), motion(StreamKind::Accel, 250)];
        let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        // An inertial unit beside the left infrared camera.
        let places = [
            (StreamKind::Color, [COLOR_FROM_DEPTH_M, 0.0, 0.0]),
            (StreamKind::Gyro, [-0.0055, 0.0051, 0.0117]),
            (StreamKind::Accel, [-0.0055, 0.0051, 0.0117]),
        ];
        let from = StreamId::only(StreamKind::Depth);
        let extrinsics = places.map(|(kind, translation)| StreamExtrinsics {
            from,
            to: StreamId::only(kind),
            transform: Extrinsics { rotation: identity, translation },
        });
        Self {
            name: "Synthetic D435I".to_owned(),
            serial: "000000000435".to_owned(),
            usb: "3.2".to_owned(),
            calibration: Calibration { streams, extrinsics: extrinsics.to_vec(), depth_units_m: Some(0.001) },
        }
    }
}

fn video(kind: StreamKind, format: Format, mode: VideoMode, focal: f32, model: LensModel) -> StreamCalibration {
    let VideoMode { width, height, rate_hz } = mode;
    let (fx, cx, cy) = (focal * width as f32, (width as f32 - 1.0) / 2.0, (height as f32 - 1.0) / 2.0);
    StreamCalibration {
        profile: StreamProfile { stream: StreamId::only(kind), format, width, height, rate_hz },
        intrinsics: Some(Intrinsics { width, height, fx, fy: fx, cx, cy, model, coefficients: [0.0; 5] }),
        motion: None,
    }
}

fn motion(kind: StreamKind, rate_hz: u32) -> StreamCalibration {
    let stream = StreamId::only(kind);
    let profile = StreamProfile { stream, format: Format::MotionXyz32f, width: 0, height: 0, rate_hz };
    let mut intrinsics = super::types::MotionIntrinsics::default();
    (0..3).for_each(|axis| intrinsics.matrix[axis][axis] = 1.0);
    StreamCalibration { profile, intrinsics: None, motion: Some(intrinsics) }
}

/// Which sensor of a D400 a stream belongs to.
fn sensor_name(kind: StreamKind) -> &'static str {
    match kind {
        StreamKind::Color => "RGB Camera",
        StreamKind::Gyro | StreamKind::Accel => "Motion Module",
        _ => "Stereo Module",
    }
}

/// librealsense appends what `rs2_register_extrinsics` is given to one list for all devices of the process, without a lock
/// (seen in 2.56.5: a segmentation fault in that list's growth when two threads do). Only software devices go this way.
static EXTRINSICS: Mutex<()> = Mutex::new(());

struct Fed {
    profile: StreamProfile,
    sensor: Arc<Handle<raw::Sensor>>,
    handle: Profile,
}

/// A synthetic camera.
pub struct SoftwareCamera {
    device: Arc<Handle<raw::Device>>,
    streams: Vec<Fed>,
    depth_units_m: f32,
}

impl SoftwareCamera {
    /// Builds it.
    ///
    /// # Errors
    /// The library refuses.
    pub fn new(library: &Library, spec: &SoftwareSpec) -> Result<Self, CameraError> {
        let api = library.api;
        let device = Arc::new(required(api.create_software_device()?, "create_software_device")?);
        let texts = [
            (info::NAME, spec.name.as_str()),
            (info::SERIAL, &spec.serial),
            (info::FIRMWARE, "5.16.0.1"),
            (info::PRODUCT_ID, "0B3A"),
            (info::USB, &spec.usb),
        ];
        for (number, value) in texts {
            api.software_device_register_info(&device, number, &text(value)?)?;
        }
        let depth_units_m = spec.calibration.depth_units_m.unwrap_or(0.001);
        let mut sensors: Vec<(&'static str, Arc<Handle<raw::Sensor>>)> = Vec::new();
        let mut streams = Vec::new();
        for (unique_id, calibration) in spec.calibration.streams.iter().enumerate() {
            let kind = calibration.profile.stream.kind;
            let name = sensor_name(kind);
            let sensor = match sensors.iter().find(|(known, _)| *known == name) {
                Some((_, sensor)) => Arc::clone(sensor),
                None => {
                    let new = api.software_device_add_sensor(&device, &text(name)?)?;
                    let new = Arc::new(required(new, "software_device_add_sensor")?);
                    add_options(&new, kind, depth_units_m)?;
                    sensors.push((name, Arc::clone(&new)));
                    new
                }
            };
            let handle = add_stream(&sensor, calibration, unique_id as i32)?;
            streams.push(Fed { profile: calibration.profile, sensor, handle });
        }
        let camera = Self { device, streams, depth_units_m };
        let guard = EXTRINSICS.lock().unwrap_or_else(PoisonError::into_inner);
        for StreamExtrinsics { from, to, transform } in &spec.calibration.extrinsics {
            let transform = RawExtrinsics { rotation: transform.rotation, translation: transform.translation };
            if let (Some(from), Some(to)) = (camera.stream(*from), camera.stream(*to)) {
                api.register_extrinsics(&from.handle, &to.handle, transform)?;
            }
        }
        drop(guard);
        Ok(camera)
    }

    fn stream(&self, stream: StreamId) -> Option<&Fed> {
        self.streams.iter().find(|fed| fed.profile.stream == stream)
    }

    /// The same device as the recorder sees it.
    ///
    /// # Errors
    /// The library refuses.
    pub fn camera(&self) -> Result<Camera, CameraError> {
        Camera::new(Arc::clone(&self.device), None)
    }

    /// Lets librealsense's own recorder write what is fed from now on: `.bag` up to version 2.57, `.db3` from 2.58.
    /// `compress` costs time and loses nothing.
    ///
    /// # Errors
    /// The library refuses, as for the other ending.
    pub fn record(&self, file: &Path, compress: bool) -> Result<VendorRecording, CameraError> {
        let api = self.device.api;
        let path =
            CString::new(file.as_os_str().as_bytes()).map_err(|_| CameraError::Text(file.display().to_string()))?;
        let device = api.create_record_device_ex(&self.device, &path, i32::from(compress))?;
        let device = Arc::new(required(device, "create_record_device_ex")?);
        let list = required(api.query_sensors(&device)?, "query_sensors")?;
        let count = api.get_sensors_count(&list)?;
        let sensors = (0..count).map(|i| required(api.create_sensor(&list, i)?, "create_sensor"));
        let sensors: Vec<_> = sensors.collect::<Result<_, _>>()?;
        for sensor in &sensors {
            api.open(sensor, &api.profiles(sensor)?)?;
        }
        let start = |sensor: Handle<raw::Sensor>| {
            let flow = api.start_flow(&sensor, Arc::new(|_, _| {}))?;
            Ok(Started { sensor: Arc::new(sensor), _flow: flow })
        };
        let started = sensors.into_iter().map(start).collect::<Result<_, CameraError>>()?;
        Ok(VendorRecording { _started: started, _device: device })
    }

    /// Feeds a sample; nobody gets it unless the camera is streaming. Metadata values that are not given keep those of
    /// the sample before, as librealsense has it.
    ///
    /// # Errors
    /// A stream that the camera does not have, or the library refuses.
    pub fn feed(&self, sample: &Sample) -> Result<(), CameraError> {
        match sample {
            Sample::Frame(frame) => {
                let (fed, at) = self.prepare(&frame.header)?;
                let pixel = frame.format.bytes_per_pixel().unwrap_or(1) as i32;
                let layout = [pixel * frame.width as i32, pixel];
                Ok(self.device.api.feed_video(&fed.sensor, at, layout, self.depth_units_m, &frame.bytes)?)
            }
            Sample::Motion(motion) => {
                let (fed, at) = self.prepare(&motion.header)?;
                Ok(self.device.api.feed_motion(&fed.sensor, at, motion.xyz)?)
            }
            Sample::Unreadable { .. } => Ok(()),
        }
    }

    /// Starts the sensors of these streams, frames as the library has them.
    pub(super) fn start_raw(&self, kinds: &[StreamKind], sink: &FrameSink) -> Result<Vec<Started>, CameraError> {
        let api = self.device.api;
        let mut started = Vec::new();
        for fed in self.streams.iter().filter(|fed| kinds.contains(&fed.profile.stream.kind)) {
            api.open(&fed.sensor, std::slice::from_ref(&fed.handle))?;
            let flow = api.start_flow(&fed.sensor, Arc::clone(sink))?;
            started.push(Started { sensor: Arc::clone(&fed.sensor), _flow: flow });
        }
        Ok(started)
    }

    fn prepare(&self, header: &FrameHeader) -> Result<(&Fed, FedAs<'_>), CameraError> {
        let fed = self.stream(header.stream).ok_or_else(|| CameraError::Stream {
            name: "the synthetic camera".to_owned(),
            serial: String::new(),
            stream: header.stream.to_string(),
            offered: self.streams.iter().map(|fed| fed.profile.stream.to_string()).collect(),
        })?;
        for (number, value) in &header.metadata {
            self.device.api.software_sensor_set_metadata(&fed.sensor, *number as i32, *value)?;
        }
        // librealsense takes a C int here.
        let number = i32::try_from(header.number).unwrap_or(i32::MAX);
        let (timestamp_ms, domain) = (header.timestamp_ms, header.domain.raw());
        Ok((fed, FedAs { profile: &fed.handle, number, timestamp_ms, domain }))
    }
}

fn text(text: &str) -> Result<CString, CameraError> {
    CString::new(text).map_err(|_| CameraError::Text(text.to_owned()))
}

/// A few of the options that a D435i has.
fn add_options(sensor: &Handle<raw::Sensor>, kind: StreamKind, depth_units_m: f32) -> Result<(), CameraError> {
    let api = sensor.api;
    match kind {
        StreamKind::Depth => {
            api.software_sensor_add_read_only_option(sensor, OPTION_DEPTH_UNITS, depth_units_m)?;
            api.software_sensor_add_option(sensor, OPTION_EMITTER_ENABLED, 0.0, 2.0, 1.0, 1.0, 1)?;
        }
        StreamKind::Color => api.software_sensor_add_option(sensor, OPTION_EXPOSURE, 1.0, 10_000.0, 1.0, 156.0, 1)?,
        _ => {}
    }
    Ok(())
}

fn add_stream(
    sensor: &Arc<Handle<raw::Sensor>>,
    calibration: &StreamCalibration,
    unique_id: i32,
) -> Result<Profile, CameraError> {
    let StreamProfile { stream, format, width, height, rate_hz } = calibration.profile;
    let (kind, index, format_number, rate_hz) = (stream.kind.raw(), stream.index, format.raw(), rate_hz as i32);
    if stream.kind.is_motion() {
        let m = calibration.motion.unwrap_or_default();
        let intrinsics = RawMotionIntrinsics {
            matrix: m.matrix,
            noise_variances: m.noise_variances,
            bias_variances: m.bias_variances,
        };
        let stream = MotionStream { kind, index, unique_id, rate_hz, format: format_number, intrinsics };
        return Ok(sensor.api.add_motion(sensor, stream)?);
    }
    let stream = VideoStream {
        kind,
        index,
        unique_id,
        width: width as i32,
        height: height as i32,
        rate_hz,
        bytes_per_pixel: format.bytes_per_pixel().unwrap_or(1) as i32,
        format: format_number,
        intrinsics: frame::raw_intrinsics(&calibration.intrinsics.unwrap_or_default()),
    };
    Ok(sensor.api.add_video(sensor, stream)?)
}

/// A running recorder of the vendor's. Dropping it closes the file.
pub struct VendorRecording {
    // Stopped before the device goes, whose end closes the file.
    _started: Vec<Started>,
    _device: Arc<Handle<raw::Device>>,
}

/// A started sensor, stopped when dropped.
pub(super) struct Started {
    sensor: Arc<Handle<raw::Sensor>>,
    _flow: Flow,
}

impl Drop for Started {
    fn drop(&mut self) {
        // There is nothing better to do when the library refuses.
        let _ = self.sensor.api.stop(&self.sensor);
        let _ = self.sensor.api.close(&self.sensor);
    }
}
