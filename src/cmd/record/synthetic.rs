//! A camera in a rendered room: everything after the sensor is what a real one would go through.

use crate::Usage;
use crate::progress::{self, Progress};
use fixtures::{CameraPath, World, WorldConfig, inertial};
use recorder::capture::{CameraSetup, End, Inlet, Source};
use recorder::realsense::{
    Calibration, DeviceDescription, Format, Frame, FrameHeader, Motion, Sample, SensorDescription, StreamCalibration,
    StreamExtrinsics, StreamId, StreamKind, StreamProfile, TimestampDomain, VideoMode, Wish, metadata,
};
use schemas::alignment::{Extrinsics, Intrinsics};
use slam_math::Se3;
use std::sync::Arc;
use std::time::Duration;

/// Pictures are rendered once and shown again and again: a closed path of so many, as far as they fit.
const LOOP_FRAMES: u32 = 120;
const LOOP_BYTES: u64 = 300 << 20;
const GYRO_HZ: u32 = 200;
const ACCEL_HZ: u32 = 250;
/// Depth value of one metre.
const UNITS_PER_METRE: f64 = 1000.0;
/// The camera's counter when the recording starts: an hour after it was switched on.
const BOOT_US: i64 = 3_600_000_000;
const EXPOSURE_US: i64 = 8_000;

/// The rendered camera.
pub struct Synthetic {
    world: World,
    wish: Wish,
    loop_ns: i64,
    /// Colour and depth bytes.
    pictures: Vec<(Vec<u8>, Vec<u8>)>,
}

impl Synthetic {
    /// Renders the pictures.
    ///
    /// # Errors
    /// Colour and depth of different sizes or rates, or a size that cannot be rendered.
    pub fn new(wish: Wish, progress: Progress) -> anyhow::Result<Self> {
        if let (Some(color), Some(depth)) = (wish.color, wish.depth)
            && color != depth
        {
            let message = format!(
                "the rendered camera has one size and rate: --color {color} --depth {color}, or one of them off"
            );
            return Err(Usage(message).into());
        }
        let mode = wish.color.or(wish.depth).unwrap_or(VideoMode { width: 160, height: 120, rate_hz: 30 });
        let (width, height) = (mode.width, mode.height);
        let picture_bytes = u64::from(width) * u64::from(height) * 5;
        let frame_count = LOOP_FRAMES.min((LOOP_BYTES / picture_bytes.max(1)) as u32).max(1);
        let scale = f64::from(width) / 640.0;
        let config = WorldConfig {
            frame_count,
            frame_rate_hz: mode.rate_hz.max(1),
            depth_units_per_metre: UNITS_PER_METRE,
            camera: fixtures::Intrinsics {
                width,
                height,
                fx_px: 525.0 * scale,
                fy_px: 525.0 * scale,
                cx_px: f64::from(width) / 2.0 - 0.5,
                cy_px: f64::from(height) / 2.0 - 0.5,
            },
            camera_path: CameraPath { amplitude_m: [0.2, 0.1, 0.05], cycles: [1.0, 1.0, 2.0], ..CameraPath::default() },
            ..WorldConfig::default()
        };
        let loop_ns = (config.duration_s() * 1e9) as i64;
        let world = World::new(&config)?;
        let bar = progress.bar("rendering");
        let pictures = (0..frame_count).map(|index| {
            let frame = world.frame(index);
            progress::update(&bar, index as usize + 1, frame_count as usize);
            (frame.rgb, frame.depth_units.iter().flat_map(|units| units.to_le_bytes()).collect())
        });
        let pictures = pictures.collect();
        bar.finish_and_clear();
        Ok(Self { world, wish, loop_ns, pictures })
    }

    fn streams(&self) -> Vec<StreamProfile> {
        let mode = |kind, format, mode: Option<VideoMode>| {
            let VideoMode { width, height, rate_hz } = mode?;
            Some(StreamProfile { stream: StreamId::only(kind), format, width, height, rate_hz })
        };
        let motion = |kind, rate_hz| {
            let profile = StreamProfile {
                stream: StreamId::only(kind),
                format: Format::MotionXyz32f,
                width: 0,
                height: 0,
                rate_hz,
            };
            self.wish.imu.then_some(profile)
        };
        let all = [
            mode(StreamKind::Depth, Format::Z16, self.wish.depth),
            mode(StreamKind::Color, Format::Rgb8, self.wish.color),
            motion(StreamKind::Gyro, GYRO_HZ),
            motion(StreamKind::Accel, ACCEL_HZ),
        ];
        all.into_iter().flatten().collect()
    }

    fn setup(&self) -> CameraSetup {
        let c = self.world.camera();
        let lens = Intrinsics::pinhole(c.width, c.height, [c.fx_px, c.fy_px, c.cx_px, c.cy_px]);
        let profiles = self.streams();
        let calibration = |profile: &StreamProfile| StreamCalibration {
            profile: *profile,
            intrinsics: profile.stream.kind.is_video().then_some(lens),
            motion: None,
        };
        // All sensors in one place.
        let transform = Extrinsics { rotation: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], translation: [0.0; 3] };
        let pairs = profiles.iter().flat_map(|from| profiles.iter().map(move |to| (from.stream, to.stream)));
        let pairs = pairs.filter(|(from, to)| from != to);
        let extrinsics = pairs.map(|(from, to)| StreamExtrinsics { from, to, transform }).collect();
        let streams = profiles.iter().map(calibration).collect();
        let calibration = Calibration { streams, extrinsics, depth_units_m: Some((1.0 / UNITS_PER_METRE) as f32) };
        let sensor = SensorDescription { name: "Renderer".to_owned(), options: Vec::new(), profiles };
        let device = DeviceDescription {
            name: "rendered room".to_owned(),
            serial: "synthetic".to_owned(),
            firmware: None,
            usb: None,
            product_id: None,
            more: Vec::new(),
            recording: None,
            sensors: vec![sensor],
        };
        let names = [
            (metadata::FRAME_COUNTER, "Frame Counter"),
            (metadata::FRAME_TIMESTAMP, "Frame Timestamp"),
            (metadata::SENSOR_TIMESTAMP, "Sensor Timestamp"),
            (metadata::ACTUAL_EXPOSURE, "Actual Exposure"),
        ];
        let attribute_names = names.map(|(number, name)| (number, name.to_owned())).to_vec();
        CameraSetup { library: "none".to_owned(), device, calibration: Arc::new(calibration), attribute_names }
    }

    /// What a stream says at its `number`th measurement, `time_ns` after the start.
    fn sample(&self, profile: &StreamProfile, number: u64, time_ns: i64, inlet: &Inlet) -> Sample {
        let device_us = BOOT_US + time_ns / 1000;
        let stream = profile.stream;
        let video = [
            (metadata::FRAME_COUNTER, number as i64),
            (metadata::FRAME_TIMESTAMP, (device_us + EXPOSURE_US / 2) % (1 << 32)),
            (metadata::SENSOR_TIMESTAMP, device_us % (1 << 32)),
            (metadata::ACTUAL_EXPOSURE, EXPOSURE_US),
        ];
        let header = FrameHeader {
            stream,
            number,
            timestamp_ms: device_us as f64 / 1000.0,
            domain: TimestampDomain::HardwareClock,
            metadata: if stream.kind.is_video() { video.to_vec() } else { Vec::new() },
            arrival: inlet.clock().now(),
        };
        if stream.kind.is_motion() {
            let path = |at_ns| self.world_from_camera(at_ns);
            let is_gyro = stream.kind == StreamKind::Gyro;
            let felt = if is_gyro { inertial::angular_velocity } else { inertial::specific_force };
            return Sample::Motion(Motion { header, xyz: felt(path, time_ns).map(|axis| axis as f32) });
        }
        let (color, depth) = &self.pictures[number as usize % self.pictures.len()];
        let bytes = if stream.kind == StreamKind::Color { color.clone() } else { depth.clone() };
        Sample::Frame(Frame { header, width: profile.width, height: profile.height, format: profile.format, bytes })
    }

    fn world_from_camera(&self, time_ns: i64) -> Se3 {
        self.world.world_from_camera(self.world.stamp_ns(0) + time_ns.rem_euclid(self.loop_ns))
    }
}

impl Source for Synthetic {
    fn name(&self) -> &'static str {
        "camera"
    }

    fn run(&mut self, inlet: &Inlet) -> End {
        let profiles = self.streams();
        inlet.camera(&self.setup());
        let start_ns = inlet.clock().now().monotonic_ns;
        let mut numbers = vec![0_u64; profiles.len()];
        let due_ns = |profile: &StreamProfile, number: u64| {
            (number as i64).saturating_mul(1_000_000_000) / i64::from(profile.rate_hz.max(1))
        };
        while !inlet.is_stopping() {
            let dues = profiles.iter().zip(&numbers).map(|(profile, number)| due_ns(profile, *number));
            let Some((next, time_ns)) = dues.enumerate().min_by_key(|(_, due)| *due) else { return End::Finished };
            let wait_ns = start_ns + time_ns - inlet.clock().now().monotonic_ns;
            if wait_ns > 0 {
                std::thread::sleep(Duration::from_nanos(wait_ns.unsigned_abs()));
            }
            inlet.sample(self.sample(&profiles[next], numbers[next], time_ns, inlet));
            numbers[next] += 1;
        }
        End::Stopped
    }
}
