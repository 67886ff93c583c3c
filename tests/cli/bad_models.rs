//! Models that cannot be baked: each a message that names the file, what is wrong and what to do.

use super::{
    Workplace,
    glb::{Glb, container, png},
};
use serde_json::json;

fn broken(change: impl FnOnce(&mut Glb)) -> Vec<u8> {
    let mut model = Glb::square();
    change(&mut model);
    model.bytes()
}

#[test]
fn the_models_that_the_bad_ones_are_made_from_are_good() {
    let place = Workplace::new();
    place.write("plain.glb", &Glb::square().bytes());
    place.write("textured.glb", &broken(|m| m.texture = Some(png())));
    place.run("bake plain.glb textured.glb --ldi 16 --out out").succeeds();
    assert_eq!(place.files("out"), ["plain.treeline", "textured.treeline"]);
}

#[test]
fn every_bad_model_is_named_with_its_fault_and_a_way_out_and_nothing_is_written() {
    let place = Workplace::new();
    let good = Glb::square().bytes();
    let no_mesh =
        container(&json!({ "asset": { "version": "2.0" }, "scenes": [{ "nodes": [] }] }), &[]);
    let models: [(&str, Vec<u8>, &[&str]); 15] = [
        ("garbage.glb", b"\x89\x12 this is no model \xff\xfe".to_vec(), &["malformed", "JSON", "export it again"]),
        ("cut_header.glb", good[..10].to_vec(), &["cut short", "header", "copy or export"]),
        ("cut.glb", good[..good.len() / 2].to_vec(), &["cut short", "bytes", "copy or export"]),
        ("empty.glb", vec![], &["malformed", "export it again"]),
        ("no_mesh.glb", no_mesh, &["no mesh", "export it with triangles"]),
        ("index.glb", broken(|m| m.indices[4] = 9), &["triangle 1", "vertex 9", "there are 4", "export it again"]),
        ("nan.glb", broken(|m| m.positions[2][1] = f32::NAN), &["square", "vertex 2", "NaN", "repair the mesh"]),
        ("infinite.glb", broken(|m| m.positions[1][0] = f32::INFINITY), &["vertex 1", "inf", "repair the mesh"]),
        ("flat.glb", broken(|m| m.positions = vec![[1.0, 2.0, 0.0]; 4]), &["zero area", "2 triangles", "check its scale"]),
        ("texture.glb", broken(|m| m.texture = Some(png()[..50].to_vec())), &["image 0", "save it as a PNG or JPEG"]),
        ("no_texture.glb", broken(|m| m.texture = Some(b"no image".to_vec())), &["image 0", "neither a PNG nor a JPEG"]),
        ("oak.fbx", good.clone(), &["unknown kind", ".glb", "convert it"]),
        ("oak", good.clone(), &["unknown kind", ".glb", "convert it"]),
        ("oak.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 7\n".to_vec(), &["vertex", "export it again"]),
        ("cloud.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n".to_vec(), &["point cloud", "reconstruct"]),
    ];
    for (name, bytes, parts) in models {
        place.write(name, &bytes);
        let run = place.run(&format!("bake {name} --ldi 32 --out out"));
        run.fails_with(&[&[name], parts].concat());
        assert!(run.err.contains("1 of 1 models failed"), "{}", run.err);
        assert_eq!(place.files("out"), [""; 0], "{name}");
    }
    assert_eq!(place.files("cache"), [""; 0]);
}

#[test]
fn a_missing_file_and_a_folder_are_no_models_for_any_command() {
    let place = Workplace::new();
    for folder in ["folder", "folder.glb"] {
        std::fs::create_dir(place.path(folder)).expect("the folder is writable");
    }
    for (name, fault) in
        [("lost.glb", "No such file"), ("folder.glb", "directory"), ("folder", "directory")]
    {
        for command in ["bake", "view --headless", "compare", "fly --headless --tree"] {
            let run = place.run(&format!("{command} {name} --out out"));
            run.fails_with(&["cannot read the model", name, fault, "check the path"]);
            assert_eq!(place.files("out"), [""; 0], "{command} {name}");
        }
    }
}
