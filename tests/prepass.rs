//! Points in Bevy's prepass textures: depth, normals and motion vectors.

mod common;

use bevy::{
    core_pipeline::prepass::{
        DepthPrepass, MotionVectorPrepass, NormalPrepass, ViewPrepassTextures,
    },
    math::Vec4Swizzles,
    prelude::*,
    render::{
        RenderApp,
        render_resource::{PollType, TextureView},
        renderer::{RenderDevice, RenderQueue},
        sync_world::RenderEntity,
    },
};
use bevy_treeline::{SplatPath, TreeImpostor};
use common::{Stage, baked, before};

const SIZE: UVec2 = UVec2::new(96, 80);
const TREE: &str = "oak";
/// Frames until everything is loaded and drawn.
const LOADED: u32 = 3;

/// The prepass of a camera, read back: a texel a pixel, row by row.
struct Prepass {
    depth: Vec<f32>,
    normals: Vec<Vec4>,
    motion: Vec<Vec2>,
}

/// Reads a texture that may only be sampled.
fn read_texels(
    device: &RenderDevice,
    queue: &RenderQueue,
    view: &TextureView,
    is_depth: bool,
) -> Vec<Vec4> {
    let device = device.wgpu_device();
    let kind = if is_depth { "texture_depth_2d" } else { "texture_2d<f32>" };
    let value =
        if is_depth { "vec4(textureLoad(image, at, 0))" } else { "textureLoad(image, at, 0)" };
    let source = format!(
        "@group(0) @binding(0) var image: {kind};
        @group(0) @binding(1) var<storage, read_write> texels: array<vec4<f32>>;
        @compute @workgroup_size(1)
        fn read(@builtin(global_invocation_id) id: vec3<u32>) {{
            let at = id.xy;
            texels[at.y * {}u + at.x] = {value};
        }}",
        SIZE.x
    );
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("read"),
        compilation_options: Default::default(),
        cache: None,
    });
    let size = u64::from(SIZE.x * SIZE.y) * 16;
    let buffer = |usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    let written = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let readback = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: wgpu::BindingResource::TextureView(view) },
            wgpu::BindGroupEntry { binding: 1, resource: written.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&default());
    {
        let mut pass = encoder.begin_compute_pass(&default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(SIZE.x, SIZE.y, 1);
    }
    encoder.copy_buffer_to_buffer(&written, 0, &readback, 0, size);
    queue.submit([encoder.finish()]);
    readback.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the buffer maps"));
    device.poll(PollType::wait_indefinitely()).expect("the device answers");
    let bytes = readback.slice(..).get_mapped_range();
    bytemuck::cast_slice::<u8, [f32; 4]>(&bytes).iter().map(|t| Vec4::from_array(*t)).collect()
}

fn read_prepass(stage: &Stage, camera: Entity) -> Prepass {
    let entity = stage.app.world().get::<RenderEntity>(camera).expect("it is drawn").id();
    let render = stage.app.get_sub_app(RenderApp).expect("there is a renderer").world();
    let (device, queue) = (render.resource::<RenderDevice>(), render.resource::<RenderQueue>());
    let textures = render.get::<ViewPrepassTextures>(entity).expect("it has a prepass");
    let read = |view: Option<&TextureView>, is_depth| {
        view.map(|view| read_texels(device, queue, view, is_depth)).unwrap_or_default()
    };
    Prepass {
        depth: read(textures.depth_view(), true).into_iter().map(|t| t.x).collect(),
        normals: read(textures.normal_view(), false),
        motion: read(textures.motion_vectors_view(), false).into_iter().map(|t| t.xy()).collect(),
    }
}

/// The tree, a camera with every prepass, and its target.
fn planted(test: &str) -> Option<(Stage, Entity, Handle<Image>)> {
    let mut stage = Stage::new(test, SplatPath::Auto)?;
    let tree = stage.tree(TREE, false);
    stage.light(Vec3::new(-0.5, -0.7, -0.5), false);
    stage.world().spawn(TreeImpostor::new(tree));
    let (camera, image) = stage.view(SIZE, before(TREE, 22.0));
    stage.world().entity_mut(camera).insert((DepthPrepass, NormalPrepass, MotionVectorPrepass));
    Some((stage, camera, image))
}

fn clip_from_world(stage: &Stage, camera: Entity) -> Mat4 {
    let world = stage.app.world();
    let view = world.get::<GlobalTransform>(camera).expect("it has a place").to_matrix();
    world.get::<Camera>(camera).expect("it is a camera").clip_from_view() * view.inverse()
}

/// Position on the screen, -1 to 1, of a pixel's centre.
fn ndc_of(index: usize) -> Vec2 {
    let pixel = Vec2::new((index as u32 % SIZE.x) as f32, (index as u32 / SIZE.x) as f32) + 0.5;
    (pixel / SIZE.as_vec2() * 2.0 - 1.0) * Vec2::new(1.0, -1.0)
}

#[test]
fn prepass_depth_and_normals_hold_the_points_that_the_picture_shows() {
    let Some((mut stage, camera, image)) = planted("prepass_depth_and_normals") else { return };
    let picture = stage.shoot(&image, LOADED);
    let prepass = read_prepass(&stage, camera);
    let eye = stage.app.world().get::<GlobalTransform>(camera).expect("a place").translation();
    let world_from_clip = clip_from_world(&stage, camera).inverse();
    let (mut covered, mut facing) = (0, 0);
    for (i, pixel) in picture.pixels().enumerate() {
        assert_eq!(prepass.depth[i] > 0.0, pixel[3] > 0, "pixel {i}");
        if prepass.depth[i] == 0.0 {
            continue;
        }
        covered += 1;
        let position = world_from_clip.project_point3(ndc_of(i).extend(prepass.depth[i]));
        let bounds = baked(TREE).data.bounds;
        let inside = position.clamp(bounds.min - 0.1, bounds.max + 0.1);
        assert!(inside.distance(position) < 1e-3, "pixel {i} lies at {position}");
        let normal = prepass.normals[i].xyz() * 2.0 - 1.0;
        assert!((normal.length() - 1.0).abs() < 0.01, "pixel {i}: {normal}");
        facing += usize::from(normal.dot(eye - position) > 0.0);
    }
    assert!(covered > 500);
    // Shading normals of leaves may bend away from the eye; most do not.
    assert!(facing > covered * 4 / 5, "{facing} of {covered} normals face the eye");
}

#[test]
fn motion_vectors_of_a_moved_camera_point_where_pixels_came_from() {
    let Some((mut stage, camera, _)) = planted("motion_vectors") else { return };
    stage.step(LOADED);
    let (past, past_clip) = (read_prepass(&stage, camera), clip_from_world(&stage, camera));
    // A step aside, nearer, and a turn.
    let mut place = before(TREE, 20.5);
    place.translation.x += 0.6;
    place.rotate_y(-0.03);
    stage.world().entity_mut(camera).insert(place);
    stage.step(1);
    let (present, clip) = (read_prepass(&stage, camera), clip_from_world(&stage, camera));
    let (mut covered, mut found) = (0, 0);
    for i in 0..present.depth.len() {
        let depth = present.depth[i];
        if depth == 0.0 {
            continue;
        }
        covered += 1;
        let position = clip.inverse().project_point3(ndc_of(i).extend(depth));
        let then = past_clip.project_point3(position);
        let expected = (ndc_of(i) - then.xy()) * Vec2::new(0.5, -0.5);
        // Half floats.
        let difference = (present.motion[i] - expected).abs().max_element();
        assert!(difference < 2e-4, "pixel {i}: {} and not {expected}", present.motion[i]);
        assert!(expected.length() > 0.01, "everything moves");
        // What was there then has the same depth, but where something else was nearer.
        let uv = (ndc_of(i) * Vec2::new(0.5, -0.5) + 0.5) - present.motion[i];
        let texel = (uv * SIZE.as_vec2()).floor().as_ivec2();
        let around = (-1..=1).flat_map(|y| (-1..=1).map(move |x| texel + IVec2::new(x, y)));
        let is_near = |at: IVec2| {
            let inside = at.min_element() >= 0 && at.x < SIZE.x as i32 && at.y < SIZE.y as i32;
            inside
                && (past.depth[(at.y * SIZE.x as i32 + at.x) as usize] / then.z - 1.0).abs() < 0.02
        };
        found += usize::from(around.into_iter().any(is_near));
    }
    assert!(covered > 500);
    assert!(found > covered * 9 / 10, "{found} of {covered} pixels were where they say");
    // At rest again.
    stage.step(1);
    let still = read_prepass(&stage, camera);
    assert!(still.motion.iter().all(|motion| motion.abs().max_element() < 1e-5));
}

#[test]
fn a_mesh_before_points_keeps_its_place_in_the_prepass() {
    let Some((mut stage, camera, image)) = planted("a_mesh_before_points") else { return };
    stage.step(LOADED);
    let alone = read_prepass(&stage, camera);
    let wall = StandardMaterial { unlit: true, ..default() };
    stage.cuboid(Vec3::new(100.0, 2.0, 0.1), wall, before(TREE, 10.0).translation);
    stage.shoot(&image, LOADED);
    let both = read_prepass(&stage, camera);
    let hidden = std::iter::zip(&alone.depth, &both.depth).filter(|(a, b)| **a > 0.0 && a != b);
    let hidden: Vec<f32> = hidden.map(|(_, depth)| *depth).collect();
    assert!(hidden.len() > 100, "the wall hides points");
    assert!(hidden.iter().all(|depth| (depth / hidden[0] - 1.0).abs() < 0.02), "only the wall");
}

/// A multisampled prepass cannot be read back here; that it is written without errors shows in the picture.
#[test]
fn a_multisampled_camera_with_every_prepass_shows_the_same_tree() {
    let Some((mut stage, camera, image)) = planted("a_multisampled_camera") else { return };
    let plain = stage.shoot(&image, LOADED);
    stage.world().entity_mut(camera).insert(Msaa::Sample4);
    let picture = stage.shoot(&image, LOADED);
    assert!(common::flip(&plain, &picture) < 0.01, "FLIP {}", common::flip(&plain, &picture));
}
