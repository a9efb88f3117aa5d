//! The table of C functions.

use super::*;
use crate::realsense::library::LoadError;
use std::path::Path;

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
        pub context_remove_device(context: Context, file: Text) -> ();
        pub query_devices(context: Context) -> Owned<DeviceList>;
        pub(super) set_devices_changed_callback(context: Context, callback: ChangeCallback, user: Pointer) -> ();
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
        pub(super) get_stream_profile(list: ProfileList, index: i32) -> Pointer;
        pub get_stream_profile_data(
            profile: Profile, kind: Out<i32>, format: Out<i32>, index: Out<i32>, unique_id: Out<i32>, rate: Out<i32>
        ) -> ();
        pub get_video_stream_resolution(profile: Profile, width: Out<i32>, height: Out<i32>) -> ();
        pub get_video_stream_intrinsics(profile: Profile, intrinsics: Out<RawIntrinsics>) -> ();
        pub get_motion_intrinsics(profile: Profile, intrinsics: Out<RawMotionIntrinsics>) -> ();
        pub get_extrinsics(from: Profile, to: Profile, extrinsics: Out<RawExtrinsics>) -> ();
        pub(super) open_multiple(sensor: Sensor, profiles: ProfilePointers, count: i32) -> ();
        pub(super) start(sensor: Sensor, callback: FrameCallback, user: Pointer) -> ();
        pub stop(sensor: Sensor) -> ();
        pub close(sensor: Sensor) -> ();
        pub(super) get_frame_stream_profile(frame: Frame) -> Pointer;
        pub get_frame_number(frame: Frame) -> u64;
        pub get_frame_timestamp(frame: Frame) -> f64;
        pub get_frame_timestamp_domain(frame: Frame) -> i32;
        pub supports_frame_metadata(frame: Frame, number: i32) -> Flag;
        pub get_frame_metadata(frame: Frame, number: i32) -> i64;
        pub get_frame_width(frame: Frame) -> i32;
        pub get_frame_height(frame: Frame) -> i32;
        pub get_frame_stride_in_bytes(frame: Frame) -> i32;
        pub get_frame_data_size(frame: Frame) -> i32;
        pub(super) get_frame_data(frame: Frame) -> Pointer;
        pub playback_device_get_file_path(device: Device) -> Text;
        pub playback_device_set_real_time(device: Device, real_time: i32) -> ();
        pub playback_device_pause(device: Device) -> ();
        pub playback_device_resume(device: Device) -> ();
        pub playback_device_get_current_status(device: Device) -> i32;
        pub create_record_device_ex(device: Device, file: Text, compress: i32) -> Owned<Device>;
        pub create_software_device() -> Owned<Device>;
        pub software_device_register_info(device: Device, info: i32, text: Text) -> ();
        pub software_device_add_sensor(device: Device, name: Text) -> Owned<Sensor>;
        pub(super) software_sensor_add_video_stream(sensor: Sensor, stream: VideoStream) -> Pointer;
        pub(super) software_sensor_add_motion_stream(sensor: Sensor, stream: MotionStream) -> Pointer;
        pub software_sensor_add_option(
            sensor: Sensor, option: i32, min: f32, max: f32, step: f32, default: f32, writable: i32
        ) -> ();
        pub software_sensor_add_read_only_option(sensor: Sensor, option: i32, value: f32) -> ();
        pub software_sensor_set_metadata(sensor: Sensor, number: i32, value: i64) -> ();
        pub(super) software_sensor_on_video_frame(sensor: Sensor, frame: VideoFrame) -> ();
        pub(super) software_sensor_on_motion_frame(sensor: Sensor, frame: MotionFrame) -> ();
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
        pub(super) get_failed_function(error: Pointer) -> Text;
        pub(super) get_failed_args(error: Pointer) -> Text;
        pub(super) get_error_message(error: Pointer) -> Text;
        pub(super) free_error(error: Pointer) -> ();
        pub(super) delete_context(pointer: Pointer) -> ();
        pub(super) delete_device_list(pointer: Pointer) -> ();
        pub(super) delete_device(pointer: Pointer) -> ();
        pub(super) delete_sensor_list(pointer: Pointer) -> ();
        pub(super) delete_sensor(pointer: Pointer) -> ();
        pub(super) delete_stream_profiles_list(pointer: Pointer) -> ();
        pub(super) release_frame(pointer: Pointer) -> ();
        pub(super) delete_processing_block(pointer: Pointer) -> ();
        pub(super) delete_frame_queue(pointer: Pointer) -> ();
    }
}

/// Profiles of one sensor.
pub(super) struct ProfilePointers;

impl Argument for ProfilePointers {
    type Rust<'a> = &'a [Pointer];
    type C = *const Pointer;
    fn to_c(rust: &[Pointer]) -> *const Pointer {
        rust.as_ptr()
    }
}

/// The loaded library. It has threads of its own, so it stays until the process ends.
#[derive(Debug)]
pub(in crate::realsense) struct Api {
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
pub(in crate::realsense) fn open_shared_object(path: &Path, global: bool) -> Result<libloading::Library, String> {
    use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LOCAL, RTLD_NOW};
    let flags = RTLD_NOW | if global { RTLD_GLOBAL } else { RTLD_LOCAL };
    // SAFETY: the initialisers of librealsense and libpython have no requirements of their caller.
    let library = unsafe { Library::open(Some(path), flags) };
    library.map(Into::into).map_err(|error| {
        let linker = std::error::Error::source(&error).map(ToString::to_string);
        linker.unwrap_or_else(|| error.to_string())
    })
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
}
