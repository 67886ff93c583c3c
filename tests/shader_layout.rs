//! Rust mirrors and WGSL structs agree on names, types, offsets and sizes. Needs no GPU.
use bevy_treeline::{MIRRORS, gpu::mirror::Mirror, shaders};
use naga::{ScalarKind, TypeInner};

/// The Rust spelling of a host-shareable WGSL type.
fn rust_type(module: &naga::Module, ty: naga::Handle<naga::Type>) -> String {
    let scalar = |s: naga::Scalar| match (s.kind, s.width) {
        (ScalarKind::Float, 4) => "f32".to_owned(),
        (ScalarKind::Uint, 4) => "u32".to_owned(),
        (ScalarKind::Sint, 4) => "i32".to_owned(),
        (ScalarKind::Uint, 8) => "u64".to_owned(),
        other => format!("{other:?}"),
    };
    match &module.types[ty].inner {
        TypeInner::Scalar(s) | TypeInner::Atomic(s) => scalar(*s),
        TypeInner::Vector { size, scalar: s } => format!("[{}; {}]", scalar(*s), *size as u32),
        TypeInner::Matrix { columns, rows, scalar: s } => {
            format!("[[{}; {}]; {}]", scalar(*s), *rows as u32, *columns as u32)
        }
        TypeInner::Array { base, size: naga::ArraySize::Constant(n), .. } => {
            format!("[{}; {n}]", rust_type(module, *base))
        }
        // A struct in a struct goes by its WGSL name, which the Rust field cannot spell: flatten such structs.
        other => format!("{other:?}"),
    }
}

/// One line per struct: `Name { field: type @offset, … } size`.
fn describe_wgsl(module: &naga::Module) -> Vec<String> {
    let structs = module.types.iter().filter_map(|(_, t)| match (&t.name, &t.inner) {
        (Some(name), TypeInner::Struct { members, span }) => Some((name, members, span)),
        _ => None,
    });
    let describe = |(name, members, span): (&String, &Vec<naga::StructMember>, &u32)| {
        let field = |m: &naga::StructMember| {
            format!(
                "{}: {} @{}",
                m.name.as_deref().unwrap_or("?"),
                rust_type(module, m.ty),
                m.offset
            )
        };
        let fields: Vec<_> = members.iter().map(field).collect();
        format!("{name} {{ {} }} {span}", fields.join(", "))
    };
    structs.map(describe).collect()
}

fn describe_rust(mirror: &Mirror) -> String {
    let fields: Vec<_> =
        mirror.fields.iter().map(|(name, ty, at)| format!("{name}: {ty} @{at}")).collect();
    format!("{} {{ {} }} {}", mirror.wgsl_name, fields.join(", "), mirror.size)
}

fn differences(source: &str) -> Vec<String> {
    let plain: String =
        source.lines().filter(|l| !l.starts_with('#')).map(|l| format!("{l}\n")).collect();
    let mut wgsl = describe_wgsl(&naga::front::wgsl::parse_str(&plain).expect("types.wgsl parses"));
    let mut rust: Vec<_> = MIRRORS.iter().copied().flatten().map(describe_rust).collect();
    wgsl.sort();
    rust.sort();
    let only = |a: &[String], b: &[String], tag: &str| -> Vec<String> {
        a.iter().filter(|x| !b.contains(x)).map(|x| format!("{tag} {x}")).collect()
    };
    [only(&rust, &wgsl, "rust"), only(&wgsl, &rust, "wgsl")].concat()
}

fn types_source() -> &'static str {
    let types = shaders::ALL.iter().find(|(path, _)| *path == "lib/types.wgsl");
    types.expect("types.wgsl is embedded").1
}

#[test]
fn rust_mirrors_match_wgsl() {
    let found = differences(types_source());
    assert!(found.is_empty(), "in one language only:\n{}", found.join("\n"));
}

#[test]
fn a_renamed_retyped_or_extra_struct_is_reported() {
    let edits = [
        ("position_xy", "position_xz"),
        ("albedo_b_misc: u32", "albedo_b_misc: f32"),
        ("struct SurfelCold", "struct Dead { x: u32 }\nstruct SurfelCold"),
    ];
    for (from, to) in edits {
        assert!(types_source().contains(from), "{from} is in types.wgsl");
        let found = differences(&types_source().replace(from, to));
        assert!(!found.is_empty(), "{from} → {to} went unnoticed");
    }
}
