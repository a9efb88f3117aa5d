//! Calls with more to them than the table tells.

use super::*;

impl Api {
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
pub(in crate::realsense) struct FedAs<'a> {
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
