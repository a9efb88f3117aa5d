//! Which cameras there are, and opening one.

use super::camera::Camera;
use super::library::Library;
use super::raw::{self, CallError, Changes, Handle, required};
use super::types::{DeviceDescription, OptionValue, SensorDescription, StreamProfile};
use super::{EXTENSION_PLAYBACK, frame, info};
use std::ffi::CString;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

/// Why a camera does not do what it was asked for.
#[derive(Debug, Clone, thiserror::Error)]
pub enum CameraError {
    /// The library refuses.
    #[error("{0}")]
    Call(#[from] CallError),
    /// No camera at all.
    #[error("no RealSense camera is connected (lsusb must show 8086:0b.., and the udev rules of docs/recording.md)")]
    NoCamera,
    /// More than one camera, and none chosen.
    #[error("{} cameras are connected, choose one by its serial number: {}", .0.len(), .0.join(", "))]
    Several(Vec<String>),
    /// None with this number.
    #[error("no camera has the serial number {wanted}; connected: {}", if found.is_empty() { "none".to_owned() } else { found.join(", ") })]
    Serial {
        /// What was asked for.
        wanted: String,
        /// What is there.
        found: Vec<String>,
    },
    /// A stream that the camera does not have.
    #[error("{name} ({serial}) has no {stream} stream; it has {}", offered.join(", "))]
    Stream {
        /// The camera.
        name: String,
        /// Its serial number.
        serial: String,
        /// What was asked for.
        stream: String,
        /// What it has.
        offered: Vec<String>,
    },
    /// An option that no sensor has, or a value outside its range.
    #[error("option {name} = {value}: {reason}")]
    Option {
        /// Its name.
        name: String,
        /// The value asked for.
        value: f32,
        /// Why not.
        reason: String,
    },
    /// A text with a zero byte in it.
    #[error("{0} has a zero byte in it")]
    Text(String),
}

/// A session with the library: the set of connected cameras and of recordings that are played as cameras.
#[derive(Debug)]
pub struct Context {
    library: Library,
    handle: Handle<raw::Context>,
    changes: &'static Changes,
    /// Recordings are devices as long as somebody holds them.
    recordings: Mutex<Vec<Handle<raw::Device>>>,
}

impl Context {
    /// Opens a session.
    ///
    /// # Errors
    /// The library refuses.
    pub fn new(library: &Library) -> Result<Self, CameraError> {
        let api = library.api;
        let handle = required(api.create_context(library.api_version)?, "create_context")?;
        let changes = api.watch(&handle)?;
        Ok(Self { library: library.clone(), handle, changes, recordings: Mutex::default() })
    }

    /// The library of this session.
    #[must_use]
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// Adds a recording (`.bag`, or `.db3` from librealsense 2.58): it is found among the devices under the serial
    /// number of the camera that made it.
    ///
    /// # Errors
    /// The library cannot read the file.
    pub fn add_recording(&self, file: &Path) -> Result<(), CameraError> {
        let path =
            CString::new(file.as_os_str().as_bytes()).map_err(|_| CameraError::Text(file.display().to_string()))?;
        let device = required(self.library.api.context_add_device(&self.handle, &path)?, "context_add_device")?;
        self.recordings.lock().unwrap_or_else(PoisonError::into_inner).push(device);
        Ok(())
    }

    /// Takes a recording away again, as unplugging does a camera: it is no longer among the devices, and whoever streams
    /// from it is told [`State::Gone`](super::State::Gone).
    ///
    /// # Errors
    /// The library refuses.
    pub fn remove_recording(&self, file: &Path) -> Result<(), CameraError> {
        let path =
            CString::new(file.as_os_str().as_bytes()).map_err(|_| CameraError::Text(file.display().to_string()))?;
        Ok(self.library.api.context_remove_device(&self.handle, &path)?)
    }

    /// How often cameras have come or gone since the session began.
    pub(super) fn changes(&self) -> u64 {
        self.changes.count.load(Ordering::SeqCst)
    }

    fn handles(&self) -> Result<Vec<Handle<raw::Device>>, CameraError> {
        let api = self.library.api;
        let list = required(api.query_devices(&self.handle)?, "query_devices")?;
        let count = api.get_device_count(&list)?;
        let device = |i| Ok(required(api.create_device(&list, i)?, "create_device")?);
        (0..count).map(device).collect()
    }

    /// The serial numbers of all devices.
    ///
    /// # Errors
    /// The library refuses.
    pub fn serials(&self) -> Result<Vec<String>, CameraError> {
        self.handles()?.iter().map(|device| Ok(device_info(device, info::SERIAL)?.unwrap_or_default())).collect()
    }

    /// All devices with all they say about themselves.
    ///
    /// # Errors
    /// The library refuses.
    pub fn devices(&self) -> Result<Vec<DeviceDescription>, CameraError> {
        let cameras = self.handles()?.into_iter().map(|device| Camera::new(Arc::new(device), None));
        cameras.map(|camera| camera?.describe()).collect()
    }

    /// Opens the camera with this serial number, or the only one.
    ///
    /// # Errors
    /// None, several without a choice, another number; or the library refuses.
    pub fn open(self: &Arc<Self>, serial: Option<&str>) -> Result<Camera, CameraError> {
        let serials = self.serials()?;
        let index = match serial {
            Some(wanted) => serials.iter().position(|found| found == wanted),
            None if serials.len() > 1 => return Err(CameraError::Several(serials)),
            None => serials.first().map(|_| 0),
        };
        let device = index.and_then(|index| self.handles().ok()?.into_iter().nth(index));
        match (device, serial) {
            (Some(device), _) => Camera::new(Arc::new(device), Some(Arc::clone(self))),
            (None, Some(wanted)) => Err(CameraError::Serial { wanted: wanted.to_owned(), found: serials }),
            (None, None) => Err(CameraError::NoCamera),
        }
    }
}

/// A text that the device tells about itself.
pub(super) fn device_info(device: &Handle<raw::Device>, number: i32) -> Result<Option<String>, CallError> {
    let api = device.api;
    if api.supports_device_info(device, number)? { api.get_device_info(device, number).map(Some) } else { Ok(None) }
}

/// Numbers in an enumeration of the library that have a name.
pub(super) fn named(name: impl Fn(i32) -> String) -> impl Iterator<Item = (i32, String)> {
    // Far more than any version has; the library numbers without gaps.
    (0..1000).map(move |number| (number, name(number))).take_while(|(_, name)| !name.is_empty() && name != "UNKNOWN")
}

/// Everything about a device.
pub(super) fn describe(
    device: &Handle<raw::Device>,
    sensors: &[Arc<Handle<raw::Sensor>>],
) -> Result<DeviceDescription, CameraError> {
    let api = device.api;
    let told = |number| device_info(device, number);
    let known = [info::NAME, info::SERIAL, info::FIRMWARE, info::USB, info::PRODUCT_ID];
    let others = named(|number| api.camera_info_to_string(number)).filter(|(number, _)| !known.contains(number));
    let more = others.filter_map(|(number, name)| Some((name, told(number).ok()??)));
    let playback = api.is_device_extendable_to(device, EXTENSION_PLAYBACK)?;
    Ok(DeviceDescription {
        name: told(info::NAME)?.unwrap_or_default(),
        serial: told(info::SERIAL)?.unwrap_or_default(),
        firmware: told(info::FIRMWARE)?,
        usb: told(info::USB)?,
        product_id: told(info::PRODUCT_ID)?,
        more: more.collect(),
        recording: playback.then(|| api.playback_device_get_file_path(device)).transpose()?,
        sensors: sensors.iter().map(|sensor| describe_sensor(sensor)).collect::<Result<_, _>>()?,
    })
}

fn describe_sensor(sensor: &Handle<raw::Sensor>) -> Result<SensorDescription, CameraError> {
    let api = sensor.api;
    let profiles = api.profiles(sensor)?;
    let profiles: Vec<StreamProfile> = profiles.iter().map(frame::profile).collect::<Result<_, _>>()?;
    Ok(SensorDescription {
        name: api.get_sensor_info(sensor, info::NAME).unwrap_or_default(),
        options: options(sensor),
        profiles,
    })
}

/// All options that the sensor tells the value of.
pub(super) fn options(sensor: &Handle<raw::Sensor>) -> Vec<OptionValue> {
    let api = sensor.api;
    named(|number| api.option_to_string(number))
        .filter(|(number, _)| api.supports_option(sensor, *number).unwrap_or(false))
        .filter_map(|(number, name)| option(sensor, number, name).ok())
        .collect()
}

/// One option with its value.
pub(super) fn option(sensor: &Handle<raw::Sensor>, number: i32, name: String) -> Result<OptionValue, CallError> {
    let api = sensor.api;
    let value = api.get_option(sensor, number)?;
    let [mut min, mut max, mut step, mut default] = [0.0; 4];
    let range = api.get_option_range(sensor, number, &mut min, &mut max, &mut step, &mut default);
    let meaning = api.get_option_value_description(sensor, number, value).ok().filter(|text| !text.is_empty());
    Ok(OptionValue {
        name,
        value,
        meaning,
        range: range.ok().map(|()| [min, max, default, step]),
        read_only: api.is_option_read_only(sensor, number)?,
    })
}
