//! An open camera: options, calibration, streaming.

use super::context::{CameraError, Context, describe, device_info, named, option};
use super::raw::{self, CallError, Flow, FrameSink, Handle, Profile, required};
use super::select::{Selection, Wish, select};
use super::types::{
    Calibration, DeviceDescription, OptionValue, Sample, StreamCalibration, StreamExtrinsics, StreamProfile,
};
use super::{EXTENSION_PLAYBACK, OPTION_DEPTH_UNITS, PLAYBACK_STOPPED, frame, info};
use crate::Arrival;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

/// An open camera.
#[derive(Debug)]
pub struct Camera {
    context: Option<Arc<Context>>,
    device: Arc<Handle<raw::Device>>,
    sensors: Vec<Arc<Handle<raw::Sensor>>>,
    serial: String,
    playback: bool,
}

/// Takes samples, on threads of the library: one a sensor at least, so that streams do not wait for each other. Must
/// return soon; where it waits, a playback with real time off waits with it, and a camera drops frames (its frame
/// counter tells).
pub type Sink = Arc<dyn Fn(Sample) + Send + Sync>;

/// How streaming stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Frames may come.
    Running,
    /// A recording has been played to its end.
    Ended,
    /// The camera has been unplugged or has reset itself.
    Gone,
}

impl Camera {
    pub(super) fn new(device: Arc<Handle<raw::Device>>, context: Option<Arc<Context>>) -> Result<Self, CameraError> {
        let api = device.api;
        let list = required(api.query_sensors(&device)?, "query_sensors")?;
        let sensor = |i| Ok(Arc::new(required(api.create_sensor(&list, i)?, "create_sensor")?));
        let sensors = (0..api.get_sensors_count(&list)?).map(sensor).collect::<Result<_, CallError>>()?;
        let serial = device_info(&device, info::SERIAL)?.unwrap_or_default();
        let playback = api.is_device_extendable_to(&device, EXTENSION_PLAYBACK)?;
        Ok(Self { context, device, sensors, serial, playback })
    }

    /// All it says about itself, with the present values of all options.
    ///
    /// # Errors
    /// The library refuses.
    pub fn describe(&self) -> Result<DeviceDescription, CameraError> {
        describe(&self.device, &self.sensors)
    }

    /// Whether it is a recording that is played.
    #[must_use]
    pub fn is_playback(&self) -> bool {
        self.playback
    }

    /// A recording: whether it is played at the speed at which it was made (frames may then be lost, as from a camera),
    /// or as fast as they are taken, none lost. Nothing for a camera.
    ///
    /// # Errors
    /// The library refuses.
    pub fn set_real_time(&self, real_time: bool) -> Result<(), CameraError> {
        if self.playback {
            self.device.api.playback_device_set_real_time(&self.device, i32::from(real_time))?;
        }
        Ok(())
    }

    /// Sets an option by its name (as [`OptionValue::name`], any case, `-` or `_` for a blank) on every sensor that has it.
    /// A value may be given by the library's word for it with [`Camera::option_word`]. Returns what the sensors say then.
    ///
    /// # Errors
    /// No sensor has it, or none takes the value.
    pub fn set_option(&self, name: &str, value: f32) -> Result<Vec<OptionValue>, CameraError> {
        let api = self.device.api;
        let error = |reason: String| CameraError::Option { name: name.to_owned(), value, reason };
        let known = named(|number| api.option_to_string(number)).find(|(_, known)| is_same_name(known, name));
        let (number, known) = known.ok_or_else(|| error("librealsense knows no such option".to_owned()))?;
        let mut set = Vec::new();
        for sensor in &self.sensors {
            let writable = api.supports_option(sensor, number)? && !api.is_option_read_only(sensor, number)?;
            if writable {
                api.set_option(sensor, number, value).map_err(|refusal| error(refusal.to_string()))?;
                set.push(option(sensor, number, known.clone())?);
            }
        }
        if set.is_empty() { Err(error("no sensor of this camera lets it be set".to_owned())) } else { Ok(set) }
    }

    /// The value that the library calls `word`, as 3 for `High Accuracy` of the option `Visual Preset`.
    ///
    /// # Errors
    /// The library refuses.
    pub fn option_word(&self, name: &str, word: &str) -> Result<Option<f32>, CameraError> {
        let options = self.describe()?.sensors.into_iter().flat_map(|sensor| sensor.options);
        let Some([min, max, ..]) = options.filter(|o| is_same_name(&o.name, name)).find_map(|o| o.range) else {
            return Ok(None);
        };
        let api = self.device.api;
        let known = named(|number| api.option_to_string(number)).find(|(_, known)| is_same_name(known, name));
        let Some((number, _)) = known else { return Ok(None) };
        // Options with words are small enumerations.
        let values = (min as i32..=max as i32).take(100).map(|value| value as f32);
        Ok(values.into_iter().find(|value| {
            let words = self.sensors.iter().filter_map(|s| api.get_option_value_description(s, number, *value).ok());
            words.into_iter().any(|known| is_same_name(&known, word))
        }))
    }

    /// The profiles for a wish, and what is wrong with them.
    ///
    /// # Errors
    /// A stream that the camera does not have at all.
    pub fn select(&self, wish: &Wish) -> Result<Selection, CameraError> {
        select(&self.describe()?, wish)
    }

    /// The sensor that offers a profile.
    fn find(&self, wanted: &StreamProfile) -> Result<(usize, Profile), CameraError> {
        for (index, sensor) in self.sensors.iter().enumerate() {
            for candidate in sensor.api.profiles(sensor)? {
                if frame::profile(&candidate)? == *wanted {
                    return Ok((index, candidate));
                }
            }
        }
        let description = self.describe()?;
        let offered = description.sensors.iter().flat_map(|sensor| &sensor.profiles).map(ToString::to_string).collect();
        let DeviceDescription { name, serial, .. } = description;
        Err(CameraError::Stream { name, serial, stream: wanted.to_string(), offered })
    }

    /// Calibration of these profiles.
    ///
    /// # Errors
    /// A profile that the camera does not offer, or the library refuses.
    pub fn calibration(&self, profiles: &[StreamProfile]) -> Result<Calibration, CameraError> {
        let found = profiles.iter().map(|p| Ok((*p, self.find(p)?.1))).collect::<Result<Vec<_>, CameraError>>()?;
        let mut calibration = Calibration { depth_units_m: self.depth_units_m(), ..Calibration::default() };
        for (profile, handle) in &found {
            let video = profile.stream.kind.is_video();
            let intrinsics = if video { Some(frame::intrinsics(handle)?) } else { None };
            // Cameras without a calibrated inertial unit refuse.
            let motion = if video { None } else { frame::motion_intrinsics(handle).ok() };
            calibration.streams.push(StreamCalibration { profile: *profile, intrinsics, motion });
        }
        for (from, from_handle) in &found {
            for (to, to_handle) in found.iter().filter(|(to, _)| to.stream != from.stream) {
                if let Ok(transform) = frame::extrinsics(from_handle, to_handle) {
                    let extrinsics = StreamExtrinsics { from: from.stream, to: to.stream, transform };
                    calibration.extrinsics.push(extrinsics);
                }
            }
        }
        Ok(calibration)
    }

    fn depth_units_m(&self) -> Option<f32> {
        self.sensors.iter().find_map(|sensor| sensor.api.get_option(sensor, OPTION_DEPTH_UNITS).ok())
    }

    /// Opens the sensors that offer these profiles, all first, then starts them. Frames go to `sink` until the returned
    /// value is dropped.
    ///
    /// # Errors
    /// A profile that the camera does not offer, or the library refuses.
    pub fn start(&self, profiles: &[StreamProfile], sink: &Sink) -> Result<Streaming, CameraError> {
        let mut by_sensor: Vec<Vec<Profile>> = vec![Vec::new(); self.sensors.len()];
        for profile in profiles {
            let (sensor, handle) = self.find(profile)?;
            by_sensor[sensor].push(handle);
        }
        let api = self.device.api;
        let mut streaming = Streaming {
            context: self.context.clone(),
            device: Arc::clone(&self.device),
            playback: self.playback,
            serial: self.serial.clone(),
            seen_changes: AtomicU64::new(self.context.as_ref().map_or(0, |context| context.changes())),
            traffic: Arc::default(),
            sensors: Vec::new(),
        };
        for (sensor, profiles) in self.sensors.iter().zip(by_sensor).filter(|(_, profiles)| !profiles.is_empty()) {
            api.open(sensor, &profiles)?;
            streaming.sensors.push((Arc::clone(sensor), None));
        }
        let metadata_count = named(|number| api.frame_metadata_to_string(number)).count() as u32;
        streaming.traffic.last_ns.store(Arrival::now().monotonic_ns, Ordering::SeqCst);
        if self.playback {
            // Else what the file has for the second sensor runs past before it is started.
            api.playback_device_pause(&self.device)?;
        }
        for (sensor, flow) in &mut streaming.sensors {
            let (sink, traffic) = (Arc::clone(sink), Arc::clone(&streaming.traffic));
            let copy: FrameSink = Arc::new(move |raw, arrival| {
                traffic.inside.fetch_add(1, Ordering::SeqCst);
                sink(frame::sample(raw, metadata_count, arrival));
                traffic.last_ns.store(Arrival::now().monotonic_ns, Ordering::SeqCst);
                traffic.inside.fetch_sub(1, Ordering::SeqCst);
            });
            *flow = Some(api.start_flow(sensor, copy)?);
        }
        if self.playback {
            api.playback_device_resume(&self.device)?;
        }
        Ok(streaming)
    }
}

/// Whether two names differ in case and word marks only.
fn is_same_name(one: &str, other: &str) -> bool {
    let plain = |text: &str| text.replace(['-', '_'], " ").to_lowercase();
    plain(one) == plain(other)
}

/// What passes through the sink.
#[derive(Debug, Default)]
struct Traffic {
    /// Samples in the sink now.
    inside: AtomicU64,
    /// When the last one was done, `CLOCK_MONOTONIC`.
    last_ns: AtomicI64,
}

/// A recording says that it has ended when the last frame is read from the file, which is before it is handed over.
const QUIET_NS: i64 = 200_000_000;

impl Traffic {
    fn is_quiet(&self) -> bool {
        let since = Arrival::now().monotonic_ns - self.last_ns.load(Ordering::SeqCst);
        self.inside.load(Ordering::SeqCst) == 0 && since > QUIET_NS
    }
}

/// Running streams. Dropping it stops them: no sample comes afterwards.
pub struct Streaming {
    context: Option<Arc<Context>>,
    device: Arc<Handle<raw::Device>>,
    playback: bool,
    serial: String,
    seen_changes: AtomicU64,
    traffic: Arc<Traffic>,
    sensors: Vec<(Arc<Handle<raw::Sensor>>, Option<Flow>)>,
}

impl Streaming {
    /// How it stands. Cheap; to be asked when frames stay away.
    ///
    /// # Errors
    /// The library refuses.
    pub fn state(&self) -> Result<State, CameraError> {
        if self.playback {
            let status = self.device.api.playback_device_get_current_status(&self.device)?;
            if status == PLAYBACK_STOPPED && self.traffic.is_quiet() {
                return Ok(State::Ended);
            }
        }
        let Some(context) = &self.context else { return Ok(State::Running) };
        let changes = context.changes();
        if changes == self.seen_changes.load(Ordering::SeqCst) {
            return Ok(State::Running);
        }
        if !context.serials()?.contains(&self.serial) {
            return Ok(State::Gone);
        }
        self.seen_changes.store(changes, Ordering::SeqCst);
        Ok(State::Running)
    }
}

impl Drop for Streaming {
    fn drop(&mut self) {
        for (sensor, flow) in self.sensors.drain(..) {
            // A camera that is gone refuses both; there is nothing left to stop then.
            if flow.is_some() {
                let _ = sensor.api.stop(&sensor);
            }
            let _ = sensor.api.close(&sensor);
            drop(flow);
        }
    }
}
