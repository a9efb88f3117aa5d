//! The text lists of a TUM-style folder: `rgb.txt`, `depth.txt`, `groundtruth.txt`.

use super::{ImportError, Repairs, read_text};
use schemas::Stamp;
use std::path::Path;

/// A quaternion shorter than this tells no rotation (a unit one has length 1).
const MIN_QUATERNION_NORM: f64 = 0.5;

/// One picture of a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ListedFile {
    /// Its time.
    pub stamp: Stamp,
    /// Its path, as the list has it: relative to the folder.
    pub path: String,
}

/// One row of ground truth.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseRow {
    /// Its time.
    pub stamp: Stamp,
    /// Metres.
    pub translation: [f64; 3],
    /// x, y, z, w as written.
    pub quaternion: [f64; 4],
}

/// Reads `stamp path` rows, in order of time. Rows out of order are sorted, repeated stamps keep their first row; both
/// are counted.
pub fn files(path: &Path, hint: &str, repairs: &mut Repairs) -> Result<Vec<ListedFile>, ImportError> {
    let text = read_text(path, hint)?;
    let mut rows = Vec::new();
    for (line, row) in data_lines(&text) {
        let (stamp, file) = row.split_once([' ', '\t', ',']).unwrap_or((row, ""));
        let file = file.trim_matches([' ', '\t', ',']);
        if file.is_empty() {
            return Err(line_error(path, line, format!("`{row}` is not `timestamp filename`")));
        }
        rows.push(ListedFile { stamp: parse_stamp(path, line, stamp, repairs)?, path: file.to_owned() });
    }
    Ok(in_order(rows, |row| row.stamp, path, repairs))
}

/// Reads `stamp tx ty tz qx qy qz qw` rows, in order of time. Rows that are no pose (NaN, infinite, no rotation) are left
/// out and counted.
pub fn poses(path: &Path, repairs: &mut Repairs) -> Result<Vec<PoseRow>, ImportError> {
    let text = read_text(path, "")?;
    let mut rows = Vec::new();
    for (line, row) in data_lines(&text) {
        let fields: Vec<&str> = row.split([' ', '\t', ',']).filter(|field| !field.is_empty()).collect();
        let [stamp, numbers @ ..] = fields.as_slice() else { continue };
        let stamp = parse_stamp(path, line, stamp, repairs)?;
        if numbers.len() != 7 {
            let message = format!("{} numbers, wanted 8: timestamp tx ty tz qx qy qz qw", numbers.len() + 1);
            return Err(line_error(path, line, message));
        }
        let mut values = [0.0_f64; 7];
        for (value, text) in values.iter_mut().zip(numbers) {
            *value = text.parse().map_err(|_| line_error(path, line, format!("`{text}` is not a number")))?;
        }
        let [tx, ty, tz, qx, qy, qz, qw] = values;
        let norm = (qx * qx + qy * qy + qz * qz + qw * qw).sqrt();
        if !values.iter().all(|v| v.is_finite()) {
            repairs.count("ground-truth row with NaN or infinity left out");
        } else if norm < MIN_QUATERNION_NORM {
            repairs.count("ground-truth row without a rotation (quaternion near zero) left out");
        } else {
            rows.push(PoseRow { stamp, translation: [tx, ty, tz], quaternion: [qx, qy, qz, qw] });
        }
    }
    Ok(in_order(rows, |row| row.stamp, path, repairs))
}

/// Lines that are neither empty nor comments, with their numbers from 1.
pub fn data_lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

fn parse_stamp(path: &Path, line: usize, text: &str, repairs: &mut Repairs) -> Result<Stamp, ImportError> {
    let parsed = Stamp::from_decimal_rounded(text);
    let (stamp, exact) = parsed.map_err(|error| line_error(path, line, error.to_string()))?;
    if stamp.0 < 0 {
        return Err(line_error(path, line, format!("time {text} is below zero, which a log cannot hold")));
    }
    if !exact {
        repairs.count("stamp finer than a nanosecond rounded");
    }
    Ok(stamp)
}

/// An error that names the line.
pub fn line_error(path: &Path, line: usize, message: String) -> ImportError {
    ImportError::Line { path: path.to_owned(), line, message }
}

/// Sorts by time, keeping the first of equal stamps.
pub fn in_order<T>(mut rows: Vec<T>, stamp: impl Fn(&T) -> Stamp, path: &Path, repairs: &mut Repairs) -> Vec<T> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let unsorted = rows.windows(2).filter(|pair| stamp(&pair[0]) > stamp(&pair[1])).count();
    repairs.add(&format!("row of {name} out of order sorted in"), unsorted as u64);
    rows.sort_by_key(&stamp);
    let before = rows.len();
    rows.dedup_by_key(|row| stamp(row));
    repairs.add(&format!("row of {name} with a repeated stamp left out"), (before - rows.len()) as u64);
    rows
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn read_files(text: &str) -> (Result<Vec<ListedFile>, ImportError>, Repairs) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rgb.txt");
        fs::write(&path, text).unwrap();
        let mut repairs = Repairs::default();
        (files(&path, "", &mut repairs), repairs)
    }

    fn read_poses(text: &str) -> (Result<Vec<PoseRow>, ImportError>, Repairs) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("groundtruth.txt");
        fs::write(&path, text).unwrap();
        let mut repairs = Repairs::default();
        (poses(&path, &mut repairs), repairs)
    }

    #[test]
    fn lists_of_all_styles() {
        let text =
            "\u{feff}# comment\r\n\r\n3.5 rgb/3.png  \r\n1.000001,rgb/1 a.png\n\t2\trgb/2.png\n2.0 rgb/again.png\n\n";
        let (rows, repairs) = read_files(text);
        let rows: Vec<(i64, String)> = rows.unwrap().into_iter().map(|row| (row.stamp.0, row.path)).collect();
        let expected = [(1_000_001_000, "rgb/1 a.png"), (2_000_000_000, "rgb/2.png"), (3_500_000_000, "rgb/3.png")];
        assert_eq!(rows, expected.map(|(stamp, path)| (stamp, path.to_owned())));
        assert_eq!(repairs.0["row of rgb.txt out of order sorted in"], 1);
        assert_eq!(repairs.0["row of rgb.txt with a repeated stamp left out"], 1);
        assert!(read_files("").0.unwrap().is_empty());
    }

    #[test]
    fn bad_list_rows_name_the_line() {
        for text in ["1.0 a.png\n2.0\n", "1.0 a.png\nx b.png\n", "1.0 a.png\n-1 b.png"] {
            let error = read_files(text).0.unwrap_err();
            assert!(error.to_string().contains("line 2"), "{error}");
        }
    }

    #[test]
    fn poses_that_are_none_are_counted() {
        let text =
            "#h\n1 1 2 3 0 0 0 1\n2 nan 2 3 0 0 0 1\n3 1 2 3 0 0 0 0\n4 1 inf 3 0 0 0 1\n1.3e0 1e-3 2 3 0 0 0.6 0.8\n";
        let (rows, repairs) = read_poses(text);
        let rows = rows.unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!(rows[1].stamp, Stamp(1_300_000_000));
        assert_eq!(rows[1].quaternion, [0.0, 0.0, 0.6, 0.8]);
        assert_eq!(repairs.0.values().sum::<u64>(), 3);
        assert!(read_poses("1 2 3\n").0.is_err());
        assert!(read_poses("1 1 2 3 0 0 0 x\n").0.is_err());
    }
}
