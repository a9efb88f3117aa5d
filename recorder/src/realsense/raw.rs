//! The vendor's C API: declarations, ownership and calls. All `unsafe` of this room is in this file; what it exports is
//! safe, since a [`Handle`] can only come from the library and knows how to go back.
//!
//! Layouts and signatures after the public headers of librealsense 2.54 - 2.59 (Apache-2.0), `include/librealsense2/h`.

use super::library::LoadError;
use crate::Arrival;
use std::ffi::{CStr, c_char, c_void};
use std::marker::PhantomData;
use std::path::Path;
use std::ptr::{self, NonNull};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

type Pointer = *mut c_void;

/// A call that librealsense refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("librealsense {function}({arguments}): {message}")]
pub struct CallError {
    /// The C function.
    pub function: String,
    /// Its arguments as the library tells them.
    pub arguments: String,
    /// Its reason.
    pub message: String,
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RawIntrinsics {
    pub width: i32,
    pub height: i32,
    pub ppx: f32,
    pub ppy: f32,
    pub fx: f32,
    pub fy: f32,
    pub model: i32,
    pub coefficients: [f32; 5],
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RawExtrinsics {
    pub rotation: [f32; 9],
    pub translation: [f32; 3],
}

#[repr(C)]
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RawMotionIntrinsics {
    pub matrix: [[f32; 4]; 3],
    pub noise_variances: [f32; 3],
    pub bias_variances: [f32; 3],
}

#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub(super) struct VideoStream {
    pub kind: i32,
    pub index: i32,
    pub unique_id: i32,
    pub width: i32,
    pub height: i32,
    pub rate_hz: i32,
    pub bytes_per_pixel: i32,
    pub format: i32,
    pub intrinsics: RawIntrinsics,
}

#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub(super) struct MotionStream {
    pub kind: i32,
    pub index: i32,
    pub unique_id: i32,
    pub rate_hz: i32,
    pub format: i32,
    pub intrinsics: RawMotionIntrinsics,
}

#[repr(C)]
struct VideoFrame {
    pixels: Pointer,
    deleter: extern "C" fn(Pointer),
    stride: i32,
    bytes_per_pixel: i32,
    timestamp_ms: f64,
    domain: i32,
    number: i32,
    profile: Pointer,
    depth_units_m: f32,
}

#[repr(C)]
struct MotionFrame {
    data: Pointer,
    deleter: extern "C" fn(Pointer),
    timestamp_ms: f64,
    domain: i32,
    number: i32,
    profile: Pointer,
}

/// How an argument goes into C.
pub(super) trait Argument {
    /// As Rust has it.
    type Rust<'a>;
    type C;
    fn to_c(rust: Self::Rust<'_>) -> Self::C;
}

/// How a result comes out of C.
pub(super) trait Answer {
    type C;
    type Rust;
    fn from_c(api: &'static Api, c: Self::C) -> Self::Rust;
}

macro_rules! plain {
    ($($type:ty),*) => { $(
        impl Argument for $type {
            type Rust<'a> = $type;
            type C = $type;
            fn to_c(rust: $type) -> $type { rust }
        }
        impl Answer for $type {
            type C = $type;
            type Rust = $type;
            fn from_c(_: &'static Api, c: $type) -> $type { c }
        }
    )* };
}

plain!((), i32, u32, i64, u64, f32, f64, Pointer, RawExtrinsics, VideoStream, MotionStream, VideoFrame, MotionFrame);
plain!(FrameCallback, ChangeCallback);

type FrameCallback = extern "C" fn(Pointer, Pointer);
type ChangeCallback = extern "C" fn(Pointer, Pointer, Pointer);

/// Zero-terminated text; a null pointer is an empty one.
pub(super) struct Text;

impl Argument for Text {
    type Rust<'a> = &'a CStr;
    type C = *const c_char;
    fn to_c(rust: &CStr) -> *const c_char {
        rust.as_ptr()
    }
}

impl Answer for Text {
    type C = *const c_char;
    type Rust = String;
    fn from_c(_: &'static Api, c: *const c_char) -> String {
        if c.is_null() {
            return String::new();
        }
        // SAFETY: the library returns zero-terminated text that lives until its next call on the same object.
        unsafe { CStr::from_ptr(c) }.to_string_lossy().into_owned()
    }
}

/// Yes or no as a C number.
pub(super) struct Flag;

impl Answer for Flag {
    type C = i32;
    type Rust = bool;
    fn from_c(_: &'static Api, c: i32) -> bool {
        c != 0
    }
}

/// A value that the library fills in.
pub(super) struct Out<T>(PhantomData<T>);

impl<T: 'static> Argument for Out<T> {
    type Rust<'a> = &'a mut T;
    type C = *mut T;
    fn to_c(rust: &mut T) -> *mut T {
        rust
    }
}

/// A kind of object that the library lends and takes back.
pub(super) trait Object: Sized + 'static {
    fn release(api: &'static Api, pointer: Pointer);
}

macro_rules! objects {
    ($($name:ident => $release:ident;)*) => { $(
        #[derive(Debug)]
        pub(super) struct $name;
        impl Object for $name {
            fn release(api: &'static Api, pointer: Pointer) { api.$release(pointer); }
        }
        impl Argument for $name {
            type Rust<'a> = &'a Handle<$name>;
            type C = Pointer;
            fn to_c(rust: &Handle<$name>) -> Pointer { rust.pointer.as_ptr() }
        }
    )* };
}

objects! {
    Context => delete_context;
    DeviceList => delete_device_list;
    Device => delete_device;
    SensorList => delete_sensor_list;
    Sensor => delete_sensor;
    ProfileList => delete_stream_profiles_list;
    Frame => release_frame;
    Block => delete_processing_block;
    Queue => delete_frame_queue;
}

/// An object of the library, given back when dropped.
#[derive(Debug)]
pub(super) struct Handle<K: Object> {
    pub api: &'static Api,
    pointer: NonNull<c_void>,
    kind: PhantomData<K>,
}

// SAFETY: librealsense locks its objects itself; each handle releases its own reference, on whatever thread.
unsafe impl<K: Object> Send for Handle<K> {}
// SAFETY: as above: shared calls on one object are allowed from several threads.
unsafe impl<K: Object> Sync for Handle<K> {}

impl<K: Object> Handle<K> {
    fn new(api: &'static Api, pointer: Pointer) -> Option<Self> {
        Some(Self { api, pointer: NonNull::new(pointer)?, kind: PhantomData })
    }

    /// Gives the object away without giving it back.
    fn into_pointer(self) -> Pointer {
        let pointer = self.pointer.as_ptr();
        std::mem::forget(self);
        pointer
    }
}

impl<K: Object> Drop for Handle<K> {
    fn drop(&mut self) {
        K::release(self.api, self.pointer.as_ptr());
    }
}

/// An object that the caller must give back. `None`: the library returned nothing and no error.
pub(super) struct Owned<K>(PhantomData<K>);

impl<K: Object> Answer for Owned<K> {
    type C = Pointer;
    type Rust = Option<Handle<K>>;
    fn from_c(api: &'static Api, c: Pointer) -> Option<Handle<K>> {
        Handle::new(api, c)
    }
}

/// An owned object that the library takes over.
pub(super) struct Given<K>(PhantomData<K>);

impl<K: Object> Argument for Given<K> {
    type Rust<'a> = Handle<K>;
    type C = Pointer;
    fn to_c(rust: Handle<K>) -> Pointer {
        rust.into_pointer()
    }
}

/// A stream profile: belongs to what it was asked from, which it keeps.
#[derive(Debug, Clone)]
pub(super) struct Profile {
    pointer: NonNull<c_void>,
    pub owner: ProfileOwner,
}

/// Who keeps a profile alive.
#[derive(Debug, Clone)]
pub(super) enum ProfileOwner {
    List(Arc<Handle<ProfileList>>),
    Sensor(Arc<Handle<Sensor>>),
    Frame(Arc<Handle<Frame>>),
}

// SAFETY: a profile is immutable, and its owner, which keeps it, may go to other threads.
unsafe impl Send for Profile {}
// SAFETY: as above.
unsafe impl Sync for Profile {}

impl Profile {
    pub fn api(&self) -> &'static Api {
        match &self.owner {
            ProfileOwner::List(owner) => owner.api,
            ProfileOwner::Sensor(owner) => owner.api,
            ProfileOwner::Frame(owner) => owner.api,
        }
    }

    fn new(pointer: Pointer, owner: ProfileOwner) -> Result<Self, CallError> {
        let pointer = NonNull::new(pointer).ok_or_else(|| missing("stream profile"))?;
        Ok(Self { pointer, owner })
    }
}

impl Argument for Profile {
    type Rust<'a> = &'a Profile;
    type C = Pointer;
    fn to_c(rust: &Profile) -> Pointer {
        rust.pointer.as_ptr()
    }
}

/// Where frames of a started sensor go. Lives for ever, since the library may call at any time until it ends; what it
/// points to goes when the stream is stopped.
struct FrameSlot {
    api: &'static Api,
    sink: RwLock<Option<FrameSink>>,
}

/// Takes frames on the library's threads.
pub(super) type FrameSink = Arc<dyn Fn(Handle<Frame>, Arrival) + Send + Sync>;

/// Frames of a started sensor go to its sink until this is dropped.
pub(super) struct Flow(&'static FrameSlot);

impl Drop for Flow {
    fn drop(&mut self) {
        *self.0.sink.write().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// Called by the library on its own threads.
extern "C" fn on_frame(frame: Pointer, user: Pointer) {
    let arrival = Arrival::now();
    // SAFETY: `user` is the `&'static FrameSlot` that `start_flow` gave.
    let slot = unsafe { &*user.cast::<FrameSlot>() };
    let frame = Handle::new(slot.api, frame);
    let sink = slot.sink.read().unwrap_or_else(PoisonError::into_inner).clone();
    if let (Some(frame), Some(sink)) = (frame, sink) {
        sink(frame, arrival);
    }
}

/// Counts changes in the set of connected devices. Called by the library on its own threads.
extern "C" fn on_change(removed: Pointer, added: Pointer, user: Pointer) {
    // SAFETY: `user` is the `&'static Changes` that `watch` was given.
    let changes = unsafe { &*user.cast::<Changes>() };
    changes.count.fetch_add(1, Ordering::SeqCst);
    drop(Handle::<DeviceList>::new(changes.api, removed));
    drop(Handle::<DeviceList>::new(changes.api, added));
}

/// How often the set of connected devices has changed.
#[derive(Debug)]
pub(super) struct Changes {
    api: &'static Api,
    pub count: AtomicU64,
}

macro_rules! api {
    (
        refusable { $($visible:vis $name:ident($($argument:ident: $type:ty),*) -> $answer:ty;)* }
        always { $($plain_visible:vis $plain:ident($($plain_argument:ident: $plain_type:ty),*) -> $plain_answer:ty;)* }
    ) => {
        /// Addresses of the C functions.
        #[derive(Debug)]
        struct Table {
            $($name: unsafe extern "C" fn($(<$type as Argument>::C,)* *mut Pointer) -> <$answer as Answer>::C,)*
            $($plain: unsafe extern "C" fn($(<$plain_type as Argument>::C),*) -> <$plain_answer as Answer>::C,)*
        }

        impl Table {
            fn load(library: &libloading::Library, path: &Path) -> Result<Self, LoadError> {
                Ok(Self {
                    $($name: symbol(library, path, concat!("rs2_", stringify!($name)))?,)*
                    $($plain: symbol(library, path, concat!("rs2_", stringify!($plain)))?,)*
                })
            }
        }

        #[allow(clippy::too_many_arguments, reason = "as many as the C function has")]
        impl Api {
            $($visible fn $name(
                &'static self, $($argument: <$type as Argument>::Rust<'_>),*
            ) -> Result<<$answer as Answer>::Rust, CallError> {
                let mut error = ptr::null_mut();
                // SAFETY: the declaration is that of the header, handles and references are alive for the call, and the
                // library reports failure through `error`.
                let value = unsafe { (self.table.$name)($(<$type as Argument>::to_c($argument),)* &raw mut error) };
                self.check(error)?;
                Ok(<$answer as Answer>::from_c(self, value))
            })*
        }

        impl Api {
            $($plain_visible fn $plain(
                &'static self, $($plain_argument: <$plain_type as Argument>::Rust<'_>),*
            ) -> <$plain_answer as Answer>::Rust {
                // SAFETY: as above; these functions cannot fail.
                let value = unsafe { (self.table.$plain)($(<$plain_type as Argument>::to_c($plain_argument)),*) };
                <$plain_answer as Answer>::from_c(self, value)
            })*
        }
    };
}

api! {
    refusable {
        pub get_api_version() -> i32;
        pub create_context(version: i32) -> Owned<Context>;
        pub context_add_device(context: Context, file: Text) -> Owned<Device>;
        pub query_devices(context: Context) -> Owned<DeviceList>;
        set_devices_changed_callback(context: Context, callback: ChangeCallback, user: Pointer) -> ();
        pub get_device_count(list: DeviceList) -> i32;
        pub create_device(list: DeviceList, index: i32) -> Owned<Device>;
        pub supports_device_info(device: Device, info: i32) -> Flag;
        pub get_device_info(device: Device, info: i32) -> Text;
        pub is_device_extendable_to(device: Device, extension: i32) -> Flag;
        pub query_sensors(device: Device) -> Owned<SensorList>;
        pub get_sensors_count(list: SensorList) -> i32;
        pub create_sensor(list: SensorList, index: i32) -> Owned<Sensor>;
        pub get_sensor_info(sensor: Sensor, info: i32) -> Text;
        pub supports_option(sensor: Sensor, option: i32) -> Flag;
        pub is_option_read_only(sensor: Sensor, option: i32) -> Flag;
        pub get_option(sensor: Sensor, option: i32) -> f32;
        pub set_option(sensor: Sensor, option: i32, value: f32) -> ();
        pub get_option_range(
            sensor: Sensor, option: i32, min: Out<f32>, max: Out<f32>, step: Out<f32>, default: Out<f32>
        ) -> ();
        pub get_option_value_description(sensor: Sensor, option: i32, value: f32) -> Text;
        pub get_stream_profiles(sensor: Sensor) -> Owned<ProfileList>;
        pub get_stream_profiles_count(list: ProfileList) -> i32;
        get_stream_profile(list: ProfileList, index: i32) -> Pointer;
        pub get_stream_profile_data(
            profile: Profile, kind: Out<i32>, format: Out<i32>, index: Out<i32>, unique_id: Out<i32>, rate: Out<i32>
        ) -> ();
        pub get_video_stream_resolution(profile: Profile, width: Out<i32>, height: Out<i32>) -> ();
        pub get_video_stream_intrinsics(profile: Profile, intrinsics: Out<RawIntrinsics>) -> ();
        pub get_motion_intrinsics(profile: Profile, intrinsics: Out<RawMotionIntrinsics>) -> ();
        pub get_extrinsics(from: Profile, to: Profile, extrinsics: Out<RawExtrinsics>) -> ();
        open_multiple(sensor: Sensor, profiles: ProfilePointers, count: i32) -> ();
        start(sensor: Sensor, callback: FrameCallback, user: Pointer) -> ();
        pub stop(sensor: Sensor) -> ();
        pub close(sensor: Sensor) -> ();
        get_frame_stream_profile(frame: Frame) -> Pointer;
        pub get_frame_number(frame: Frame) -> u64;
        pub get_frame_timestamp(frame: Frame) -> f64;
        pub get_frame_timestamp_domain(frame: Frame) -> i32;
        pub supports_frame_metadata(frame: Frame, number: i32) -> Flag;
        pub get_frame_metadata(frame: Frame, number: i32) -> i64;
        pub get_frame_width(frame: Frame) -> i32;
        pub get_frame_height(frame: Frame) -> i32;
        pub get_frame_stride_in_bytes(frame: Frame) -> i32;
        pub get_frame_data_size(frame: Frame) -> i32;
        get_frame_data(frame: Frame) -> Pointer;
        pub playback_device_get_file_path(device: Device) -> Text;
        pub playback_device_set_real_time(device: Device, real_time: i32) -> ();
        pub playback_device_pause(device: Device) -> ();
        pub playback_device_resume(device: Device) -> ();
        pub playback_device_get_current_status(device: Device) -> i32;
        pub create_record_device_ex(device: Device, file: Text, compress: i32) -> Owned<Device>;
        pub create_software_device() -> Owned<Device>;
        pub software_device_register_info(device: Device, info: i32, text: Text) -> ();
        pub software_device_add_sensor(device: Device, name: Text) -> Owned<Sensor>;
        software_sensor_add_video_stream(sensor: Sensor, stream: VideoStream) -> Pointer;
        software_sensor_add_motion_stream(sensor: Sensor, stream: MotionStream) -> Pointer;
        pub software_sensor_add_option(
            sensor: Sensor, option: i32, min: f32, max: f32, step: f32, default: f32, writable: i32
        ) -> ();
        pub software_sensor_add_read_only_option(sensor: Sensor, option: i32, value: f32) -> ();
        pub software_sensor_set_metadata(sensor: Sensor, number: i32, value: i64) -> ();
        software_sensor_on_video_frame(sensor: Sensor, frame: VideoFrame) -> ();
        software_sensor_on_motion_frame(sensor: Sensor, frame: MotionFrame) -> ();
        pub register_extrinsics(from: Profile, to: Profile, extrinsics: RawExtrinsics) -> ();
        pub create_sync_processing_block() -> Owned<Block>;
        pub create_align(stream: i32) -> Owned<Block>;
        pub create_frame_queue(capacity: i32) -> Owned<Queue>;
        pub start_processing_queue(block: Block, queue: Queue) -> ();
        pub process_frame(block: Block, frame: Given<Frame>) -> ();
        pub wait_for_frame(queue: Queue, timeout_ms: u32) -> Owned<Frame>;
        pub embedded_frames_count(frames: Frame) -> i32;
        pub extract_frame(frames: Frame, index: i32) -> Owned<Frame>;
    }
    always {
        pub stream_to_string(number: i32) -> Text;
        pub format_to_string(number: i32) -> Text;
        pub frame_metadata_to_string(number: i32) -> Text;
        pub timestamp_domain_to_string(number: i32) -> Text;
        pub distortion_to_string(number: i32) -> Text;
        pub camera_info_to_string(number: i32) -> Text;
        pub option_to_string(number: i32) -> Text;
        pub extension_to_string(number: i32) -> Text;
        pub playback_status_to_string(number: i32) -> Text;
        get_failed_function(error: Pointer) -> Text;
        get_failed_args(error: Pointer) -> Text;
        get_error_message(error: Pointer) -> Text;
        free_error(error: Pointer) -> ();
        delete_context(pointer: Pointer) -> ();
        delete_device_list(pointer: Pointer) -> ();
        delete_device(pointer: Pointer) -> ();
        delete_sensor_list(pointer: Pointer) -> ();
        delete_sensor(pointer: Pointer) -> ();
        delete_stream_profiles_list(pointer: Pointer) -> ();
        release_frame(pointer: Pointer) -> ();
        delete_processing_block(pointer: Pointer) -> ();
        delete_frame_queue(pointer: Pointer) -> ();
    }
}

/// Profiles of one sensor.
struct ProfilePointers;

impl Argument for ProfilePointers {
    type Rust<'a> = &'a [Pointer];
    type C = *const Pointer;
    fn to_c(rust: &[Pointer]) -> *const Pointer {
        rust.as_ptr()
    }
}

/// The loaded library. It has threads of its own, so it stays until the process ends.
#[derive(Debug)]
pub(super) struct Api {
    table: Table,
}

fn symbol<F: Copy>(library: &libloading::Library, path: &Path, name: &str) -> Result<F, LoadError> {
    // SAFETY: only used for fields of `Table`, whose types are those of the header's declarations.
    let found = unsafe { library.get::<F>(name) };
    found.map(|symbol| *symbol).map_err(|_| LoadError::Symbol { path: path.to_owned(), name: name.to_owned() })
}

/// Opens a shared object. `global`: what it defines is there for objects that are opened later.
///
/// # Errors
/// The dynamic linker's sentence.
pub(super) fn open_shared_object(path: &Path, global: bool) -> Result<libloading::Library, String> {
    use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LOCAL, RTLD_NOW};
    let flags = RTLD_NOW | if global { RTLD_GLOBAL } else { RTLD_LOCAL };
    // SAFETY: the initialisers of librealsense and libpython have no requirements of their caller.
    let library = unsafe { Library::open(Some(path), flags) };
    library.map(Into::into).map_err(|error| {
        let linker = std::error::Error::source(&error).map(ToString::to_string);
        linker.unwrap_or_else(|| error.to_string())
    })
}

fn missing(what: &str) -> CallError {
    let message = "returned nothing and gave no reason".to_owned();
    CallError { function: what.to_owned(), arguments: String::new(), message }
}

/// What a call must return that says it succeeded.
pub(super) fn required<K: Object>(handle: Option<Handle<K>>, what: &str) -> Result<Handle<K>, CallError> {
    handle.ok_or_else(|| missing(what))
}

impl Api {
    /// The functions of an opened library, which is never closed.
    pub fn load(library: libloading::Library, path: &Path) -> Result<&'static Self, LoadError> {
        let table = Table::load(&library, path)?;
        std::mem::forget(library);
        Ok(Box::leak(Box::new(Self { table })))
    }

    fn check(&'static self, error: Pointer) -> Result<(), CallError> {
        if error.is_null() {
            return Ok(());
        }
        let function = self.get_failed_function(error);
        let arguments = self.get_failed_args(error);
        let message = self.get_error_message(error);
        self.free_error(error);
        Err(CallError { function, arguments, message })
    }

    /// Begins to count changes of the connected devices.
    pub fn watch(&'static self, context: &Handle<Context>) -> Result<&'static Changes, CallError> {
        let changes: &'static Changes = Box::leak(Box::new(Changes { api: self, count: AtomicU64::new(0) }));
        self.set_devices_changed_callback(context, on_change, ptr::from_ref(changes).cast_mut().cast())?;
        Ok(changes)
    }

    /// The profiles of a sensor.
    pub fn profiles(&'static self, sensor: &Handle<Sensor>) -> Result<Vec<Profile>, CallError> {
        let list = Arc::new(required(self.get_stream_profiles(sensor)?, "get_stream_profiles")?);
        let count = self.get_stream_profiles_count(&list)?;
        let profile = |i| Profile::new(self.get_stream_profile(&list, i)?, ProfileOwner::List(Arc::clone(&list)));
        (0..count).map(profile).collect()
    }

    /// The profile of a frame.
    pub fn frame_profile(&'static self, frame: &Arc<Handle<Frame>>) -> Result<Profile, CallError> {
        Profile::new(self.get_frame_stream_profile(frame)?, ProfileOwner::Frame(Arc::clone(frame)))
    }

    /// Opens a sensor with profiles of its own.
    pub fn open(&'static self, sensor: &Handle<Sensor>, profiles: &[Profile]) -> Result<(), CallError> {
        let pointers: Vec<Pointer> = profiles.iter().map(|profile| profile.pointer.as_ptr()).collect();
        self.open_multiple(sensor, &pointers, pointers.len() as i32)
    }

    /// Starts an opened sensor.
    pub fn start_flow(&'static self, sensor: &Handle<Sensor>, sink: FrameSink) -> Result<Flow, CallError> {
        let slot: &'static FrameSlot = Box::leak(Box::new(FrameSlot { api: self, sink: RwLock::new(Some(sink)) }));
        let flow = Flow(slot);
        self.start(sensor, on_frame, ptr::from_ref(slot).cast_mut().cast())?;
        Ok(flow)
    }

    /// The bytes of a frame, `length` of which its size and format promise. `None`: the frame has fewer.
    pub fn frame_bytes<'a>(
        &'static self,
        frame: &'a Handle<Frame>,
        length: usize,
    ) -> Result<Option<&'a [u8]>, CallError> {
        // Frames of software sensors tell a size of 0.
        let told = usize::try_from(self.get_frame_data_size(frame)?).unwrap_or(0);
        let data = self.get_frame_data(frame)?;
        if data.is_null() || told != 0 && told < length {
            return Ok(None);
        }
        // SAFETY: at least `length` bytes stand there by the frame's own size, else by its stride and height (12 bytes for
        // an inertial sample), and they do not change while the frame is held.
        Ok(Some(unsafe { std::slice::from_raw_parts(data.cast::<u8>(), length) }))
    }
}

/// Bytes for a software frame: the library frees them through [`free_bytes`], which must know how many there are. They
/// stand at a multiple of 16, which the library's SSE code takes for granted.
fn lend_bytes(bytes: &[u8]) -> Pointer {
    let words = bytes.len().div_ceil(size_of::<u128>()) + 1;
    let mut memory = vec![0_u128; words].into_boxed_slice();
    memory[0] = words as u128;
    let start = Box::into_raw(memory).cast::<u128>();
    // SAFETY: one word further there are `words - 1` words, enough for the bytes, and nobody else knows them.
    unsafe {
        let data = start.add(1).cast::<u8>();
        data.copy_from_nonoverlapping(bytes.as_ptr(), bytes.len());
        data.cast()
    }
}

extern "C" fn free_bytes(data: Pointer) {
    // SAFETY: `data` comes from `lend_bytes`, is given back once, and the word before it is the length of the box.
    unsafe {
        let start = data.cast::<u128>().sub(1);
        drop(Box::from_raw(ptr::slice_from_raw_parts_mut(start, *start as usize)));
    }
}

/// When and as what a software frame is fed.
#[derive(Debug, Clone, Copy)]
pub(super) struct FedAs<'a> {
    pub profile: &'a Profile,
    pub number: i32,
    pub timestamp_ms: f64,
    pub domain: i32,
}

impl Api {
    /// Adds a stream of pictures to a software sensor.
    pub fn add_video(&'static self, sensor: &Arc<Handle<Sensor>>, stream: VideoStream) -> Result<Profile, CallError> {
        let pointer = self.software_sensor_add_video_stream(sensor, stream)?;
        Profile::new(pointer, ProfileOwner::Sensor(Arc::clone(sensor)))
    }

    /// Adds an inertial stream to a software sensor.
    pub fn add_motion(&'static self, sensor: &Arc<Handle<Sensor>>, stream: MotionStream) -> Result<Profile, CallError> {
        let pointer = self.software_sensor_add_motion_stream(sensor, stream)?;
        Profile::new(pointer, ProfileOwner::Sensor(Arc::clone(sensor)))
    }

    /// Feeds a picture of `[stride, bytes per pixel]` to a started software sensor.
    pub fn feed_video(
        &'static self,
        sensor: &Handle<Sensor>,
        at: FedAs<'_>,
        [stride, bytes_per_pixel]: [i32; 2],
        depth_units_m: f32,
        bytes: &[u8],
    ) -> Result<(), CallError> {
        let FedAs { profile, number, timestamp_ms, domain } = at;
        let (pixels, profile) = (lend_bytes(bytes), profile.pointer.as_ptr());
        let deleter = free_bytes;
        let frame = VideoFrame {
            pixels,
            deleter,
            stride,
            bytes_per_pixel,
            timestamp_ms,
            domain,
            number,
            profile,
            depth_units_m,
        };
        self.software_sensor_on_video_frame(sensor, frame)
    }

    /// Feeds an inertial sample to a started software sensor.
    pub fn feed_motion(&'static self, sensor: &Handle<Sensor>, at: FedAs<'_>, xyz: [f32; 3]) -> Result<(), CallError> {
        let bytes: Vec<u8> = xyz.iter().flat_map(|value| value.to_le_bytes()).collect();
        let FedAs { profile, number, timestamp_ms, domain } = at;
        let (data, profile) = (lend_bytes(&bytes), profile.pointer.as_ptr());
        let frame = MotionFrame { data, deleter: free_bytes, timestamp_ms, domain, number, profile };
        self.software_sensor_on_motion_frame(sensor, frame)
    }
}
