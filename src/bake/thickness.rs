//! How thick the surface is around each sample, in LDI pixels: the baked size that says how far splats may overlap.
//!
//! In: peeled samples; out: a class per sample. A splat may be larger than what its point stands for where that closes
//! gaps in a trunk or a wall, but not where the surface is thinner than the splat. O(samples × thickness), parallel.

use super::peel::{PeelOutput, PeelSample};
use rayon::prelude::*;

/// Least thickness of each class, in LDI pixels.
pub const THICKNESS_CLASSES: [u32; 4] = [1, 3, 8, 24];

/// The class of each sample: the highest of [`THICKNESS_CLASSES`] that its surface reaches along both axes of the
/// image it was kept in.
pub fn thickness_classes(output: &PeelOutput) -> Vec<u8> {
    let images: Vec<Image> = (0..output.viewports.len()).map(|d| Image::new(output, d)).collect();
    output
        .samples
        .par_iter()
        .map(|sample| {
            images.get(usize::from(sample.direction)).map_or(0, |image| image.class(output, sample))
        })
        .collect()
}

/// The kept samples of one direction by pixel.
struct Image {
    width: i32,
    height: i32,
    /// Where each pixel's samples start in `samples`; one more at the end.
    starts: Vec<u32>,
    samples: Vec<u32>,
}

impl Image {
    fn new(output: &PeelOutput, direction: usize) -> Self {
        let viewport = &output.viewports[direction];
        let (width, height) = (viewport.width as usize, viewport.height as usize);
        let own: Vec<u32> = (0..output.samples.len() as u32)
            .filter(|i| usize::from(output.samples[*i as usize].direction) == direction)
            .collect();
        let pixel = |i: u32| {
            let [x, y] = output.samples[i as usize].cell.map(usize::from);
            y.min(height - 1) * width + x.min(width - 1)
        };
        let mut starts = vec![0u32; width * height + 1];
        for &i in &own {
            starts[pixel(i) + 1] += 1;
        }
        for p in 0..width * height {
            starts[p + 1] += starts[p];
        }
        let mut next = starts.clone();
        let mut samples = vec![0; own.len()];
        for i in own {
            let slot = &mut next[pixel(i)];
            samples[*slot as usize] = i;
            *slot += 1;
        }
        Self { width: width as i32, height: height as i32, starts, samples }
    }

    fn class(&self, output: &PeelOutput, sample: &PeelSample) -> u8 {
        let most = THICKNESS_CLASSES[3];
        let across = |x, y| {
            let there = self.reach(output, sample, [x, y], most);
            // The other half matters only as far as it is still missing.
            1 + there + self.reach(output, sample, [-x, -y], most.saturating_sub(there))
        };
        let columns = across(1, 0);
        let thickness =
            if columns < THICKNESS_CLASSES[1] { columns } else { columns.min(across(0, 1)) };
        THICKNESS_CLASSES.iter().rposition(|least| thickness >= *least).unwrap_or(0) as u8
    }

    /// Pixels that the surface goes on in a direction, at most `most`: as long as the next pixel has a sample of the
    /// same material within two pixels of depth, which is what a face that this direction keeps can rise, and some.
    fn reach(&self, output: &PeelOutput, from: &PeelSample, step: [i32; 2], most: u32) -> u32 {
        let viewport = &output.viewports[usize::from(from.direction)];
        let forward = viewport.direction.forward;
        let most_rise = 2.0 * viewport.pixel;
        let mut at = from.cell.map(i32::from);
        let mut depth = from.position.dot(forward);
        for done in 0..most {
            at = [at[0] + step[0], at[1] + step[1]];
            if at[0] < 0 || at[1] < 0 || at[0] >= self.width || at[1] >= self.height {
                return done;
            }
            let pixel = (at[1] * self.width + at[0]) as usize;
            let here = &self.samples[self.starts[pixel] as usize..self.starts[pixel + 1] as usize];
            let rise = |i: &u32| (output.samples[*i as usize].position.dot(forward) - depth).abs();
            let same =
                here.iter().filter(|i| output.samples[**i as usize].material == from.material);
            match same.min_by(|a, b| rise(a).total_cmp(&rise(b))) {
                Some(next) if rise(next) <= most_rise => {
                    depth = output.samples[*next as usize].position.dot(forward);
                }
                _ => return done,
            }
        }
        most
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::{
        peel::{cpu, directions, viewports},
        settings::BakeSettings,
        source::{SourceMaterial, SourceModel},
        test_models::{bounds, quad},
    };
    use bevy::math::Vec3;

    #[test]
    fn a_strip_is_as_thick_as_its_shorter_side() {
        // 1 × `side` units in the plane z = 0; with 100 pixels a unit, classes start at 0.03, 0.08 and 0.24.
        for (side, class) in [(0.015, 0), (0.05, 1), (0.15, 2), (0.5, 3)] {
            let model = SourceModel {
                meshes: vec![quad(Vec3::ZERO, Vec3::X, Vec3::Y * side, 0)],
                materials: vec![SourceMaterial::default()],
                ..Default::default()
            };
            let frames = directions(3);
            let views = viewports(&bounds(&model), 100, &frames);
            let output = cpu::peel(
                &model,
                &views,
                &BakeSettings { ldi_size: 100, ..Default::default() },
                &|_| (),
            );
            let classes = thickness_classes(&output);
            assert!(!classes.is_empty());
            let share =
                classes.iter().filter(|c| **c == class).count() as f32 / classes.len() as f32;
            assert!(share > 0.9, "{side}: {share} of class {class}");
        }
    }
}
