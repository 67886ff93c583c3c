//! glTF materials → [`SourceMaterial`], with the base colour images they use.

use super::super::uri::{self, Uri};
use super::super::{
    Files, SourceAlpha, SourceError, SourceMaterial, SourceModel, SourceTexture, SourceWrap,
    images, leaf,
};
use super::Buffers;
use bevy::math::{Mat3, Vec2, Vec4};
use gltf::material::AlphaMode;
use gltf::texture::{MagFilter, WrappingMode};
use std::collections::BTreeMap;

/// The texture coordinate set of a material's base colour texture, if it has one.
pub(super) fn texcoord_set(material: &gltf::Material) -> Option<u32> {
    let info = material.pbr_metallic_roughness().base_color_texture()?;
    let overridden = info.texture_transform().and_then(|transform| transform.tex_coord());
    Some(overridden.unwrap_or_else(|| info.tex_coord()))
}

/// Images decoded so far: number in the file → number in the model.
#[derive(Default)]
pub(super) struct Images(BTreeMap<usize, usize>);

impl Images {
    /// Reads a material; decodes its base colour image into the model if no other material has.
    pub fn read_material(
        &mut self,
        material: &gltf::Material,
        buffers: &Buffers,
        files: &mut Files,
        model: &mut SourceModel,
    ) -> Result<SourceMaterial, SourceError> {
        let name = match (material.name(), material.index()) {
            (Some(name), _) => name.to_owned(),
            (None, Some(index)) => format!("#{index}"),
            (None, None) => "default".to_owned(),
        };
        let pbr = material.pbr_metallic_roughness();
        let base_color = Vec4::from_array(pbr.base_color_factor());
        let alpha = match material.alpha_mode() {
            AlphaMode::Opaque => SourceAlpha::Opaque,
            AlphaMode::Mask => SourceAlpha::Mask(material.alpha_cutoff().unwrap_or(0.5)),
            AlphaMode::Blend => {
                let warning = format!("material `{name}`: blended alpha was read as a mask at 0.5");
                model.warnings.push(warning);
                SourceAlpha::Mask(0.5)
            }
        };
        let base_color_texture = match pbr.base_color_texture() {
            Some(info) => Some(self.read_texture(&info, buffers, files, model)?),
            None => None,
        };
        let double_sided = material.double_sided();
        let is_cut = alpha != SourceAlpha::Opaque;
        Ok(SourceMaterial {
            // A name that was made up here says nothing about leaves.
            is_leaf: leaf::is_leaf(
                material.name().unwrap_or_default(),
                is_cut,
                double_sided,
                base_color,
            ),
            name,
            base_color,
            base_color_texture,
            alpha,
            double_sided,
            unlit: material.unlit(),
            perceptual_roughness: pbr.roughness_factor(),
            metallic: pbr.metallic_factor(),
            keeps_normals: false,
        })
    }

    fn read_texture(
        &mut self,
        info: &gltf::texture::Info,
        buffers: &Buffers,
        files: &mut Files,
        model: &mut SourceModel,
    ) -> Result<SourceTexture, SourceError> {
        let texture = info.texture();
        let sampler = texture.sampler();
        let wrap = |mode| match mode {
            WrappingMode::Repeat => SourceWrap::Repeat,
            WrappingMode::MirroredRepeat => SourceWrap::MirroredRepeat,
            WrappingMode::ClampToEdge => SourceWrap::ClampToEdge,
        };
        // Turned counter-clockwise on screen, where v points down: clockwise in numbers (KHR_texture_transform).
        let uv_transform = info.texture_transform().map_or(Mat3::IDENTITY, |transform| {
            Mat3::from_scale_angle_translation(
                Vec2::from_array(transform.scale()),
                -transform.rotation(),
                Vec2::from_array(transform.offset()),
            )
        });
        Ok(SourceTexture {
            image: self.read_image(&texture.source(), buffers, files, model)?,
            wrap: [wrap(sampler.wrap_s()), wrap(sampler.wrap_t())],
            nearest: sampler.mag_filter() == Some(MagFilter::Nearest),
            uv_transform,
        })
    }

    fn read_image(
        &mut self,
        image: &gltf::Image,
        buffers: &Buffers,
        files: &mut Files,
        model: &mut SourceModel,
    ) -> Result<usize, SourceError> {
        if let Some(&known) = self.0.get(&image.index()) {
            return Ok(known);
        }
        let file = files.file;
        let name = match image.name() {
            Some(name) => format!("{} (`{name}`)", image.index()),
            None => image.index().to_string(),
        };
        let fail = |place: &str, problem: String| SourceError::Image {
            file: file.to_owned(),
            image: name.clone(),
            place: place.to_owned(),
            problem,
        };
        // From the JSON: the crate's own accessor insists on a MIME type.
        let json = &buffers.document.as_json().images[image.index()];
        let view = json.buffer_view.and_then(|view| buffers.document.views().nth(view.value()));
        let decoded = if let Some(view) = view {
            let place = format!("buffer view {}", view.index());
            images::decode(file, &name, &place, buffers.view(&view)?)?
        } else {
            let text = json.uri.as_deref().ok_or_else(|| {
                fail("nowhere", "it has neither a URI nor a buffer view".to_owned())
            })?;
            match uri::resolve(text).map_err(|problem| fail("its URI", problem))? {
                Uri::Data(bytes) => images::decode(file, &name, "a data: URI", &bytes)?,
                Uri::Path(path) => {
                    let place = format!("file `{path}`");
                    let bytes = files.fetch(&path).map_err(|e| fail(&place, e.to_string()))?;
                    images::decode(file, &name, &place, &bytes)?
                }
            }
        };
        model.images.push(decoded);
        self.0.insert(image.index(), model.images.len() - 1);
        Ok(model.images.len() - 1)
    }
}
