//! Sun, sky and haze: a time of day in; lights, fog and a sky behind everything out. O(cameras + lights) when it changes.

use super::{Landscape, material::SkyMaterial, stream::Frame};
use crate::landscape::{Daylight, TimeOfDay};
use bevy::{
    asset::RenderAssetUsages,
    camera::{Exposure, visibility::NoFrustumCulling},
    light::{NotShadowCaster, NotShadowReceiver},
    mesh::PrimitiveTopology,
    pbr::{DistanceFog, FogFalloff},
    prelude::*,
    render::renderer::RenderAdapterInfo,
};
use std::fmt;
use wgpu::DeviceType;

/// What is drawn behind the landscape.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SkyKind {
    /// The gradient, on every adapter.
    #[default]
    Gradient,
    /// Nothing: the app has a sky of its own (Bevy's `Atmosphere` where [`SkySupport`] allows it, a skybox, a clear colour).
    None,
}

/// The time of day and what follows it.
#[derive(Resource, Clone, Debug, PartialEq)]
pub struct Sky {
    /// Default: 15 h at midsummer.
    pub time: TimeOfDay,
    /// Default: [`SkyKind::Gradient`].
    pub kind: SkyKind,
    /// Sets every light with [`Sun`], the global ambient light, the clear colour, and colour and density of the
    /// [`DistanceFog`] that cameras have. Default: true.
    pub drives_lights: bool,
    /// Distance in metres at which haze leaves 5 % of a colour. Default (`None`): the side of the ground, within 3 to 40 km.
    pub visibility_m: Option<f32>,
}

impl Default for Sky {
    fn default() -> Self {
        Self {
            time: TimeOfDay::default(),
            kind: SkyKind::default(),
            drives_lights: true,
            visibility_m: None,
        }
    }
}

/// The directional light that is the sun (and the moon at night).
#[derive(Component, Clone, Copy, Debug, Default)]
#[require(DirectionalLight)]
pub struct Sun;

/// Whether Bevy's atmosphere can run beside a landscape; for the log and `doctor`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SkySupport {
    /// It can; cameras need `Hdr` and `AtmosphereSettings`.
    Atmosphere,
    /// It must not be used: it crashes software drivers.
    GradientOnly {
        /// Name of the adapter.
        adapter: String,
    },
}

impl SkySupport {
    /// What an adapter can do.
    pub fn of(adapter: &wgpu::AdapterInfo) -> Self {
        if adapter.device_type == DeviceType::Cpu {
            Self::GradientOnly { adapter: adapter.name.clone() }
        } else {
            Self::Atmosphere
        }
    }
}

impl fmt::Display for SkySupport {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Atmosphere => {
                write!(f, "sky: gradient by time of day; Bevy's atmosphere can be used instead")
            }
            Self::GradientOnly { adapter } => write!(
                f,
                "sky: gradient by time of day; {adapter} is a software driver, on which Bevy's atmosphere crashes"
            ),
        }
    }
}

/// The light of the present moment.
#[derive(Resource)]
pub(super) struct CurrentLight(pub Daylight);

impl Default for CurrentLight {
    fn default() -> Self {
        Self(Daylight::new(&TimeOfDay::default()))
    }
}

fn color(linear: Vec3) -> Color {
    Color::LinearRgba(LinearRgba::rgb(linear.x, linear.y, linear.z))
}

pub(super) fn light_by_time(
    sky: Res<Sky>,
    mut current: ResMut<CurrentLight>,
    mut suns: Query<(Ref<Sun>, &mut DirectionalLight, &mut Transform)>,
    mut ambient: Option<ResMut<GlobalAmbientLight>>,
    mut clear: Option<ResMut<ClearColor>>,
) {
    if sky.is_changed() {
        current.0 = Daylight::new(&sky.time);
    }
    let light = current.0;
    if !sky.drives_lights {
        return;
    }
    for (sun, mut directional, mut transform) in &mut suns {
        if sky.is_changed() || sun.is_added() {
            directional.color = color(light.light_color);
            directional.illuminance = light.illuminance;
            transform.look_to(-light.light_direction, Vec3::Y);
        }
    }
    if !sky.is_changed() {
        return;
    }
    if let Some(ambient) = &mut ambient {
        ambient.color = color(light.ambient_color);
        ambient.brightness = light.ambient_brightness;
    }
    if let Some(clear) = &mut clear {
        clear.0 = color(light.horizon);
    }
}

/// Haze in the colour of the sky at the horizon, with its glow around the sun.
pub(super) fn haze_cameras(
    sky: Res<Sky>,
    current: Res<CurrentLight>,
    landscape: Option<Res<Landscape>>,
    mut cameras: Query<(&mut DistanceFog, Option<&Exposure>), With<Camera3d>>,
) {
    if !sky.drives_lights {
        return;
    }
    let light = &current.0;
    let side = landscape.map_or(16_000.0, |l| l.ground.side_m());
    let visibility = sky.visibility_m.unwrap_or(side.clamp(3_000.0, 40_000.0)).max(10.0);
    for (mut fog, exposure) in &mut cameras {
        // Fog colours are not exposed by Bevy; its glow is, by the sun's own colour.
        let exposed = 1000.0 * exposure.copied().unwrap_or_default().exposure();
        let sun = (light.light_color * light.illuminance).max(Vec3::splat(1.0)) * 1e-3;
        let wanted = (
            color(light.horizon * exposed),
            color((light.glow * 0.55 / sun).min(Vec3::splat(8.0))),
        );
        if (fog.color, fog.directional_light_color) != wanted {
            (fog.color, fog.directional_light_color) = wanted;
            fog.directional_light_exponent = 8.0;
        }
        let falloff = FogFalloff::Exponential { density: 3.0 / visibility };
        if !matches!(fog.falloff, FogFalloff::Exponential { density } if density == 3.0 / visibility)
        {
            fog.falloff = falloff;
        }
    }
}

/// The entity that draws the sky.
#[derive(Component)]
pub(super) struct SkyBehind;

pub(super) fn draw_sky(
    mut commands: Commands,
    sky: Res<Sky>,
    frame: Res<Frame>,
    adapter: Option<Res<RenderAdapterInfo>>,
    behind: Query<Entity, With<SkyBehind>>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<SkyMaterial>>,
) {
    if !sky.is_changed() {
        return;
    }
    match (sky.kind, behind.iter().next()) {
        (SkyKind::Gradient, None) => {
            if let Some(adapter) = adapter {
                info!("{}", SkySupport::of(&adapter));
            }
            // One triangle over the whole screen, in clip space.
            let corners = vec![[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0f32]];
            let mesh = Mesh::new(PrimitiveTopology::TriangleList, RenderAssetUsages::RENDER_WORLD)
                .with_inserted_attribute(Mesh::ATTRIBUTE_POSITION, corners);
            commands.spawn((
                Name::new("sky"),
                SkyBehind,
                Mesh3d(meshes.add(mesh)),
                MeshMaterial3d(materials.add(SkyMaterial { frame: frame.0.clone() })),
                (NoFrustumCulling, NotShadowCaster, NotShadowReceiver),
            ));
        }
        (SkyKind::None, Some(entity)) => commands.entity(entity).despawn(),
        _ => {}
    }
}
