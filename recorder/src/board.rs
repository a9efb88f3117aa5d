//! The printable calibration board: a chessboard with ArUco markers in its white squares (ChArUco).
//!
//! Every inner corner has a number of its own, so a board may be partly hidden or outside the picture. Layout and markers
//! are OpenCV's, so that its detector finds them: black square first, markers numbered along the rows. The number of rows
//! is odd, since OpenCV changed the layout of even ones in version 4.6.

use std::fmt::Write as _;

/// Side of a marker's pattern, cells; a black border of one cell surrounds it.
const MARKER_CELLS: u32 = 5;

/// The first markers of OpenCV's dictionary `DICT_5X5_100`, a bit a cell (1 = white), rows joined, most significant first.
const MARKERS: [u32; 60] = [
    0x145b2bc, 0x01c06e6, 0x1af0edd, 0x10395f7, 0x1aeb524, 0x1d4082d, 0x0d3d7ec, 0x0e2146b, 0x10d6132, 0x1313fa5,
    0x13cee03, 0x1a2dac0, 0x1e62b11, 0x05e7166, 0x1fcfca8, 0x051e37f, 0x097a758, 0x0bea26f, 0x0f64dc4, 0x1061de8,
    0x12dda75, 0x150e440, 0x16b0ca1, 0x0ba12de, 0x19cd023, 0x1a59972, 0x1c3ce8b, 0x0224246, 0x03b9672, 0x024223b,
    0x027376e, 0x0368873, 0x040d0ce, 0x04aaac8, 0x04643ba, 0x07a6fea, 0x0998aac, 0x082d101, 0x09aad1d, 0x0863c72,
    0x0ad2825, 0x0a52f9e, 0x0d849f7, 0x0c309d9, 0x0da7e31, 0x0e9627a, 0x0e9b997, 0x0f94806, 0x0f59125, 0x0f6b7d7,
    0x11b58e4, 0x11ad279, 0x11e380b, 0x1169445, 0x12ffb4a, 0x158cb8d, 0x15987f0, 0x1422fdf, 0x14e1227, 0x156df22,
];

/// A ChArUco board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    /// Squares in a row.
    pub columns: u32,
    /// Rows of squares; odd.
    pub rows: u32,
    /// Side of a square, millimetres.
    pub square_mm: f64,
    /// Side of a marker with its border, millimetres.
    pub marker_mm: f64,
}

impl Default for Board {
    /// Fills a landscape A4 page.
    fn default() -> Self {
        Self { columns: 7, rows: 5, square_mm: 38.0, marker_mm: 28.0 }
    }
}

/// Why a board makes no sense.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BoardError {
    /// Size of the chessboard.
    #[error("{columns} x {rows} squares: 3 x 3 to 24 x 5 or the like, at most 120 squares and an odd number of rows")]
    Squares {
        /// Squares in a row.
        columns: u32,
        /// Rows.
        rows: u32,
    },
    /// Side lengths.
    #[error("squares of {square_mm} mm with markers of {marker_mm} mm: markers take 40 to 90 % of a square")]
    Lengths {
        /// Side of a square.
        square_mm: f64,
        /// Side of a marker.
        marker_mm: f64,
    },
    /// The paper is too small.
    #[error("the board is {width_mm} x {height_mm} mm, the page {page_mm:?} mm: smaller squares, or a larger page")]
    Page {
        /// Width of the board.
        width_mm: f64,
        /// Height of the board.
        height_mm: f64,
        /// Width and height of the page.
        page_mm: [f64; 2],
    },
}

/// A black rectangle: left, top, width, height.
type Rectangle = [f64; 4];

impl Board {
    /// Checks the numbers.
    ///
    /// # Errors
    /// Too few or too many squares, an even number of rows, or markers that do not fit.
    pub fn validated(self) -> Result<Self, BoardError> {
        let Self { columns, rows, square_mm, marker_mm } = self;
        let squares = u64::from(columns) * u64::from(rows);
        if columns < 3 || rows < 3 || rows.is_multiple_of(2) || squares > 2 * MARKERS.len() as u64 {
            return Err(BoardError::Squares { columns, rows });
        }
        let share = marker_mm / square_mm;
        if !(1.0..=1e4).contains(&square_mm) || !(0.4..=0.9).contains(&share) {
            return Err(BoardError::Lengths { square_mm, marker_mm });
        }
        Ok(self)
    }

    /// Width and height, millimetres.
    #[must_use]
    pub fn size_mm(&self) -> [f64; 2] {
        [f64::from(self.columns) * self.square_mm, f64::from(self.rows) * self.square_mm]
    }

    /// Everything black, millimetres from the upper left corner; cells of a row that touch are one rectangle.
    fn black(&self) -> Vec<Rectangle> {
        let (mut out, mut marker) = (Vec::new(), 0);
        let cells = MARKER_CELLS + 2;
        let cell = self.marker_mm / f64::from(cells);
        let margin = 0.5 * (self.square_mm - self.marker_mm);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (x, y) = (f64::from(column) * self.square_mm, f64::from(row) * self.square_mm);
                if (row + column).is_multiple_of(2) {
                    out.push([x, y, self.square_mm, self.square_mm]);
                    continue;
                }
                for line in 0..cells {
                    let black = |at: u32| at < cells && is_black(marker, line, at);
                    let mut at = 0;
                    while at < cells {
                        let length = (at..cells).take_while(|at| black(*at)).count() as u32;
                        if length > 0 {
                            let (left, top) = (x + margin + f64::from(at) * cell, y + margin + f64::from(line) * cell);
                            out.push([left, top, f64::from(length) * cell, cell]);
                        }
                        at += length + 1;
                    }
                }
                marker += 1;
            }
        }
        out
    }

    /// What stands under the board.
    fn caption(&self) -> String {
        let Self { columns, rows, square_mm, marker_mm } = self;
        format!(
            "ChArUco {columns} x {rows}, DICT_5X5_100, squares {square_mm} mm, markers {marker_mm} mm: measure a square!"
        )
    }

    /// Where the board begins on a page.
    fn origin(&self, page_mm: [f64; 2]) -> Result<[f64; 2], BoardError> {
        let [width_mm, height_mm] = self.size_mm();
        let free = [page_mm[0] - width_mm, page_mm[1] - height_mm];
        // A printer leaves some millimetres of border free.
        if free[0] < 8.0 || free[1] < 8.0 {
            return Err(BoardError::Page { width_mm, height_mm, page_mm });
        }
        Ok([0.5 * free[0], 0.5 * free[1]])
    }

    /// As an SVG page.
    ///
    /// # Errors
    /// An impossible board, or a page that is too small.
    pub fn svg(&self, page_mm: [f64; 2]) -> Result<String, BoardError> {
        let [x0, y0] = self.validated()?.origin(page_mm)?;
        let [width, height] = page_mm;
        let mut text = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
             shape-rendering=\"crispEdges\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n"
        );
        for [x, y, w, h] in self.black() {
            // Writing into a String cannot fail.
            let _ =
                writeln!(text, "<rect x=\"{:.4}\" y=\"{:.4}\" width=\"{w:.4}\" height=\"{h:.4}\"/>", x0 + x, y0 + y);
        }
        let _ = writeln!(
            text,
            "<text x=\"{x0:.3}\" y=\"{:.3}\" font-family=\"sans-serif\" font-size=\"2.5\">{}</text>\n</svg>",
            y0 + self.size_mm()[1] + 3.2,
            self.caption()
        );
        Ok(text)
    }

    /// As a PDF page (version 1.4, one content stream of filled rectangles).
    ///
    /// # Errors
    /// An impossible board, or a page that is too small.
    pub fn pdf(&self, page_mm: [f64; 2]) -> Result<Vec<u8>, BoardError> {
        let [x0, y0] = self.validated()?.origin(page_mm)?;
        // PDF counts from the lower left in points of 1/72 inch.
        let points = |mm: f64| mm * 72.0 / 25.4;
        let mut content = String::from("0 g\n");
        for [x, y, w, h] in self.black() {
            let bottom = page_mm[1] - (y0 + y + h);
            let _ =
                writeln!(content, "{:.4} {:.4} {:.4} {:.4} re f", points(x0 + x), points(bottom), points(w), points(h));
        }
        let baseline = page_mm[1] - (y0 + self.size_mm()[1] + 3.2);
        let _ = write!(content, "BT /F1 7 Tf {:.3} {:.3} Td ({}) Tj ET", points(x0), points(baseline), self.caption());
        let objects = [
            "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
            "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
            format!(
                "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {:.3} {:.3}] /Contents 4 0 R /Resources << /Font << /F1 5 0 R >> >> >>",
                points(page_mm[0]),
                points(page_mm[1])
            ),
            format!("<< /Length {} >>\nstream\n{content}\nendstream", content.len()),
            "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
        ];
        let (mut text, mut offsets) = (String::from("%PDF-1.4\n"), Vec::new());
        for (i, object) in objects.iter().enumerate() {
            offsets.push(text.len());
            let _ = write!(text, "{} 0 obj\n{object}\nendobj\n", i + 1);
        }
        let start = text.len();
        let _ = write!(text, "xref\n0 {}\n0000000000 65535 f \n", objects.len() + 1);
        offsets.iter().for_each(|offset| {
            let _ = writeln!(text, "{offset:010} 00000 n ");
        });
        let _ = write!(text, "trailer << /Size {} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n", objects.len() + 1);
        Ok(text.into_bytes())
    }

    /// As a picture with a white border of one square: width, height, grey values.
    ///
    /// # Errors
    /// An impossible board.
    pub fn picture(&self, pixels_per_square: u32) -> Result<(u32, u32, Vec<u8>), BoardError> {
        let board = self.validated()?;
        let scale = f64::from(pixels_per_square) / board.square_mm;
        let (width, height) = ((board.columns + 2) * pixels_per_square, (board.rows + 2) * pixels_per_square);
        let mut pixels = vec![255u8; (width * height) as usize];
        let at = |mm: f64| (mm * scale).round() as u32 + pixels_per_square;
        for [x, y, w, h] in board.black() {
            for row in at(y)..at(y + h) {
                let line = (row * width) as usize;
                pixels[line + at(x) as usize..line + at(x + w) as usize].fill(0);
            }
        }
        Ok((width, height, pixels))
    }
}

/// Whether a cell of a marker is black; the outermost cells are its border.
fn is_black(marker: usize, line: u32, at: u32) -> bool {
    let inside = 1..=MARKER_CELLS;
    if !inside.contains(&line) || !inside.contains(&at) {
        return true;
    }
    let bit = (line - 1) * MARKER_CELLS + at - 1;
    MARKERS[marker] >> (MARKER_CELLS * MARKER_CELLS - 1 - bit) & 1 == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    const A4: [f64; 2] = [297.0, 210.0];

    #[test]
    fn the_default_board_fits_a_page() {
        let svg = Board::default().svg(A4).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("width=\"297mm\"") && svg.trim_end().ends_with("</svg>"));
        // 18 black squares, and the upper line of each of 17 markers in one piece.
        assert_eq!(svg.matches("width=\"38.0000\" height=\"38.0000\"").count(), 18);
        assert_eq!(svg.matches("width=\"28.0000\" height=\"4.0000\"").count() / 17, 2);
        let pdf = String::from_utf8(Board::default().pdf(A4).unwrap()).unwrap();
        let start: usize = pdf.rsplit("startxref\n").next().unwrap().lines().next().unwrap().parse().unwrap();
        assert!(pdf[start..].starts_with("xref"), "the cross-reference table is where the trailer says");
        assert_eq!(pdf.matches(" re f").count() + 2, svg.matches("<rect").count() + 1);
    }

    #[test]
    fn black_and_white_are_where_they_belong() {
        let (width, height, pixels) = Board::default().picture(70).unwrap();
        assert_eq!((width, height, pixels.len()), (9 * 70, 7 * 70, 9 * 70 * 7 * 70));
        let at = |x: u32, y: u32| pixels[(y * width + x) as usize];
        assert_eq!(at(10, 10), 255, "border");
        assert_eq!(at(75, 75), 0, "first square");
        assert_eq!(at(143, 75), 255, "white around the first marker");
        assert_eq!(at(152, 82), 0, "border of the first marker");
    }

    #[test]
    fn impossible_boards_are_refused() {
        let board = Board::default();
        for wrong in [
            Board { rows: 4, ..board },
            Board { columns: 2, ..board },
            Board { columns: 25, ..board },
            Board { columns: u32::MAX, ..board },
            Board { marker_mm: 38.0, ..board },
            Board { square_mm: f64::NAN, ..board },
        ] {
            assert!(wrong.svg(A4).is_err(), "{wrong:?}");
        }
        assert!(matches!(Board { square_mm: 60.0, marker_mm: 40.0, ..board }.pdf(A4), Err(BoardError::Page { .. })));
    }
}
