//! The inspection file, where the program can write one.

#[cfg(not(feature = "rerun"))]
pub(super) use disabled::Inspection;
#[cfg(feature = "rerun")]
pub(super) use enabled::Inspection;

/// Name of the inspection file in a run.
pub const INSPECTION_RRD: &str = "replay.rrd";

#[cfg(feature = "rerun")]
mod enabled {
    use schemas::metadata;
    use schemas::msg::{encoding, format};

    use crate::OutputFolder;
    use crate::eval::Trajectory;
    use crate::inspect::{ColorPicture, ImageCodec, Inspector};
    use crate::run::RunError;
    use crate::run::drive::Stepped;
    use crate::run::source::Source;

    /// Writes the inspection file, if it is wanted.
    pub(in crate::run) struct Inspection(Option<Inspector>);

    impl Inspection {
        pub fn create(wanted: bool, folder: &OutputFolder, source: &Source) -> Result<Self, RunError> {
            if !wanted {
                return Ok(Self(None));
            }
            let name = source.log.metadata().get(metadata::SOURCE).and_then(|record| record.get("name"));
            let name = name.map_or("log", String::as_str);
            let path = folder.path(super::INSPECTION_RRD);
            Ok(Self(Some(Inspector::create(&path, name, &source.setup, false)?)))
        }

        pub fn frame(&mut self, stepped: &Stepped<'_>) -> Result<(), RunError> {
            let Some(inspector) = &mut self.0 else { return Ok(()) };
            let color = stepped.prepared.color.as_ref().and_then(|color| {
                // Raw pixels are shown in grey, as the SLAM sees them.
                let codec = match color.format.as_str() {
                    format::PNG => ImageCodec::Png,
                    encoding::RGB8 => return None,
                    _ => ImageCodec::Jpeg,
                };
                Some(ColorPicture { bytes: &color.bytes, codec })
            });
            Ok(inspector.frame(&stepped.prepared.input, color, stepped.report, stepped.slam.map())?)
        }

        pub fn finish(self, trajectory: &Trajectory, truth: &Trajectory) -> Result<(), RunError> {
            if let Some(inspector) = self.0 {
                inspector.finish(trajectory, Some(truth).filter(|truth| !truth.poses.is_empty()))?;
            }
            Ok(())
        }
    }
}

#[cfg(not(feature = "rerun"))]
mod disabled {
    use crate::OutputFolder;
    use crate::eval::Trajectory;
    use crate::run::RunError;
    use crate::run::drive::Stepped;
    use crate::run::source::Source;

    /// Refuses to write an inspection file.
    pub(in crate::run) struct Inspection;

    impl Inspection {
        pub fn create(wanted: bool, _: &OutputFolder, _: &Source) -> Result<Self, RunError> {
            if wanted { Err(RunError::NoInspection) } else { Ok(Self) }
        }

        #[expect(
            clippy::unused_self,
            clippy::unnecessary_wraps,
            reason = "the same calls with and without the feature"
        )]
        pub fn frame(&mut self, _: &Stepped<'_>) -> Result<(), RunError> {
            Ok(())
        }

        #[expect(
            clippy::unused_self,
            clippy::unnecessary_wraps,
            reason = "the same calls with and without the feature"
        )]
        pub fn finish(self, _: &Trajectory, _: &Trajectory) -> Result<(), RunError> {
            Ok(())
        }
    }
}
