//! A map of ground, trees and flight to look at. Tests only.

use super::*;
use crate::math::quantize::linear_to_srgb8;
use bevy::math::Vec3;

const SIZE: u32 = 1200;

#[test]
#[ignore = "writes a picture to look at; run with --ignored"]
fn a_map_is_written_to_the_temporary_folder() {
    let side = 1000.0;
    let field = Heightfield::rolling(side, heightfield::DEFAULT_CELLS, 1);
    let trees = scatter(&field, &ScatterSettings { count: 14_000, ..ScatterSettings::default() })
        .expect("room");
    let path = FlightPath::over_forest(&field, &trees, 1);
    let mesh = field.mesh_data();
    let sun = Vec3::new(0.6, 0.5, -0.4).normalize();
    let to_pixel =
        |v: f32| (((v / side + 0.5) * SIZE as f32) as i64).clamp(0, i64::from(SIZE) - 1) as u32;
    let mut image = image::RgbImage::from_fn(SIZE, SIZE, |x, y| {
        let [px, pz] = [x, y].map(|v| (v as f32 / SIZE as f32 - 0.5) * side);
        let cell = |v: f32| ((v / side + 0.5) * field.cells() as f32) as usize;
        let color = mesh.colors[cell(pz) * (field.cells() as usize + 1) + cell(px)];
        let light = 2.6 * field.normal(px, pz).dot(sun).max(0.0) + 0.6;
        image::Rgb([0, 1, 2].map(|k| linear_to_srgb8(color[k] * light)))
    });
    for tree in &trees {
        let crown = [[40, 110, 25], [130, 170, 50], [15, 60, 40]][tree.species % 3];
        for dz in -1i64..=1 {
            for dx in -1i64..=1 {
                let x = (i64::from(to_pixel(tree.position.x)) + dx).clamp(0, i64::from(SIZE) - 1)
                    as u32;
                let y = (i64::from(to_pixel(tree.position.z)) + dz).clamp(0, i64::from(SIZE) - 1)
                    as u32;
                image.put_pixel(x, y, image::Rgb(crown));
            }
        }
    }
    for i in 0..6000 {
        let p = path.position(i as f32 / 6000.0);
        let above = ((p.y - field.height(p.x, p.z)) / 50.0).clamp(0.0, 1.0);
        let color = image::Rgb([255, (255.0 * (1.0 - above)) as u8, (120.0 * above) as u8]);
        for k in 0..4 {
            image.put_pixel(
                (to_pixel(p.x) + k % 2).min(SIZE - 1),
                (to_pixel(p.z) + k / 2).min(SIZE - 1),
                color,
            );
        }
    }
    let file = std::env::temp_dir().join("treeline_map.png");
    image.save(&file).expect("the temporary folder is writable");
    let [low, high] = field.height_range();
    println!("{}: ground {low:.1} to {high:.1} m, flight {:.0} m", file.display(), path.length_m());
}
