//! Errors of a picture against the truth: the columns from `flip_mean` to `coverage_error`, and the error map.

use super::row::Row;
use crate::{
    compare,
    flip::CropRect,
    options::{ToolError, ToolResult},
};
use bevy_treeline::math::image_error::coverage_error;
use image::RgbaImage;
use std::path::Path;

/// A picture, and what trees cover of it (as alpha).
pub struct Shot {
    pub picture: RgbaImage,
    pub cover: RgbaImage,
}

impl Shot {
    /// Reads both files.
    pub fn read(picture: &Path, cover: &Path) -> ToolResult<Self> {
        let read = |path: &Path| match image::open(path) {
            Ok(image) => Ok(image.to_rgba8()),
            Err(error) => Err(ToolError::Message(format!(
                "cannot read {}: {error}; delete it to have it made again",
                path.display()
            ))),
        };
        Ok(Self { picture: read(picture)?, cover: read(cover)? })
    }

    fn alpha(&self) -> impl Iterator<Item = u8> + '_ {
        self.cover.pixels().map(|pixel| pixel[3])
    }
}

/// Fills the columns; the error map of the whole picture is returned. `around_tree`: only the box that shows trees counts, as
/// in `treeline compare`. `first_row_below`: see the columns `.._below`.
pub fn fill(
    shot: &Shot,
    truth: &Shot,
    around_tree: bool,
    first_row_below: Option<u32>,
    row: &mut Row,
) -> ToolResult<RgbaImage> {
    let (width, height) = truth.picture.dimensions();
    let everything = CropRect { x: 0, y: 0, width, height };
    let crop = if around_tree { compare::tree_box(&truth.cover) } else { None };
    let all = compare::errors(&truth.picture, &shot.picture, crop.unwrap_or(everything))?;
    row.flip_mean = Some(all.mean.into());
    row.flip_p95 = Some(all.p95.into());
    row.block_rmse = Some(all.block.into());
    if let Some(y) = first_row_below.filter(|y| *y < height) {
        let below = CropRect { x: 0, y, width, height: height - y };
        let below = compare::errors(&truth.picture, &shot.picture, below)?;
        row.flip_mean_below = Some(below.mean.into());
        row.block_rmse_below = Some(below.block.into());
    }
    let coverage = coverage_error(shot.alpha(), truth.alpha());
    row.coverage_error = coverage.is_finite().then_some(coverage.into());
    Ok(all.map)
}
