//! What a D435i would measure in the synthetic world.

use fixtures::{Intrinsics, World, WorldConfig, scenario};
use recorder::Arrival;
use recorder::realsense::{
    Format, Frame, FrameHeader, Motion, Sample, SoftwareSpec, StreamId, StreamKind, TimestampDomain, VideoMode,
    metadata,
};
use std::error::Error;

/// The world seen by two cameras at one point.
pub struct Rig {
    color: World,
    depth: World,
    mode: VideoMode,
}

/// Inertial rates, Hz.
const GYRO_HZ: i64 = 200;
const ACCEL_HZ: i64 = 250;
/// Step of the differences that motion is taken from.
const STEP_NS: i64 = 2_000_000;
/// Standard gravity, m/s^2; the world's z axis points up.
const GRAVITY: f64 = 9.806_65;

fn camera(mode: VideoMode, focal: f64) -> Intrinsics {
    let (width, height) = (f64::from(mode.width), f64::from(mode.height));
    // Values that an f32 holds, as a camera tells them.
    let f = f64::from((focal * width) as f32);
    let (cx_px, cy_px) = ((width - 1.0) / 2.0, (height - 1.0) / 2.0);
    Intrinsics { width: mode.width, height: mode.height, fx_px: f, fy_px: f, cx_px, cy_px }
}

impl Rig {
    /// # Errors
    /// An unknown scenario.
    pub fn new(name: &str, mode: VideoMode) -> Result<Self, Box<dyn Error>> {
        let base = match name {
            "demo" => scenario::demo(),
            "static" => scenario::static_room(),
            "robots" => scenario::robots_people(),
            "tiny" => scenario::tiny(),
            other => return Err(format!("no scenario `{other}`; there are demo, static, robots, tiny").into()),
        };
        let duration_s = base.duration_s();
        let world = |focal| {
            let frame_count = (duration_s * f64::from(mode.rate_hz)) as u32;
            let camera = camera(mode, focal);
            World::new(&WorldConfig { camera, frame_rate_hz: mode.rate_hz, frame_count, ..base.clone() })
        };
        Ok(Self { color: world(0.73)?, depth: world(0.53)?, mode })
    }

    /// Tells the camera its lenses.
    pub fn calibrate(&self, spec: &mut SoftwareSpec) {
        for stream in &mut spec.calibration.streams {
            let world = if stream.profile.stream.kind == StreamKind::Depth { &self.depth } else { &self.color };
            if let Some(intrinsics) = &mut stream.intrinsics {
                let camera = world.camera();
                intrinsics.fx = camera.fx_px as f32;
                intrinsics.fy = camera.fy_px as f32;
                intrinsics.cx = camera.cx_px as f32;
                intrinsics.cy = camera.cy_px as f32;
            }
        }
        spec.calibration.extrinsics.iter_mut().for_each(|pair| pair.transform.translation = [0.0; 3]);
    }

    /// All samples in order of time. `device_us` is the device's clock, from nanoseconds since the start.
    pub fn samples(
        &self,
        seconds: f64,
        device_us: &dyn Fn(i64) -> i64,
        take: &mut dyn FnMut(Sample) -> Result<(), Box<dyn Error>>,
    ) -> Result<(), Box<dyn Error>> {
        let start_ns = self.color.stamp_ns(0);
        let end_ns = (seconds * 1e9) as i64;
        let mut next = [0_i64; 3];
        let rates = [i64::from(self.mode.rate_hz), GYRO_HZ, ACCEL_HZ];
        loop {
            let due = [0, 1, 2].map(|stream| next[stream] * 1_000_000_000 / rates[stream]);
            let stream = (0..3).min_by_key(|stream| due[*stream]).unwrap_or(0);
            let (at_ns, number) = (due[stream], next[stream] as u64 + 1);
            if at_ns >= end_ns {
                return Ok(());
            }
            next[stream] += 1;
            let header = |kind| header(kind, number, start_ns + at_ns, device_us(at_ns));
            match stream {
                0 => {
                    let index = number as u32 - 1;
                    let (color, depth) = std::thread::scope(|scope| {
                        let depth = scope.spawn(|| self.depth.frame(index));
                        (self.color.frame(index), depth.join())
                    });
                    let depth = depth.map_err(|_| "the renderer failed")?;
                    let depth = depth.depth_units.iter().flat_map(|units| units.to_le_bytes()).collect();
                    take(self.picture(header(StreamKind::Depth), Format::Z16, depth))?;
                    take(self.picture(header(StreamKind::Color), Format::Rgb8, color.rgb))?;
                }
                1 => take(motion(header(StreamKind::Gyro), self.rotation_rate(start_ns + at_ns)))?,
                _ => take(motion(header(StreamKind::Accel), self.specific_force(start_ns + at_ns)))?,
            }
        }
    }

    fn picture(&self, header: FrameHeader, format: Format, bytes: Vec<u8>) -> Sample {
        Sample::Frame(Frame { header, width: self.mode.width, height: self.mode.height, format, bytes })
    }

    /// rad/s in the camera's axes.
    fn rotation_rate(&self, stamp_ns: i64) -> [f64; 3] {
        let before = self.color.world_from_camera(stamp_ns - STEP_NS / 2);
        let after = self.color.world_from_camera(stamp_ns + STEP_NS / 2);
        let [x, y, z, w] = (before.inverse() * after).quaternion_xyzw();
        // Twice the vector part is the angle, of either of the two quaternions.
        [x, y, z].map(|part| 2.0 * part * w.signum() / (STEP_NS as f64 * 1e-9))
    }

    /// m/s^2 in the camera's axes; at rest it points up.
    fn specific_force(&self, stamp_ns: i64) -> [f64; 3] {
        let poses = [-STEP_NS, 0, STEP_NS].map(|step| self.color.world_from_camera(stamp_ns + step));
        let [before, now, after] = poses.each_ref().map(|pose| pose.translation);
        let mut force = (before - now * 2.0 + after) / (STEP_NS as f64 * 1e-9 * STEP_NS as f64 * 1e-9);
        force.z += GRAVITY;
        let local = poses[1].rotation.transpose() * force;
        [local.x, local.y, local.z]
    }
}

fn motion(header: FrameHeader, value: [f64; 3]) -> Sample {
    Sample::Motion(Motion { header, xyz: value.map(|axis| axis as f32) })
}

/// librealsense's stamps are on the host's clock, its metadata on the device's.
fn header(kind: StreamKind, number: u64, stamp_ns: i64, device_us: i64) -> FrameHeader {
    let counter = device_us & 0xffff_ffff;
    let mut metadata = vec![
        (metadata::FRAME_COUNTER, number as i64),
        (metadata::FRAME_TIMESTAMP, counter),
        (metadata::SENSOR_TIMESTAMP, counter),
    ];
    if kind.is_video() {
        metadata.push((metadata::ACTUAL_EXPOSURE, 8_000));
    }
    FrameHeader {
        stream: StreamId::only(kind),
        number,
        timestamp_ms: stamp_ns as f64 * 1e-6,
        domain: TimestampDomain::GlobalTime,
        metadata,
        arrival: Arrival::default(),
    }
}
