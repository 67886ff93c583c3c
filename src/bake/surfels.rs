//! Peeled samples → surfels, one for one and in the same order, and the area of the surface they stand for. O(n).

use super::peel::{PeelDirection, PeelOutput};
use super::source::{SourceMaterial, SourceModel};
use super::thickness::thickness_classes;
use crate::asset::{SURFEL_KEEPS_NORMAL, SURFEL_LEAF, SURFEL_TWO_SIDED, SURFEL_UNLIT, Surfel};

/// The surfel of each sample. Ambient visibility is open (255), which `lighting` changes, and the group 0.
pub fn surfels(model: &SourceModel, output: &PeelOutput) -> Vec<Surfel> {
    let fallback = SourceMaterial::default();
    let thickness = thickness_classes(output);
    let surfel = |(sample, thickness): (&super::peel::PeelSample, &u8)| {
        let material = model.materials.get(usize::from(sample.material)).unwrap_or(&fallback);
        Surfel {
            position: sample.position,
            face_normal: sample.face_normal,
            normal: sample.normal,
            albedo: sample.albedo,
            flags: flags(material),
            thickness: *thickness,
            roughness: material.perceptual_roughness,
            ambient_visibility: 255,
            group: 0,
            metallic: material.metallic,
        }
    };
    output.samples.iter().zip(&thickness).map(surfel).collect()
}

fn flags(material: &SourceMaterial) -> u8 {
    let bit = |set: bool, flag: u8| if set { flag } else { 0 };
    bit(material.is_leaf, SURFEL_LEAF)
        | bit(material.double_sided, SURFEL_TWO_SIDED)
        | bit(material.unlit, SURFEL_UNLIT)
        | bit(material.keeps_normals, SURFEL_KEEPS_NORMAL)
}

/// Surface area that the samples stand for (model units²): the model's, with the holes of masks left out.
///
/// A sample is a pixel of its direction's image; on the surface, the pixel is larger by 1 / |n · forward|. The direction
/// most parallel to n kept it, which for three perpendicular directions or more is at least 1/√3: the clamp only guards
/// against rounding. A sample whose direction or viewport is missing counts nothing.
pub fn sample_area(output: &PeelOutput, directions: &[PeelDirection]) -> f64 {
    let steepest = 3f32.sqrt().recip();
    let area = |sample: &super::peel::PeelSample| {
        let index = usize::from(sample.direction);
        let (Some(direction), Some(viewport)) =
            (directions.get(index), output.viewports.get(index))
        else {
            return 0.0;
        };
        let parallel = direction.forward.dot(sample.face_normal).abs().max(steepest);
        f64::from(viewport.pixel) * f64::from(viewport.pixel) / f64::from(parallel)
    };
    output.samples.iter().map(area).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::peel::{cpu, directions, viewports};
    use crate::bake::settings::BakeSettings;
    use crate::bake::test_models::{self, bounds, quad};
    use crate::math::triangle::normal_and_area;
    use bevy::math::Vec3;

    #[test]
    fn flags_come_from_the_material() {
        let quads = (0..2).map(|i| quad(Vec3::Z * i as f32, Vec3::X, Vec3::Y, i)).collect();
        let mut model = test_models::model(quads, 2);
        model.materials[0].is_leaf = true;
        model.materials[0].double_sided = true;
        model.materials[1].unlit = true;
        model.materials[1].perceptual_roughness = 0.25;
        let viewports = viewports(&bounds(&model), 4, &directions(3));
        let output = cpu::peel(&model, &viewports, &BakeSettings::default(), &|_| {});
        let surfels = surfels(&model, &output);
        assert_eq!(surfels.len(), 32);
        assert_eq!((surfels[0].flags, surfels[0].roughness), (SURFEL_LEAF | SURFEL_TWO_SIDED, 1.0));
        assert_eq!((surfels[31].flags, surfels[31].roughness), (SURFEL_UNLIT, 0.25));
        assert!(surfels.iter().all(|s| s.ambient_visibility == 255 && s.group == 0));
    }

    #[test]
    fn the_area_of_the_bunny_is_found_from_its_samples() {
        let Some(model) = test_models::bunny("the_area_of_the_bunny_is_found_from_its_samples")
        else {
            return;
        };
        let mesh = &model.meshes[0];
        let corner = |i: u32| mesh.positions[i as usize];
        let area = |t: &[u32; 3]| {
            normal_and_area(corner(t[0]), corner(t[1]), corner(t[2])).map_or(0.0, |n| n.1)
        };
        let truth: f64 = mesh.triangles.iter().map(area).sum();
        for count in [3, 7] {
            let directions = directions(count);
            let viewports = viewports(&bounds(&model), 300, &directions);
            let output = cpu::peel(&model, &viewports, &BakeSettings::default(), &|_| {});
            let ratio = sample_area(&output, &directions) / truth;
            assert!((ratio - 1.0).abs() < 0.01, "{count} directions: {ratio}");
        }
    }
}
