use super::*;
use crate::bake::peel::{cpu, directions, viewports};
use crate::bake::settings::BakeSettings;
use crate::bake::source::SourceModel;
use crate::bake::test_models::{self, bounds};
use crate::lod::window::{WINDOW_CYCLE, window_start};
use crate::math::hash::SplitMix64;
use proptest::prelude::*;
use std::collections::BTreeMap;

const METHODS: [OrderMethod; 4] =
    [OrderMethod::Random, OrderMethod::FarthestPoint, OrderMethod::BlueNoise, OrderMethod::Lattice];

fn peel(model: &SourceModel, ldi_size: u32) -> Vec<PeelSample> {
    let viewports = viewports(&bounds(model), ldi_size, &directions(3));
    cpu::peel(model, &viewports, &BakeSettings::default(), &|_| {}).samples
}

/// The samples of a ball of triangles, closed, seen from three sides.
fn ball(ldi_size: u32) -> Vec<PeelSample> {
    let steps = 24;
    let point = |i: u32, j: u32| {
        let (u, v) = (
            i as f32 / steps as f32 * std::f32::consts::TAU,
            j as f32 / steps as f32 * std::f32::consts::PI,
        );
        Vec3::new(v.sin() * u.cos(), v.cos(), v.sin() * u.sin())
    };
    let quads = (0..steps * steps).map(|i| (i / steps, i % steps)).flat_map(|(i, j)| {
        [[(i, j), (i + 1, j), (i + 1, j + 1)], [(i, j), (i + 1, j + 1), (i, j + 1)]]
    });
    let positions: Vec<Vec3> = quads.flatten().map(|(i, j)| point(i % steps, j)).collect();
    let triangles =
        (0..positions.len() as u32 / 3).map(|i| [i * 3, i * 3 + 1, i * 3 + 2]).collect();
    let normals = positions.clone();
    let mesh =
        crate::bake::source::SourceMesh { positions, normals, triangles, ..Default::default() };
    peel(&test_models::model(vec![mesh], 1), ldi_size)
}

fn is_permutation(order: &[u32], count: usize) -> bool {
    let mut sorted = order.to_vec();
    sorted.sort_unstable();
    sorted.into_iter().eq(0..count as u32)
}

/// Coarse cells that should hold `expected` points of the prefix on average over the surface: each that holds a fair share of
/// the whole list must hold a point of the prefix. Returns how many do not.
fn empty_cells(positions: &[Vec3], order: &[u32], n: usize, side: f32) -> (usize, usize) {
    let cell = |i: u32| (positions[i as usize] / side).floor().as_ivec3().to_array();
    let mut counts = BTreeMap::<[i32; 3], [usize; 2]>::new();
    for (rank, &i) in order.iter().enumerate() {
        let count = counts.entry(cell(i)).or_default();
        count[0] += 1;
        count[1] += usize::from(rank < n);
    }
    let fair = |count: &[usize; 2]| count[0] * n >= positions.len() * 4;
    let occupied = counts.values().filter(|c| fair(c)).count();
    (counts.values().filter(|c| fair(c) && c[1] == 0).count(), occupied)
}

#[test]
fn every_prefix_covers_the_whole_tree() {
    let mut models = vec![("ball", ball(150), 2.0 / 150.0)];
    if let Some(bunny) = test_models::bunny("every_prefix_covers_the_whole_tree (bunny)") {
        let side = bounds(&bunny).extent().max_element() / 200.0;
        models.push(("bunny", peel(&bunny, 200), side));
    }
    for (name, samples, pixel) in models {
        let positions = positions(&samples);
        for method in METHODS {
            let order = order(&samples, method, 1, &|_| {});
            for n in [4, 16, 64].map(|share| samples.len() / share) {
                // A cell's side so that a plane through it holds 32 points of the prefix.
                let side = pixel * (32.0 * samples.len() as f32 / n as f32).sqrt();
                let (empty, occupied) = empty_cells(&positions, &order, n, side);
                assert!(occupied > 10, "{name}: only {occupied} cells tell nothing");
                // Random prefixes may leave holes; they only must not leave many.
                let allowed = if method == OrderMethod::Random { occupied / 20 } else { 0 };
                assert!(
                    empty <= allowed,
                    "{name} {method:?}, {n} points: {empty} of {occupied} cells are empty"
                );
                let gap = coverage_gap(&positions, &order, n) / side;
                let most = if method == OrderMethod::Random { 2.0 } else { 1.0 };
                assert!(gap < most, "{name} {method:?}, {n} points: a hole of {gap} cells");
            }
        }
    }
}

#[test]
fn no_direction_is_preferred_in_any_prefix() {
    let samples = ball(100);
    for method in METHODS {
        let order = order(&samples, method, 5, &|_| {});
        for n in [samples.len() / 3, samples.len() / 9, samples.len() / 27] {
            for direction in 0..3 {
                let share = |indices: &[u32]| {
                    let of =
                        indices.iter().filter(|&&i| samples[i as usize].direction == direction);
                    of.count() as f32 / indices.len() as f32
                };
                let ratio = share(&order[..n]) / share(&order);
                assert!(
                    (ratio - 1.0).abs() < 0.12,
                    "{method:?}, {n} points, direction {direction}: {ratio}"
                );
            }
        }
    }
}

#[test]
fn farthest_points_are_those_that_comparing_all_pairs_gives() {
    let mut random = SplitMix64(4);
    let positions: Vec<Vec3> = (0..600)
        .map(|_| Vec3::new(random.next_f32(), random.next_f32(), random.next_f32()))
        .collect();
    let order = farthest::order(&positions, 7, &|_| {});
    let mut squared = vec![f32::INFINITY; positions.len()];
    for (k, &i) in order.iter().enumerate() {
        if k > 0 {
            let largest = squared.iter().copied().fold(0.0, f32::max);
            assert_eq!(squared[i as usize], largest, "point {k}");
        }
        for (s, p) in std::iter::zip(&mut squared, &positions) {
            *s = s.min(p.distance_squared(positions[i as usize]));
        }
    }
}

#[test]
fn lattice_keys_take_the_even_quarter_first_then_its_diagonals() {
    let mut cells: Vec<(u32, [u16; 2])> =
        (0..16).map(|i| [i % 4, i / 4]).map(|[x, y]| (lattice::key(x, y), [x, y])).collect();
    cells.sort_unstable();
    let cells: Vec<[u16; 2]> = cells.into_iter().map(|(_, cell)| cell).collect();
    assert_eq!(cells[..4], [[0, 0], [2, 2], [2, 0], [0, 2]]);
    assert!(cells[4..8].iter().all(|[x, y]| x % 2 == 1 && y % 2 == 1));
}

/// The largest hole of each of the windows that eight frames show of `n` points.
fn window_gaps(positions: &[Vec3], order: &[u32], n: usize) -> Vec<f32> {
    let starts = (0..WINDOW_CYCLE)
        .map(|turn| window_start(n as u32, order.len() as u32, turn) as usize)
        .collect::<std::collections::BTreeSet<_>>();
    starts.into_iter().map(|start| coverage_gap(positions, &order[start..], n)).collect()
}

#[test]
fn every_window_of_a_lattice_list_is_as_even_as_its_prefix() {
    let samples = ball(200);
    let positions = positions(&samples);
    let order = order(&samples, OrderMethod::Lattice, 1, &|_| {});
    // Between powers of 4 a window is most of two lattices.
    for share in [3.0, 3.9, 5.0, 7.0, 9.0, 13.0, 16.5, 23.0, 40.0, 63.0, 100.0] {
        let n = (samples.len() as f32 / share) as usize;
        let prefix = coverage_gap(&positions, &order, n);
        let gaps = window_gaps(&positions, &order, n);
        let worst = gaps.iter().copied().fold(0.0, f32::max) / prefix;
        let anywhere = (1..40)
            .map(|i| i * (samples.len() - n) / 40)
            .map(|start| coverage_gap(&positions, &order[start..], n))
            .fold(0.0, f32::max)
            / prefix;
        println!("1/{share}: {} windows, worst hole {worst}, of any range {anywhere}", gaps.len());
        assert!(worst < 1.35, "1/{share}: {gaps:?} against {prefix}");
    }
}

#[test]
fn eight_windows_together_are_as_even_as_a_prefix_of_their_size() {
    let samples = ball(200);
    let positions = positions(&samples);
    let order = order(&samples, OrderMethod::Lattice, 1, &|_| {});
    for share in [9.0, 16.0, 30.0, 64.0, 120.0] {
        let n = (samples.len() as f32 / share) as usize;
        let starts = (0..WINDOW_CYCLE).map(|turn| window_start(n as u32, order.len() as u32, turn));
        let shown: Vec<u32> = starts.flat_map(|s| &order[s as usize..][..n]).copied().collect();
        let together = coverage_gap(&positions, &shown, shown.len());
        let prefix = coverage_gap(&positions, &order, shown.len());
        println!("8 / {share}: hole {}", together / prefix);
        assert!(together / prefix < 2.2, "8 windows of 1/{share}: {together} against {prefix}");
    }
}

#[test]
fn evenness_is_zero_for_a_lattice_and_a_half_for_random_points() {
    let lattice: Vec<Vec3> =
        (0..2500).map(|i| Vec3::new((i % 50) as f32, (i / 50) as f32, 0.0)).collect();
    let order: Vec<u32> = (0..2500).collect();
    assert!(coverage_evenness(&lattice, &order, 2500) < 1e-6);
    assert!(
        (coverage_gap(&lattice, &order, 2500), coverage_gap(&lattice, &order, 0))
            == (0.0, f32::INFINITY)
    );
    let mut random = SplitMix64(1);
    let scattered: Vec<Vec3> =
        (0..2500).map(|_| Vec3::new(random.next_f32(), random.next_f32(), 0.0)).collect();
    assert!((coverage_evenness(&scattered, &order, 2500) - 0.52).abs() < 0.05);
    assert_eq!(coverage_evenness(&scattered, &order, 1), 0.0);
}

fn any_samples() -> impl Strategy<Value = Vec<PeelSample>> {
    let sample = (0u8..4, 0u16..3, 0u16..40, 0u16..40, 0i8..20).prop_map(
        |(direction, layer, x, y, depth)| PeelSample {
            position: Vec3::new(f32::from(x), f32::from(y), f32::from(depth)),
            normal: Vec3::Z,
            face_normal: Vec3::Z,
            albedo: [0; 3],
            material: 0,
            direction,
            layer,
            cell: [x, y],
        },
    );
    proptest::collection::vec(sample, 0..300)
}

proptest! {
    #[test]
    fn every_order_is_a_deterministic_permutation(samples in any_samples(), seed in any::<u64>()) {
        for method in METHODS {
            let first = order(&samples, method, seed, &|_| {});
            prop_assert!(is_permutation(&first, samples.len()), "{:?}", method);
            prop_assert_eq!(&first, &order(&samples, method, seed, &|_| {}));
            if samples.len() > 100 {
                prop_assert_ne!(&first, &order(&samples, method, seed ^ 1, &|_| {}), "{:?}", method);
            }
        }
    }
}

/// Run with `--ignored --nocapture`: the tables of the report.
#[test]
#[ignore = "measures; run it alone, in release"]
fn timings_and_evenness_of_the_bunny() {
    let Some(bunny) = test_models::bunny("timings_and_evenness_of_the_bunny") else { return };
    for ldi_size in [255, 500, 1000] {
        let samples = peel(&bunny, ldi_size);
        let positions = positions(&samples);
        let pixel = bounds(&bunny).extent().max_element() / ldi_size as f32;
        println!("{} points: evenness / gap in spacings of N0/4, N0/16, N0/64", samples.len());
        for method in METHODS {
            let start = std::time::Instant::now();
            let order = order(&samples, method, 1, &|_| {});
            let seconds = start.elapsed().as_secs_f32();
            let rows = [4, 16, 64].map(|share| {
                let n = samples.len() / share;
                let spacing = pixel * (share as f32).sqrt();
                let gap = coverage_gap(&positions, &order, n) / spacing;
                format!("{:.3} / {gap:.2}", coverage_evenness(&positions, &order, n))
            });
            println!("{method:?}: {seconds:.2} s; {}", rows.join(", "));
        }
    }
}
