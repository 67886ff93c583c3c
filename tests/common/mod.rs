//! What the rendering tests share: a headless app that draws frame by frame, trees to draw, pictures and their error.

#![allow(dead_code, reason = "each test file uses a part")]

use bevy::{
    camera::RenderTarget,
    core_pipeline::tonemapping::{DebandDither, Tonemapping},
    log::LogPlugin,
    prelude::*,
    render::{
        RenderApp, RenderPlugin,
        pipelined_rendering::PipelinedRenderingPlugin,
        render_asset::RenderAssets,
        render_resource::{
            BufferDescriptor, BufferUsages, Extent3d, MapMode, PollType, TexelCopyBufferInfo,
            TexelCopyBufferLayout, TextureFormat, TextureUsages, WgpuFeatures, WgpuLimits,
        },
        renderer::{RenderDevice, RenderQueue},
        settings::{Backends, RenderCreation, WgpuSettings},
        texture::GpuImage,
    },
    window::ExitCondition,
};
use bevy_treeline::{
    BakeSettings, CacheLocation, SplatPath, TreeAsset, TreelineCounters, TreelinePlugin,
    ViewCounters,
    asset::{NearMesh, NearMeshPiece},
    bake::{BakeContext, Baked, bake_file, near_mesh_sources},
    gpu::headless::headless_device,
    render::{SplatSupport, pipeline_states},
};
use image::RgbaImage;
use std::{
    path::PathBuf,
    sync::{
        Mutex, MutexGuard, OnceLock, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
};

/// Trees to draw: name here, file in `assets/trees`, and longest side of their LDIs.
const TREES: [(&str, &str, u32); 4] = [
    ("oak", "oak", 128),
    ("birch", "birch", 128),
    ("spruce", "spruce", 128),
    ("fine spruce", "spruce", 512),
];

/// One of [`TREES`], baked once per test program.
pub fn baked(name: &str) -> &'static Baked {
    static BAKED: [OnceLock<Baked>; TREES.len()] = [const { OnceLock::new() }; TREES.len()];
    let found = TREES.iter().position(|(n, _, _)| *n == name).expect("it is one of `TREES`");
    BAKED[found].get_or_init(|| {
        let (_, file, ldi_size) = TREES[found];
        let root = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
        let path = root.join("assets/trees").join(file).with_extension("glb");
        let settings = BakeSettings { ldi_size, ..default() };
        let baked = bake_file(&path, &settings, &BakeContext::default(), &|_, _| ());
        baked.expect("the trees of this project bake")
    })
}

/// One test draws at a time: several devices of a software driver at once are slow.
fn turn() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the adapter can do; `None` without one.
fn adapter() -> Option<&'static (WgpuFeatures, WgpuLimits)> {
    static FOUND: OnceLock<Option<(WgpuFeatures, WgpuLimits)>> = OnceLock::new();
    let find = || headless_device().ok().map(|(a, _, _)| (a.features(), a.limits()));
    FOUND.get_or_init(find).as_ref()
}

/// Whether there is a GPU (or a software driver) for a splat path. Says so if not, and fails under `REQUIRE_GPU=1` if
/// there is none at all.
fn can_draw(test: &str, splat_path: SplatPath) -> bool {
    let Some((features, limits)) = adapter() else {
        let required = std::env::var("REQUIRE_GPU").as_deref() == Ok("1");
        assert!(!required, "REQUIRE_GPU=1, but there is no adapter for {test}");
        println!("SKIPPED {test} (no adapter)");
        return false;
    };
    if let SplatSupport::Off { reason } = SplatSupport::of(splat_path, *features, limits) {
        println!("SKIPPED {test} ({reason})");
        return false;
    }
    true
}

/// A headless app and the right to draw.
pub struct Stage {
    pub app: App,
    _turn: MutexGuard<'static, ()>,
}

impl Stage {
    /// An app with the plugin; `None` without an adapter for that splat path.
    pub fn new(test: &str, splat_path: SplatPath) -> Option<Self> {
        Self::with(test, splat_path, |_| ())
    }

    /// The same with more plugins.
    pub fn with(test: &str, splat_path: SplatPath, add: impl FnOnce(&mut App)) -> Option<Self> {
        let turn = turn();
        can_draw(test, splat_path).then(|| Self { app: headless_app(splat_path, add), _turn: turn })
    }

    pub fn world(&mut self) -> &mut World {
        self.app.world_mut()
    }

    /// Draws frames, each until the GPU is done.
    pub fn step(&mut self, frames: u32) {
        for _ in 0..frames {
            self.app.update();
            let device = self.app.world().resource::<RenderDevice>();
            device.wgpu_device().poll(PollType::wait_indefinitely()).expect("the device works");
        }
    }

    /// A picture to draw into.
    pub fn target(&mut self, size: UVec2) -> Handle<Image> {
        let format = TextureFormat::Rgba8UnormSrgb;
        let mut image = Image::new_target_texture(size.x, size.y, format, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        self.world().resource_mut::<Assets<Image>>().add(image)
    }

    /// A camera that draws into `image` and sees what lies before `at`.
    pub fn camera(&mut self, image: &Handle<Image>, at: Transform) -> Entity {
        self.world().spawn((plain_camera(), RenderTarget::from(image.clone()), at)).id()
    }

    /// The same with a new picture of `size`.
    pub fn view(&mut self, size: UVec2, at: Transform) -> (Entity, Handle<Image>) {
        let image = self.target(size);
        (self.camera(&image, at), image)
    }

    /// Draws `frames` and takes the picture.
    pub fn shoot(&mut self, image: &Handle<Image>, frames: u32) -> RgbaImage {
        self.step(frames);
        self.capture(image)
    }

    /// A baked tree as an asset.
    pub fn tree(&mut self, name: &str, with_mesh: bool) -> Handle<TreeAsset> {
        let baked = baked(name);
        let near_mesh = with_mesh.then(|| {
            let mesh = self.near_mesh(name);
            self.world().resource_mut::<Assets<NearMesh>>().add(mesh)
        });
        let asset = TreeAsset { data: baked.data.clone(), near_mesh };
        self.world().resource_mut::<Assets<TreeAsset>>().add(asset)
    }

    /// The model's meshes and materials, centred on the middle of its box.
    pub fn near_mesh(&mut self, name: &str) -> NearMesh {
        let world = self.app.world_mut();
        let Baked { model, data, .. } = baked(name);
        let parts = near_mesh_sources(model, data.is_shaded()).into_iter().map(|source| {
            let mut material = source.material;
            let image = source.texture.map(|t| world.resource_mut::<Assets<Image>>().add(t));
            material.base_color_texture = image;
            NearMeshPiece {
                mesh: world.resource_mut::<Assets<Mesh>>().add(source.mesh),
                material: world.resource_mut::<Assets<StandardMaterial>>().add(material),
                center: source.center,
                half_extents: source.half_extents,
            }
        });
        NearMesh { parts: parts.collect() }
    }

    /// A box of one colour.
    pub fn cuboid(&mut self, size: Vec3, material: StandardMaterial, at: Vec3) -> Entity {
        let world = self.app.world_mut();
        let mesh = world.resource_mut::<Assets<Mesh>>().add(Cuboid::from_size(size));
        let material = world.resource_mut::<Assets<StandardMaterial>>().add(material);
        let place = Transform::from_translation(at);
        world.spawn((Mesh3d(mesh), MeshMaterial3d(material), place)).id()
    }

    /// Sky light, and a sun that shines along `direction`.
    pub fn light(&mut self, direction: Vec3, shadows: bool) -> Entity {
        let color = Color::srgb(0.78, 0.88, 1.0);
        self.world().insert_resource(GlobalAmbientLight { color, brightness: 700.0, ..default() });
        let sun = DirectionalLight {
            illuminance: 9_000.0,
            color: Color::srgb(1.0, 0.95, 0.86),
            shadow_maps_enabled: shadows,
            ..default()
        };
        self.world().spawn((sun, Transform::default().looking_to(direction, Vec3::Z))).id()
    }

    /// What a camera's view drew in the newest frame that came back.
    pub fn counters(&self, camera: Entity) -> ViewCounters {
        self.find_counters(camera).expect("counters have come back")
    }

    pub fn find_counters(&self, camera: Entity) -> Option<ViewCounters> {
        self.app.world().resource::<TreelineCounters>().of(camera)
    }

    /// Pipelines of this crate that are ready, and what is wrong with others.
    pub fn pipelines(&self) -> (usize, Vec<String>) {
        pipeline_states(self.app.get_sub_app(RenderApp).expect("there is a renderer").world())
    }

    /// The pixels of a target.
    pub fn capture(&self, target: &Handle<Image>) -> RgbaImage {
        let render = self.app.get_sub_app(RenderApp).expect("there is a renderer").world();
        let images = render.resource::<RenderAssets<GpuImage>>();
        let texture = &images.get(target).expect("the target was drawn").texture;
        let (device, queue) = (render.resource::<RenderDevice>(), render.resource::<RenderQueue>());
        let (width, height) = (texture.width(), texture.height());
        let row = RenderDevice::align_copy_bytes_per_row(width as usize * 4);
        let buffer = device.create_buffer(&BufferDescriptor {
            label: Some("capture"),
            size: row as u64 * u64::from(height),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let layout = TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row as u32),
            rows_per_image: None,
        };
        let mut encoder = device.create_command_encoder(&default());
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            TexelCopyBufferInfo { buffer: &buffer, layout },
            Extent3d { width, height, depth_or_array_layers: 1 },
        );
        queue.submit([encoder.finish()]);
        buffer.slice(..).map_async(MapMode::Read, |result| result.expect("the copy is mapped"));
        device.wgpu_device().poll(PollType::wait_indefinitely()).expect("the device works");
        let bytes = buffer.slice(..).get_mapped_range();
        let rows = bytes.chunks_exact(row).flat_map(|r| &r[..width as usize * 4]);
        RgbaImage::from_raw(width, height, rows.copied().collect()).expect("the size is right")
    }
}

fn headless_app(splat_path: SplatPath, add: impl FnOnce(&mut App)) -> App {
    // The log can be set up once in a process.
    static LOGGING: AtomicBool = AtomicBool::new(false);
    let mut settings = WgpuSettings::default();
    // Without DX12 among the backends, Bevy does not validate indirect draws in release builds.
    if cfg!(target_os = "linux") && std::env::var("WGPU_BACKEND").is_err() {
        settings.backends = Some(Backends::VULKAN);
    }
    let plugins = DefaultPlugins
        .set(WindowPlugin {
            primary_window: None,
            exit_condition: ExitCondition::DontExit,
            ..default()
        })
        .set(LogPlugin { filter: "warn,wgpu=error,symphonia=error".into(), ..default() })
        .set(RenderPlugin {
            render_creation: RenderCreation::from(settings),
            synchronous_pipeline_compilation: true,
            ..default()
        })
        .disable::<PipelinedRenderingPlugin>();
    #[cfg(feature = "app")]
    let plugins = plugins.disable::<bevy::winit::WinitPlugin>();
    let logs = LOGGING.swap(true, Ordering::Relaxed);
    let plugins = if logs { plugins.disable::<LogPlugin>() } else { plugins };
    let mut app = App::new();
    app.add_plugins(plugins)
        .add_plugins(TreelinePlugin { splat_path, cache: CacheLocation::Off, ..default() })
        // Alpha 0 where nothing is drawn, so that pictures carry their coverage.
        .insert_resource(ClearColor(Color::NONE));
    add(&mut app);
    app.finish();
    app.cleanup();
    app
}

/// A camera whose pictures are the same each time: no dither, no multisampling, a tone curve without a table.
pub fn plain_camera() -> impl Bundle {
    (Camera3d::default(), Msaa::Off, Tonemapping::AcesFitted, DebandDither::Disabled)
}

/// The place at `distance` before the middle of a tree that stands at the origin, looking at it.
pub fn before(name: &str, distance: f32) -> Transform {
    let middle = baked(name).data.bounds.center();
    Transform::from_translation(middle + Vec3::Z * distance).looking_at(middle, Vec3::Y)
}

/// Mean FLIP error over the whole picture, alpha left out.
pub fn flip(reference: &RgbaImage, test: &RgbaImage) -> f32 {
    flip_map(reference, test).0
}

/// Mean FLIP error and the error of each pixel in the colours of magma.
pub fn flip_map(reference: &RgbaImage, test: &RgbaImage) -> (f32, RgbaImage) {
    let (width, height) = reference.dimensions();
    assert_eq!((width, height), test.dimensions(), "the pictures have one size");
    let rgb = |image: &RgbaImage| {
        let bytes: Vec<u8> = image.pixels().flat_map(|p| [p[0], p[1], p[2]]).collect();
        nv_flip::FlipImageRgb8::with_data(width, height, &bytes)
    };
    let map = nv_flip::flip(rgb(reference), rgb(test), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    let errors = map.to_vec();
    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
    let colors = map.apply_color_lut(&nv_flip::magma_lut()).to_vec();
    let rgba = colors.chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]).collect();
    (mean, RgbaImage::from_raw(width, height, rgba).expect("the map has the pictures' size"))
}

/// Part of a picture.
pub fn crop(image: &RgbaImage, origin: UVec2, size: UVec2) -> RgbaImage {
    image::imageops::crop_imm(image, origin.x, origin.y, size.x, size.y).to_image()
}

/// Pixels covered, as the sum of alpha.
pub fn coverage(image: &RgbaImage) -> f32 {
    image.pixels().map(|p| f32::from(p[3]) / 255.0).sum()
}

/// Mean sRGB of the pixels that are wholly covered, 0 to 255.
pub fn mean_color(image: &RgbaImage) -> Vec3 {
    let covered: Vec<Vec3> = image
        .pixels()
        .filter(|p| p[3] == 255)
        .map(|p| Vec3::new(f32::from(p[0]), f32::from(p[1]), f32::from(p[2])))
        .collect();
    assert!(!covered.is_empty(), "something is drawn");
    covered.iter().sum::<Vec3>() / covered.len() as f32
}
