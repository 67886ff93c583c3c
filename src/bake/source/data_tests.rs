//! The models of the shared data folder, and what happens when their bytes break.

use super::{SourceAlpha, SourceModel, load_model, parse_model};
use proptest::prelude::*;
use std::fmt::Write;
use std::io;
use std::path::PathBuf;

/// The data folder, if this checkout has one.
fn data(test: &str) -> Option<PathBuf> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("SKIPPED {test}: no ../shared/data");
    None
}

fn assert_sound(model: &SourceModel) {
    for mesh in &model.meshes {
        let vertices = mesh.positions.len();
        assert_eq!(mesh.normals.len(), vertices);
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-5));
        assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < vertices));
        assert!(mesh.material < model.materials.len());
    }
    assert!(model.surface_area() > 0.0 && model.surface_area().is_finite());
    assert_ne!(model.content_hash, [0; 32]);
}

/// File, triangles, and which materials are foliage.
type Tree = (&'static str, usize, &'static [(&'static str, bool)]);
const TREES: [Tree; 11] = [
    ("CommonTree_2.glb", 2_950, &[("Wood", false), ("Green", true)]),
    ("PineTree_3.glb", 2_383, &[("Wood", false), ("Green", true)]),
    ("bevy_palmtree.glb", 2_184, &[("Trunk", false), ("Leaves", true)]),
    ("eztree_ash_medium.glb", 20_000, &[("bark_oak", false), ("leaves_ash", true)]),
    ("eztree_bush_1.glb", 13_872, &[("bark_oak", false), ("leaves_ash", true)]),
    ("eztree_oak_large.glb", 22_566, &[("bark_oak", false), ("leaves_oak", true)]),
    ("eztree_pine_medium.glb", 19_872, &[("bark_pine", false), ("leaves_pine", true)]),
    ("gazebo_oak_tree.glb", 948, &[("leaves", true), ("bark", false)]),
    ("playcanvas_low-poly-tree.glb", 1_126, &[("Material", true)]),
    ("sapling_quaking_aspen.glb", 40_764, &[("leaves", true), ("bark", false)]),
    ("sapling_weeping_willow.glb", 185_920, &[("leaves.003", true), ("bark.003", false)]),
];

#[test]
fn every_tree_loads_with_its_triangles_and_its_leaves() {
    let Some(data) = data("every_tree_loads_with_its_triangles_and_its_leaves") else { return };
    let mut table = String::new();
    for (file, triangles, materials) in TREES {
        let model = load_model(&data.join("trees").join(file)).unwrap();
        assert_sound(&model);
        let found: Vec<_> = model.materials.iter().map(|m| (m.name.as_str(), m.is_leaf)).collect();
        assert_eq!(found, materials, "{file}");
        let dropped: usize = (model.warnings.iter())
            .filter_map(|w| {
                w.strip_suffix(" triangles without area were dropped")?.parse::<usize>().ok()
            })
            .sum();
        assert_eq!(model.triangle_count() + dropped, triangles, "{file}");
        assert_eq!(model.name, file);
        let extent = model.bounds().extent();
        writeln!(
            table,
            "{file:32} {:7} triangles ({dropped} dropped), {} meshes, {} images, size {:.2} × {:.2} × {:.2} from y {:.2}, \
             area {:.2}, mean leaf {:.3e}, {:?}",
            model.triangle_count(),
            model.meshes.len(),
            model.images.len(),
            extent.x,
            extent.y,
            extent.z,
            model.bounds().min.y,
            model.surface_area(),
            model.mean_leaf_area(),
            model.warnings
        )
        .unwrap();
        assert!(model.mean_leaf_area() > 0.0);
    }
    println!("{table}");
}

#[test]
fn every_mesh_loads_with_smooth_normals() {
    let Some(data) = data("every_mesh_loads_with_smooth_normals") else { return };
    for (file, triangles) in [
        ("bun_zipper.ply", 69_451),
        ("cow.obj", 5_804),
        ("dragon_vrip_res3.ply", 47_794),
        ("dragon_vrip_res4.ply", 11_102),
        ("teapot.obj", 6_320),
    ] {
        let model = load_model(&data.join("meshes").join(file)).unwrap();
        assert_sound(&model);
        println!(
            "{file:24} {:6} triangles, size {}, area {}, {:?}",
            model.triangle_count(),
            model.bounds().extent(),
            model.surface_area(),
            model.warnings
        );
        assert!(model.triangle_count() + 400 > triangles && model.triangle_count() <= triangles);
        assert_eq!(model.mean_leaf_area(), 0.0);
    }
}

#[test]
fn the_palm_stands_upright_with_its_node_transforms_applied() {
    let Some(data) = data("the_palm_stands_upright_with_its_node_transforms_applied") else {
        return;
    };
    let model = load_model(&data.join("trees/bevy_palmtree.glb")).unwrap();
    assert_eq!(model.meshes.len(), 8);
    let bounds = model.bounds();
    assert!(bounds.extent().y > 3.0 && bounds.extent().y < 6.0, "{bounds:?}");
    // Seven equal leaves around the top of the trunk.
    for leaf in &model.meshes[1..] {
        let top = leaf.positions.iter().map(|p| p.y).fold(f32::MIN, f32::max);
        assert!(top > 3.0, "{} is at {top}", leaf.name);
    }
}

#[test]
fn masked_textures_keep_their_holes() {
    let Some(data) = data("masked_textures_keep_their_holes") else { return };
    for (file, cutoff) in [("eztree_ash_medium.glb", 0.5), ("eztree_pine_medium.glb", 0.3)] {
        let model = load_model(&data.join("trees").join(file)).unwrap();
        let leaf = model.materials.iter().find(|m| m.is_leaf).unwrap();
        assert_eq!(leaf.alpha, SourceAlpha::Mask(cutoff));
        let image = &model.images[leaf.base_color_texture.as_ref().unwrap().image];
        let holes = image.rgba8.chunks_exact(4).filter(|texel| texel[3] < 128).count();
        let share = holes as f64 / f64::from(image.width * image.height);
        assert!(share > 0.1 && share < 0.9, "{file}: {share} of the texture is a hole");
        let mut opaque = model.clone();
        for material in &mut opaque.materials {
            material.alpha = SourceAlpha::Opaque;
        }
        let kept = model.mean_leaf_area() / opaque.mean_leaf_area();
        println!("{file}: {:.3} of the texture and {kept:.3} of the cards are opaque", 1.0 - share);
        assert!(kept > 0.05 && kept < 0.95);
    }
}

#[test]
fn the_hash_follows_the_bytes_and_point_clouds_are_refused() {
    let Some(data) = data("the_hash_follows_the_bytes_and_point_clouds_are_refused") else {
        return;
    };
    let bytes = std::fs::read(data.join("meshes/cow.obj")).unwrap();
    let read = |bytes: &[u8]| {
        parse_model("cow.obj", bytes, &mut |_| Err(io::ErrorKind::NotFound.into())).unwrap()
    };
    assert_eq!(read(&bytes).content_hash, *blake3::hash(&bytes).as_bytes());
    assert_eq!(read(&bytes), read(&bytes));
    let commented = [bytes, b"# more\n".to_vec()].concat();
    assert_eq!(read(&commented).content_hash, *blake3::hash(&commented).as_bytes());
    let cloud = data.join("pointclouds/potree_vol_total_sorvilier.ply");
    let message = load_model(&cloud).unwrap_err().to_string();
    assert!(message.contains("point cloud (498868 vertices"), "{message}");
}

#[test]
fn unknown_and_missing_files_are_named() {
    for (path, part) in [
        ("oak.fbx", "read from .glb, .gltf, .obj, .ply files"),
        ("oak", "unknown kind"),
        ("no/such/oak.glb", "cannot read the model `no/such/oak.glb`"),
    ] {
        let message = load_model(std::path::Path::new(path)).unwrap_err().to_string();
        assert!(message.contains(part), "{message} lacks {part}");
    }
}

fn nothing(_: &str) -> io::Result<Vec<u8>> {
    Err(io::ErrorKind::NotFound.into())
}

#[test]
fn a_truncated_tree_is_an_error_wherever_it_is_cut() {
    let Some(data) = data("a_truncated_tree_is_an_error_wherever_it_is_cut") else { return };
    for file in ["bevy_palmtree.glb", "gazebo_oak_tree.glb"] {
        let bytes = std::fs::read(data.join("trees").join(file)).unwrap();
        for cut in 0..200 {
            let end = bytes.len() * cut / 200;
            let error = parse_model(file, &bytes[..end], &mut nothing).unwrap_err().to_string();
            assert!(error.contains(file), "{error}");
            // With the length in the header mended, so that the cut is found further in.
            if end > 20 {
                let mut mended = bytes[..end].to_vec();
                mended[8..12].copy_from_slice(&(end as u32).to_le_bytes());
                assert!(parse_model(file, &mended, &mut nothing).is_err());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn flipped_bytes_never_panic(
        tree in 0..3usize,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<bool>(), any::<u8>()), 1..12),
    ) {
        let Some(data) = data("flipped_bytes_never_panic") else { return Ok(()) };
        let file = ["bevy_palmtree.glb", "gazebo_oak_tree.glb", "CommonTree_2.glb"][tree];
        let mut bytes = std::fs::read(data.join("trees").join(file)).unwrap();
        let json = 20..20 + u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        for (at, in_json, value) in flips {
            let at = if in_json { json.start + at.index(json.len()) } else { at.index(bytes.len()) };
            // Digits stay digits in the JSON, or nearly every flip would be a syntax error.
            let is_digit = in_json && bytes[at].is_ascii_digit();
            bytes[at] = if is_digit { b'0' + value % 10 } else { value };
        }
        let _ = parse_model(file, &bytes, &mut nothing);
    }

    #[test]
    fn changed_numbers_in_the_json_never_panic(
        tree in 0..3usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![
            0u64..20, Just(255), Just(65_536), Just(1 << 32), Just(u64::MAX), Just(i64::MAX as u64)
        ]), 1..4),
    ) {
        let Some(data) = data("changed_numbers_in_the_json_never_panic") else { return Ok(()) };
        let file = ["bevy_palmtree.glb", "gazebo_oak_tree.glb", "CommonTree_2.glb"][tree];
        let bytes = std::fs::read(data.join("trees").join(file)).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let mut json = String::from_utf8(bytes[20..20 + length].to_vec()).unwrap();
        for (at, value) in changes {
            let numbers: Vec<_> = json
                .match_indices(|c: char| c.is_ascii_digit())
                .map(|(i, _)| i)
                .filter(|&i| i > 0 && matches!(json.as_bytes()[i - 1], b':' | b'[' | b',' | b' '))
                .collect();
            let start = *at.get(&numbers);
            let end = json[start..].find(|c: char| !c.is_ascii_digit()).unwrap_or(1) + start;
            json.replace_range(start..end, &value.to_string());
        }
        json.push_str(&" ".repeat(json.len().next_multiple_of(4) - json.len()));
        let mut changed = bytes[..12].to_vec();
        changed.extend((json.len() as u32).to_le_bytes());
        changed.extend(b"JSON");
        changed.extend(json.as_bytes());
        changed.extend(&bytes[20 + length..]);
        let total = changed.len() as u32;
        changed[8..12].copy_from_slice(&total.to_le_bytes());
        let _ = parse_model(file, &changed, &mut nothing);
    }

    #[test]
    fn broken_text_never_panics(
        is_ply in any::<bool>(),
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let (file, text) = if is_ply {
            ("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
                0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
        } else {
            ("a.obj", "mtllib a.mtl\ng a\nv 0 0 0\nv 1 0 0 1 0 1\nv 0 1 0\nvt 0 1\nvn 0 0 1\nusemtl b\nf 1/1/1 2//1 -1/-1\n")
        };
        let mut bytes = text.as_bytes().to_vec();
        for (at, value) in flips {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let _ = parse_model(file, &bytes, &mut |_| Ok(bytes.iter().rev().copied().collect()));
    }
}
