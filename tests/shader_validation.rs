//! Every entry point composes with its imports, Bevy's included, and passes naga, under every def set it is used with.
//! Needs no GPU. All failures are reported at once.
use bevy_treeline::shaders;
use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, NagaModuleDescriptor, ShaderDefValue,
    get_preprocessor_data,
};
use std::{
    collections::{BTreeMap, HashMap},
    fs,
    path::{Path, PathBuf},
    process::Command,
};

type Defs = HashMap<String, ShaderDefValue>;
/// Name and value, short to write in a table.
type Def = (&'static str, ShaderDefValue);

const fn on(name: &'static str) -> Def {
    (name, ShaderDefValue::Bool(true))
}

const fn uint(name: &'static str, value: u32) -> Def {
    (name, ShaderDefValue::UInt(value))
}

/// What Bevy sets for every shader (`PipelineCache`), and for those that import `bevy_pbr::pbr_functions`
/// (`bevy::pbr::MATERIAL_BIND_GROUP_INDEX`; needed even without a material).
const EVERYWHERE: &[Def] = &[
    uint("AVAILABLE_STORAGE_BUFFER_BINDINGS", 8),
    uint("MATERIAL_BIND_GROUP", 3),
    // This crate's own constants (`render::{select,resolve}`).
    uint("SELECT_WORKGROUP", bevy_treeline::gpu::types::SELECT_WORKGROUP),
    uint("POINTS_PER_ITEM", bevy_treeline::gpu::types::POINTS_PER_ITEM),
    uint("RESOLVE_BLOCK", bevy_treeline::gpu::types::RESOLVE_BLOCK),
];

/// What Bevy sets on one of its modules as it loads it (`MeshRenderPlugin`).
const OF_MODULES: &[(&str, &[Def])] = &[(
    "bevy_pbr::mesh_view_types",
    &[
        uint("MAX_DIRECTIONAL_LIGHTS", 10),
        uint("MAX_CASCADES_PER_LIGHT", 4),
        uint("MAX_RECT_LIGHTS", 8),
    ],
)];

/// The def sets each shader is used with at run time, by its path below `shaders/`. One without a row is tried once,
/// with none of its own.
#[rustfmt::skip] // one row a line
const DEF_SETS: &[(&str, &[&[Def]])] = &[
    ("select/cull_blocks.wgsl", PHASES),
    ("select/cull_clusters.wgsl", PHASES),
    ("select/cull_instances.wgsl", PHASES),
    ("splat/splat_u64.wgsl", SPLATS),
    ("splat/splat_depth.wgsl", SPLATS),
    ("splat/splat_payload.wgsl", SPLATS),
    ("resolve/resolve.wgsl", SUNLIGHTS),
    ("resolve/resolve.wgsl", VIEWS),
    ("resolve/resolve.wgsl", FOGS),
    ("resolve/resolve.wgsl", DEBUG_VIEWS),
    ("resolve/resolve_samples.wgsl", VIEWS),
    ("resolve/resolve_samples.wgsl", EDGES),
    ("prepass/write_prepass.wgsl", POINT_PREPASSES),
    ("near/light_near.wgsl", DEFERRED_LIGHTS),
    ("temporal/accumulate.wgsl", &[&[], &[on("HIGH_DYNAMIC_RANGE")]]),
    ("landscape/ground.wgsl", VIEWS),
    ("landscape/sky.wgsl", VIEWS),
    ("landscape/ground_prepass.wgsl", PREPASSES),
];

/// The phases of selection.
const PHASES: &[&[Def]] = &[&[], &[on("SELECT_SECOND")]];

/// What splat pipelines draw, and how.
const SPLATS: &[&[Def]] = &[
    &[],
    &[on("SPLAT_SECOND"), on("SPLAT_PARALLEL")],
    &[on("SPLAT_GROVES")],
    &[on("SPLAT_DISCS")],
    &[on("SPLAT_SQUARES"), on("SPLAT_GROVES")],
    &[on("SPLAT_MIXED"), on("SPLAT_SECOND")],
];

/// Light without lamps; contrast correction of it and of colours alone.
const SUNLIGHTS: &[&[Def]] = &[
    &[on("VIEW_PROJECTION_PERSPECTIVE"), on("TREELINE_SUNLIGHT")],
    &[
        on("MULTISAMPLED"),
        on("VIEW_PROJECTION_PERSPECTIVE"),
        on("SHADOW_FILTER_METHOD_GAUSSIAN"),
        on("TREELINE_SUNLIGHT"),
        on("TREELINE_SUN_SHADOWS"),
    ],
    &[on("VIEW_PROJECTION_PERSPECTIVE"), on("TREELINE_SUNLIGHT"), on("TREELINE_CONTRAST")],
    &[on("VIEW_PROJECTION_ORTHOGRAPHIC"), on("TREELINE_CONTRAST")],
];

/// The same in Bevy's deferred lighting.
const DEFERRED_LIGHTS: &[&[Def]] = &[
    &[
        on("DEFERRED_PREPASS"),
        on("DEPTH_PREPASS"),
        on("VIEW_PROJECTION_PERSPECTIVE"),
        on("TREELINE_SUNLIGHT"),
    ],
    &[
        on("DEFERRED_PREPASS"),
        on("VIEW_PROJECTION_ORTHOGRAPHIC"),
        on("DISTANCE_FOG"),
        on("SHADOW_FILTER_METHOD_GAUSSIAN"),
        on("TREELINE_SUNLIGHT"),
        on("TREELINE_SUN_SHADOWS"),
    ],
];

/// Def sets of Bevy's prepasses (`PrepassPipeline::specialize`).
const PREPASSES: &[&[Def]] = &[
    // Depth alone has no fragment shader.
    &[on("PREPASS_PIPELINE"), on("DEPTH_PREPASS")],
    &[on("PREPASS_PIPELINE"), on("DEPTH_PREPASS"), on("PREPASS_FRAGMENT"), on("NORMAL_PREPASS")],
    &[
        on("PREPASS_PIPELINE"),
        on("PREPASS_FRAGMENT"),
        on("NORMAL_PREPASS"),
        on("MOTION_VECTOR_PREPASS"),
        on("DEFERRED_PREPASS"),
        on("UNCLIPPED_DEPTH_ORTHO_EMULATION"),
    ],
];

/// Def sets of Bevy's mesh view (`MeshPipeline::specialize`) that a pass in Bevy's main pass meets. For `DEF_SETS` rows of
/// such a shader.
const VIEWS: &[&[Def]] = &[
    // Hdr, no post-processing in the shader.
    &[on("MULTISAMPLED"), on("VIEW_PROJECTION_PERSPECTIVE"), on("SHADOW_FILTER_METHOD_GAUSSIAN")],
    // Everything that adds bindings.
    &[
        on("DEPTH_PREPASS"),
        on("NORMAL_PREPASS"),
        on("MOTION_VECTOR_PREPASS"),
        on("VIEW_PROJECTION_PERSPECTIVE"),
        on("ENVIRONMENT_MAP"),
        on("SCREEN_SPACE_AMBIENT_OCCLUSION"),
        on("SHADOW_FILTER_METHOD_TEMPORAL"),
        on("TEMPORAL_JITTER"),
        on("DISTANCE_FOG"),
    ],
    // Without Hdr: tonemapping in the shader.
    &[
        on("TONEMAP_IN_SHADER"),
        uint("TONEMAPPING_LUT_TEXTURE_BINDING_INDEX", 27),
        uint("TONEMAPPING_LUT_SAMPLER_BINDING_INDEX", 28),
        on("TONEMAP_METHOD_TONY_MC_MAPFACE"),
        on("DEBAND_DITHER"),
        on("VIEW_PROJECTION_ORTHOGRAPHIC"),
        on("SHADOW_FILTER_METHOD_HARDWARE_2X2"),
    ],
];

/// Kinds of fog that resolve computes itself: squared or not, with the sun's glow or without.
const FOGS: &[&[Def]] = &[&fog(0, 0), &fog(0, 1), &fog(1, 0), &fog(1, 1)];

const fn fog(squared: u32, glow: u32) -> [Def; 5] {
    [
        on("DISTANCE_FOG"),
        on("VIEW_PROJECTION_PERSPECTIVE"),
        on("TREELINE_FOG"),
        uint("TREELINE_FOG_SQUARED", squared),
        uint("TREELINE_FOG_GLOW", glow),
    ]
}

/// The draw of pixels that points cover in part.
const EDGES: &[&[Def]] = &[&[on("TREELINE_EDGES"), on("VIEW_PROJECTION_PERSPECTIVE")]];

/// What points write of Bevy's prepasses.
const POINT_PREPASSES: &[&[Def]] = &[
    &[uint("SAMPLES_PER_SIDE", 1)],
    &[uint("SAMPLES_PER_SIDE", 2), on("NORMAL_PREPASS")],
    &[uint("SAMPLES_PER_SIDE", 1), on("NORMAL_PREPASS"), on("MOTION_VECTOR_PREPASS")],
];

/// Debug views of resolve.
const DEBUG_VIEWS: &[&[Def]] = &[
    &[on("VIEW_PROJECTION_PERSPECTIVE"), uint("TREELINE_DEBUG_VIEW", 1)],
    &[on("VIEW_PROJECTION_ORTHOGRAPHIC"), on("MULTISAMPLED"), uint("TREELINE_DEBUG_VIEW", 8)],
];

fn defs(sets: &[&[Def]]) -> Defs {
    sets.iter().copied().flatten().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

/// An importable module.
struct Library {
    file: String,
    source: String,
}

/// Where cargo keeps the sources of Bevy's crates, from cargo itself: no network, since they are compiled already.
fn bevy_crate_folders() -> Vec<PathBuf> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let rustc = Command::new("rustc").arg("-vV").output().expect("rustc runs");
    let about = String::from_utf8_lossy(&rustc.stdout);
    let host = about.lines().find_map(|l| l.strip_prefix("host: ")).expect("rustc names its host");
    // Without the filter, cargo would ask for the sources of every platform's packages.
    let output = Command::new(cargo)
        .args([
            "metadata",
            "--offline",
            "--format-version",
            "1",
            "--all-features",
            "--filter-platform",
            host,
        ])
        .arg("--manifest-path")
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("Cargo.toml"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "cargo metadata: {}", String::from_utf8_lossy(&output.stderr));
    let metadata: serde_json::Value =
        serde_json::from_slice(&output.stdout).expect("cargo prints JSON");
    let packages = metadata["packages"].as_array().expect("metadata lists packages");
    let text = |package: &serde_json::Value, key: &str| {
        package[key].as_str().unwrap_or_default().to_owned()
    };
    let bevy =
        packages.iter().filter(|p| text(p, "name").starts_with("bevy_") && !p["source"].is_null());
    bevy.filter_map(|p| Some(Path::new(&text(p, "manifest_path")).parent()?.join("src"))).collect()
}

fn wgsl_files(dir: &Path, out: &mut Vec<PathBuf>) {
    for path in fs::read_dir(dir).into_iter().flatten().flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            wgsl_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "wgsl") {
            out.push(path);
        }
    }
}

/// Every importable module of this crate and of Bevy, by import path.
fn libraries() -> BTreeMap<String, Library> {
    let mut files = Vec::new();
    for folder in bevy_crate_folders() {
        wgsl_files(&folder, &mut files);
    }
    files.sort();
    let bevy = files.into_iter().map(|path| {
        let source = fs::read_to_string(&path).expect("Bevy's shaders are readable");
        Library { file: path.to_string_lossy().into_owned(), source }
    });
    let own = shaders::ALL
        .iter()
        .map(|(path, source)| Library { file: (*path).to_owned(), source: (*source).to_owned() });
    // Own modules last, so that they would win.
    let named = bevy.chain(own).filter_map(|l| Some((get_preprocessor_data(&l.source).0?, l)));
    named.collect()
}

/// Adds what `source` imports, and before it what that imports, as Bevy's shader cache does. What is no module is left to
/// the composer's message.
fn add_imports(
    composer: &mut Composer,
    libraries: &BTreeMap<String, Library>,
    source: &str,
) -> Result<(), String> {
    let (_, imports, _) = get_preprocessor_data(source);
    for import in imports {
        let name = import.import;
        let Some(library) = libraries.get(&name) else { continue };
        if composer.contains_module(&name) {
            continue;
        }
        add_imports(composer, libraries, &library.source)?;
        let own_defs =
            OF_MODULES.iter().find(|(module, _)| *module == name).map_or(&[][..], |(_, defs)| defs);
        let module = ComposableModuleDescriptor {
            source: &library.source,
            file_path: &library.file,
            shader_defs: defs(&[own_defs]),
            ..Default::default()
        };
        if let Err(e) = composer.add_composable_module(module) {
            return Err(e.emit_to_string(composer));
        }
    }
    Ok(())
}

/// Composes and validates one shader under one def set.
fn check(
    composer: &mut Composer,
    libraries: &BTreeMap<String, Library>,
    (path, source): (&str, &str),
    set: &[Def],
) -> Result<naga::Module, String> {
    let report = |e: String| {
        let names: Vec<_> = set.iter().map(|(name, value)| format!("{name}={value:?}")).collect();
        format!("{path} [{}]: {e}", names.join(" "))
    };
    add_imports(composer, libraries, source).map_err(report)?;
    let shader_defs = defs(&[EVERYWHERE, set]);
    let module =
        NagaModuleDescriptor { source, file_path: path, shader_defs, ..Default::default() };
    let module =
        composer.make_naga_module(module).map_err(|e| report(e.emit_to_string(composer)))?;
    let flags = naga::valid::ValidationFlags::all();
    let mut validator = naga::valid::Validator::new(flags, naga::valid::Capabilities::all());
    validator.validate(&module).map_err(|e| report(e.emit_to_string(source)))?;
    Ok(module)
}

fn composer() -> Composer {
    Composer::default().with_capabilities(naga::valid::Capabilities::all())
}

fn has_entry_point(source: &str) -> bool {
    ["@compute", "@vertex", "@fragment"].iter().any(|stage| source.contains(stage))
}

#[test]
fn every_entry_point_is_valid_under_every_def_set() {
    let (libraries, mut composer) = (libraries(), composer());
    let mut failures = Vec::new();
    for shader in shaders::ALL.iter().filter(|(_, source)| has_entry_point(source)) {
        let rows = DEF_SETS.iter().filter(|(path, _)| *path == shader.0);
        let mut sets: Vec<_> = rows.flat_map(|(_, sets)| sets.iter().copied()).collect();
        if sets.is_empty() {
            sets.push(&[]);
        }
        for set in sets {
            match check(&mut composer, &libraries, *shader, set) {
                Ok(module) => {
                    // The label in a capture is the entry point's name, so it has to say which file it is.
                    let stem = Path::new(shader.0)
                        .file_stem()
                        .and_then(|s| s.to_str())
                        .unwrap_or_default();
                    if let [only] = &module.entry_points[..]
                        && !only.name.starts_with(stem)
                    {
                        failures.push(format!(
                            "{}: entry point {} is not named like its file",
                            shader.0, only.name
                        ));
                    }
                }
                Err(failure) => failures.push(failure),
            }
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

/// An importable module as a shader of its own: an `#import` alone composes only what is used of it.
fn as_shader(library: &str) -> String {
    library.replace("#define_import_path", "// module")
}

#[test]
fn every_importable_module_is_valid() {
    let (libraries, mut composer) = (libraries(), composer());
    let own = shaders::ALL.iter().filter(|(_, source)| get_preprocessor_data(source).0.is_some());
    let failures: Vec<_> = own
        .filter_map(|(path, source)| {
            check(&mut composer, &libraries, (path, &as_shader(source)), &[]).err()
        })
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

#[test]
fn every_row_of_the_table_names_a_shader() {
    let unknown =
        |path: &&str| !path.is_empty() && !shaders::ALL.iter().any(|(known, _)| known == path);
    let stale: Vec<_> = DEF_SETS.iter().map(|(path, _)| *path).filter(unknown).collect();
    assert!(stale.is_empty(), "no such shader: {stale:?}");
}

/// Stands for the resolve pass: lights a point with Bevy's own functions.
const LIT: &str = "
#import bevy_pbr::mesh_view_bindings as view_bindings
#import bevy_pbr::pbr_functions
#import bevy_pbr::pbr_types::pbr_input_new
#import bevy_treeline::surfel

@group(2) @binding(0) var<storage, read> surfels: array<vec4<u32>>;

@fragment
fn lit(@builtin(position) frag_coord: vec4<f32>) -> @location(0) vec4<f32> {
    let s = surfels[u32(frag_coord.x)];
    var pbr = pbr_input_new();
    pbr.frag_coord = frag_coord;
    pbr.world_position = vec4<f32>(surfel::surfel_position(s.x, s.y, vec3<f32>(0.0), vec3<f32>(1.0)), 1.0);
    pbr.world_normal = surfel::surfel_normal(s.z);
    pbr.N = pbr.world_normal;
    pbr.V = normalize(view_bindings::view.world_position - pbr.world_position.xyz);
    pbr.material.base_color = vec4<f32>(surfel::surfel_albedo(s.z, s.w), 1.0);
    return pbr_functions::main_pass_post_lighting_processing(pbr, pbr_functions::apply_pbr_lighting(pbr));
}
";

#[test]
fn a_shader_that_lights_with_bevys_functions_is_valid_in_every_view() {
    let (libraries, mut composer) = (libraries(), composer());
    let failures: Vec<_> = VIEWS
        .iter()
        .filter_map(|set| check(&mut composer, &libraries, ("lit.wgsl", LIT), set).err())
        .collect();
    assert!(failures.is_empty(), "{}", failures.join("\n\n"));
}

#[test]
fn a_wrong_type_or_a_missing_import_is_reported() {
    let (libraries, mut composer) = (libraries(), composer());
    let wrong = [
        "#import bevy_treeline::hash\n@compute @workgroup_size(1) fn f() { let x: f32 = hash::mix_bits(1u); }",
        "#import bevy_treeline::no_such_module\n@compute @workgroup_size(1) fn f() { no_such_module::g(); }",
        "#import bevy_render::view::View\n@compute @workgroup_size(1) fn f(v: View) {}",
    ];
    for source in wrong {
        let result = check(&mut composer, &libraries, ("wrong.wgsl", source), &[]);
        assert!(result.is_err(), "went unnoticed: {source}");
    }
    let module = "#define_import_path bevy_treeline::bad\nfn f() -> f32 { return 1u; }";
    let result = check(&mut composer, &libraries, ("bad.wgsl", &as_shader(module)), &[]);
    assert!(result.is_err(), "an error in an importable module went unnoticed");
}
