//! What a log of a recording holds, as the samples that it was made from.

use recorder::Arrival;
use recorder::picture::decode_rgb8;
use recorder::realsense::*;
use schemas::Message as _;
use schemas::msg::{CompressedImage, FrameMetadata, Image, Imu};
use schemas::topics;
use std::collections::BTreeMap;
use std::path::Path;

/// Topics of a stream's measurements and of what was told about them.
const STREAMS: [(StreamKind, &str, &str); 4] = [
    (StreamKind::Depth, topics::DEPTH_NATIVE, topics::DEPTH_NATIVE_METADATA),
    (StreamKind::Color, topics::COLOR, topics::COLOR_METADATA),
    (StreamKind::Gyro, topics::GYRO, topics::GYRO_METADATA),
    (StreamKind::Accel, topics::ACCEL, topics::ACCEL_METADATA),
];

/// Hands over all samples in the log's order.
pub fn for_each_sample(path: &Path, take: &mut dyn FnMut(StreamKind, Sample)) {
    let bytes = std::fs::read(path).unwrap();
    let mut measured: BTreeMap<&str, Vec<u8>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap) {
        let on = |topic: &str| message.channel.topic == topic;
        for (kind, topic, metadata_topic) in STREAMS {
            if on(topic) {
                assert!(measured.insert(topic, message.data.to_vec()).is_none(), "{topic}: nothing was told about one");
            } else if on(metadata_topic) {
                // The metadata follow their measurement.
                let data = measured.remove(topic).unwrap();
                take(kind, sample(kind, &data, &FrameMetadata::decode(&message.data).unwrap()));
            }
        }
    }
    assert!(measured.is_empty());
}

fn sample(kind: StreamKind, data: &[u8], told: &FrameMetadata) -> Sample {
    let ids = told.attribute_ids.iter().map(|id| u32::from(*id));
    let header = FrameHeader {
        stream: StreamId::only(kind),
        number: told.frame_number,
        timestamp_ms: told.timestamp_ms,
        domain: [TimestampDomain::HardwareClock, TimestampDomain::SystemTime, TimestampDomain::GlobalTime]
            [usize::from(told.domain)],
        metadata: ids.zip(told.attribute_values.iter().copied()).collect(),
        arrival: Arrival { monotonic_ns: told.arrival_monotonic_ns, realtime_ns: told.arrival_realtime_ns },
    };
    match kind {
        StreamKind::Depth => {
            let Image { width, height, data, .. } = Image::decode(data).unwrap();
            Sample::Frame(Frame { header, width, height, format: Format::Z16, bytes: data.into_owned() })
        }
        StreamKind::Color => {
            let (width, height, bytes) = decode_rgb8(&CompressedImage::decode(data).unwrap().data).unwrap();
            Sample::Frame(Frame { header, width, height, format: Format::Rgb8, bytes })
        }
        _ => {
            let imu = Imu::decode(data).unwrap();
            let v = if kind == StreamKind::Gyro { imu.angular_velocity } else { imu.linear_acceleration };
            Sample::Motion(Motion { header, xyz: [v.x as f32, v.y as f32, v.z as f32] })
        }
    }
}
