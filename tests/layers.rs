//! Fails when a module names another that sits above or beside it: imports go down only, L0 ← L1 ← L2 ← L3 ← app.
//!
//! The table is the layer diagram. A new top-level module has to be placed in it; a new file inside a module has not.
use std::{
    fs,
    path::{Path, PathBuf},
};

struct Layer {
    /// Path below `src/`; the longest matching prefix rules a file.
    at: &'static str,
    /// Modules of this crate that it may name besides its own top-level module, which it always may.
    may_name: &'static [&'static str],
    /// Crates (or their modules) that may not appear. `bevy::render` stands for `bevy_render` too.
    may_not: &'static [&'static str],
}

/// Pure code knows no engine: plain values in, plain values out.
const ENGINE: &[&str] = &[
    "bevy::render",
    "bevy::pbr",
    "bevy::ecs",
    "bevy::app",
    "bevy::asset",
    "bevy::prelude",
    "bevy::core_pipeline",
    "bevy::shader",
    "wgpu",
];
/// Code of the main world: everything of Bevy but the renderer.
const RENDERER: &[&str] = &["bevy::render", "bevy::core_pipeline", "wgpu"];
/// Code that may say what is extracted, and no more of the renderer.
const NO_GPU_WORK: &[&str] = &[
    "bevy::render::RenderApp",
    "bevy::render::render_resource",
    "bevy::render::renderer",
    "bevy::core_pipeline",
    "wgpu",
];
const ANY: &[&str] = &["*"];

#[rustfmt::skip] // one row a line
const LAYERS: &[Layer] = &[
    // L0
    Layer { at: "math", may_name: &["lod"], may_not: ENGINE },
    Layer { at: "lod", may_name: &["math"], may_not: ENGINE },
    // L1
    Layer { at: "gpu", may_name: &["math"], may_not: &[] },
    Layer { at: "gpu/mirror", may_name: &[], may_not: ENGINE },
    Layer { at: "asset", may_name: &["math", "lod", "gpu::mirror"], may_not: RENDERER },
    Layer { at: "species", may_name: &["math"], may_not: ENGINE },
    Layer { at: "shaders", may_name: &[], may_not: RENDERER },
    // L2
    Layer { at: "bake", may_name: &["math", "lod", "asset", "gpu", "shaders", "species"], may_not: &[] },
    Layer { at: "bake/lighting", may_name: &["math", "asset"], may_not: ENGINE },
    Layer { at: "bake/order", may_name: &["math", "lod", "asset"], may_not: ENGINE },
    Layer { at: "bake/settings", may_name: &["math"], may_not: ENGINE },
    Layer { at: "bake/surfels", may_name: &["math", "asset"], may_not: ENGINE },
    // Instances and work items are kept in the form that the GPU reads: plain structs.
    Layer { at: "forest", may_name: &["math", "lod", "asset", "bake", "gpu::types"], may_not: RENDERER },
    // A component says itself that it is extracted.
    // Asks which prepasses a camera has.
    Layer { at: "forest/near_mesh", may_name: &["math", "lod", "asset", "bake", "gpu::types"], may_not: &["bevy::render", "wgpu"] },
    Layer { at: "forest/settings", may_name: &["math", "lod"], may_not: NO_GPU_WORK },
    Layer { at: "landscape", may_name: &["math"], may_not: ENGINE },
    // Materials of its own, which bind GPU resources.
    Layer { at: "landscape/draw", may_name: &["math", "shaders"], may_not: &[] },
    // Tiles become `Forest` components.
    Layer { at: "landscape/planting", may_name: &["asset", "forest"], may_not: RENDERER },
    Layer { at: "landscape/streaming", may_name: &["forest"], may_not: RENDERER },
    // L3
    Layer { at: "render", may_name: &["math", "lod", "asset", "gpu", "shaders", "forest"], may_not: &[] },
    // Reads the counters of views, which come from the render world.
    Layer { at: "governor", may_name: &["lod", "forest", "render"], may_not: RENDERER },
    Layer { at: "diagnostics", may_name: &["forest", "render"], may_not: RENDERER },
    // What wires it all together.
    Layer { at: "plugin", may_name: ANY, may_not: &[] },
    Layer { at: "lib", may_name: ANY, may_not: &[] },
    // A crate of its own: its `crate::` is the tool, the library is `bevy_treeline::`.
    Layer { at: "bin", may_name: ANY, may_not: &[] },
];

/// Stages of a module from left to right: each may name itself and those to its left. What is not listed is not checked.
const STAGES: &[(&str, &[&str])] = &[(
    "render",
    &[
        "extract",
        "residency",
        "cull_tiles",
        "view",
        "select",
        "splat",
        "pyramid",
        "resolve",
        "prepass",
        "temporal",
        "shadow",
        "silhouette",
        "deferred_blend",
        "pop",
    ],
)];

/// A word, `::`, or any other character of Rust code; comments, strings and character literals are left out.
fn tokens(source: &str) -> Vec<&str> {
    let bytes = source.as_bytes();
    let is_word = |b: u8| b.is_ascii_alphanumeric() || b == b'_' || b >= 128;
    let (mut found, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        let rest = &bytes[at..];
        let start = at;
        if rest.starts_with(b"//") {
            at += rest.iter().position(|b| *b == b'\n').unwrap_or(rest.len());
        } else if rest.starts_with(b"/*") {
            at += source[at..].find("*/").map_or(rest.len(), |end| end + 2);
        } else if rest.starts_with(b"r\"") || rest.starts_with(b"r#\"") {
            let end = if rest[1] == b'#' { "\"#" } else { "\"" };
            at += 3 + source[at + 3..].find(end).map_or(rest.len() - 3, |to| to + end.len());
        } else if rest[0] == b'"' {
            at += 1;
            while at < bytes.len() && bytes[at] != b'"' {
                at += if bytes[at] == b'\\' { 2 } else { 1 };
            }
            at += 1;
        } else if rest[0] == b'\'' {
            // 'a' or '\n' is a character, 'a without the closing quote is a lifetime.
            let character = rest.iter().skip(2).take(10).position(|b| *b == b'\'').map(|to| to + 3);
            let lifetime = rest.get(1).is_some_and(|b| is_word(*b)) && rest.get(2) != Some(&b'\'');
            at += if lifetime && rest[1] < 128 { 1 } else { character.unwrap_or(1) };
        } else if rest.starts_with(b"::") {
            at += 2;
            found.push("::");
        } else if is_word(rest[0]) {
            at += rest.iter().position(|b| !is_word(*b)).unwrap_or(rest.len());
            found.push(&source[start..at]);
        } else {
            at += 1;
            if !rest[0].is_ascii_whitespace() {
                found.push(&source[start..at]);
            }
        }
    }
    found
}

/// Follows `::a::{b, c::d}` from `at` (behind the first word of the path in `stem`) and records every full path.
/// Returns the index behind it.
fn follow_path(
    tokens: &[&str],
    mut at: usize,
    mut stem: Vec<String>,
    found: &mut Vec<Vec<String>>,
) -> usize {
    while tokens.get(at) == Some(&"::") {
        at += 1;
        match tokens.get(at) {
            Some(&"{") => {
                at += 1;
                while at < tokens.len() && tokens[at] != "}" {
                    if tokens[at] == "," {
                        at += 1;
                        continue;
                    }
                    let mut branch = stem.clone();
                    // `{self}` names the stem itself.
                    if tokens[at] != "self" {
                        branch.push(tokens[at].to_owned());
                    }
                    at = follow_path(tokens, at + 1, branch, found);
                    // `as name`
                    while at < tokens.len() && !matches!(tokens[at], "," | "}") {
                        at += 1;
                    }
                }
                return at + 1;
            }
            // Generic arguments, `a::<T>`: the path goes no further.
            Some(&"<") | None => break,
            Some(word) => {
                // A chain of `super` is resolved by the caller; here each further one goes up.
                stem.push((*word).to_owned());
                at += 1;
            }
        }
    }
    found.push(stem);
    at
}

/// Every path named in the source of module `module`, made absolute: `crate::…` and `super::…` start with `crate`, others
/// with a crate or a local name.
fn named_paths(module: &[&str], source: &str) -> Vec<Vec<String>> {
    let tokens = tokens(source);
    let (mut found, mut at) = (Vec::new(), 0);
    // Depth of braces at which each open inline module began.
    let (mut depth, mut inline): (usize, Vec<(usize, &str)>) = (0, Vec::new());
    while at < tokens.len() {
        let next = tokens.get(at + 1).copied();
        match tokens[at] {
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                inline.pop_if(|(open, _)| *open > depth);
            }
            "mod" if tokens.get(at + 2) == Some(&"{") => {
                depth += 1;
                inline.push((depth, next.unwrap_or_default()));
                at += 3;
                continue;
            }
            _ => {}
        }
        // A path starts at a word before `::` that is not itself behind one.
        let starts = next == Some("::") && (at == 0 || tokens[at - 1] != "::");
        if !starts || tokens[at] == ">" {
            at += 1;
            continue;
        }
        let here: Vec<String> =
            module.iter().copied().chain(inline.iter().map(|m| m.1)).map(str::to_owned).collect();
        let mut stem = vec![tokens[at].to_owned()];
        let mut up = 0;
        while matches!(tokens[at], "super" | "self") && tokens.get(at + 1) == Some(&"::") {
            up += usize::from(tokens[at] == "super");
            if !matches!(tokens.get(at + 2), Some(&"super")) {
                stem = vec!["crate".to_owned()];
                stem.extend(here[..here.len().saturating_sub(up)].iter().cloned());
                break;
            }
            at += 2;
        }
        at = follow_path(&tokens, at + 1, stem, &mut found);
    }
    found
}

/// True if `path` is `rule` or below it; both are split at `::`. Every crate of Bevy counts as a module of `bevy`.
fn is_below(path: &[String], rule: &str) -> bool {
    let mut parts: Vec<&str> = path.iter().map(String::as_str).collect();
    if let Some(part) = parts[0].strip_prefix("bevy_").filter(|part| *part != "treeline") {
        parts.splice(0..1, ["bevy", part]);
    }
    let rule: Vec<&str> = rule.split("::").collect();
    parts.starts_with(&rule)
}

/// What is wrong with the file at `file` (below `src/`, without its ending).
fn violations(file: &str, source: &str) -> Vec<String> {
    let rules = LAYERS.iter().filter(|l| file == l.at || file.starts_with(&format!("{}/", l.at)));
    let Some(layer) = rules.max_by_key(|l| l.at.len()) else {
        return vec![format!("{file}: has no row in LAYERS (tests/layers.rs): place it")];
    };
    let mut module: Vec<&str> = file.split('/').collect();
    module.pop_if(|last| *last == "mod" || *last == "lib");
    let home = layer.at.split('/').next().unwrap_or(layer.at);
    let stages = STAGES.iter().find(|(at, _)| *at == home).map_or(&[][..], |(_, stages)| stages);
    let stage_of = |name: Option<&str>| stages.iter().position(|stage| Some(*stage) == name);
    let own_stage = stage_of(module.get(1).copied());

    let mut wrong = Vec::new();
    for path in named_paths(&module, source) {
        if let Some(rule) = layer.may_not.iter().find(|rule| is_below(&path, rule)) {
            wrong.push(format!("{file}: {} (no {rule} here)", path.join("::")));
        }
        if path[0] != "crate" || layer.may_name == ANY {
            continue;
        }
        let below = &path[1..];
        let Some(top) = below.first() else { continue };
        let allowed = top == home || layer.may_name.iter().any(|rule| is_below(below, rule));
        if !allowed {
            wrong.push(format!("{file}: {}", path.join("::")));
        } else if let (Some(own), Some(other)) =
            (own_stage, stage_of(below.get(1).map(String::as_str)))
            && top == home
            && other > own
        {
            wrong.push(format!("{file}: {} (a stage further on)", path.join("::")));
        }
    }
    wrong
}

fn rust_files(dir: &Path, out: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(dir) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
    out.sort();
}

#[test]
fn modules_only_name_lower_layers() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&src, &mut files);
    let mut wrong = Vec::new();
    for path in &files {
        let file = path.strip_prefix(&src).expect("below src").with_extension("");
        let file = file.to_str().expect("UTF-8").replace('\\', "/");
        wrong.extend(violations(&file, &fs::read_to_string(path).expect("readable")));
    }
    assert!(!files.is_empty() && wrong.is_empty(), "forbidden imports:\n{}", wrong.join("\n"));
}

#[test]
fn the_tool_and_the_examples_use_the_public_library() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    rust_files(&root.join("src/bin"), &mut files);
    rust_files(&root.join("examples"), &mut files);
    // The compiler keeps private items private; what it would let pass is a library file compiled in a second time.
    let borrowed = |text: &str| {
        let words = tokens(text);
        let attribute = words.windows(4).any(|w| w == ["#", "[", "path", "="]);
        attribute || words.windows(3).any(|w| w == ["include", "!", "("])
    };
    let wrong: Vec<_> =
        files.iter().filter(|f| borrowed(&fs::read_to_string(f).expect("readable"))).collect();
    assert!(wrong.is_empty(), "these compile library files in again: {wrong:?}");
}

#[test]
fn a_forbidden_import_is_reported() {
    let cases = [
        ("math/octahedral", "use crate::bake::peel::cpu;"),
        (
            "math/octahedral",
            "fn f() { let x = crate::{math::hash::mix_bits, asset::surfel::Surfel}; }",
        ),
        ("math/mod", "use super::asset::surfel;"),
        ("math/octahedral", "use super::super::gpu::headless;"),
        ("math/octahedral", "mod tests { use super::super::super::render; }"),
        ("math/hash", "use bevy::{math::Vec3, render::renderer::RenderDevice};"),
        ("lod/fade", "use bevy_ecs::prelude::*;"),
        ("lod/fade", "fn f(d: &wgpu::Device) {}"),
        ("gpu/mirror", "use crate::math::hash;"),
        ("asset/mod", "use crate::gpu::headless;"),
        ("bake/job", "use crate::landscape::scatter;"),
        ("bake/order/lattice", "use crate::gpu::headless;"),
        ("forest/settings", "use bevy::render::RenderApp;"),
        ("render/select/pass", "use crate::bake::settings::BakeSettings;"),
        (
            "render/select/pass",
            "use crate::render::{extract::ExtractedTrees, splat::SplatPipeline};",
        ),
        ("render/select/pass", "use super::super::resolve;"),
        ("novelty", "fn f() {}"),
    ];
    for (file, source) in cases {
        assert!(!violations(file, source).is_empty(), "{file} went unnoticed: {source}");
    }
}

#[test]
fn an_allowed_import_is_not_reported() {
    let cases = [
        (
            "math/octahedral",
            "use super::hash; use crate::{lod::fade, math::{bounding::Aabb as Box, hash}};",
        ),
        ("math/mod", "mod tests { use super::*; use super::hash::mix_bits; }"),
        ("math/hash", "use bevy::math::Vec3; fn f() -> u32 { u32::from(b'\"') /* crate::bake */ }"),
        (
            "math/hash",
            "// crate::render\nfn f<'a>(x: &'a str) -> char { let _ = \"crate::bake::x\"; ':' }",
        ),
        ("asset/surfel", "use crate::gpu::mirror::gpu_types; use bevy::asset::Asset;"),
        (
            "bake/peel/gpu",
            "use crate::gpu::headless; use wgpu::Device; use super::super::source::SourceModel;",
        ),
        ("render/resolve/pass", "use crate::render::{resolve::Key, splat::Output, plumbing::X};"),
        (
            "render/mod",
            "pub mod select; use select::SelectPlugin; use crate::render::pop::PopPlugin;",
        ),
        ("plugin", "use crate::{render, bake, forest};"),
        ("lib", "pub use crate::plugin::TreelinePlugin;"),
        ("bin/treeline/main", "use bevy_treeline::bake; use crate::sheet::contact_sheet;"),
    ];
    for (file, source) in cases {
        assert_eq!(violations(file, source), Vec::<String>::new(), "{source}");
    }
}
