//! Models for tests: the paper's bunny and cow, read from `../shared/data`, and quads made by hand.

use super::source::{SourceMaterial, SourceMesh, SourceModel};
use crate::math::bounding::Aabb;
use bevy::math::Vec3;
use std::path::Path;

/// A parallelogram of two triangles from `corner`, one colour; its front side is that of `along × up`.
pub fn quad(corner: Vec3, along: Vec3, up: Vec3, material: usize) -> SourceMesh {
    SourceMesh {
        positions: vec![corner, corner + along, corner + along + up, corner + up],
        normals: vec![along.cross(up).normalize(); 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        material,
        ..Default::default()
    }
}

/// A model of these meshes with the given number of default materials.
pub fn model(meshes: Vec<SourceMesh>, materials: usize) -> SourceModel {
    let materials = vec![SourceMaterial::default(); materials];
    SourceModel { meshes, materials, ..Default::default() }
}

/// The box around a model.
pub fn bounds(model: &SourceModel) -> Aabb {
    Aabb::of(model.meshes.iter().flat_map(|mesh| mesh.positions.iter().copied()))
}

/// The Stanford bunny (69,451 triangles), or `None` with a message if the data is not there.
pub fn bunny(test: &str) -> Option<SourceModel> {
    let text = read("bun_zipper.ply", test)?;
    let body: Vec<&str> = text.lines().skip_while(|line| *line != "end_header").skip(1).collect();
    let (vertices, faces) = body.split_at(35_947);
    let positions = vertices.iter().map(|line| Vec3::from_slice(&numbers(line)[..3])).collect();
    let corners = |line: &&str| {
        let n = numbers(line);
        [n[1] as u32, n[2] as u32, n[3] as u32]
    };
    Some(smooth(positions, faces[..69_451].iter().map(corners).collect()))
}

/// The cow (5,804 triangles), or `None` with a message if the data is not there.
pub fn cow(test: &str) -> Option<SourceModel> {
    let text = read("cow.obj", test)?;
    let lines = |tag: &'static str| text.lines().filter_map(move |line| line.strip_prefix(tag));
    let positions = lines("v ").map(|line| Vec3::from_slice(&numbers(line))).collect();
    let corner =
        |word: &str| word.split('/').next().and_then(|n| n.parse::<u32>().ok()).expect("index") - 1;
    let triangle = |line: &str| {
        let corners: Vec<u32> = line.split_whitespace().map(corner).collect();
        [corners[0], corners[1], corners[2]]
    };
    Some(smooth(positions, lines("f ").map(triangle).collect()))
}

fn read(name: &str, test: &str) -> Option<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/meshes").join(name);
    let text = std::fs::read_to_string(path).ok();
    if text.is_none() {
        println!("SKIPPED {test}: no ../shared/data");
    }
    text
}

fn numbers(line: &str) -> Vec<f32> {
    line.split_whitespace().map(|word| word.parse().expect("a number")).collect()
}

/// A model of one mesh with vertex normals weighted by area.
fn smooth(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> SourceModel {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in &triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        triangle.iter().for_each(|&i| normals[i as usize] += (b - a).cross(c - a));
    }
    let normals = normals.iter().map(|n| n.normalize_or(Vec3::Y)).collect();
    model(vec![SourceMesh { positions, normals, triangles, ..Default::default() }], 1)
}
