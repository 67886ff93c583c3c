//! What is flown over: ground, forest, sun and sky, and the path.

use super::{FlyArgs, SkyArg, roster};
use crate::{
    options::{ToolError, ToolResult},
    scene,
};
use bevy::{
    camera::Hdr,
    core_pipeline::{
        prepass::{DepthPrepass, NormalPrepass},
        tonemapping::Tonemapping,
    },
    light::{
        Atmosphere, CascadeShadowConfigBuilder, DirectionalLightShadowMap,
        atmosphere::ScatteringMedium,
    },
    pbr::AtmosphereSettings,
    prelude::*,
};
use bevy_treeline::{
    GovernorBudget, NearMeshes, QualityGovernor, TreelineSettings, UploadBudget,
    gpu::headless::headless_device,
    landscape::{
        BiomeSettings, Biomes, Crown, DemTerrain, FlightPath, FlightSettings, ForestShade, Ground,
        Landscape, NoiseTerrain, PlantedForest, Planting, PlantingPlugin, PlantingSettings,
        PlantingSpecies, Scatter, ScatterError, ScatterSettings, ShadeSource, Sky, SkyKind,
        SkySupport, Sun, TerrainLod, TerrainPlugin, TerrainSettings, TimeOfDay, TreeAmount,
    },
};
use std::{sync::Arc, time::Instant};

/// The way of the camera.
#[derive(Resource, Clone)]
pub struct Flight(pub FlightPath);

impl Flight {
    /// Where the camera is at share `t` of the way.
    pub fn place(&self, t: f32) -> Transform {
        let (eye, target) = self.0.look(t);
        Transform::from_translation(eye).looking_at(target, Vec3::Y)
    }
}

/// Names of what grows, for the panel.
#[derive(Resource)]
pub struct Roster(pub Vec<String>);

/// Assets of what grows.
#[derive(Resource)]
pub struct Kinds {
    /// As planted.
    pub kinds: Vec<PlantingSpecies>,
    /// Species that are meshes near the camera.
    pub has_mesh: Vec<bool>,
}

/// Whether Bevy's atmosphere is the sky.
#[derive(Resource)]
struct HasAtmosphere(bool);

/// Everything that is made before an app runs.
pub struct Plan {
    landscape: Landscape,
    scatter: Option<Scatter>,
    members: Vec<roster::Member>,
    flight: FlightPath,
    /// Bevy's atmosphere instead of the gradient.
    atmosphere: bool,
}

/// Trees that come while flying are sent to the GPU in pieces of this size a frame.
const UPLOAD_BYTES: usize = 4 << 20;

/// Whether the atmosphere is drawn; asked for on a software driver, it is refused, since the driver would crash.
fn atmosphere(args: &FlyArgs) -> ToolResult<bool> {
    let (adapter, ..) = headless_device().map_err(|error| ToolError::NoGpu(error.to_string()))?;
    let support = SkySupport::of(&adapter.get_info());
    match args.sky {
        SkyArg::Gradient => Ok(false),
        SkyArg::Auto => Ok(support == SkySupport::Atmosphere),
        SkyArg::Atmosphere if support == SkySupport::Atmosphere => Ok(true),
        SkyArg::Atmosphere => {
            Err(ToolError::Message(format!("--sky atmosphere cannot be: {support}")))
        }
    }
}

fn message(error: impl ToString) -> ToolError {
    ToolError::Message(error.to_string())
}

fn ground(args: &FlyArgs) -> ToolResult<Arc<dyn Ground>> {
    if let Some(path) = &args.dem {
        return Ok(Arc::new(DemTerrain::load(path).map_err(message)?));
    }
    let settings = TerrainSettings { seed: args.seed, side_m: args.side, ..default() };
    Ok(Arc::new(NoiseTerrain::new(&settings).map_err(message)?))
}

/// Bytes that a tree takes: 32 in the main world, 32 on the GPU.
const TREE_BYTES: usize = 64;

/// What the trees of the whole ground may take, so that those within `tree_distance_m` of the camera take the memory asked
/// for: the others are made when they come near.
fn tree_bytes(memory_mib: u32, tree_distance_m: f32, side_m: f32) -> u64 {
    let share = (2.0 * tree_distance_m / side_m).min(1.0).powi(2);
    ((u64::from(memory_mib) << 20) as f64 / f64::from(share)) as u64
}

impl Plan {
    /// The way of the camera.
    pub fn flight(&self) -> Flight {
        Flight(self.flight.clone())
    }

    /// Points of all plants of all species.
    pub fn points_baked(&self) -> u64 {
        self.members.iter().map(roster::Member::points).sum()
    }
}

/// Trees of the forest that the camera's way of one landscape keeps clear of: no smaller one has others.
const MOST_TREES: u64 = 10_000_000;

/// Makes ground, species, forest and flight. Says what takes long. `at_once`: see [`roster::bake`].
pub fn prepare(args: &FlyArgs, at_once: bool) -> ToolResult<Plan> {
    prepare_as(args, at_once, false)
}

/// The same, but ground, places of forests and flight do not depend on how many trees there are: to compare numbers.
pub fn prepare_one_landscape(args: &FlyArgs) -> ToolResult<Plan> {
    prepare_as(args, false, true)
}

fn prepare_as(args: &FlyArgs, at_once: bool, one_landscape: bool) -> ToolResult<Plan> {
    let start = Instant::now();
    let ground = ground(args)?;
    // Before the bakes: without an adapter they would take minutes in vain.
    let atmosphere = atmosphere(args)?;
    let biomes = match args.trees {
        // Few trees still make closed forests, of which there are fewer.
        Some(total) if !one_landscape => BiomeSettings::default().for_trees(total, ground.side_m()),
        _ => BiomeSettings::default(),
    };
    let biomes = BiomeSettings { seed: args.seed, ..biomes };
    let biomes = Arc::new(Biomes::new(&*ground, &biomes));
    let mut landscape = Landscape::new(ground.clone(), biomes.clone());
    let made = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let members = if args.no_forest { vec![] } else { roster::bake(args, at_once)? };
    let baked = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let mut scatter = None;
    // What the way keeps clear of.
    let mut obstacles = None;
    if !members.is_empty() {
        let amount = match (args.trees, args.density) {
            (Some(total), _) => TreeAmount::Total(total),
            (None, density) => TreeAmount::PerHectare(density.unwrap_or(220.0)),
        };
        let plant = |amount: TreeAmount| -> ToolResult<Scatter> {
            let settings = ScatterSettings {
                seed: args.seed,
                amount,
                season: args.season,
                max_bytes: tree_bytes(args.memory, args.tree_distance, ground.side_m()),
                cover_per_m2: 2.4,
                ..default()
            };
            let species = members.iter().map(|member| member.scatter.clone()).collect();
            let made = Scatter::new(ground.clone(), biomes.clone(), species, settings);
            made.map_err(|error| match error {
                ScatterError::Memory { .. } => {
                    message(format!("{error} (--memory sets the bound)"))
                }
                error => message(error),
            })
        };
        let made = plant(amount)?;
        let shade = Arc::new(ForestShade::new(made.clone()));
        landscape.shade = Some(shade.clone());
        obstacles = Some(match one_landscape {
            true => Arc::new(ForestShade::new(plant(TreeAmount::Total(MOST_TREES))?)),
            false => shade,
        });
        scatter = Some(made);
    }
    let scattered = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let crowns = |min: Vec2, max: Vec2| -> Vec<Crown> {
        let mut found = vec![];
        if let Some(obstacles) = &obstacles {
            obstacles.crowns(min, max, &mut found);
        }
        found
    };
    let settings = FlightSettings { seed: args.seed, ..default() };
    let flight = FlightPath::over(&*ground, &biomes, &crowns, &settings);
    println!(
        "{:.0} km of ground in {made:.1} s, {} species in {baked:.1} s, {} trees in {scattered:.1} s, a way of {:.1} km in {:.1} s",
        ground.side_m() / 1000.0,
        members.len(),
        scatter.as_ref().map_or(0.0, |s| s.expected_trees().round()),
        flight.length_m() / 1000.0,
        start.elapsed().as_secs_f64()
    );
    Ok(Plan { landscape, scatter, members, flight, atmosphere })
}

/// Puts it all into an app. `wait`: every frame has all that it needs, however long that takes.
pub fn build(app: &mut App, args: &FlyArgs, plan: Plan, wait: bool) {
    app.add_plugins((TerrainPlugin, PlantingPlugin));
    app.insert_resource(plan.landscape)
        .insert_resource(TerrainLod {
            memory_mb: (args.memory / 4).clamp(64, 1024),
            wait,
            ..default()
        })
        .insert_resource(PlantingSettings {
            max_trees: (args.memory as usize * (1 << 20)) / TREE_BYTES,
            tree_distance_m: args.tree_distance,
            wait,
            ..default()
        })
        .insert_resource(Sky {
            time: TimeOfDay::at(args.hour),
            kind: if plan.atmosphere { SkyKind::None } else { SkyKind::Gradient },
            visibility_m: Some(args.visibility),
            ..default()
        })
        .insert_resource(UploadBudget { bytes_per_frame: (!wait).then_some(UPLOAD_BYTES) })
        .insert_resource(HasAtmosphere(plan.atmosphere))
        .insert_resource(Flight(plan.flight))
        .insert_resource(Roster(plan.members.iter().map(|m| m.scatter.name.clone()).collect()));
    let world = app.world_mut();
    world.resource_mut::<NearMeshes>().max_trees = args.near_meshes;
    if let Some(scatter) = plan.scatter {
        let kinds = roster::plant(world, &plan.members);
        world.insert_resource(Kinds {
            kinds: kinds.clone(),
            has_mesh: plan.members.iter().map(|member| member.has_mesh).collect(),
        });
        let forest = PlantedForest::new(Arc::new(scatter));
        world.insert_resource(Planting::new(forest, &kinds));
    }
    world.insert_resource(DirectionalLightShadowMap { size: 2048 });
    world.spawn((
        Sun,
        DirectionalLight { shadow_maps_enabled: args.shadow_maps, ..default() },
        CascadeShadowConfigBuilder {
            num_cascades: 2,
            maximum_distance: 120.0,
            first_cascade_far_bound: 30.0,
            ..default()
        }
        .build(),
    ));
}

/// Spawns the camera, with haze in the colour of the sky.
pub fn camera(world: &mut World, args: &FlyArgs) -> Entity {
    let camera = world.spawn((
        scene::plain_camera(),
        // Trees behind hills and near meshes are rejected point by point, and hidden ground is not shaded.
        DepthPrepass,
        // A prepass of depth alone cannot dither, so meshes would not fade in.
        NormalPrepass,
        Projection::Perspective(PerspectiveProjection {
            fov: std::f32::consts::FRAC_PI_4 * 1.15,
            far: 100_000.0,
            ..default()
        }),
        TreelineSettings {
            quality: args.quality,
            min_mesh_distance: args.mesh_distance,
            // Inside forests every tree in sight gets its points, hidden by others or not.
            point_capacity_millions: 96.0,
            ..default()
        },
    ));
    let camera = camera.id();
    world.entity_mut(camera).insert(Tonemapping::AcesFitted);
    let points = args.budget_points.map(|n| GovernorBudget::Points(n as u32));
    if let Some(budget) = points.or(args.budget_ms.map(GovernorBudget::GpuMillis)) {
        world.entity_mut(camera).insert(QualityGovernor::new(budget));
    }
    if world.resource::<HasAtmosphere>().0 {
        let medium = ScatteringMedium::earth(256, 256);
        let medium = world.resource_mut::<Assets<ScatteringMedium>>().add(medium);
        world.spawn(Atmosphere::earth(medium));
        // Its own haze takes the place of the fog.
        world.entity_mut(camera).insert((Hdr, AtmosphereSettings::default()));
    } else {
        // Colour and density follow the sky.
        world.entity_mut(camera).insert(DistanceFog::default());
    }
    camera
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_bounds_the_trees_within_reach_not_those_of_the_world() {
        assert_eq!(tree_bytes(64, 9_000.0, 16_000.0), 64 << 20);
        // A quarter of the side either way: a quarter of the ground.
        assert_eq!(tree_bytes(64, 4_000.0, 16_000.0), 4 * (64 << 20));
    }
}
