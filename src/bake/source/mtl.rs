//! Material libraries of OBJ files (.mtl): text and textures → materials. Linear in the bytes.
//!
//! Read: `newmtl`, `Kd` (linear, as Blender writes it), `map_Kd` with `-s`, `-o` and `-clamp`, `d` and `Tr`, and `map_d` where it
//! names the image of `map_Kd`. The rest says nothing that points keep.

use super::{
    Files, SourceAlpha, SourceError, SourceImage, SourceMaterial, SourceModel, SourceTexture,
    SourceWrap, images, leaf,
};
use bevy::math::{Mat3, Vec2, Vec4};
use std::collections::BTreeMap;

/// A material as its library says it, its texture not read yet.
#[derive(Clone, Debug)]
struct MtlMaterial {
    material: SourceMaterial,
    texture: Option<MtlTexture>,
    /// Path of `map_d`.
    alpha_map: Option<String>,
}

/// A use of a texture file.
#[derive(Clone, Debug, PartialEq)]
struct MtlTexture {
    path: String,
    wrap: [SourceWrap; 2],
    uv_transform: Mat3,
}

impl MtlMaterial {
    fn new(name: &str) -> Self {
        let material = SourceMaterial { name: name.to_owned(), ..SourceMaterial::default() };
        Self { material, texture: None, alpha_map: None }
    }
}

/// Parses a library. What cannot be read is left at its default, with a warning that names the line.
fn parse(library: &str, text: &str, warnings: &mut Vec<String>) -> Vec<MtlMaterial> {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let line = line.trim();
        let (keyword, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let rest = rest.trim();
        if keyword == "newmtl" {
            materials.push(MtlMaterial::new(rest));
            continue;
        }
        let Some(current) = materials.last_mut() else { continue };
        if read_line(current, keyword, rest).is_none() {
            warnings.push(format!("`{library}` line {}: `{line}` was ignored", number + 1));
        }
    }
    for material in &mut materials {
        finish(material, library, warnings);
    }
    materials
}

/// Applies one line; none if its values cannot be read.
fn read_line(current: &mut MtlMaterial, keyword: &str, rest: &str) -> Option<()> {
    let number = || rest.split_whitespace().next()?.parse::<f32>().ok();
    let color = &mut current.material.base_color;
    match keyword {
        "Kd" => {
            let mut words = rest.split_whitespace();
            let r: f32 = words.next()?.parse().ok()?;
            // One number means grey.
            let g = words.next().map_or(Some(r), |word| word.parse().ok())?;
            let b = words.next().map_or(Some(r), |word| word.parse().ok())?;
            *color = Vec4::new(r, g, b, color.w);
        }
        "d" => color.w = number()?,
        "Tr" => color.w = 1.0 - number()?,
        "map_Kd" => current.texture = Some(read_texture(rest)?),
        "map_d" => current.alpha_map = Some(read_texture(rest)?.path),
        _ => {}
    }
    Some(())
}

/// A texture statement: options, then a path, which may hold spaces.
fn read_texture(statement: &str) -> Option<MtlTexture> {
    let mut wrap = [SourceWrap::Repeat; 2];
    let (mut scale, mut offset) = (Vec2::ONE, Vec2::ZERO);
    let mut rest = statement;
    let next_word = |text: &str| -> Option<(String, usize)> {
        let word = text.split_whitespace().next()?;
        Some((word.to_owned(), text.find(word)? + word.len()))
    };
    while rest.trim_start().starts_with('-') {
        let (option, end) = next_word(rest)?;
        rest = &rest[end..];
        match option.as_str() {
            "-s" | "-o" | "-t" => {
                // One to three numbers.
                let mut values = Vec::new();
                while values.len() < 3
                    && let Some((word, end)) = next_word(rest)
                    && let Ok(value) = word.parse::<f32>()
                {
                    values.push(value);
                    rest = &rest[end..];
                }
                let default = if option == "-s" { 1.0 } else { 0.0 };
                let values = Vec2::new(*values.first()?, *values.get(1).unwrap_or(&default));
                match option.as_str() {
                    "-s" => scale = values,
                    "-o" => offset = values,
                    _ => {}
                }
            }
            _ => {
                let (value, mut end) = next_word(rest)?;
                if option == "-clamp" && value == "on" {
                    wrap = [SourceWrap::ClampToEdge; 2];
                }
                if option == "-mm" {
                    end += next_word(&rest[end..])?.1;
                }
                rest = &rest[end..];
            }
        }
    }
    let path = rest.trim().trim_matches('"').replace('\\', "/");
    // OBJ coordinates have v up, ours (flipped by the reader) down: v' = 1 − (s (1 − v) + o).
    let uv_transform = Mat3::from_scale_angle_translation(
        scale,
        0.0,
        Vec2::new(offset.x, 1.0 - scale.y - offset.y),
    );
    (!path.is_empty()).then_some(MtlTexture { path, wrap, uv_transform })
}

/// What follows from all lines of a material together.
fn finish(current: &mut MtlMaterial, library: &str, warnings: &mut Vec<String>) {
    let material = &mut current.material;
    let name = &material.name;
    if material.base_color.w < 1.0 {
        warnings.push(format!(
            "`{library}` material `{name}`: its transparency (d {}) was read as a mask at 0.5",
            material.base_color.w
        ));
        material.alpha = SourceAlpha::Mask(0.5);
    }
    let color_path = current.texture.as_ref().map(|texture| &texture.path);
    match &current.alpha_map {
        Some(path) if Some(path) == color_path => material.alpha = SourceAlpha::Mask(0.5),
        Some(path) => warnings.push(format!(
            "`{library}` material `{name}`: map_d `{path}` was ignored; put its mask in the alpha of map_Kd"
        )),
        None => {}
    }
    material.is_leaf = leaf::is_leaf(
        &material.name,
        material.alpha != SourceAlpha::Opaque,
        material.double_sided,
        material.base_color,
    );
}

/// Reads the libraries and textures of the materials in use into the model, in the order of their first use.
pub(super) fn read_materials(
    libraries: &[String],
    names: &[String],
    files: &mut Files,
    model: &mut SourceModel,
) -> Result<(), SourceError> {
    let mut known = BTreeMap::new();
    for library in libraries {
        // One name, which may hold spaces, or else several.
        let read = files.fetch(library).or_else(|error| {
            let words = library.split_whitespace();
            let all = words.map(|word| files.fetch(word)).collect::<Result<Vec<_>, _>>();
            all.map(|all| all.join(&b'\n')).map_err(|_| error)
        });
        match read {
            Ok(bytes) => {
                let text = String::from_utf8_lossy(&bytes);
                for material in parse(library, &text, &mut model.warnings) {
                    known.entry(material.material.name.clone()).or_insert(material);
                }
            }
            Err(error) => model.warnings.push(format!(
                "material library `{library}` cannot be read ({error}): its materials are white"
            )),
        }
    }
    let mut images = BTreeMap::new();
    for name in names {
        let MtlMaterial { mut material, texture, .. } = match known.get(name) {
            Some(material) => material.clone(),
            None => {
                if !name.is_empty() && !known.is_empty() {
                    let warning = format!("material `{name}` is in no library: it is white");
                    model.warnings.push(warning);
                }
                let mut unknown = MtlMaterial::new(name);
                unknown.material.is_leaf = leaf::is_leaf(name, false, false, Vec4::ONE);
                unknown
            }
        };
        if let Some(texture) = texture {
            let image = match images.get(&texture.path) {
                Some(&image) => image,
                None => {
                    let image = read_image(&texture.path, files)?;
                    model.images.push(image);
                    images.insert(texture.path.clone(), model.images.len() - 1);
                    model.images.len() - 1
                }
            };
            // Libraries have no word for a mask in the alpha of map_Kd; that it has holes says it.
            if material.alpha == SourceAlpha::Opaque && model.images[image].has_holes() {
                material.alpha = SourceAlpha::Mask(0.5);
                material.is_leaf = leaf::is_leaf(name, true, false, material.base_color);
            }
            material.base_color_texture = Some(SourceTexture {
                image,
                wrap: texture.wrap,
                nearest: false,
                uv_transform: texture.uv_transform,
            });
        }
        model.materials.push(material);
    }
    Ok(())
}

/// Reads a texture; where the path of the machine it was exported on does not lead anywhere, from beside the model.
fn read_image(path: &str, files: &mut Files) -> Result<SourceImage, SourceError> {
    let bytes = files.fetch(path).or_else(|error| match path.rsplit_once('/') {
        Some((_, file_name)) => files.fetch(file_name).map_err(|_| error),
        None => Err(error),
    });
    let place = format!("file `{path}`");
    let bytes = bytes.map_err(|error| SourceError::Image {
        file: files.file.to_owned(),
        image: format!("`{path}`"),
        place: place.clone(),
        problem: error.to_string(),
    })?;
    images::decode(files.file, &format!("`{path}`"), &place, &bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_is_read() {
        let text = "# comment\nKd 9 9 9\nnewmtl old bark\nKd 0.5 0.25 0.125\nKs 1 1 1\n\
                    newmtl leaves\r\n Kd 0.5\nd 0.9\nmap_Kd -s 2 3 1 -clamp on my leaf.png\nmap_d my leaf.png\n\
                    newmtl moss\nKd 0.1 x\nKd 0.1 0.3 0.1\nmap_Kd -bm 0.2 tex\\moss.png\nmap_d mask.png\n";
        let mut warnings = Vec::new();
        let materials = parse("tree.mtl", text, &mut warnings);
        assert_eq!(materials.len(), 3);
        assert_eq!(materials[0].material.name, "old bark");
        assert_eq!(materials[0].material.base_color, Vec4::new(0.5, 0.25, 0.125, 1.0));
        assert!(!materials[0].material.is_leaf);
        let leaves = &materials[1];
        assert_eq!(leaves.material.base_color, Vec4::new(0.5, 0.5, 0.5, 0.9));
        assert_eq!(leaves.material.alpha, SourceAlpha::Mask(0.5));
        let texture = leaves.texture.as_ref().unwrap();
        assert_eq!(texture.path, "my leaf.png");
        assert_eq!(texture.wrap, [SourceWrap::ClampToEdge; 2]);
        // The bottom of the image in OBJ (v = 0) is v = 1 here and stays it.
        assert_eq!(texture.uv_transform.transform_point2(Vec2::ONE), Vec2::new(2.0, 1.0));
        let moss = &materials[2];
        assert!(moss.material.is_leaf, "green without other hints");
        assert_eq!(moss.texture.as_ref().unwrap().path, "tex/moss.png");
        assert_eq!(moss.material.alpha, SourceAlpha::Opaque);
        assert_eq!(warnings.len(), 3, "{warnings:?}");
        assert!(warnings[0].contains("line 12"), "{warnings:?}");
    }
}
