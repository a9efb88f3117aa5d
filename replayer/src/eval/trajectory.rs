//! Trajectories and their TUM text form: `stamp tx ty tz qx qy qz qw`, one pose a line.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use schemas::Stamp;
use slam_math::Se3;

use super::EvalError;

/// Where the camera was at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// Nanoseconds on the log's timeline.
    pub stamp: Stamp,
    /// Pose of the camera (x right, y down, z forward) in the world, metres.
    pub world_from_camera: Se3,
}

/// Poses in stamp order. Frames without a pose (tracking lost) are absent.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trajectory {
    /// Stamps never go back; equal stamps are allowed.
    pub poses: Vec<StampedPose>,
}

/// A line of eight numbers has no business being longer.
const MAX_LINE_BYTES: u64 = 1024;
/// Positions beyond this are not metres of a camera's path.
const MAX_POSITION_M: f64 = 1e9;

impl Trajectory {
    /// Reads a TUM text file.
    ///
    /// # Errors
    /// [`EvalError::Io`], or as [`parse_tum`](Self::parse_tum).
    pub fn read_tum(path: &Path) -> Result<Self, EvalError> {
        let io = |source| EvalError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io)?;
        if file.metadata().map_err(io)?.is_dir() {
            return Err(io(std::io::ErrorKind::IsADirectory.into()));
        }
        Self::parse_tum(BufReader::new(file), &path.display().to_string())
    }

    /// Reads TUM text: lines starting with `#` and empty lines are skipped, fields are parted by white space.
    ///
    /// # Errors
    /// [`EvalError::Line`] for a line that is not eight finite numbers with a unit quaternion (length 0.9 to 1.1), or
    /// whose stamp is before the one above it; [`EvalError::Empty`] when no pose is found. `name` goes into messages.
    pub fn parse_tum(mut text: impl BufRead, name: &str) -> Result<Self, EvalError> {
        let mut poses: Vec<StampedPose> = Vec::new();
        let mut bytes = Vec::new();
        for line in 1.. {
            let wrong = |reason: String| EvalError::Line { name: name.to_owned(), line, reason };
            bytes.clear();
            let read = text.by_ref().take(MAX_LINE_BYTES).read_until(b'\n', &mut bytes);
            match read.map_err(|source| EvalError::Io { path: name.into(), source })? as u64 {
                0 => break,
                MAX_LINE_BYTES if bytes.last() != Some(&b'\n') => {
                    return Err(wrong(format!("longer than {MAX_LINE_BYTES} bytes: not a TUM trajectory")));
                }
                _ => {}
            }
            let content = std::str::from_utf8(&bytes).map_err(|_| wrong("not text".to_owned()))?;
            let content = content.trim_start_matches('\u{feff}').trim();
            if content.is_empty() || content.starts_with('#') {
                continue;
            }
            let pose = parse_pose(content).map_err(wrong)?;
            if let Some(last) = poses.last().filter(|last| last.stamp > pose.stamp) {
                let (now, before) = (pose.stamp, last.stamp);
                return Err(wrong(format!("stamp {now} is before the previous one, {before}: sort the file by stamp")));
            }
            poses.push(pose);
        }
        if poses.is_empty() {
            return Err(EvalError::Empty { name: name.to_owned() });
        }
        Ok(Self { poses })
    }

    /// TUM text with nine decimals; stamps are exact, quaternions have w >= 0.
    #[must_use]
    pub fn to_tum(&self) -> String {
        let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
        for pose in &self.poses {
            let (t, q) = (pose.world_from_camera.translation, pose.world_from_camera.quaternion_xyzw());
            text.push_str(&pose.stamp.to_decimal9());
            for value in t.iter().chain(&q) {
                let _ = write!(text, " {value:.9}"); // writing to a String cannot fail
            }
            text.push('\n');
        }
        text
    }

    /// Length of the path, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.poses.windows(2).fold(0.0, |sum, pair| sum + step_m(&pair[0], &pair[1]))
    }

    /// First and last stamp as text, for messages.
    pub(crate) fn range(&self) -> String {
        match (self.poses.first(), self.poses.last()) {
            (Some(first), Some(last)) => format!("{} to {} s", first.stamp, last.stamp),
            _ => "none".to_owned(),
        }
    }
}

/// Distance between two positions, metres.
pub(crate) fn step_m(a: &StampedPose, b: &StampedPose) -> f64 {
    (b.world_from_camera.translation - a.world_from_camera.translation).norm()
}

/// Eight fields of one line; the error says what is wrong with them.
fn parse_pose(content: &str) -> Result<StampedPose, String> {
    let fields: Vec<&str> = content.split_ascii_whitespace().collect();
    let [stamp, numbers @ ..] = fields.as_slice() else { return Err("empty".to_owned()) };
    if numbers.len() != 7 {
        return Err(format!("{} fields where 8 are expected: stamp tx ty tz qx qy qz qw", fields.len()));
    }
    // Digits below a nanosecond are rounding noise of a program that printed doubles: round them.
    let (stamp, _) = Stamp::from_decimal_rounded(stamp).map_err(|error| error.to_string())?;
    let mut values = [0.0f64; 7];
    for (value, text) in values.iter_mut().zip(numbers) {
        *value = text.parse().map_err(|_| format!("'{text}' is not a number"))?;
        if !value.is_finite() {
            return Err(format!("'{text}' is not a finite number"));
        }
    }
    let [x, y, z, qx, qy, qz, qw] = values;
    if [x, y, z].iter().any(|v| v.abs() > MAX_POSITION_M) {
        return Err(format!("position {x} {y} {z} is beyond {MAX_POSITION_M:e} m"));
    }
    let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
    if !(0.9..=1.1).contains(&norm) {
        return Err(format!("quaternion {qx} {qy} {qz} {qw} has length {norm:.3}, not 1"));
    }
    Ok(StampedPose { stamp, world_from_camera: Se3::from_quaternion([x, y, z], [qx, qy, qz, qw]) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Trajectory, EvalError> {
        Trajectory::parse_tum(text.as_bytes(), "t.txt")
    }

    #[test]
    fn text_round_trips_to_the_last_digit() {
        let text = "# c\n\n1700000000.123456789 1.5 -2 3e-1 0 0 0.6 0.8\r\n1700000001 0 0 0 0 0 0 1";
        let parsed = parse(text).unwrap();
        assert_eq!(parsed.poses.len(), 2);
        assert_eq!(parsed.poses[0].stamp, Stamp(1_700_000_000_123_456_789));
        let written = parsed.to_tum();
        assert!(written.contains("1700000000.123456789 1.500000000 -2.000000000 0.300000000 0.000000000"));
        assert_eq!(parse(&written).unwrap().to_tum(), written);
    }

    #[test]
    fn bad_lines_are_named() {
        for (text, reason) in [
            ("0 0 0 0 0 0 0 1\n1 nan 0 0 0 0 0 1", "line 2: 'nan' is not a finite number"),
            ("0 0 0 0 0 0 1", "line 1: 7 fields"),
            ("x 0 0 0 0 0 0 1", "line 1: `x` is not a time"),
            ("0 0 0 0 0 0 0 0", "line 1: quaternion"),
            ("0 1e300 0 0 0 0 0 1", "line 1: position"),
            ("1 0 0 0 0 0 0 1\n#\n0 0 0 0 0 0 0 1", "line 3: stamp 0.000000000 is before"),
            ("", "no pose"),
            ("# only a comment\n", "no pose"),
            (&"9".repeat(5000), "line 1: longer than"),
        ] {
            let message = parse(text).unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        }
        assert!(Trajectory::parse_tum(&b"\xff\xfe1 2"[..], "t").unwrap_err().to_string().contains("not text"));
        assert!(Trajectory::read_tum(Path::new("/nowhere/t.txt")).unwrap_err().to_string().contains("/nowhere"));
    }
}
