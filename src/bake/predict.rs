//! How many points a bake will give, before peeling: triangles in, an expected count out. O(triangles · directions).

use super::peel::{PeelDirection, most_parallel};
use super::source::{SourceAlpha, SourceModel};
use crate::math::triangle::normal_and_area;

/// Expected number of points of the opaque triangles with LDI pixels of side `pixel` (model units).
///
/// A triangle is kept by the direction most parallel to its normal n, and covers `area · max |n · forward|` of its image:
/// that many times pixels². Masked materials are left out, as their holes are not known without their textures. What the
/// count cannot know is coincident surfaces, of which peeling keeps one.
pub fn predicted_points(model: &SourceModel, directions: &[PeelDirection], pixel: f32) -> f64 {
    let opaque = |material: usize| {
        model.materials.get(material).is_none_or(|m| m.alpha == SourceAlpha::Opaque)
    };
    let mut projected_area = 0.0;
    for mesh in model.meshes.iter().filter(|mesh| opaque(mesh.material)) {
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|i| mesh.positions.get(i as usize).copied());
            let (Some(a), Some(b), Some(c)) = (a, b, c) else { continue };
            let Some((normal, area)) = normal_and_area(a, b, c) else { continue };
            let Some(direction) = directions.get(most_parallel(directions, normal)) else {
                continue;
            };
            projected_area += area * f64::from(direction.forward.dot(normal).abs());
        }
    }
    projected_area / (f64::from(pixel) * f64::from(pixel))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::peel::{cpu, directions, viewports};
    use crate::bake::settings::BakeSettings;
    use crate::bake::test_models;

    /// Per row: LDI size, predicted count, the paper's count (Bærentzen 2005, table 1), and the layers per direction that its
    /// table has: those of partitioned triangles (its §2.1); for the cow at 1000 it has 5, 4, 5.
    fn check(name: &str, model: &SourceModel, rows: [(u32, f64, f64, [u32; 3]); 2]) {
        for (ldi_size, expected, paper, layers) in rows {
            let directions = directions(3);
            let viewports = viewports(&test_models::bounds(model), ldi_size, &directions);
            let predicted = predicted_points(model, &directions, viewports[0].pixel);
            let output = cpu::peel(model, &viewports, &BakeSettings::default(), &|_| {});
            let partition = BakeSettings { partition_triangles: true, ..Default::default() };
            let parts = cpu::peel(model, &viewports, &partition, &|_| {});
            let points = output.samples.len() as f64;
            println!(
                "{name} LDI {ldi_size}: predicted {predicted:.0}, peeled {points}, paper {paper}; layers {:?}, partitioned {:?}",
                output.layers, parts.layers
            );
            assert!((predicted / expected - 1.0).abs() < 0.005, "{predicted} against {expected}");
            assert!((points / paper - 1.0).abs() < 0.03, "{points} against {paper}");
            assert_eq!((parts.layers, output.left_over), (layers.to_vec(), vec![0; 3]));
        }
    }

    #[test]
    fn the_bunny_gives_the_papers_counts() {
        let Some(model) = test_models::bunny("the_bunny_gives_the_papers_counts") else { return };
        check(
            "bunny",
            &model,
            [(100, 20_154.0, 20_395.0, [3, 4, 4]), (1000, 2_015_443.0, 2_018_092.0, [4, 5, 4])],
        );
    }

    #[test]
    fn the_cow_gives_the_papers_counts() {
        let Some(model) = test_models::cow("the_cow_gives_the_papers_counts") else { return };
        check(
            "cow",
            &model,
            [(100, 8_740.0, 8_891.0, [5, 4, 4]), (1000, 874_000.0, 875_494.0, [5, 4, 4])],
        );
    }
}
