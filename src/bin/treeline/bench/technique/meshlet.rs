//! Bevy's meshlets, the peer that this build never runs: the row says why.

use super::{Made, Technique, Work};
use crate::{
    bench::scenes::SceneArg,
    options::{ToolError, ToolResult},
};
use bevy::{prelude::*, render::settings::WgpuFeatures};

/// Without Bevy's feature `meshlet`.
struct Meshlet;

pub fn make(variants: &[&str]) -> Made {
    match variants.first() {
        Some(variant) => Err(format!("`{variant}` is no variant of it")),
        None => Ok(Box::new(Meshlet)),
    }
}

impl Technique for Meshlet {
    fn can_run(&self, _scene: SceneArg, features: WgpuFeatures) -> Result<(), String> {
        Err(if features.contains(WgpuFeatures::TEXTURE_INT64_ATOMIC) {
            // Its plugin ends the program on adapters that lack the feature, so it is not even built in.
            "not part of this build: Bevy's feature `meshlet` is off".into()
        } else {
            "cannot run: the adapter lacks TEXTURE_INT64_ATOMIC".into()
        })
    }

    fn plant(&mut self, _app: &mut App, _work: &mut Work) -> ToolResult {
        Err(ToolError::Message("meshlets are not part of this build".into()))
    }

    fn set_up_camera(&self, _camera: &mut EntityWorldMut) {}
}
