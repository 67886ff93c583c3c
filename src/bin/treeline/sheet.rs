//! Contact sheets: labelled images side by side, for people to compare.
//!
//! In: images with labels; out: one image. O(pixels of the sheet).

use crate::font;
use image::{Rgba, RgbaImage, imageops};

const BACKGROUND: Rgba<u8> = Rgba([24, 26, 28, 255]);
const LABEL: Rgba<u8> = Rgba([235, 235, 235, 255]);
/// Around and between the cells.
const MARGIN_PX: u32 = 12;
/// Size of a font pixel.
const LABEL_SCALE: u32 = 2;

/// Lays out `cells` row by row, `columns` (≥ 1) in each, every image scaled to `cell_width` pixels (≥ 1) and its label
/// above it. Labels longer than the cell are wrapped. A row is as high as its highest cell.
pub fn contact_sheet(cells: &[(String, RgbaImage)], columns: u32, cell_width: u32) -> RgbaImage {
    let cell_width = cell_width.max(1);
    let columns = columns.clamp(1, cells.len().max(1) as u32);
    let line_px = font::LINE_HEIGHT * LABEL_SCALE;
    let letters = (cell_width / (font::ADVANCE * LABEL_SCALE)).max(1) as usize;

    let rows: Vec<Vec<Cell>> = cells
        .chunks(columns as usize)
        .map(|row| {
            row.iter().map(|(label, image)| Cell::new(label, image, cell_width, letters)).collect()
        })
        .collect();
    let label_px =
        |row: &[Cell]| row.iter().map(|c| c.lines.len() as u32 * line_px).max().unwrap_or(0);
    let image_px = |row: &[Cell]| row.iter().map(|c| c.image.height()).max().unwrap_or(0);
    let row_px = |row: &Vec<Cell>| label_px(row) + image_px(row) + MARGIN_PX;

    let width = columns * (cell_width + MARGIN_PX) + MARGIN_PX;
    let height = rows.iter().map(row_px).sum::<u32>() + MARGIN_PX;
    let mut sheet = RgbaImage::from_pixel(width, height, BACKGROUND);
    let mut y = MARGIN_PX;
    for row in &rows {
        let image_y = y + label_px(row);
        for (x, cell) in (0..).map(|i| MARGIN_PX + i * (cell_width + MARGIN_PX)).zip(row) {
            // Bottom-aligned, so that a short label stays at its image.
            let label_y = image_y - cell.lines.len() as u32 * line_px;
            for (line_y, line) in (0..).map(|i| label_y + i * line_px).zip(&cell.lines) {
                font::draw_line(&mut sheet, (x, line_y), line, LABEL_SCALE, LABEL);
            }
            imageops::overlay(&mut sheet, &cell.image, x.into(), image_y.into());
        }
        y += row_px(row);
    }
    sheet
}

/// A cell at its final size.
struct Cell {
    lines: Vec<String>,
    image: RgbaImage,
}

impl Cell {
    fn new(label: &str, image: &RgbaImage, width: u32, letters: usize) -> Self {
        let height = scaled_height(image, width);
        let image = if image.dimensions() == (width, height) || height == 0 {
            image.clone()
        } else if image.width() < width {
            // Enlarged pixels stay visible as such: a smooth enlargement would hide what is compared.
            imageops::resize(image, width, height, imageops::FilterType::Nearest)
        } else {
            imageops::resize(image, width, height, imageops::FilterType::Triangle)
        };
        Self { lines: wrap(label, letters), image }
    }
}

/// Height that keeps the proportions, at least 1; 0 for an image without pixels.
fn scaled_height(image: &RgbaImage, width: u32) -> u32 {
    let (w, h) = (u64::from(image.width()), u64::from(image.height()));
    if w == 0 || h == 0 {
        return 0;
    }
    let height = (h * u64::from(width) + w / 2) / w;
    height.clamp(1, u64::from(u32::MAX)) as u32
}

/// Breaks a label at its line ends, at spaces, and within words longer than a line.
fn wrap(label: &str, letters: usize) -> Vec<String> {
    let mut lines = Vec::new();
    for part in label.lines() {
        let mut line: Vec<char> = Vec::new();
        for word in part.split(' ') {
            let word: Vec<char> = word.chars().collect();
            if !line.is_empty() && line.len() + 1 + word.len() > letters {
                lines.push(line.drain(..).collect());
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.extend(word);
            while line.len() > letters {
                lines.push(line.drain(..letters).collect());
            }
        }
        lines.push(line.into_iter().collect());
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(width: u32, height: u32, shade: u8) -> RgbaImage {
        RgbaImage::from_pixel(width, height, Rgba([shade, 0, 0, 255]))
    }

    #[test]
    fn a_sheet_holds_its_cells_in_rows_at_one_width() {
        let cells: Vec<_> = [(100, 50), (200, 200), (50, 25)]
            .into_iter()
            .map(|(w, h)| ("ab".to_owned(), plain(w, h, 200)))
            .collect();
        let sheet = contact_sheet(&cells, 2, 100);
        let (label, margin) = (20, 12);
        // Rows of 100 (the square image) and 50 pixels.
        assert_eq!(
            sheet.dimensions(),
            (2 * 112 + margin, 100 + 50 + 2 * (label + margin) + margin)
        );
        let red = sheet.pixels().filter(|p| p[0] == 200).count();
        assert_eq!(red, 100 * 50 + 100 * 100 + 100 * 50);
        assert!(sheet.pixels().any(|p| *p == LABEL));
    }

    #[test]
    fn long_labels_wrap_at_spaces_and_within_long_words() {
        assert_eq!(wrap("points of oak", 9), ["points of", "oak"]);
        assert_eq!(wrap("abcdefgh ij", 3), ["abc", "def", "gh", "ij"]);
        assert_eq!(wrap("one\ntwo", 9), ["one", "two"]);
        assert_eq!(wrap("", 9), Vec::<String>::new());
    }

    #[test]
    fn odd_input_gives_a_sheet_nevertheless() {
        assert_eq!(contact_sheet(&[], 0, 0).dimensions(), (25, 12));
        let cells = [("é".to_owned(), RgbaImage::new(0, 0)), ("tall".to_owned(), plain(1, 9, 1))];
        let sheet = contact_sheet(&cells, 9, 2);
        assert_eq!(sheet.width(), 2 * 14 + 12);
    }

    #[test]
    fn every_printable_letter_has_a_shape_of_its_own() {
        let mut seen: Vec<RgbaImage> = Vec::new();
        for code in 32u8..127 {
            let mut image = RgbaImage::from_pixel(6, 10, BACKGROUND);
            font::draw_line(&mut image, (0, 0), &char::from(code).to_string(), 1, LABEL);
            assert!(!seen.contains(&image), "{} looks like another", char::from(code));
            seen.push(image);
        }
    }
}
