//! The vendor's C API: declarations, ownership and calls. All `unsafe` of the crate's cameras is in this folder; what it
//! exports is safe, since a [`Handle`] can only come from the library and knows how to go back.
//!
//! Layouts and signatures after the public headers of librealsense 2.54 - 2.59 (Apache-2.0), `include/librealsense2/h`.

mod calls;
mod table;

pub(super) use calls::FedAs;
pub(super) use table::{Api, open_shared_object};

use crate::Arrival;
use std::ffi::{CStr, c_char, c_void};
use std::marker::PhantomData;
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

fn missing(what: &str) -> CallError {
    let message = "returned nothing and gave no reason".to_owned();
    CallError { function: what.to_owned(), arguments: String::new(), message }
}

/// What a call must return that says it succeeded.
pub(super) fn required<K: Object>(handle: Option<Handle<K>>, what: &str) -> Result<Handle<K>, CallError> {
    handle.ok_or_else(|| missing(what))
}
