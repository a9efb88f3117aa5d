//! What a D435i would measure in the synthetic world.

use crate::lens::bend;
use crate::plan::Plan;
use crate::planted;
use fixtures::{CameraPath, World, WorldConfig, inertial, scenario};
use recorder::Arrival;
use recorder::realsense::{
    Format, Frame, FrameHeader, Motion, Sample, SoftwareSpec, StreamId, StreamKind, TimestampDomain, VideoMode,
    metadata,
};
use schemas::alignment::{Intrinsics, LensModel};
use slam_math::{Se3, float};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Duration;

/// Pictures of so many seconds are rendered; longer recordings go to and fro through them.
pub const RENDERED_S: f64 = 12.0;
/// Inertial rates, Hz.
const GYRO_HZ: i64 = 200;
const ACCEL_HZ: i64 = 250;
/// Values beside the counter and the stamps that a picture carries: all that librealsense knows up to "Sub-preset info".
const OTHER_METADATA: std::ops::RangeInclusive<u32> = 3..=35;

/// The world seen by two cameras at one point.
pub struct Rig {
    color: World,
    depth: World,
    mode: VideoMode,
    /// Coefficients of the colour camera's lens.
    lens: [f32; 5],
    /// The camera turns round after so many frames.
    turn: u32,
    /// Where rendered pictures are kept.
    store: Option<PathBuf>,
    /// Colour and depth, in the order of the way.
    pictures: OnceLock<[Vec<Vec<u8>>; 2]>,
}

fn camera(mode: VideoMode, focal: f64) -> fixtures::Intrinsics {
    let (width, height) = (f64::from(mode.width), f64::from(mode.height));
    // Values that an f32 holds, as a camera tells them.
    let f = f64::from((focal * width) as f32);
    let (cx_px, cy_px) = ((width - 1.0) / 2.0, (height - 1.0) / 2.0);
    fixtures::Intrinsics { width: mode.width, height: mode.height, fx_px: f, fy_px: f, cx_px, cy_px }
}

/// The world's camera as a device tells it.
fn lens(world: &World, coefficients: [f32; 5]) -> Intrinsics {
    let c = world.camera();
    let pinhole = Intrinsics::pinhole(c.width, c.height, [c.fx_px, c.fy_px, c.cx_px, c.cy_px]);
    Intrinsics { model: LensModel::InverseBrownConrady, coefficients, ..pinhole }
}

/// A still room, seen by somebody who looks about as one does to tell clocks and transforms: by half a radian to each side,
/// and a hand that tilts. A hand-eye transform is out by the path's error over the turning: 2 mm over 0.4 rad are 5 mm.
fn handheld() -> WorldConfig {
    let camera_path = CameraPath {
        cycles: [2.0, 3.0, 4.0],
        look_amplitude_m: [1.6, 0.0, 0.9],
        sway_m: 0.02,
        sway_rad: 0.15,
        ..CameraPath::default()
    };
    WorldConfig { camera_path, frame_count: (RENDERED_S * 30.0) as u32, ..scenario::static_room() }
}

impl Rig {
    /// # Errors
    /// An unknown scenario.
    pub fn new(plan: &Plan) -> Result<Self, Box<dyn Error>> {
        let (mode, name) = (plan.mode, plan.scenario.as_str());
        let base = match name {
            "handheld" => handheld(),
            "demo" => scenario::demo(),
            "static" => scenario::static_room(),
            "robots" => scenario::robots_people(),
            "tiny" => scenario::tiny(),
            other => {
                return Err(format!("no scenario `{other}`; there are handheld, demo, static, robots, tiny").into());
            }
        };
        let duration_s = base.duration_s();
        let world = |focal| {
            let frame_count = (duration_s * f64::from(mode.rate_hz)) as u32;
            let camera = camera(mode, focal);
            World::new(&WorldConfig { camera, frame_rate_hz: mode.rate_hz, frame_count, ..base.clone() })
        };
        let shown_s = float::min(plan.seconds, RENDERED_S);
        let turn = ((shown_s * f64::from(mode.rate_hz)).ceil() as u32).max(1);
        Ok(Self {
            color: world(0.73)?,
            depth: world(0.53)?,
            mode,
            lens: plan.lens,
            turn,
            store: plan.pictures.clone(),
            pictures: OnceLock::new(),
        })
    }

    /// Tells the camera its lenses.
    pub fn calibrate(&self, spec: &mut SoftwareSpec) {
        for stream in &mut spec.calibration.streams {
            let (world, coefficients) = match stream.profile.stream.kind {
                StreamKind::Depth => (&self.depth, [0.0; 5]),
                _ => (&self.color, self.lens),
            };
            if let Some(intrinsics) = &mut stream.intrinsics {
                *intrinsics = Intrinsics { model: intrinsics.model, ..lens(world, coefficients) };
            }
        }
        spec.calibration.extrinsics.iter_mut().for_each(|pair| pair.transform.translation = [0.0; 3]);
    }

    /// Hands over all samples, each at its time; `take` is told what was planted already.
    pub fn in_real_time(
        &self,
        plan: &Plan,
        take: &mut dyn FnMut(Sample) -> Result<(), Box<dyn Error>>,
    ) -> Result<(), Box<dyn Error>> {
        self.prepare();
        let start_ns = Arrival::now().monotonic_ns;
        self.samples(plan, &mut |at_ns, sample| {
            let wait_ns = start_ns + at_ns - Arrival::now().monotonic_ns;
            std::thread::sleep(Duration::from_nanos(u64::try_from(wait_ns).unwrap_or(0)));
            take(sample)
        })
    }

    /// All samples with their times in nanoseconds since the start, in order.
    pub fn samples(
        &self,
        plan: &Plan,
        take: &mut dyn FnMut(i64, Sample) -> Result<(), Box<dyn Error>>,
    ) -> Result<(), Box<dyn Error>> {
        let end_ns = (plan.seconds * 1e9) as i64;
        // Depth comes with colour.
        let kinds = [StreamKind::Color, StreamKind::Gyro, StreamKind::Accel];
        let mut numbers = [1_u64; 3];
        loop {
            let due_ns = |stream: &usize| self.time_ns(kinds[*stream], numbers[*stream]);
            let stream = (0..3).min_by_key(due_ns).unwrap_or(0);
            let (at_ns, number) = (due_ns(&stream), numbers[stream]);
            if at_ns >= end_ns {
                return Ok(());
            }
            numbers[stream] += 1;
            let depth = (stream == 0).then_some(StreamKind::Depth);
            for kind in depth.into_iter().chain([kinds[stream]]) {
                if let Some(sample) = planted(plan, self.sample(plan, kind, number)) {
                    take(at_ns, sample)?;
                }
            }
        }
    }

    /// When a sample is taken, nanoseconds since the start; numbers begin at 1.
    fn time_ns(&self, kind: StreamKind, number: u64) -> i64 {
        let rate_hz = match kind {
            StreamKind::Gyro => GYRO_HZ,
            StreamKind::Accel => ACCEL_HZ,
            _ => i64::from(self.mode.rate_hz),
        };
        (number as i64 - 1) * 1_000_000_000 / rate_hz
    }

    /// What a stream says at its `number`th measurement, before anything is planted.
    pub fn sample(&self, plan: &Plan, kind: StreamKind, number: u64) -> Sample {
        let at_ns = self.time_ns(kind, number);
        let header = header(kind, number, self.color.stamp_ns(0) + at_ns, plan.device_us(at_ns));
        match kind {
            StreamKind::Gyro => motion(header, inertial::angular_velocity(|ns| self.world_from_camera(ns), at_ns)),
            StreamKind::Accel => motion(header, inertial::specific_force(|ns| self.world_from_camera(ns), at_ns)),
            _ => self.picture(header),
        }
    }

    fn picture(&self, header: FrameHeader) -> Sample {
        let (place, format) = match header.stream.kind {
            StreamKind::Depth => (1, Format::Z16),
            _ => (0, Format::Rgb8),
        };
        let round = header.number.saturating_sub(1) % (2 * u64::from(self.turn));
        let index = round.min(2 * u64::from(self.turn) - round) as usize;
        let mut bytes = self.pictures()[place][index].clone();
        bytes[..4].copy_from_slice(&(header.number as u32).to_le_bytes());
        Sample::Frame(Frame { header, width: self.mode.width, height: self.mode.height, format, bytes })
    }

    /// Renders the pictures, which takes longer than showing them.
    pub fn prepare(&self) {
        self.pictures();
    }

    /// Colour and depth of all places on the way.
    fn pictures(&self) -> &[Vec<Vec<u8>>; 2] {
        self.pictures.get_or_init(|| match &self.store {
            Some(store) => self.stored(store).expect("the rendered pictures can be kept"),
            None => self.rendered(),
        })
    }

    /// The pictures of a file, which is made if there is none.
    fn stored(&self, store: &Path) -> std::io::Result<[Vec<Vec<u8>>; 2]> {
        if !store.exists() {
            let rendered = self.rendered();
            std::fs::write(store, rendered.iter().flatten().flatten().copied().collect::<Vec<u8>>())?;
            return Ok(rendered);
        }
        let (bytes, count) = (std::fs::read(store)?, self.turn as usize + 1);
        let pixels = self.mode.width as usize * self.mode.height as usize;
        if bytes.len() != 5 * pixels * count {
            return Err(std::io::Error::other(format!("{} holds the pictures of another plan", store.display())));
        }
        let (color, depth) = bytes.split_at(3 * pixels * count);
        Ok([(color, 3), (depth, 2)]
            .map(|(bytes, size)| bytes.chunks_exact(size * pixels).map(<[u8]>::to_vec).collect()))
    }

    fn rendered(&self) -> [Vec<Vec<u8>>; 2] {
        eprintln!("rendering {} pictures", 2 * (self.turn + 1));
        std::thread::scope(|scope| {
            let depth = scope.spawn(|| {
                let units = |index| self.depth.frame(index).depth_units;
                (0..=self.turn).map(|index| units(index).iter().flat_map(|v| v.to_le_bytes()).collect()).collect()
            });
            let lens = lens(&self.color, self.lens);
            let is_bent = self.lens.iter().any(|value| *value != 0.0);
            let seen = |rgb: Vec<u8>| if is_bent { bend(&rgb, &lens) } else { rgb };
            let color = (0..=self.turn).map(|index| seen(self.color.frame(index).rgb)).collect();
            [color, depth.join().expect("the renderer does not fail")]
        })
    }

    /// Where the camera is, nanoseconds after the start.
    pub fn world_from_camera(&self, at_ns: i64) -> Se3 {
        let turn_ns = i64::from(self.turn) * 1_000_000_000 / i64::from(self.mode.rate_hz);
        let round_ns = at_ns.rem_euclid(2 * turn_ns);
        self.color.world_from_camera(self.color.stamp_ns(0) + round_ns.min(2 * turn_ns - round_ns))
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
        metadata.extend(OTHER_METADATA.map(|id| (id, 1000 * number as i64 + i64::from(id))));
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
