//! The WGSL twins of `math::hash`, `math::octahedral`, `asset::surfel` and `lod::{contrast, thinning, window}` give what Rust gives. Runs on any adapter.
use bevy::{
    math::{Vec2, Vec3},
    tasks::block_on,
};
use bevy_treeline::{
    asset::{Surfel, SurfelCold, SurfelHot, light_factor},
    lod::{
        contrast::{contrast_factor, leaves_in_pixel, mean_shade, own_share},
        thinning::{FACTOR_STEPS, factor_of, factor_place},
        window::window_start,
    },
    math::{bounding::Aabb, hash, octahedral, quantize},
    shaders,
};

const LO: Vec3 = Vec3::new(-2.0, 0.5, 10.0);
const EXTENT: Vec3 = Vec3::new(4.0, 20.0, 0.25);
const COUNT: usize = 4096;
/// Numbers that the shader writes for each input.
const WRITTEN: usize = 28;

/// Calls every function of the libraries on words of random bits.
const ENTRY: &str = "
@group(0) @binding(0) var<storage, read> words: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> written: array<f32>;

@compute @workgroup_size(64)
fn call_all(@builtin(global_invocation_id) id: vec3<u32>) {
    let w = words[id.x];
    let position = surfel_position(w.x, w.y, vec3<f32>(-2.0, 0.5, 10.0), vec3<f32>(4.0, 20.0, 0.25));
    let face = surfel_face_normal(w.y);
    let normal = surfel_normal(w.z);
    let albedo = surfel_albedo(w.z, w.w);
    let square = encode(normal);
    let bits = encode_bits(normal, 8u, 7u);
    let n = f32(w.x & 0xffffu) / 16.0;
    let n0 = 1.0 + f32(w.y & 0xfffffu);
    let share = unit_from_bits(w.x);
    let place = factor_place(n, n0);
    let words = factor_words(place);
    var table: array<u32, 16>;
    for (var i = 0u; i < 16u; i++) {
        table[i] = w.z ^ (i * 0x9e3779b9u);
    }
    var values = array<f32, 28>(
        position.x, position.y, position.z, face.x, face.y, face.z, normal.x, normal.y, normal.z,
        albedo.x, albedo.y, albedo.z, f32(surfel_is_one_sided(w.y)) + 2.0 * f32(surfel_thickness(w.y)), f32(surfel_flags(w.w)), surfel_roughness(w.w),
        surfel_ambient_visibility(w.w), f32(surfel_group(w.w)) + surfel_metallic(w.w), unit_from_bits(w.x), square.x, square.y,
        f32(bits.x), f32(bits.y), surfel_light_factor(surfel_ambient_visibility(w.w)),
        f32(window_start((w.x & 0xffffu) >> (w.w & 15u), 1u + (w.y & 0xffffffu), w.z)),
        place, factor_between(table[words.x], table[words.y], place), mean_shade(2.0 * share - 1.0),
        own_share(contrast_factor(leaves_in_pixel(0.01, 3.0 * share), 1.0 + f32(w.y & 7u)), 0.75),
    );
    for (var i = 0u; i < 28u; i++) {
        written[id.x * 28u + i] = values[i];
    }
}
";

fn expected(words: [u32; 4]) -> [f32; WRITTEN] {
    let bounds = Aabb { min: LO, max: LO + EXTENT };
    let hot = SurfelHot { position_xy: words[0], position_z_face: words[1] };
    let cold = SurfelCold { normal_albedo_rg: words[2], albedo_b_misc: words[3] };
    let s = Surfel::unpack(hot, cold, &bounds);
    let square: Vec2 = octahedral::encode(s.normal);
    let bits = octahedral::encode_bits(s.normal, 8, 7).map(|b| b as f32);
    let albedo = s.albedo.map(quantize::srgb8_to_linear);
    let one_sided = (hot.position_z_face >> 31) as f32;
    let ambient = f32::from(s.ambient_visibility) / 255.0;
    let count = (words[0] & 0xffff) >> (words[3] & 15);
    let window = window_start(count, 1 + (words[1] & 0xff_ffff), words[2]);
    let (few, all) = ((words[0] & 0xffff) as f32 / 16.0, 1.0 + (words[1] & 0xf_ffff) as f32);
    let share = hash::unit_from_bits(words[0]);
    let table: [f32; FACTOR_STEPS] = std::array::from_fn(|step| {
        let word = words[2] ^ (step as u32 / 2).wrapping_mul(0x9e37_79b9);
        (word >> (16 * (step & 1)) & 0xffff) as f32 / 16_384.0
    });
    let leaves = leaves_in_pixel(0.01, 3.0 * share);
    let contrast = contrast_factor(leaves, 1.0 + (words[1] & 7) as f32);
    let (p, f, n) = (s.position, s.face_normal, s.normal);
    #[rustfmt::skip] // in the order of the shader
    let values = [
        p.x, p.y, p.z, f.x, f.y, f.z, n.x, n.y, n.z,
        albedo[0], albedo[1], albedo[2], one_sided + 2.0 * f32::from(s.thickness), f32::from(s.flags), s.roughness,
        ambient, f32::from(s.group) + s.metallic, hash::unit_from_bits(words[0]), square.x, square.y,
        bits[0], bits[1], light_factor(ambient), window as f32,
        factor_place(few, all), factor_of(&table, few, all), mean_shade(2.0 * share - 1.0), own_share(contrast, 0.75),
    ];
    values
}

/// An adapter's device, or `None` with a line that says so; a failure under `REQUIRE_GPU=1`.
fn device() -> Option<(wgpu::Device, wgpu::Queue)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let found = block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default()));
    let device = found
        .ok()
        .and_then(|a| block_on(a.request_device(&wgpu::DeviceDescriptor::default())).ok());
    if device.is_none() {
        assert!(
            std::env::var("REQUIRE_GPU").as_deref() != Ok("1"),
            "REQUIRE_GPU=1, but there is no adapter"
        );
        println!("SKIPPED shader_library_parity: no adapter");
    }
    device
}

/// The libraries and the entry point as one plain module.
fn source() -> String {
    let library = |url: &str| {
        let (_, source) =
            shaders::ALL.iter().find(|(path, _)| url.ends_with(path)).expect("it is embedded");
        let plain = source
            .lines()
            .filter(|l| !l.starts_with('#'))
            .map(|l| format!("{l}\n"))
            .collect::<String>();
        plain.replace("octahedral::", "")
    };
    [shaders::HASH, shaders::OCTAHEDRAL, shaders::SURFEL, shaders::LOD, shaders::CONTRAST]
        .map(library)
        .concat()
        + ENTRY
}

fn run(device: &wgpu::Device, queue: &wgpu::Queue, words: &[[u32; 4]]) -> Vec<f32> {
    let buffer = |size: usize, usage| {
        let size = size as u64;
        device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    let bytes: &[u8] = bytemuck::cast_slice(words);
    let size = words.len() * WRITTEN * 4;
    let input = buffer(bytes.len(), wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST);
    let output = buffer(size, wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
    let readback = buffer(size, wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
    queue.write_buffer(&input, 0, bytes);

    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("call_all"),
        source: wgpu::ShaderSource::Wgsl(source().into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("call_all"),
        layout: None,
        module: &module,
        entry_point: Some("call_all"),
        compilation_options: Default::default(),
        cache: None,
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: input.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: output.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    {
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups(words.len() as u32 / 64, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&output, 0, &readback, 0, size as u64);
    queue.submit([encoder.finish()]);
    readback.slice(..).map_async(wgpu::MapMode::Read, |result| result.expect("the buffer maps"));
    device.poll(wgpu::PollType::wait_indefinitely()).expect("the device answers");
    bytemuck::cast_slice(&readback.slice(..).get_mapped_range()).to_vec()
}

#[test]
fn wgsl_and_rust_compute_the_same() {
    let Some((device, queue)) = device() else { return };
    let mut random = hash::SplitMix64(1);
    let words: Vec<[u32; 4]> =
        (0..COUNT).map(|_| std::array::from_fn(|_| (random.next_u64() >> 32) as u32)).collect();
    let found = run(&device, &queue, &words);
    assert_eq!(found.len(), COUNT * WRITTEN);
    for (words, found) in words.iter().zip(found.chunks_exact(WRITTEN)) {
        for (i, (expected, found)) in std::iter::zip(expected(*words), found).enumerate() {
            let tolerance = match i {
                // Whole numbers and hashes: to the bit.
                12 | 13 | 16 | 17 | 23 => 0.0,
                // Rounded numbers: a step, where the rounded value lies between two.
                20 | 21 => 1.0,
                // Logarithms of numbers up to a million, and arc cosines.
                24 => 1e-3,
                25 => 4e-3,
                26 | 27 => 5e-4,
                _ => 2e-5,
            };
            let difference = (expected - found).abs();
            assert!(
                difference <= tolerance,
                "{words:08x?}, number {i}: Rust {expected}, WGSL {found}"
            );
        }
    }
}
