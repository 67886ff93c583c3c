//! Ground from a real elevation model: a 16-bit grey PNG and the JSON beside it in, [`Ground`] out. O(posts).
//!
//! The JSON holds `spacing_m`, `height_min_m`, `height_max_m`, `width` and `height` (others are ignored); a post of value v
//! is at min + v / 65535 · (max − min). Catmull-Rom between the posts, and below their spacing a little noise that is
//! the stronger the steeper the ground is.

use super::{
    Ground,
    gradient_noise::{OFFSET, fractal, noise},
    height_grid::{Cubic, HeightGrid},
    smoothstep,
};
use bevy::math::Vec2;
use serde::Deserialize;
use std::{
    fs, io,
    path::{Path, PathBuf},
};
use thiserror::Error;

/// Octaves of detail end at this wavelength in metres.
const FINEST_WAVE_M: f32 = 5.0;
/// Fewest posts a side.
const FEWEST_POSTS: u32 = 8;

/// Why an elevation model is not a ground.
#[derive(Debug, Error)]
pub enum DemError {
    /// A file cannot be read.
    #[error(
        "{}: {what} cannot be read: {source}; an elevation model is a 16-bit grey PNG with a JSON of the same name beside it",
        path.display()
    )]
    Read {
        /// Which file.
        path: PathBuf,
        /// Its part.
        what: &'static str,
        /// Why.
        source: io::Error,
    },
    /// The description is not what it has to be.
    #[error(
        "{}: {reason}; it needs the numbers `spacing_m`, `height_min_m`, `height_max_m`, `width` and `height`",
        path.display()
    )]
    Description {
        /// Which file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The picture is not a PNG that can be decoded.
    #[error("{}: not a readable PNG: {source}; write it again as a 16-bit grey PNG", path.display())]
    Decode {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: image::ImageError,
    },
    /// The picture has the wrong kind of pixels.
    #[error(
        "{}: the pixels are {found}, which are too coarse or not heights; write it as 16-bit grey (for example \
         `gdal_translate -of PNG -ot UInt16 -scale`)",
        path.display()
    )]
    Pixels {
        /// Which file.
        path: PathBuf,
        /// What they are.
        found: String,
    },
    /// Picture and description disagree.
    #[error(
        "{}: the picture has {found_width} x {found_height} posts, but {} says {width} x {height}; correct `width` and `height`, \
         or use the picture that belongs to it",
        path.display(), json.display()
    )]
    Size {
        /// The picture.
        path: PathBuf,
        /// The description.
        json: PathBuf,
        /// Posts found.
        found_width: u32,
        /// Posts found.
        found_height: u32,
        /// Posts described.
        width: u32,
        /// Posts described.
        height: u32,
    },
}

/// A real landscape; see the module. The square is as long as the shorter extent, around the middle of the model; what
/// lies beyond it in the longer one can be asked for too.
pub struct DemTerrain {
    grid: HeightGrid,
    spacing_m: f32,
    side_m: f32,
    range: [f32; 2],
    water_m: Option<f32>,
    octaves: u32,
    seed: u32,
}

#[derive(Deserialize)]
struct Description {
    spacing_m: f32,
    height_min_m: f32,
    height_max_m: f32,
    width: u32,
    height: u32,
}

impl DemTerrain {
    /// Loads `png` and the `.json` of the same name beside it.
    ///
    /// # Errors
    /// If one is missing or malformed, the pixels are not 16-bit grey, or the sizes disagree.
    pub fn load(png: &Path) -> Result<Self, DemError> {
        let json = png.with_extension("json");
        let description = describe(&json)?;
        let bytes = fs::read(png).map_err(|source| DemError::Read {
            path: png.into(),
            what: "the picture",
            source,
        })?;
        let picture = image::load_from_memory_with_format(&bytes, image::ImageFormat::Png)
            .map_err(|source| DemError::Decode { path: png.into(), source })?;
        let color = picture.color();
        let image::DynamicImage::ImageLuma16(picture) = picture else {
            return Err(DemError::Pixels { path: png.into(), found: format!("{color:?}") });
        };
        let Description { spacing_m, height_min_m, height_max_m, width, height } = description;
        if picture.dimensions() != (width, height) {
            let (found_width, found_height) = picture.dimensions();
            return Err(DemError::Size {
                path: png.into(),
                json,
                found_width,
                found_height,
                width,
                height,
            });
        }
        let scale = (height_max_m - height_min_m) / 65_535.0;
        let posts = picture.pixels().map(|p| height_min_m + f32::from(p[0]) * scale).collect();
        let grid = HeightGrid { columns: width as usize, rows: height as usize, posts };
        let [low, high] = grid.range();
        // Catmull-Rom overshoots by at most an eighth of a step between posts; noise adds below a spacing.
        let reach = 0.125 * (high - low) + 0.2 * spacing_m;
        Ok(Self {
            side_m: (width.min(height) - 1) as f32 * spacing_m,
            range: [low - reach, high + reach],
            water_m: None,
            octaves: (spacing_m / FINEST_WAVE_M).log2().ceil().clamp(0.0, 6.0) as u32,
            seed: 0xDE3,
            grid,
            spacing_m,
        })
    }

    /// With still water at a height in metres (default: none; an elevation model does not say where water is).
    #[must_use]
    pub fn with_water(mut self, level_m: Option<f32>) -> Self {
        self.water_m = level_m.filter(|level| level.is_finite());
        self
    }

    fn posts(&self, x: f32, z: f32) -> Vec2 {
        let middle = Vec2::new(self.grid.columns as f32 - 1.0, self.grid.rows as f32 - 1.0) * 0.5;
        Vec2::new(x, z) / self.spacing_m + middle
    }
}

fn describe(json: &Path) -> Result<Description, DemError> {
    let text = fs::read_to_string(json).map_err(|source| DemError::Read {
        path: json.into(),
        what: "the description",
        source,
    })?;
    let wrong = |reason: String| DemError::Description { path: json.into(), reason };
    let found: Description = serde_json::from_str(&text).map_err(|e| wrong(e.to_string()))?;
    let Description { spacing_m, height_min_m, height_max_m, width, height } = found;
    if !(spacing_m > 0.0 && spacing_m <= 10_000.0) {
        return Err(wrong(format!(
            "`spacing_m` is {spacing_m}; it must be above 0 and at most 10,000"
        )));
    }
    if !(height_min_m.is_finite() && height_max_m.is_finite() && height_max_m > height_min_m) {
        return Err(wrong(format!(
            "heights from {height_min_m} to {height_max_m} m; `height_max_m` must be above `height_min_m`"
        )));
    }
    if width < FEWEST_POSTS || height < FEWEST_POSTS {
        return Err(wrong(format!(
            "{width} x {height} posts; at least {FEWEST_POSTS} x {FEWEST_POSTS} are needed"
        )));
    }
    Ok(found)
}

impl Ground for DemTerrain {
    fn side_m(&self) -> f32 {
        self.side_m
    }

    fn height(&self, x: f32, z: f32) -> f32 {
        let at = self.posts(x, z);
        let [coarse, dx, dz] = self.grid.with_slope(at.x, at.y, Cubic::CatmullRom);
        let slope = Vec2::new(dx, dz) / self.spacing_m;
        let rough = 0.07 * self.spacing_m * (0.04 + smoothstep(0.05, 0.8, slope.length()));
        let mut drift = slope;
        let (mut sum, mut amplitude, mut frequency) = (0.0, 1.0, 0.9);
        for octave in 0..self.octaves {
            let sample = noise(at * frequency + OFFSET * octave as f32, self.seed ^ octave);
            drift += sample.slope * (amplitude * frequency * rough / self.spacing_m);
            sum += amplitude * sample.value / (1.0 + 1.6 * drift.length_squared());
            amplitude *= 0.47;
            frequency *= 2.03;
        }
        coarse + rough * sum
    }

    fn height_range(&self) -> [f32; 2] {
        self.range
    }

    fn detail_m(&self) -> f32 {
        1.0
    }

    fn water_level(&self) -> Option<f32> {
        self.water_m
    }

    /// Hollows over three posts are wet, ridges dry.
    fn moisture(&self, x: f32, z: f32) -> f32 {
        let at = self.posts(x, z);
        let here = self.grid.bilinear(at.x, at.y);
        let ring = [Vec2::X, Vec2::Y, Vec2::NEG_X, Vec2::NEG_Y].map(|d| at + d * 4.0);
        let around = ring.iter().map(|p| self.grid.bilinear(p.x, p.y)).sum::<f32>() * 0.25;
        let hollow = (around - here) / (4.0 * self.spacing_m);
        let wander = fractal(at * 0.13, 3, self.seed ^ 0x900);
        (0.42 + 1.6 * hollow + 0.2 * wander).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageBuffer, Luma};

    const GOOD: &str = r#"{"spacing_m": 30, "height_min_m": 100.0, "height_max_m": 400.0, "width": 12, "height": 10}"#;

    fn written(json: Option<&str>, posts: u32) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().expect("a folder");
        let png = folder.path().join("dem.png");
        let picture: ImageBuffer<Luma<u16>, Vec<u16>> =
            ImageBuffer::from_fn(posts, 10, |x, z| Luma([(x * 5000 + z) as u16]));
        picture.save(&png).expect("the folder can be written");
        if let Some(json) = json {
            fs::write(png.with_extension("json"), json).expect("the folder can be written");
        }
        (folder, png)
    }

    fn message(json: Option<&str>, posts: u32) -> String {
        let (_folder, png) = written(json, posts);
        match DemTerrain::load(&png) {
            Ok(_) => panic!("{json:?} with {posts} posts is refused"),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn posts_are_met_and_the_shorter_extent_is_the_side() {
        let (_folder, png) = written(Some(GOOD), 12);
        let ground = DemTerrain::load(&png).expect("it is good");
        assert_eq!(ground.side_m(), 270.0);
        let post = ground.height(-5.5 * 30.0, -4.5 * 30.0);
        assert!((post - 100.0).abs() < 6.0, "{post}");
        let [low, high] = ground.height_range();
        for i in 0..400 {
            let h = ground.height(i as f32 - 200.0, i as f32 * 0.7 - 140.0);
            assert!(h >= low && h <= high, "{h}");
        }
        assert_eq!(ground.water_level(), None);
        assert_eq!(ground.with_water(Some(150.0)).water_level(), Some(150.0));
    }

    #[test]
    fn what_is_wrong_with_a_model_is_said() {
        let missing = message(None, 12);
        assert!(missing.contains("dem.json") && missing.contains("description"), "{missing}");
        let size = message(Some(GOOD), 11);
        assert!(size.contains("11 x 10") && size.contains("12 x 10"), "{size}");
        let malformed = message(Some("{"), 12);
        assert!(malformed.contains("dem.json") && malformed.contains("spacing_m"), "{malformed}");
        let flat = message(Some(&GOOD.replace("400", "100")), 12);
        assert!(flat.contains("height_max_m"), "{flat}");
        let (_folder, png) = written(Some(GOOD), 12);
        image::GrayImage::new(12, 10).save(&png).expect("the folder can be written");
        let shallow = DemTerrain::load(&png).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(shallow.contains("L8") && shallow.contains("16-bit grey"), "{shallow}");
        fs::write(&png, b"no picture").expect("the folder can be written");
        let broken = DemTerrain::load(&png).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(broken.contains("not a readable PNG"), "{broken}");
        let nowhere = DemTerrain::load(Path::new("nowhere.png")).err().map(|e| e.to_string());
        assert!(nowhere.is_some_and(|e| e.contains("nowhere.json")));
    }

    #[test]
    fn a_real_model_loads() {
        let png = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../shared/data/dem/bigtujunga_1197x643.png");
        if !png.exists() {
            println!("SKIPPED a_real_model_loads: no ../shared/data");
            return;
        }
        let ground = DemTerrain::load(&png).expect("it is good");
        assert_eq!(ground.side_m(), 642.0 * 30.0);
        let here = ground.height(0.0, 0.0);
        assert!((315.0..2295.0).contains(&here), "{here}");
    }
}
