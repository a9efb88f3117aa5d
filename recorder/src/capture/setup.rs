//! What holds for a whole connection to a camera, as records of the log.

use super::encode::{Encoded, stream_id};
use super::stream::Stream;
use crate::realsense::{Calibration, DeviceDescription, StreamProfile};
use schemas::msg::{Extrinsics, Header, MotionIntrinsics, Quaternion, TFMessage, Transform, TransformStamped, Vector3};
use schemas::topics::{self, frame};
use schemas::{Stamp, StampError, metadata, pairing};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A camera, opened and ready to stream.
#[derive(Debug, Clone)]
pub struct CameraSetup {
    /// The library that talks to it, with its version.
    pub library: String,
    /// What it says about itself, with the values of all options.
    pub device: DeviceDescription,
    /// Calibration of the streams that will come.
    pub calibration: Arc<Calibration>,
    /// Names of metadata values by their numbers.
    pub attribute_names: Vec<(u32, String)>,
}

impl CameraSetup {
    /// The recorded streams with their profiles.
    #[must_use]
    pub fn streams(&self) -> Vec<(Stream, StreamProfile)> {
        let profiles = self.calibration.streams.iter().map(|calibration| calibration.profile);
        profiles.filter_map(|profile| Some((Stream::of_camera(profile.stream)?, profile))).collect()
    }

    /// The record [`metadata::DEVICE`]; `anchors_ns` are those of all connections so far.
    #[must_use]
    pub fn device_record(&self, anchors_ns: &[Option<i64>]) -> BTreeMap<String, String> {
        let device = &self.device;
        let mut record = BTreeMap::new();
        let mut put = |key: String, value: String| drop(record.insert(key, value));
        put("name".to_owned(), device.name.clone());
        put("serial".to_owned(), device.serial.clone());
        put("library".to_owned(), self.library.clone());
        let told = [
            ("firmware", &device.firmware),
            ("usb", &device.usb),
            ("product_id", &device.product_id),
            ("playback_of", &device.recording),
        ];
        for (key, value) in told {
            put(key.to_owned(), value.clone().unwrap_or_else(|| "not told".to_owned()));
        }
        for (name, text) in &device.more {
            put(format!("info/{name}"), text.clone());
        }
        if let Some(units) = self.calibration.depth_units_m {
            put("depth_metres_per_unit".to_owned(), units.to_string());
        }
        for calibration in &self.calibration.streams {
            let stream = calibration.profile.stream;
            put(format!("profile/{stream}"), calibration.profile.to_string());
            if let Some(lens) = calibration.intrinsics {
                put(format!("distortion/{stream}"), format!("{:?} {:?}", lens.model, lens.coefficients));
            }
        }
        for sensor in &device.sensors {
            for option in &sensor.options {
                let meaning = option.meaning.as_ref().map(|word| format!(" ({word})")).unwrap_or_default();
                put(format!("option/{}/{}", sensor.name, option.name), format!("{}{meaning}", option.value));
            }
        }
        for (number, name) in &self.attribute_names {
            put(format!("attribute/{number}"), name.clone());
        }
        for (connection, anchor_ns) in anchors_ns.iter().enumerate() {
            let text = anchor_ns.map_or_else(|| "no device time came".to_owned(), |ns| ns.to_string());
            put(format!("anchor_ns/{connection}"), text);
        }
        record
    }

    /// The record [`metadata::DEPTH`], if depth comes.
    #[must_use]
    pub fn depth_record(&self) -> Option<BTreeMap<String, String>> {
        let units = units_per_metre(self.calibration.depth_units_m?);
        let values = [
            (metadata::DEPTH_UNITS_PER_METRE, units.as_str()),
            ("frame", frame::DEPTH),
            ("registered_to", "nothing: a reader registers it to colour"),
        ];
        Some(values.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned())).collect())
    }

    /// The record [`metadata::PAIRING`]: the two cameras run freely, so partners may be half a period apart.
    #[must_use]
    pub fn pairing_record(&self) -> BTreeMap<String, String> {
        let videos = self.streams().into_iter().filter(|(stream, _)| stream.is_video());
        let slowest_hz = videos.map(|(_, profile)| profile.rate_hz.max(1)).min().unwrap_or(30);
        let tolerance_ns = (600_000_000 / u64::from(slowest_hz)).max(pairing::DEFAULT_TOLERANCE_NS);
        let rule = "closest first, each stamp once, strictly nearer";
        let values = [(metadata::TOLERANCE_NS, tolerance_ns.to_string()), ("rule", rule.to_owned())];
        values.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
    }

    /// Extrinsics, inertial calibration and static transforms as messages at `stamp`.
    ///
    /// # Errors
    /// A stamp that a ROS time cannot hold.
    pub fn messages(&self, stamp: Stamp) -> Result<Vec<Encoded>, StampError> {
        let mut out = Vec::new();
        let mut transforms = Vec::new();
        let streams = self.streams();
        let root = [Stream::Color, Stream::Depth].into_iter().find(|s| streams.iter().any(|(known, _)| known == s));
        for (stream, profile) in &streams {
            let target = root.filter(|root| root != stream).and_then(stream_id);
            if let Some(transform) = target.and_then(|target| self.calibration.extrinsics(profile.stream, target)) {
                let root_frame = root.map_or(frame::CAMERA, Stream::frame);
                let header = Header::new(stamp, root_frame)?;
                let message = extrinsics(header, stream.frame(), &transform);
                transforms.push(edge(&message));
                out.push(Encoded::new(topics::EXTRINSICS, stamp, stamp, &message));
            }
            let topic = match stream {
                Stream::Gyro => topics::GYRO_INFO,
                Stream::Accel => topics::ACCEL_INFO,
                _ => continue,
            };
            if let Some(motion) = self.calibration.stream(profile.stream).and_then(|c| c.motion) {
                let header = Header::new(stamp, stream.frame())?;
                let mut data = [0.0; 12];
                data.iter_mut().zip(motion.matrix.as_flattened()).for_each(|(to, from)| *to = f64::from(*from));
                let [noise_variances, bias_variances] =
                    [motion.noise_variances, motion.bias_variances].map(|v| v.map(f64::from));
                let message = MotionIntrinsics { header, data, noise_variances, bias_variances };
                out.push(Encoded::new(topic, stamp, stamp, &message));
            }
        }
        if !transforms.is_empty() {
            out.push(Encoded::new(topics::TF_STATIC, stamp, stamp, &TFMessage { transforms }));
        }
        Ok(out)
    }
}

/// Depth value of one metre as a decimal: the nearest whole number if that is what the device means in its 32 bits.
fn units_per_metre(metres_per_unit: f32) -> String {
    let units = 1.0 / f64::from(metres_per_unit);
    let whole = units.round();
    if (1.0 / whole) as f32 == metres_per_unit { whole.to_string() } else { units.to_string() }
}

/// The device's numbers with the rotation row after row.
fn extrinsics(header: Header, child: &str, told: &schemas::alignment::Extrinsics) -> Extrinsics {
    let [a, b, c, d, e, f, g, h, i] = told.rotation.map(f64::from);
    let rotation = [a, d, g, b, e, h, c, f, i];
    Extrinsics { header, child_frame_id: child.to_owned(), rotation, translation: told.translation.map(f64::from) }
}

fn edge(message: &Extrinsics) -> TransformStamped {
    let rotation = nalgebra::Matrix3::from_row_slice(&message.rotation);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(rotation);
    let rotation = nalgebra::UnitQuaternion::from_rotation_matrix(&rotation);
    let [x, y, z, w]: [f64; 4] = rotation.coords.into();
    let [tx, ty, tz] = message.translation;
    let transform = Transform { translation: Vector3 { x: tx, y: ty, z: tz }, rotation: Quaternion { x, y, z, w } };
    TransformStamped { header: message.header.clone(), child_frame_id: message.child_frame_id.clone(), transform }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_units_are_what_the_device_means() {
        assert_eq!(units_per_metre(0.001), "1000");
        assert_eq!(units_per_metre(0.000_1), "10000");
        assert_eq!(units_per_metre(1.0 / 5000.0), "5000");
        let odd = units_per_metre(0.000_987_65).parse::<f64>().unwrap();
        assert_eq!((1.0 / odd) as f32, 0.000_987_65);
    }

    #[test]
    fn rotations_are_turned_over() {
        // A quarter turn about z takes x to y; columns: (0 1 0), (-1 0 0), (0 0 1).
        let told = schemas::alignment::Extrinsics {
            rotation: [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
            translation: [0.015, 0.0, 0.0],
        };
        let message = extrinsics(Header::default(), frame::DEPTH, &told);
        assert_eq!(message.rotation, [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let q = edge(&message).transform.rotation;
        assert!((q.z - 0.5_f64.sqrt()).abs() < 1e-12 && (q.w - 0.5_f64.sqrt()).abs() < 1e-12, "{q:?}");
    }
}
