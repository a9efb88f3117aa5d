//! Which depth a log has, and how native depth comes to the colour camera.

use std::sync::Arc;

use schemas::alignment::{self, Aligner, LensModel};
use schemas::msg::{CameraInfo, Extrinsics};
use schemas::topics;

use super::open::Entry;
use super::{Log, LogError};

/// What a live recording tells about its depth camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct NativeDepth {
    pub info: Option<CameraInfo>,
    /// From the depth camera to the colour camera.
    pub color_from_depth: Option<Extrinsics>,
}

impl Log {
    /// Depth images in stamp order, with what registers them to colour if they are not yet: registered ones if there are
    /// any, else the native ones of a live recording.
    pub(crate) fn depths(&self) -> Result<(Vec<Entry>, Option<Arc<Aligner>>), LogError> {
        let registered = self.sorted(topics::DEPTH);
        let native = self.sorted(topics::DEPTH_NATIVE);
        if !registered.is_empty() || native.is_empty() {
            return Ok((registered, None));
        }
        let missing = |topic: &str| {
            let what = format!("depth cannot be registered to colour: nothing on {topic}");
            LogError::missing(&self.path, what)
        };
        let NativeDepth { info, color_from_depth } = &self.native_depth;
        let depth = info.as_ref().ok_or_else(|| missing(topics::DEPTH_NATIVE_INFO))?;
        let color = self.camera_info.as_ref().ok_or_else(|| missing(topics::COLOR_INFO))?;
        let rig = color_from_depth.as_ref().ok_or_else(|| missing(topics::EXTRINSICS))?;
        let units_m = (1.0 / self.depth_units_per_metre()?) as f32;
        let lenses = lens(depth).zip(lens(color));
        let aligner = lenses.ok_or_else(|| "its lens model is not known".to_owned()).and_then(|(depth, color)| {
            Aligner::new(&depth, &color, &transform(rig), units_m).map_err(|error| error.to_string())
        });
        let failed = |reason| LogError::missing(&self.path, format!("depth cannot be registered to colour: {reason}"));
        Ok((native, Some(Arc::new(aligner.map_err(failed)?))))
    }
}

/// The device's own numbers: what was written as 64 bits was 32 bits there.
fn lens(info: &CameraInfo) -> Option<alignment::Intrinsics> {
    let [fx, _, cx, _, fy, cy, ..] = info.k.map(|value| value as f32);
    let mut coefficients = [0.0; 5];
    coefficients.iter_mut().zip(&info.d).for_each(|(to, from)| *to = *from as f32);
    let model = match info.distortion_model.as_str() {
        "" | "none" => LensModel::None,
        "plumb_bob" => LensModel::BrownConrady,
        "modified_brown_conrady" => LensModel::ModifiedBrownConrady,
        "inverse_brown_conrady" => LensModel::InverseBrownConrady,
        _ => return None,
    };
    Some(alignment::Intrinsics { width: info.width, height: info.height, fx, fy, cx, cy, model, coefficients })
}

fn transform(rig: &Extrinsics) -> alignment::Extrinsics {
    let [a, b, c, d, e, f, g, h, i] = rig.rotation.map(|value| value as f32);
    // Columns.
    let rotation = [a, d, g, b, e, h, c, f, i];
    alignment::Extrinsics { rotation, translation: rig.translation.map(|value| value as f32) }
}
