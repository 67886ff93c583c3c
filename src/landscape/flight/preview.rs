//! A map and a profile of flights to look at. Tests only.

use super::test_grounds::{Mountains, biomes, real_dem, woods};
use super::*;
use crate::landscape::Heightfield;
use image::{Rgb, RgbImage};

const MAP: u32 = 900;
const PROFILE: u32 = 260;

#[test]
#[ignore = "writes pictures to look at; run with --ignored"]
fn maps_of_flights_are_written_to_the_temporary_folder() {
    draw("hills_1km", &Heightfield::rolling(1000.0, 256, 1), 1);
    draw("mountains_4km", &Mountains::new(4000.0, 2), 2);
    draw("mountains_16km", &Mountains::new(16_000.0, 3), 3);
    if let Some(dem) = real_dem() {
        draw("dem", &dem, 1);
    }
}

fn color_of(role: Role) -> Rgb<u8> {
    Rgb(match role {
        Role::ValleyFloor => [90, 200, 255],
        Role::ForestEdge => [255, 230, 0],
        Role::InsideForest => [255, 90, 0],
        Role::Canopy => [255, 0, 200],
        Role::Ridge => [255, 255, 255],
        Role::Overview => [220, 0, 0],
    })
}

/// Above: the surroundings of the flight from above, coloured by role. Below: ground, crowns and eye along the way.
fn draw(name: &str, ground: &dyn Ground, seed: u64) {
    let biomes = biomes(ground, seed);
    let source = woods(ground, &biomes, 6.0);
    let path = FlightPath::over(
        ground,
        &biomes,
        &source,
        &FlightSettings { seed, ..FlightSettings::default() },
    );
    let places: Vec<Vec3> = (0..8000).map(|i| path.position(i as f32 / 8000.0)).collect();
    let (mut min, mut max) = (places[0], places[0]);
    for p in &places {
        (min, max) = (min.min(*p), max.max(*p));
    }
    let middle = (min + max) * 0.5;
    let side = (max - min).x.max((max - min).z) * 1.15;
    let at = |x: u32, y: u32| {
        let [u, v] = [x, y].map(|k| (k as f32 / MAP as f32 - 0.5) * side);
        (middle.x + u, middle.z + v)
    };
    let mut image = RgbImage::from_pixel(1800, MAP.max(4 * PROFILE + 20), Rgb([20, 20, 24]));
    for y in 0..MAP {
        for x in 0..MAP {
            let (px, pz) = at(x, y);
            let site = ground.site(px, pz);
            let biome = biomes.at(px, pz, &site);
            let base =
                Vec3::new(120.0, 130.0, 70.0).lerp(Vec3::new(20.0, 70.0, 25.0), biome.forest);
            let base = base.lerp(Vec3::splat(130.0), biome.rock + biome.scree);
            let base = base.lerp(Vec3::splat(240.0), biome.snow);
            let light =
                0.35 + 0.75 * site.normal.dot(Vec3::new(0.6, 0.6, -0.5).normalize()).max(0.0);
            let water = site.above_water_m < 0.0;
            let c = if water { Vec3::new(40.0, 70.0, 140.0) } else { base * light };
            image.put_pixel(x, y, Rgb(c.to_array().map(|v| v.clamp(0.0, 255.0) as u8)));
        }
    }
    for (i, p) in places.iter().enumerate() {
        let t = i as f32 / places.len() as f32;
        let [x, y] = [p.x - middle.x, p.z - middle.z]
            .map(|v| ((v / side + 0.5) * MAP as f32).clamp(1.0, MAP as f32 - 2.0) as u32);
        for k in 0..4 {
            image.put_pixel(x + k % 2, y + k / 2, color_of(path.role_at(t)));
        }
    }
    // Four rows of the profile, each a quarter of the way.
    let mut crowns = Crowns::new(&source);
    let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
    for row in 0..4 {
        let width = 1800 - MAP - 10;
        let share = |x: u32| (row as f32 + x as f32 / width as f32) / 4.0;
        let eyes: Vec<Vec3> = (0..width).map(|x| path.position(share(x))).collect();
        let floor = |p: &Vec3| ground.height(p.x, p.z);
        let low = eyes.iter().map(floor).fold(f32::MAX, f32::min) - 5.0;
        let high = eyes.iter().map(|p| p.y).fold(f32::MIN, f32::max).max(low + 60.0) + 5.0;
        let to_y = |h: f32| {
            let share = ((h - low) / (high - low)).clamp(0.0, 1.0);
            row * (PROFILE + 5) + ((1.0 - share) * (PROFILE - 1) as f32) as u32
        };
        for (x, eye) in eyes.iter().enumerate() {
            let x = MAP + 10 + x as u32;
            for y in to_y(floor(eye))..=to_y(low) {
                image.put_pixel(x, y, Rgb([90, 75, 55]));
            }
            for y in to_y(level)..to_y(floor(eye)) {
                image.put_pixel(x, y, Rgb([40, 70, 140]));
            }
            crowns.visit(Vec2::new(eye.x, eye.z), 0.0, |crown| {
                let foot = crown.position.y;
                for y in to_y(foot + crown.height_m)..=to_y(foot + crown.open_below_m()) {
                    image.put_pixel(x, y, Rgb([30, 110, 40]));
                }
            });
            let (_, target) = path.look(share(x - MAP - 10));
            let y = to_y(eye.y);
            image.put_pixel(x, y, color_of(path.role_at(share(x - MAP - 10))));
            image.put_pixel(x, y.saturating_sub(1), color_of(path.role_at(share(x - MAP - 10))));
            // Ticks of the view's pitch.
            if x.is_multiple_of(40) {
                let pitch = (target.y - eye.y) / target.distance(*eye);
                for k in 0..18 {
                    let y = to_y(eye.y - (-pitch * k as f32) * (high - low) / PROFILE as f32);
                    image.put_pixel((x + k).min(1799), y, Rgb([255, 255, 255]));
                }
            }
        }
    }
    let file = std::env::temp_dir().join(format!("treeline_flight_{name}.png"));
    image.save(&file).expect("the temporary folder is writable");
    println!("{}: {:.0} m", file.display(), path.length_m());
}
