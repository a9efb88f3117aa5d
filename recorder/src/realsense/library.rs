//! Finding librealsense, and trusting it.

use super::context::named;
use super::raw::{Api, CallError, open_shared_object};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Environment variable with the path of the library.
pub const LIBRARY_VARIABLE: &str = "PSLAM_LIBREALSENSE";
/// Minor versions that are looked for, newest first; older ones lack functions, newer ones are not tried.
const MINOR_VERSIONS: std::ops::RangeInclusive<u32> = 54..=59;
const OLDEST_API: i32 = 25_400;

/// Why librealsense cannot be used.
#[derive(Debug, Clone, thiserror::Error)]
pub enum LoadError {
    /// None is installed.
    #[error(
        "librealsense2 not found; looked for {}; install librealsense2 2.54 - 2.59 or pass --librealsense PATH \
         (docs/recording.md has the commands)",
        looked_for.join(", ")
    )]
    NotFound {
        /// Names that were tried.
        looked_for: Vec<String>,
    },
    /// It is there and does not load.
    #[error("{} cannot be loaded: {reason}{hint}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The dynamic linker's sentence.
        reason: String,
        /// What to do, or empty.
        hint: String,
    },
    /// It is not librealsense 2.54 or newer.
    #[error("{} has no function {name}: it is not librealsense 2.54 or newer", path.display())]
    Symbol {
        /// The file.
        path: PathBuf,
        /// The missing function.
        name: String,
    },
    /// It is too old.
    #[error("{} is librealsense {found}; 2.54 is the oldest that is supported", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version.
        found: String,
    },
    /// Its numbers mean something else than ours.
    #[error(
        "{} (version {version}) calls {what} {number} `{found}` instead of `{expected}`: its numbers have changed, \
         so nothing it says can be trusted; use librealsense 2.54 - 2.59",
        path.display()
    )]
    SelfCheck {
        /// The file.
        path: PathBuf,
        /// Its version.
        version: String,
        /// Which enumeration.
        what: &'static str,
        /// Number.
        number: i32,
        /// Our name.
        expected: &'static str,
        /// Its name.
        found: String,
    },
    /// It refuses to say its version.
    #[error("{}: {source}", path.display())]
    Call {
        /// The file.
        path: PathBuf,
        /// Its reason.
        source: CallError,
    },
}

/// A loaded librealsense. Cheap to copy; the library stays until the process ends.
#[derive(Debug, Clone)]
pub struct Library {
    pub(super) api: &'static Api,
    pub(super) api_version: i32,
    path: PathBuf,
}

impl Library {
    /// Loads `choice`, else what [`LIBRARY_VARIABLE`] names, else `librealsense2.so.2.59` down to `.2.54`, else
    /// `librealsense2.so`. The library inside the Python wheel `pyrealsense2` will do: the libpython it needs is opened
    /// first.
    ///
    /// # Errors
    /// Nothing is found, or what is found cannot be trusted.
    pub fn load(choice: Option<&Path>) -> Result<Self, LoadError> {
        let variable = std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty()).map(PathBuf::from);
        if let Some(path) = choice.map(Path::to_owned).or(variable) {
            let library = open(&path).map_err(|reason| open_error(&path, reason))?;
            return Self::from_shared_object(library, &path);
        }
        let versioned = MINOR_VERSIONS.rev().map(|minor| format!("librealsense2.so.2.{minor}"));
        let names: Vec<String> = versioned.chain(["librealsense2.so".to_owned()]).collect();
        for path in names.iter().map(PathBuf::from) {
            match open(&path) {
                Ok(library) => return Self::from_shared_object(library, &path),
                Err(reason) if is_absent(&reason, &path) => {}
                Err(reason) => return Err(open_error(&path, reason)),
            }
        }
        let variable = format!("{LIBRARY_VARIABLE} (not set)");
        Err(LoadError::NotFound { looked_for: std::iter::once(variable).chain(names).collect() })
    }

    fn from_shared_object(library: libloading::Library, path: &Path) -> Result<Self, LoadError> {
        let path = path.to_owned();
        let api = Api::load(library, &path)?;
        let api_version = match api.get_api_version() {
            Ok(version) => version,
            Err(source) => return Err(LoadError::Call { path, source }),
        };
        let library = Self { api, api_version, path };
        if api_version < OLDEST_API {
            return Err(LoadError::Version { path: library.path.clone(), found: library.version() });
        }
        library.self_check()?;
        Ok(library)
    }

    /// Its version, as `2.56.5`.
    #[must_use]
    pub fn version(&self) -> String {
        let number = self.api_version;
        format!("{}.{}.{}", number / 10_000, number / 100 % 100, number % 100)
    }

    /// Where it was loaded from.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The library's name of a metadata value, as `Sensor Timestamp`.
    #[must_use]
    pub fn metadata_name(&self, number: u32) -> String {
        self.api.frame_metadata_to_string(i32::try_from(number).unwrap_or(-1))
    }

    /// All metadata values that it knows, by their numbers.
    #[must_use]
    pub fn metadata_names(&self) -> Vec<(u32, String)> {
        let names = named(|number| self.api.frame_metadata_to_string(number));
        names.map(|(number, name)| (number as u32, name)).collect()
    }

    /// Compares the numbers that the recorder uses with the library's names for them.
    fn self_check(&self) -> Result<(), LoadError> {
        let api = self.api;
        type Table = (&'static str, fn(&'static Api, i32) -> String, &'static [(i32, &'static str)]);
        let tables: [Table; 9] = [
            ("stream", Api::stream_to_string, STREAMS),
            ("format", Api::format_to_string, FORMATS),
            ("metadata", Api::frame_metadata_to_string, METADATA),
            ("timestamp domain", Api::timestamp_domain_to_string, DOMAINS),
            ("distortion", Api::distortion_to_string, DISTORTIONS),
            ("camera info", Api::camera_info_to_string, CAMERA_INFO),
            ("option", Api::option_to_string, OPTIONS),
            ("extension", Api::extension_to_string, EXTENSIONS),
            ("playback status", Api::playback_status_to_string, PLAYBACK_STATUS),
        ];
        for (what, name, table) in tables {
            for (number, expected) in table {
                let (number, expected, found) = (*number, *expected, name(api, *number));
                if found != expected {
                    let (path, version) = (self.path.clone(), self.version());
                    return Err(LoadError::SelfCheck { path, version, what, number, expected, found });
                }
            }
        }
        Ok(())
    }
}

const STREAMS: &[(i32, &str)] = &[(1, "Depth"), (2, "Color"), (3, "Infrared"), (5, "Gyro"), (6, "Accel")];
const FORMATS: &[(i32, &str)] = &[(1, "Z16"), (4, "YUYV"), (5, "RGB8"), (6, "BGR8"), (9, "Y8"), (16, "MOTION_XYZ32F")];
const METADATA: &[(i32, &str)] = &[
    (0, "Frame Counter"),
    (1, "Frame Timestamp"),
    (2, "Sensor Timestamp"),
    (3, "Actual Exposure"),
    (4, "Gain Level"),
    (5, "Auto Exposure"),
    (7, "Time Of Arrival"),
    (9, "Backend Timestamp"),
    (29, "Frame Emitter Mode"),
];
const DOMAINS: &[(i32, &str)] = &[(0, "Hardware Clock"), (1, "System Time"), (2, "Global Time")];
const DISTORTIONS: &[(i32, &str)] = &[
    (0, "None"),
    (1, "Modified Brown Conrady"),
    (2, "Inverse Brown Conrady"),
    (3, "Ftheta"),
    (4, "Brown Conrady"),
    (5, "Kannala Brandt4"),
];
const CAMERA_INFO: &[(i32, &str)] =
    &[(0, "Name"), (1, "Serial Number"), (2, "Firmware Version"), (7, "Product Id"), (9, "Usb Type Descriptor")];
const OPTIONS: &[(i32, &str)] = &[
    (3, "Exposure"),
    (10, "Enable Auto Exposure"),
    (12, "Visual Preset"),
    (13, "Laser Power"),
    (18, "Emitter Enabled"),
    (28, "Depth Units"),
];
const EXTENSIONS: &[(i32, &str)] = &[(16, "Playback")];
const PLAYBACK_STATUS: &[(i32, &str)] = &[(1, "Playing"), (2, "Paused"), (3, "Stopped")];

/// Opens a library; one that wants Python's symbols gets the libpython that its name tells.
fn open(path: &Path) -> Result<libloading::Library, String> {
    let first = match open_shared_object(path, false) {
        Err(reason) if reason.contains("undefined symbol: Py") || reason.contains("undefined symbol: _Py") => reason,
        result => return result,
    };
    let Some(python) = libpython_of(path) else { return Err(first) };
    let python = open_shared_object(Path::new(&python), true).map_err(|reason| {
        let mut text = first;
        let _ = write!(text, "; and the libpython that it needs is not there: {reason}");
        text
    })?;
    // The wheel's library keeps addresses into it.
    std::mem::forget(python);
    open_shared_object(path, false)
}

/// `libpython3.11.so.1.0` for `pyrealsense2.cpython-311-x86_64-linux-gnu.so`.
fn libpython_of(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let digits = name.split_once("cpython-3")?.1.split_once('-')?.0;
    let minor: u32 = digits.parse().ok()?;
    Some(format!("libpython3.{minor}.so.1.0"))
}

fn is_absent(reason: &str, path: &Path) -> bool {
    reason.contains("No such file") && reason.contains(&path.display().to_string())
}

fn open_error(path: &Path, reason: String) -> LoadError {
    let hint = if reason.contains("libpython") {
        "; install it (Debian: apt-get install libpython3.11)"
    } else if reason.contains("libusb") || reason.contains("libudev") {
        "; install it (Debian: apt-get install libusb-1.0-0 libudev1)"
    } else {
        ""
    };
    LoadError::Open { path: path.to_owned(), reason, hint: hint.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wheel_tells_its_python() {
        let wheel = Path::new("a/pyrealsense2.cpython-311-x86_64-linux-gnu.so");
        assert_eq!(libpython_of(wheel).as_deref(), Some("libpython3.11.so.1.0"));
        assert_eq!(libpython_of(Path::new("librealsense2.so")), None);
    }

    #[test]
    fn what_cannot_be_loaded_is_told() {
        let missing = Library::load(Some(Path::new("/nowhere/librealsense2.so"))).unwrap_err().to_string();
        assert!(missing.starts_with("/nowhere/librealsense2.so cannot be loaded: "), "{missing}");
        // A library, but another one.
        let other = Library::load(Some(Path::new("libc.so.6"))).unwrap_err().to_string();
        assert!(other.contains("libc.so.6 has no function rs2_"), "{other}");
    }
}
