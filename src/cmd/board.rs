//! `pslam board`: a calibration board to print.

use crate::{Outcome, Usage, stdout};
use recorder::board::Board as Layout;
use replayer::write_file;
use std::path::PathBuf;

/// Arguments.
#[derive(Debug, clap::Args)]
pub struct Board {
    /// File to write: .svg or .pdf.
    #[arg(short, long)]
    out: PathBuf,
    #[command(flatten)]
    layout: BoardLayout,
    /// Page, landscape.
    #[arg(long, value_name = "SIZE", default_value = "a4", value_parser = ["a4", "a3", "letter"])]
    page: String,
    /// Overwrite an existing file.
    #[arg(long)]
    force: bool,
}

/// The board's layout, for every command that needs it.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Board (ChArUco, DICT_5X5_100)")]
pub struct BoardLayout {
    /// Squares in a row.
    #[arg(long, value_name = "N", default_value = "7")]
    columns: u32,
    /// Rows of squares, an odd number.
    #[arg(long, value_name = "N", default_value = "5")]
    rows: u32,
    /// Side of a square, millimetres, as measured on the print.
    #[arg(long, value_name = "MM", default_value = "38")]
    square_mm: f64,
    /// Side of a marker, millimetres.
    #[arg(long, value_name = "MM", default_value = "28")]
    marker_mm: f64,
}

impl BoardLayout {
    pub(super) fn layout(&self) -> anyhow::Result<Layout> {
        let Self { columns, rows, square_mm, marker_mm } = *self;
        let layout = Layout { columns, rows, square_mm, marker_mm };
        Ok(layout.validated().map_err(|error| Usage(error.to_string()))?)
    }
}

impl Board {
    pub(super) fn run(self) -> anyhow::Result<Outcome> {
        let layout = self.layout.layout()?;
        let page = match self.page.as_str() {
            "a3" => [420.0, 297.0],
            "letter" => [279.4, 215.9],
            _ => [297.0, 210.0],
        };
        let wrong = |error: recorder::board::BoardError| Usage(error.to_string());
        let bytes = match self.out.extension().and_then(|extension| extension.to_str()) {
            Some("svg") => layout.svg(page).map_err(wrong)?.into_bytes(),
            Some("pdf") => layout.pdf(page).map_err(wrong)?,
            _ => return Err(Usage(format!("{}: the name must end with .svg or .pdf", self.out.display())).into()),
        };
        write_file(&self.out, &bytes, self.force)?;
        let [width, height] = layout.size_mm();
        let text = format!(
            "{}: a board of {width} x {height} mm. Print it at 100 %, glue it to something flat, measure a square and give \
             that as --square-mm to `pslam calibrate`.",
            self.out.display()
        );
        stdout::text(&text)?;
        Ok(Outcome::Good)
    }
}
