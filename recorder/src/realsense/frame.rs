//! Frames out of the library's memory into ours.

use super::raw::{self, CallError, Handle, Profile, RawExtrinsics, RawIntrinsics, RawMotionIntrinsics};
use super::types::{
    Format, Frame, FrameHeader, Motion, MotionIntrinsics, Sample, StreamId, StreamKind, StreamProfile, TimestampDomain,
};
use crate::Arrival;
use schemas::alignment::{Extrinsics, Intrinsics, LensModel};
use std::sync::Arc;

const LENS_MODELS: [LensModel; 6] = [
    LensModel::None,
    LensModel::ModifiedBrownConrady,
    LensModel::InverseBrownConrady,
    LensModel::FTheta,
    LensModel::BrownConrady,
    LensModel::KannalaBrandt,
];

fn unsigned(value: i32) -> u32 {
    u32::try_from(value).unwrap_or(0)
}

/// What a profile is.
pub(super) fn profile(profile: &Profile) -> Result<StreamProfile, CallError> {
    let api = profile.api();
    let [mut kind, mut format, mut index, mut unique_id, mut rate, mut width, mut height] = [0; 7];
    api.get_stream_profile_data(profile, &mut kind, &mut format, &mut index, &mut unique_id, &mut rate)?;
    let kind = StreamKind::from_raw(kind);
    if kind.is_video() {
        api.get_video_stream_resolution(profile, &mut width, &mut height)?;
    }
    Ok(StreamProfile {
        stream: StreamId { kind, index },
        format: Format::from_raw(format),
        width: unsigned(width),
        height: unsigned(height),
        rate_hz: unsigned(rate),
    })
}

/// The camera of a picture profile.
pub(super) fn intrinsics(profile: &Profile) -> Result<Intrinsics, CallError> {
    let mut raw = RawIntrinsics::default();
    profile.api().get_video_stream_intrinsics(profile, &mut raw)?;
    let known = usize::try_from(raw.model).ok().and_then(|model| LENS_MODELS.get(model));
    let model = *known.ok_or_else(|| CallError {
        function: "rs2_get_video_stream_intrinsics".to_owned(),
        arguments: String::new(),
        message: format!("the distortion model {} has no meaning here", raw.model),
    })?;
    let RawIntrinsics { width, height, ppx: cx, ppy: cy, fx, fy, coefficients, .. } = raw;
    Ok(Intrinsics { width: unsigned(width), height: unsigned(height), fx, fy, cx, cy, model, coefficients })
}

/// The library's form of a camera.
pub(super) fn raw_intrinsics(camera: &Intrinsics) -> RawIntrinsics {
    let Intrinsics { width, height, fx, fy, cx: ppx, cy: ppy, model, coefficients } = *camera;
    let model = LENS_MODELS.iter().position(|known| *known == model).unwrap_or(0) as i32;
    RawIntrinsics { width: width as i32, height: height as i32, ppx, ppy, fx, fy, model, coefficients }
}

/// Scale, bias and noise of an inertial profile.
pub(super) fn motion_intrinsics(profile: &Profile) -> Result<MotionIntrinsics, CallError> {
    let mut raw = RawMotionIntrinsics::default();
    profile.api().get_motion_intrinsics(profile, &mut raw)?;
    let RawMotionIntrinsics { matrix, noise_variances, bias_variances } = raw;
    Ok(MotionIntrinsics { matrix, noise_variances, bias_variances })
}

/// `to_from_from`.
pub(super) fn extrinsics(from: &Profile, to: &Profile) -> Result<Extrinsics, CallError> {
    let mut raw = RawExtrinsics::default();
    from.api().get_extrinsics(from, to, &mut raw)?;
    Ok(Extrinsics { rotation: raw.rotation, translation: raw.translation })
}

/// Copies a frame out and gives it back to the library.
pub(super) fn sample(frame: Handle<raw::Frame>, metadata_count: u32, arrival: Arrival) -> Sample {
    read(frame, metadata_count, arrival).unwrap_or_else(|reason| Sample::Unreadable { arrival, reason })
}

fn read(frame: Handle<raw::Frame>, metadata_count: u32, arrival: Arrival) -> Result<Sample, String> {
    let api = frame.api;
    let frame = Arc::new(frame);
    let told = |error: CallError| error.to_string();
    let StreamProfile { stream, format, .. } =
        api.frame_profile(&frame).and_then(|found| profile(&found)).map_err(told)?;
    let header = header(&frame, stream, metadata_count, arrival).map_err(told)?;
    let about = format!("{stream} frame {}", header.number);
    let all =
        |length| api.frame_bytes(&frame, length).map_err(told)?.ok_or(format!("{about} has fewer than {length} bytes"));
    if stream.kind.is_motion() {
        let values = all(12)?.chunks_exact(4).map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]));
        let mut xyz = [0.0; 3];
        xyz.iter_mut().zip(values).for_each(|(axis, value)| *axis = value);
        return Ok(Sample::Motion(Motion { header, xyz }));
    }
    let width = api.get_frame_width(&frame).map(unsigned).map_err(told)?;
    let height = api.get_frame_height(&frame).map(unsigned).map_err(told)?;
    let stride = api.get_frame_stride_in_bytes(&frame).map(unsigned).map_err(told)? as usize;
    let pixel = format.bytes_per_pixel().ok_or_else(|| format!("{about} has the unknown format {format:?}"))?;
    let row = width as usize * pixel;
    if stride < row || row == 0 {
        return Err(format!("{about} has rows of {stride} bytes, too few for {width}x{height} {format:?}"));
    }
    let bytes = all(stride * height as usize)?;
    let bytes = if stride == row { bytes.to_vec() } else { without_padding(bytes, stride, row) };
    Ok(Sample::Frame(Frame { header, width, height, format, bytes }))
}

fn without_padding(bytes: &[u8], stride: usize, row: usize) -> Vec<u8> {
    bytes.chunks(stride).flat_map(|padded| &padded[..row]).copied().collect()
}

fn header(
    frame: &Handle<raw::Frame>,
    stream: StreamId,
    metadata_count: u32,
    arrival: Arrival,
) -> Result<FrameHeader, CallError> {
    let api = frame.api;
    let mut metadata = Vec::new();
    for number in 0..metadata_count {
        if api.supports_frame_metadata(frame, number as i32)? {
            metadata.push((number, api.get_frame_metadata(frame, number as i32)?));
        }
    }
    Ok(FrameHeader {
        stream,
        number: api.get_frame_number(frame)?,
        timestamp_ms: api.get_frame_timestamp(frame)?,
        domain: TimestampDomain::from_raw(api.get_frame_timestamp_domain(frame)?),
        metadata,
        arrival,
    })
}
