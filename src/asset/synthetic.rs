//! A tree-like cloud of surfels for tests of the file format: discs for leaves in a crown, snapped to an LDI as
//! peeling does, in random order. The same for the same seed. Factors of few points are all 1.

use super::surfel::{SURFEL_LEAF, SURFEL_TWO_SIDED, Surfel};
use super::tree_data::{BakeSeconds, BakeStatistics, SeenMean, SourceReference, TreeData};
use crate::lod::thinning::FACTOR_STEPS;
use crate::math::{bounding::Aabb, hash::SplitMix64};
use bevy::math::Vec3;

/// A tree of `count` points, 8 m wide and 10 m high, in an LDI of 512 pixels.
pub(crate) fn synthetic_tree(count: usize, seed: u64) -> TreeData {
    let mut random = SplitMix64(seed);
    let bounds = Aabb { min: Vec3::new(-4.0, 0.0, -4.0), max: Vec3::new(4.0, 10.0, 4.0) };
    let pixel = 10.0 / 512.0;
    let mut surfels: Vec<Surfel> = Vec::with_capacity(count);
    while surfels.len() < count {
        let center = ball(&mut random) * Vec3::new(3.9, 4.9, 3.9) + bounds.center();
        let normal = ball(&mut random).normalize_or(Vec3::Y);
        let right = normal.any_orthonormal_vector();
        let up = normal.cross(right);
        let shade = random.range(0.6, 1.0);
        // The axis most parallel to the normal is the one the point was peeled along: its depth is not snapped.
        let along = normal.abs().cmpge(Vec3::splat(normal.abs().max_element()));
        for _ in 0..40.min(count - surfels.len()) {
            let offset = ball(&mut random) * 0.07;
            let point = center + right * offset.x + up * offset.y;
            let cell = ((point - bounds.min) / pixel).floor() + 0.5;
            let position = Vec3::select(along, point, bounds.min + cell * pixel);
            let bent = (normal + ball(&mut random) * 0.3).normalize_or(normal);
            let albedo = [70.0, 110.0, 40.0].map(|c| (c * shade + random.range(-8.0, 8.0)) as u8);
            surfels.push(Surfel {
                position: position.clamp(bounds.min, bounds.max),
                face_normal: normal,
                normal: bent,
                albedo,
                flags: SURFEL_LEAF | SURFEL_TWO_SIDED,
                roughness: 0.8,
                thickness: 1,
                ambient_visibility: 255,
                group: 0,
                metallic: 0.0,
            });
        }
    }
    random.shuffle(&mut surfels);
    let (hot, cold) = surfels.iter().map(|s| s.pack(&bounds)).unzip();
    TreeData {
        bounds,
        pixel,
        surface_area: 123.4,
        mean_leaf_area: 0.015,
        area_factors: [1.0; FACTOR_STEPS],
        light_factors: [1.0; FACTOR_STEPS],
        seen_mean: SeenMean::default(),
        hot,
        cold,
        source: Some(SourceReference { path: "trees/oak.glb".into(), content_hash: [7; 32] }),
        statistics: BakeStatistics {
            triangles: 60_000,
            ldi_size: 512,
            layers: vec![31, 40, 29],
            fragments: vec![90_000, 70_000, 88_000],
            left_over: 0,
            backend: "cpu".into(),
            order: "lattice".into(),
            seed: u64::MAX,
            seconds: BakeSeconds { loading: 0.25, peeling: 1.234_567, ordering: 0.1, total: 1.6 },
            warnings: vec!["material `bark` is blended: read as a mask".into()],
        },
    }
}

/// A point of the unit ball.
fn ball(random: &mut SplitMix64) -> Vec3 {
    loop {
        let p = Vec3::from_array(std::array::from_fn(|_| random.range(-1.0, 1.0)));
        if p.length_squared() <= 1.0 {
            return p;
        }
    }
}
