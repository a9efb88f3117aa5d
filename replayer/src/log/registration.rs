//! Which depth a log has, and how native depth comes to the colour camera.

use std::sync::Arc;

use schemas::alignment::{self, Aligner, Intrinsics};
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
        let lenses = Intrinsics::from_camera_info(depth).zip(Intrinsics::from_camera_info(color));
        let aligner = lenses.ok_or_else(|| "its lens model is not known".to_owned()).and_then(|(depth, color)| {
            Aligner::new(&depth, &color, &alignment::Extrinsics::from_message(rig), units_m)
                .map_err(|error| error.to_string())
        });
        let failed = |reason| LogError::missing(&self.path, format!("depth cannot be registered to colour: {reason}"));
        Ok((native, Some(Arc::new(aligner.map_err(failed)?))))
    }
}
