//! What every reader ends in: a model as read → the same model, sound, or an error. O(vertices + triangles).
//!
//! Sound means: indices in range, positions finite, one unit normal a vertex, no degenerate triangle or empty mesh, a
//! surface of some area, a size that single precision can hold. The rest of the bake relies on it and checks no more.

use super::normals::{face_cross, smooth};
use super::{SourceError, SourceMesh, SourceModel};
use bevy::math::{DVec3, Vec2, Vec3, Vec4};

/// Materials that a surfel's sample can number.
const MAX_MATERIALS: usize = 1 << 16;
/// Largest sides of a model that can be baked, in its units. Squares and products of areas stay far from the limits of `f32`.
const EXTENT_RANGE: std::ops::RangeInclusive<f32> = 1e-9..=1e9;

/// Checks a model and mends what can be mended: generates or replaces missing, zero and infinite normals and makes the
/// others unit vectors, drops degenerate triangles and empty meshes, replaces infinite texture coordinates and colours.
/// What it drops or replaces is counted in [`SourceModel::warnings`].
///
/// # Errors
/// No triangles, zero area, indices or references out of range, infinite positions, attributes of other lengths
/// than the positions, sizes outside single precision.
pub fn check(model: &mut SourceModel) -> Result<(), SourceError> {
    check_references(model)?;
    let file = &model.name;
    let mut degenerate = 0;
    let mut triangles = 0;
    for mesh in &mut model.meshes {
        check_mesh(file, mesh)?;
        triangles += mesh.triangles.len();
        let SourceMesh { triangles: kept, positions, .. } = mesh;
        let before = kept.len();
        kept.retain(|t| face_cross(t.map(|i| positions[i as usize])) != DVec3::ZERO);
        degenerate += before - kept.len();
    }
    model.meshes.retain(|mesh| !mesh.triangles.is_empty());
    if model.meshes.is_empty() {
        let file = file.clone();
        return Err(match triangles {
            0 => SourceError::NoMesh { file, problem: "it holds no triangles".to_owned() },
            _ => SourceError::ZeroArea { file, triangles },
        });
    }
    let extent = model.bounds().extent().max_element();
    if !EXTENT_RANGE.contains(&extent) {
        return Err(SourceError::Extent { file: model.name.clone(), extent });
    }
    if degenerate > 0 {
        model.warnings.push(format!("{degenerate} triangles without area were dropped"));
    }
    for mesh in &mut model.meshes {
        mend_normals(mesh, &mut model.warnings);
        mend_values(mesh, &mut model.warnings);
    }
    for material in &mut model.materials {
        material.base_color = finite_or(material.base_color, Vec4::ONE).max(Vec4::ZERO);
        material.perceptual_roughness = unit_or(material.perceptual_roughness, 1.0);
        material.metallic = unit_or(material.metallic, 0.0);
    }
    Ok(())
}

/// Checks what numbers of materials and images point to, and that images have their pixels.
fn check_references(model: &SourceModel) -> Result<(), SourceError> {
    let reference = |place, what, index, count| {
        let file = model.name.clone();
        if index < count {
            Ok(())
        } else {
            Err(SourceError::Reference { file, place, what, index, count })
        }
    };
    let (materials, images) = (model.materials.len(), model.images.len());
    for mesh in &model.meshes {
        reference(format!("mesh `{}`", mesh.name), "material", mesh.material, materials)?;
    }
    for material in &model.materials {
        if let Some(texture) = &material.base_color_texture {
            reference(format!("material `{}`", material.name), "image", texture.image, images)?;
        }
    }
    if materials > MAX_MATERIALS {
        return Err(SourceError::TooMany {
            file: model.name.clone(),
            what: "materials",
            count: materials,
            limit: MAX_MATERIALS,
        });
    }
    for (i, image) in model.images.iter().enumerate() {
        let bytes = image.width as usize * image.height as usize * 4;
        if bytes == 0 || image.rgba8.len() != bytes {
            return Err(SourceError::Image {
                file: model.name.clone(),
                image: i.to_string(),
                place: "memory".to_owned(),
                problem: format!(
                    "it has {} bytes for {} × {} pixels",
                    image.rgba8.len(),
                    image.width,
                    image.height
                ),
            });
        }
    }
    Ok(())
}

/// Checks one mesh: lengths of attributes, range of indices, finite positions. Readers call it before they use indices.
pub(super) fn check_mesh(file: &str, mesh: &SourceMesh) -> Result<(), SourceError> {
    let vertices = mesh.positions.len();
    for (attribute, found) in [
        ("normals", mesh.normals.len()),
        ("texture coordinates", mesh.uvs.len()),
        ("colours", mesh.colors.len()),
    ] {
        if found != 0 && found != vertices {
            let (file, mesh) = (file.to_owned(), mesh.name.clone());
            return Err(SourceError::AttributeLength { file, mesh, attribute, found, vertices });
        }
    }
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        if let Some(&index) = corners.iter().find(|&&i| i as usize >= vertices) {
            let (file, mesh) = (file.to_owned(), mesh.name.clone());
            return Err(SourceError::IndexOutOfRange { file, mesh, triangle, index, vertices });
        }
    }
    match mesh.positions.iter().position(|p| !p.is_finite()) {
        Some(vertex) => Err(SourceError::NonFinitePosition {
            file: file.to_owned(),
            mesh: mesh.name.clone(),
            vertex,
            position: mesh.positions[vertex],
        }),
        None => Ok(()),
    }
}

/// Makes normals unit vectors, and those that have no direction face normals.
fn mend_normals(mesh: &mut SourceMesh, warnings: &mut Vec<String>) {
    if mesh.normals.is_empty() {
        mesh.normals = smooth(&mesh.positions, &mesh.triangles);
        return;
    }
    // In double precision, so that very short normals keep their direction.
    let units: Vec<Option<Vec3>> =
        mesh.normals.iter().map(|n| n.as_dvec3().try_normalize().map(|n| n.as_vec3())).collect();
    let broken = units.iter().filter(|n| n.is_none()).count();
    if broken == 0 {
        mesh.normals = units.into_iter().flatten().collect();
        return;
    }
    warnings.push(format!("mesh `{}`: {broken} zero or infinite normals were replaced", mesh.name));
    let faces = smooth(&mesh.positions, &mesh.triangles);
    mesh.normals = units.into_iter().zip(faces).map(|(unit, face)| unit.unwrap_or(face)).collect();
}

/// Replaces texture coordinates and colours that are not numbers, or infinite.
fn mend_values(mesh: &mut SourceMesh, warnings: &mut Vec<String>) {
    let mut replaced = 0;
    for uv in mesh.uvs.iter_mut().filter(|uv| !uv.is_finite()) {
        *uv = Vec2::ZERO;
        replaced += 1;
    }
    for color in mesh.colors.iter_mut().filter(|color| !color.is_finite()) {
        *color = Vec4::ONE;
        replaced += 1;
    }
    if replaced > 0 {
        let name = &mesh.name;
        warnings.push(format!(
            "mesh `{name}`: {replaced} infinite texture coordinates or colours were replaced"
        ));
    }
}

fn finite_or(value: Vec4, default: Vec4) -> Vec4 {
    if value.is_finite() { value } else { default }
}

fn unit_or(value: f32, default: f32) -> f32 {
    if value.is_nan() { default } else { value.clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::source::{SourceImage, SourceMaterial, SourceTexture, SourceWrap};
    use bevy::math::Mat3;

    fn model() -> SourceModel {
        let mesh = SourceMesh {
            name: "crown".to_owned(),
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..SourceMesh::default()
        };
        SourceModel {
            name: "oak".to_owned(),
            meshes: vec![mesh],
            materials: vec![SourceMaterial::default()],
            ..SourceModel::default()
        }
    }

    fn error_of(change: impl FnOnce(&mut SourceModel)) -> String {
        let mut model = model();
        change(&mut model);
        check(&mut model).unwrap_err().to_string()
    }

    #[test]
    fn a_broken_model_is_refused_with_the_place_of_the_fault() {
        let texture = SourceTexture {
            image: 2,
            wrap: [SourceWrap::Repeat; 2],
            nearest: false,
            uv_transform: Mat3::IDENTITY,
        };
        type Change = Box<dyn FnOnce(&mut SourceModel)>;
        let cases: [(&[&str], Change); 12] = [
            (
                &["crown", "triangle 1", "vertex 9", "4"],
                Box::new(|m| m.meshes[0].triangles[1] = [0, 9, 2]),
            ),
            (&["crown", "vertex 2", "NaN"], Box::new(|m| m.meshes[0].positions[2].y = f32::NAN)),
            (
                &["crown", "vertex 1", "inf"],
                Box::new(|m| m.meshes[0].positions[1].x = f32::INFINITY),
            ),
            (
                &["crown", "3 normals", "4 vertices"],
                Box::new(|m| m.meshes[0].normals = vec![Vec3::Y; 3]),
            ),
            (&["1 texture coordinates"], Box::new(|m| m.meshes[0].uvs = vec![Vec2::ZERO])),
            (&["5 colours"], Box::new(|m| m.meshes[0].colors = vec![Vec4::ONE; 5])),
            (&["crown", "material 3", "there are 1"], Box::new(|m| m.meshes[0].material = 3)),
            (
                &["image 2", "there are 0"],
                Box::new(|m| m.materials[0].base_color_texture = Some(texture)),
            ),
            (&["no mesh"], Box::new(|m| m.meshes.clear())),
            (
                &["2 triangles", "zero area"],
                Box::new(|m| m.meshes[0].positions = vec![Vec3::ONE; 4]),
            ),
            (
                &["units large"],
                Box::new(|m| m.meshes[0].positions.iter_mut().for_each(|p| *p *= 1e30)),
            ),
            (
                &["0 bytes for 2 × 2"],
                Box::new(|m| {
                    m.images.push(SourceImage { width: 2, height: 2, rgba8: Vec::new() });
                }),
            ),
        ];
        for (parts, change) in cases {
            let text = error_of(change);
            assert!(text.contains("oak"), "{text} lacks the file");
            for part in parts {
                assert!(text.contains(part), "{text} lacks {part}");
            }
        }
    }

    #[test]
    fn degenerate_triangles_and_empty_meshes_are_dropped_and_counted() {
        let mut model = model();
        model.meshes[0].triangles.extend([[1, 1, 2], [0, 0, 0]]);
        model.meshes.push(SourceMesh { name: "empty".to_owned(), ..SourceMesh::default() });
        check(&mut model).unwrap();
        assert_eq!((model.triangle_count(), model.meshes.len()), (2, 1));
        assert_eq!(model.warnings, ["2 triangles without area were dropped"]);
    }

    #[test]
    fn every_normal_is_a_unit_vector_afterwards() {
        let mut model = model();
        model.meshes[0].normals =
            vec![Vec3::Z * 1e-30, Vec3::new(0.0, f32::NAN, 0.0), Vec3::ZERO, Vec3::X * 7.0];
        check(&mut model).unwrap();
        assert_eq!(
            model.meshes[0].normals,
            [Vec3::Z, Vec3::Z, Vec3::new(1.0, 0.0, 1.0).normalize(), Vec3::X]
        );
        assert!(model.warnings[0].contains("2 zero or infinite normals"), "{:?}", model.warnings);
    }

    #[test]
    fn infinite_attributes_and_factors_are_replaced() {
        let mut model = model();
        model.meshes[0].uvs = vec![Vec2::INFINITY; 4];
        model.materials[0].base_color.x = f32::INFINITY;
        model.materials[0].perceptual_roughness = f32::NAN;
        check(&mut model).unwrap();
        assert_eq!(model.meshes[0].uvs[3], Vec2::ZERO);
        assert_eq!(model.materials[0], SourceMaterial::default());
        assert_eq!(model.warnings.len(), 1);
    }
}
