//! What every flight promises, on grounds of several kinds and sizes.

use super::test_grounds::{Mountains, biomes, real_dem, woods};
use super::*;
use crate::landscape::Heightfield;
use std::time::Instant;

/// Asserts every promise of a flight and returns the share of it per role.
fn check(name: &str, ground: &dyn Ground, cell_m: f32, seed: u64) -> Vec<(Role, f32)> {
    let biomes = biomes(ground, seed);
    let source = woods(ground, &biomes, cell_m);
    let settings = FlightSettings { seed, ..FlightSettings::default() };
    let start = Instant::now();
    let path = FlightPath::over(ground, &biomes, &source, &settings);
    let took = start.elapsed().as_secs_f32();
    let samples = (path.length_m() / 0.4) as usize;
    let step = path.length_m() / samples as f32;
    let half = ground.side_m() * 0.5;
    let level = ground.water_level().unwrap_or(f32::NEG_INFINITY);
    let mut crowns = Crowns::new(&source);
    let (mut lowest, mut closest, mut fastest) = (f32::MAX, f32::MAX, 0.0f32);
    let mut shares: Vec<(Role, f32)> = vec![];
    let mut before = path.position(-1.0 / samples as f32);
    let mut direction: Option<Vec3> = None;
    let mut climb = f32::NAN;
    for i in 0..=samples {
        let t = i as f32 / samples as f32;
        let (eye, target) = path.look(t);
        assert_eq!(eye, path.position(t));
        assert!(eye.x.abs() < half && eye.z.abs() < half, "{name}: {eye} is outside");
        let above = eye.y - ground.height(eye.x, eye.z);
        lowest = lowest.min(above);
        assert!(above >= GROUND_CLEARANCE_M, "{name} {seed}: {above} m above ground at t {t}");
        assert!(eye.y >= level + WATER_CLEARANCE_M, "{name} {seed}: {} over water", eye.y - level);
        let moved = eye.distance(before);
        assert!(
            (moved - step).abs() < 0.12 * step + 4e-3,
            "{name} {seed}: {moved} of {step} at {t}"
        );
        let rise = (eye.y - before.y) / moved;
        assert!(
            (rise - climb).abs() < 0.12 || climb.is_nan(),
            "{name} {seed}: kink at {t}: {climb} {rise}"
        );
        climb = rise;
        let role = path.role_at(t);
        crowns.visit(Vec2::new(eye.x, eye.z), 0.0, |crown| {
            assert!(!crown.contains(eye), "{name} {seed}: in leaves at t {t}, {role}");
            if eye.y < crown.position.y + crown.height_m {
                assert_eq!(role, Role::InsideForest, "{name} {seed} at t {t}");
                let bark = crown.distance(Vec2::new(eye.x, eye.z)) - crown.trunk_m();
                closest = closest.min(bark);
                assert!(bark >= EYE_TO_TRUNK_M, "{name} {seed}: {bark} m from a trunk at t {t}");
            }
        });
        let looks = (target - eye).normalize();
        if let Some(last) = direction {
            // In f64: the dot product of two nearly equal directions loses the angle.
            let turn = looks.as_dvec3().angle_between(last.as_dvec3()) as f32;
            fastest = fastest.max(turn / step * 14.0);
        }
        direction = Some(looks);
        let floor = ground.height(target.x, target.z).max(level);
        assert!(target.y > floor, "{name} {seed}: looks into the ground at t {t}");
        let share = 1.0 / samples as f32;
        match shares.iter_mut().find(|s| s.0 == role) {
            Some(entry) => entry.1 += share,
            None => shares.push((role, share)),
        }
        before = eye;
    }
    let fastest = fastest.to_degrees();
    println!(
        "{name} {seed}: {:.0} m in {took:.2} s, lowest {lowest:.2}, bark {closest:.2}, turn {fastest:.1}°/s, {}",
        path.length_m(),
        shares
            .iter()
            .map(|(r, s)| format!("{r} {:.0} %", s * 100.0))
            .collect::<Vec<_>>()
            .join(", ")
    );
    assert!(fastest < 25.0 || ground.side_m() < 1000.0, "{name} {seed}: turns {fastest}°/s");
    assert!(path.position(0.25).distance(path.position(1.25)) < 0.05);
    assert_eq!(path.position(f32::NAN), path.position(0.0));
    assert_eq!(path.position(f32::INFINITY), path.position(0.0));
    shares
}

#[test]
fn flights_keep_their_promises_over_rolling_hills() {
    for (side_m, seed) in [(1000.0, 1), (1000.0, 2), (4000.0, 3), (16_000.0, 4)] {
        check(&format!("hills {side_m}"), &Heightfield::rolling(side_m, 256, seed), 5.0, seed);
    }
}

#[test]
fn flights_keep_their_promises_over_mountains_with_lakes() {
    for side_m in [1000.0, 4000.0, 16_000.0] {
        for seed in 1..4 {
            check(&format!("mountains {side_m}"), &Mountains::new(side_m, seed), 6.0, seed);
        }
    }
}

#[test]
fn flights_keep_their_promises_in_dense_and_in_sparse_woods() {
    for cell_m in [3.5, 9.0] {
        check(&format!("woods {cell_m}"), &Mountains::new(4000.0, 5), cell_m, 5);
    }
}

#[test]
fn flights_keep_their_promises_over_a_real_dem() {
    let Some(dem) = real_dem() else {
        println!("SKIPPED flights_keep_their_promises_over_a_real_dem: no ../shared/data");
        return;
    };
    for seed in 1..3 {
        check("dem", &dem, 7.0, seed);
    }
}

#[test]
fn tiny_grounds_have_flights_too() {
    for side_m in [60.0, 150.0, 400.0] {
        check(&format!("tiny {side_m}"), &Heightfield::rolling(side_m, 64, 9), 6.0, 9);
    }
}

#[test]
fn a_flight_shows_every_kind_of_place() {
    for seed in 1..5 {
        let shares = check("varied", &Mountains::new(8000.0, seed), 6.0, seed);
        let share = |role| shares.iter().find(|s| s.0 == role).map_or(0.0, |s| s.1);
        for role in
            [Role::ValleyFloor, Role::ForestEdge, Role::InsideForest, Role::Ridge, Role::Overview]
        {
            assert!(share(role) > 0.02, "seed {seed}: {role} {}", share(role));
        }
    }
}

#[test]
fn the_same_settings_give_the_same_flight_and_others_another() {
    let ground = Mountains::new(4000.0, 1);
    let biomes = biomes(&ground, 1);
    let source = woods(&ground, &biomes, 6.0);
    let fly = |seed| {
        let settings = FlightSettings { seed, length_m: 3000.0, center: None };
        FlightPath::over(&ground, &biomes, &source, &settings)
    };
    assert_eq!(fly(1), fly(1));
    assert_ne!(fly(1), fly(2));
}

#[test]
fn a_middle_is_kept_where_there_is_room() {
    let ground = Mountains::new(16_000.0, 1);
    let biomes = biomes(&ground, 1);
    for (asked, most_m) in [(Vec2::new(3000.0, -2000.0), 600.0), (Vec2::NAN, 8000.0)] {
        let settings =
            FlightSettings { center: Some(asked), length_m: 4000.0, ..Default::default() };
        let path = FlightPath::over(&ground, &biomes, &|_, _| vec![], &settings);
        let points = (0..100).map(|i| path.position(i as f32 / 100.0));
        let mean = points.map(|p| Vec2::new(p.x, p.z)).sum::<Vec2>() / 100.0;
        let asked = if asked.is_finite() { asked } else { Vec2::ZERO };
        assert!(mean.distance(asked) < most_m, "{mean} for {asked}");
        assert!((2500.0..5500.0).contains(&path.length_m()), "{}", path.length_m());
    }
}
