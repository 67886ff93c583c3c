//! What resolve pipelines differ in besides Bevy's own key: part of the pipeline, so that what is off costs nothing.

use crate::forest::DebugView;
use bevy::{
    color::Alpha,
    pbr::{DistanceFog, FogFalloff, MeshPipelineKey},
    shader::ShaderDefVal,
};

/// Key of a resolve pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::render) struct ResolveKey {
    pub mesh: MeshPipelineKey,
    pub fog: Option<SimpleFog>,
    pub debug_view: DebugView,
    pub draw: ResolveDraw,
    pub sunlight: Option<Sunlight>,
    /// Colours are moved towards the mean of their tree.
    pub contrast: bool,
}

/// Light that comes from directional and ambient lights alone: the shader then has no code for others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::render) struct Sunlight {
    /// Some of them has shadow maps.
    pub shadows: bool,
}

/// What Bevy's key says of light that is neither.
const OTHER_LIGHT: MeshPipelineKey = MeshPipelineKey::ENVIRONMENT_MAP
    .union(MeshPipelineKey::IRRADIANCE_VOLUME)
    .union(MeshPipelineKey::ATMOSPHERE)
    .union(MeshPipelineKey::CONTACT_SHADOWS);

impl Sunlight {
    /// `None`: there is other light.
    pub fn of(mesh: MeshPipelineKey, lamps: bool, shadows: bool) -> Option<Self> {
        (!lamps && !mesh.intersects(OTHER_LIGHT)).then_some(Self { shadows })
    }

    /// What `sunlight.wgsl` is told.
    pub fn shader_defs(self) -> Vec<ShaderDefVal> {
        let shadows = self.shadows.then(|| "TREELINE_SUN_SHADOWS".into());
        ["TREELINE_SUNLIGHT".into()].into_iter().chain(shadows).collect()
    }
}

/// What a draw shows of the visibility buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::render) enum ResolveDraw {
    /// All of it: a sample is a pixel.
    Pixels,
    /// Pixels with four covered samples.
    Samples,
    /// Pixels with one to three covered samples, blended.
    Edges,
}

/// Fog of a kind that the shader computes itself. Bevy's own function holds every kind, and a software driver pays for
/// all of them in every pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(in crate::render) struct SimpleFog {
    squared: bool,
    /// Light of the sun scattered in it.
    glows: bool,
}

impl SimpleFog {
    /// `None`: no fog, or a kind that is left to Bevy.
    pub fn of(fog: Option<&DistanceFog>) -> Option<Self> {
        let fog = fog?;
        let squared = match fog.falloff {
            FogFalloff::Exponential { .. } => false,
            FogFalloff::ExponentialSquared { .. } => true,
            FogFalloff::Linear { .. } | FogFalloff::Atmospheric { .. } => return None,
        };
        Some(Self { squared, glows: fog.directional_light_color.alpha() > 0.0 })
    }
}

impl ResolveKey {
    /// What the shader is told.
    pub fn shader_defs(&self) -> Vec<ShaderDefVal> {
        let mut defs = vec![];
        if self.draw == ResolveDraw::Edges {
            defs.push("TREELINE_EDGES".into());
        }
        if let Some(fog) = self.fog {
            defs.extend([
                "TREELINE_FOG".into(),
                ShaderDefVal::UInt("TREELINE_FOG_SQUARED".into(), fog.squared.into()),
                ShaderDefVal::UInt("TREELINE_FOG_GLOW".into(), fog.glows.into()),
            ]);
        }
        if let Some(sunlight) = self.sunlight {
            defs.extend(sunlight.shader_defs());
        }
        if self.contrast {
            defs.push("TREELINE_CONTRAST".into());
        }
        if self.debug_view != DebugView::Off {
            let view = self.debug_view as u32;
            defs.push(ShaderDefVal::UInt("TREELINE_DEBUG_VIEW".into(), view));
        }
        defs
    }
}
