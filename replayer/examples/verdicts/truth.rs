//! What each pixel shows, and whether it moves.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use image::{ColorType, ImageDecoder, codecs::png::PngDecoder};
use schemas::Stamp;
use serde::Deserialize;

use super::Result;

/// Whether a mover moves, by its number.
type Moving = BTreeMap<u8, bool>;

/// Masks and states of the movers by the stamp of the picture.
pub struct Truth {
    masks: BTreeMap<Stamp, PathBuf>,
    moving: Option<BTreeMap<Stamp, Moving>>,
}

/// `movers.json`.
#[derive(Deserialize)]
struct MoversFile {
    frames: Vec<MoversFrame>,
}

/// The movers that one picture shows.
#[derive(Deserialize)]
struct MoversFrame {
    timestamp: String,
    movers: Vec<MoverState>,
}

#[derive(Deserialize)]
struct MoverState {
    id: u8,
    moving: bool,
}

impl Truth {
    /// Lists the masks of a folder and reads `movers.json` beside it.
    pub fn open(folder: &Path) -> Result<Self> {
        let at = |path: &Path, error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let mut masks = BTreeMap::new();
        for entry in folder.read_dir().map_err(|error| at(folder, &error))? {
            let path = entry?.path();
            let Some(stem) = path.file_stem().filter(|_| path.extension().is_some_and(|end| end == "png")) else {
                continue;
            };
            let stamp = Stamp::from_decimal(&stem.to_string_lossy()).map_err(|error| at(&path, &error))?;
            masks.insert(stamp, path);
        }
        if masks.is_empty() {
            return Err(at(folder, &"no masks here; wanted T.png with T the stamp of a picture").into());
        }
        let path = folder.canonicalize()?.with_file_name("movers.json");
        let moving = match std::fs::read(&path) {
            Ok(text) => Some(states(&text).map_err(|error| at(&path, &error))?),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
            Err(error) => return Err(at(&path, &error).into()),
        };
        Ok(Self { masks, moving })
    }

    /// The mover at each pixel, row by row; 0 = static scene.
    pub fn mask(&self, stamp: Stamp, size: (u32, u32)) -> Result<Vec<u8>> {
        let path = self.masks.get(&stamp).ok_or("there is no mask with its stamp")?;
        let read = || -> Result<Vec<u8>> {
            let decoder = PngDecoder::new(BufReader::new(File::open(path)?))?;
            let (found, color) = (decoder.dimensions(), decoder.color_type());
            if found != size || color != ColorType::L8 {
                return Err(format!("{found:?} pixels of {color:?}, wanted {size:?} of L8").into());
            }
            let mut pixels = vec![0; size.0 as usize * size.1 as usize];
            decoder.read_image(&mut pixels)?;
            Ok(pixels)
        };
        read().map_err(|error| format!("{}: {error}", path.display()).into())
    }

    /// Which of the movers move at this time, by number; `None` when nothing is known and all of them do.
    pub fn moving(&self, stamp: Stamp) -> Result<Option<&Moving>> {
        let frame =
            self.moving.as_ref().map(|frames| frames.get(&stamp).ok_or("movers.json has no frame with its stamp"));
        Ok(frame.transpose()?)
    }
}

fn states(text: &[u8]) -> Result<BTreeMap<Stamp, Moving>> {
    let file: MoversFile = serde_json::from_slice(text)?;
    let states = |frame: &MoversFrame| frame.movers.iter().map(|mover| (mover.id, mover.moving)).collect();
    file.frames.iter().map(|frame| Ok((Stamp::from_decimal(&frame.timestamp)?, states(frame)))).collect()
}
