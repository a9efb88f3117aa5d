//! The file itself: a stream of messages, written under a temporary name and renamed when complete.

use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};

use re_log_encoding::{CrateVersion, EncodeError, Encoder, EncodingOptions};
use re_log_types::{
    ApplicationId, BlueprintActivationCommand, LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreKind, StoreSource,
    TimeCell, TimePoint,
};

use crate::chunks::{Chunks, Ids};
use crate::{Blueprint, Content, RrdError, blueprint};

/// Name of the program in the file's header.
const SOURCE: &str = "panoptic-slam";

/// When something was so.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum At {
    /// At all times: calibration, styles, descriptions.
    Static,
    /// At one frame, on both timelines.
    Frame {
        /// Index of the frame (timeline `frame`).
        frame: i64,
        /// Stamp of the frame in nanoseconds since the epoch (timeline `sensor_time`).
        sensor_time_ns: i64,
    },
    /// At a moment: nanoseconds since the epoch, on the timeline `sensor_time` alone.
    Time(i64),
}

impl At {
    pub(crate) fn time_point(self) -> TimePoint {
        let mut time = TimePoint::default();
        if let Self::Frame { frame, .. } = self {
            time.insert_cell("frame", TimeCell::from_sequence(frame));
        }
        if let Self::Frame { sensor_time_ns, .. } | Self::Time(sensor_time_ns) = self {
            time.insert_cell("sensor_time", TimeCell::from_timestamp_nanos_since_epoch(sensor_time_ns));
        }
        time
    }
}

/// Writes one `.rrd` file: one recording and at most one blueprint.
///
/// The file appears under its name only when [`RrdWriter::finish`] succeeds; until then, and for good after a failure,
/// it lies beside it with `.partial` appended.
pub struct RrdWriter {
    encoder: Encoder<BufWriter<File>>,
    ids: Ids,
    chunks: Chunks,
    recording: StoreId,
    path: PathBuf,
    partial: PathBuf,
}

impl RrdWriter {
    /// Opens `<path>.partial` and writes the header. `application_id` is what viewers keep layouts by, `recording_id`
    /// tells recordings of one application apart; both should be fixed, since they are part of the bytes.
    ///
    /// # Errors
    /// [`RrdError::Exists`] when the target or the `.partial` file is there and `force` is false; [`RrdError::Io`].
    pub fn create(
        path: impl AsRef<Path>,
        application_id: &str,
        recording_id: &str,
        force: bool,
    ) -> Result<Self, RrdError> {
        let path = path.as_ref().to_path_buf();
        let mut partial = path.clone().into_os_string();
        partial.push(".partial");
        let partial = PathBuf::from(partial);
        if !force && let Some(found) = [&path, &partial].into_iter().find(|p| p.exists()) {
            return Err(RrdError::Exists { path: found.clone() });
        }
        let file = File::create(&partial).map_err(|source| RrdError::Io { path: partial.clone(), source })?;
        let mut encoder =
            Encoder::new_eager(CrateVersion::LOCAL, EncodingOptions::PROTOBUF_COMPRESSED, BufWriter::new(file))
                .map_err(|e| refused(&partial, "header", e))?;
        // The footer is the one part whose bytes come out of a hash map. Viewers open the file without it.
        encoder.do_not_emit_footer();
        let application = ApplicationId::try_new(application_id).map_err(|e| RrdError::encode("application id", &e))?;
        let recording = StoreId::new(StoreKind::Recording, application, recording_id.to_owned());
        let mut writer = Self { encoder, ids: Ids::default(), chunks: Chunks::default(), recording, path, partial };
        writer.open_store(writer.recording.clone())?;
        Ok(writer)
    }

    /// Shows `content` at `entity` from `at` on, in place of the items the entity showed before.
    ///
    /// # Errors
    /// [`RrdError::Length`] when arrays of `content` do not fit together; [`RrdError::Io`] when writing fails;
    /// [`RrdError::Encode`].
    pub fn log(&mut self, entity: &str, at: At, content: &impl Content) -> Result<(), RrdError> {
        let components = content.components(entity)?;
        if let Some(chunk) = self.chunks.push(&mut self.ids, entity, at.time_point(), components)? {
            self.append(entity, &LogMsg::ArrowMsg(self.recording.clone(), chunk))?;
        }
        Ok(())
    }

    /// Stores the layout that the viewer opens with. Call it once.
    ///
    /// # Errors
    /// [`RrdError::Shares`] when a container's shares do not fit its children; [`RrdError::Io`], [`RrdError::Encode`].
    pub fn blueprint(&mut self, layout: &Blueprint) -> Result<(), RrdError> {
        let messages = blueprint_messages(self.recording.application_id(), layout, &mut self.ids)?;
        messages.iter().try_for_each(|message| self.append("blueprint", message))
    }

    /// Writes what is still gathered, closes the file and gives it its name.
    ///
    /// # Errors
    /// [`RrdError::Encode`] or [`RrdError::Io`]; the `.partial` file then remains.
    pub fn finish(mut self) -> Result<PathBuf, RrdError> {
        for chunk in self.chunks.drain(&mut self.ids)? {
            self.append("recording", &LogMsg::ArrowMsg(self.recording.clone(), chunk))?;
        }
        let refused = |e| refused(&self.partial, "end of file", e);
        self.encoder.finish().map_err(refused)?;
        let mut file = self.encoder.into_inner().map_err(refused)?;
        file.flush()
            .and_then(|()| file.get_ref().sync_all())
            .map_err(|source| RrdError::Io { path: self.partial.clone(), source })?;
        fs::rename(&self.partial, &self.path).map_err(|source| RrdError::Io { path: self.path.clone(), source })?;
        Ok(self.path)
    }

    fn open_store(&mut self, store: StoreId) -> Result<(), RrdError> {
        let message = store_message(store, &mut self.ids);
        self.append("store", &message)
    }

    fn append(&mut self, entity: &str, message: &LogMsg) -> Result<(), RrdError> {
        self.encoder.append(message).map(|_| ()).map_err(|e| refused(&self.partial, entity, e))
    }
}

/// The encoder writes as it goes: what the operating system says is about the file, the rest about the data.
fn refused(file: &Path, entity: &str, error: EncodeError) -> RrdError {
    match error {
        EncodeError::Write(source) => RrdError::Io { path: file.to_owned(), source },
        error => RrdError::encode(entity, &error),
    }
}

/// What opens a store.
pub(crate) fn store_message(store: StoreId, ids: &mut Ids) -> LogMsg {
    let info = StoreInfo::new(store, StoreSource::Other(SOURCE.to_owned()));
    LogMsg::SetStoreInfo(SetStoreInfo { row_id: ids.next(), info })
}

/// A layout, and that it is to be used.
pub(crate) fn blueprint_messages(
    application: &ApplicationId,
    layout: &Blueprint,
    ids: &mut Ids,
) -> Result<Vec<LogMsg>, RrdError> {
    let store = StoreId::new(StoreKind::Blueprint, application.clone(), "layout");
    let mut messages = vec![store_message(store.clone(), ids)];
    let mut time = TimePoint::default();
    time.insert_cell("blueprint", TimeCell::from_sequence(0));
    let mut chunks = Chunks::default();
    let arrow = |chunk| LogMsg::ArrowMsg(store.clone(), chunk);
    for (entity, components) in blueprint::rows(layout)? {
        // Far below the limits of a chunk, so all of them come out of `drain`.
        messages.extend(chunks.push(ids, &entity, time.clone(), components)?.map(arrow));
    }
    messages.extend(chunks.drain(ids)?.into_iter().map(arrow));
    messages.push(LogMsg::BlueprintActivationCommand(BlueprintActivationCommand::make_active(store.clone())));
    Ok(messages)
}
