//! Results as a run would give them, for tests: the figures of trials on a software driver (two cores, 1280x720).

use super::row::{Machine, Results, Row, SCHEMA};

/// Instances, CPU seconds, wall ms, FLIP, block RMSE, resident MB.
type Peer = (u64, f64, f64, Option<f64>, Option<f64>, f64);

#[rustfmt::skip] // one row a line
const STOCK: &[Peer] = &[
    (1_000, 9.7, 6_079.0, Some(0.0702), Some(0.0028), 2_621.0),
    (10_000, 50.6, 43_782.0, None, None, 2_375.0),
];
#[rustfmt::skip]
const LOD: &[Peer] = &[
    (1_000, 4.7, 2_335.0, Some(0.0810), Some(0.0056), 1_108.0),
    (10_000, 5.0, 4_900.0, Some(0.0824), Some(0.0061), 1_226.0),
    (100_000, 5.2, 2_636.0, Some(0.0851), Some(0.0066), 2_323.0),
];
/// Instances, CPU ms of a frame, then of culling, splatting and resolve, millions of points.
#[rustfmt::skip]
const POINTS: &[(u64, f64, f64, f64, f64, f64)] = &[
    (1_000, 333.0, 1.1, 44.0, 101.0, 0.81),
    (10_000, 337.0, 3.0, 55.0, 113.0, 1.07),
    (100_000, 355.0, 6.6, 68.0, 113.0, 1.33),
    (1_000_000, 370.0, 20.0, 73.0, 110.0, 1.48),
];

fn row(technique: &str, instances: u64) -> Row {
    Row {
        commit: "8bbb08f".into(),
        date: "2026-11-22".into(),
        adapter: "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
        driver: "llvmpipe Mesa 22.3.6".into(),
        backend: "Vulkan".into(),
        size: "1280x720".into(),
        scene: "baseline".into(),
        seed: 42,
        technique: technique.into(),
        instances,
        species: "sapling_quaking_aspen".into(),
        status: "ok".into(),
        camera: "still".into(),
        runs: 3,
        frames: 9,
        source_triangles: Some(44_000),
        ..Default::default()
    }
}

fn timed(mut row: Row, cpu_s: f64, frame_ms: f64) -> Row {
    row.cpu_s_per_frame = Some(cpu_s);
    (row.cpu_s_min, row.cpu_s_max) = (Some(cpu_s * 0.98), Some(cpu_s * 1.03));
    row.frame_ms = Some(frame_ms);
    (row.frame_ms_p25, row.frame_ms_p75) = (Some(frame_ms * 0.97), Some(frame_ms * 1.04));
    row.frame_ms_p95 = Some(frame_ms * 1.2);
    row
}

fn peer(technique: &str, (instances, cpu_s, frame_ms, flip, block, rss): Peer) -> Row {
    let gpu_ms = frame_ms * 0.98;
    Row {
        gpu_ms: Some(gpu_ms),
        gpu_ms_opaque: Some(gpu_ms * 0.99),
        gpu_ms_other: Some(gpu_ms * 0.01),
        cpu_ms_main: Some(1.1 + instances as f64 * 2.5e-4),
        cpu_ms_extract: Some(0.7 + instances as f64 * 6.4e-5),
        cpu_ms_render: Some(2.6 + instances as f64 * 1.6e-5),
        flip_mean: flip,
        flip_p95: flip.map(|flip| flip * 3.1),
        block_rmse: block,
        rss_mb: Some(rss),
        ..timed(row(technique, instances), cpu_s, frame_ms)
    }
}

fn points(technique: &str, cost: f64, flip: f64, block: f64) -> impl Iterator<Item = Row> {
    let row = row(technique, 0);
    POINTS.iter().map(move |&(instances, cpu_ms, cull, splat, resolve, million)| {
        let gpu_ms = (cull + splat + resolve + 150.0) * cost;
        Row {
            instances,
            points_baked: Some(262_144),
            points_drawn: Some((million * cost * 1e6) as u64),
            work_items: Some(26_400),
            overdraw: Some(million / 0.36),
            gpu_ms: Some(gpu_ms),
            gpu_ms_select: Some(cull * cost),
            gpu_ms_splat: Some(splat * cost),
            gpu_ms_pyramid: Some(6.0 * cost),
            gpu_ms_classify: Some(2.0 * cost),
            gpu_ms_resolve: Some(resolve * cost),
            gpu_ms_temporal: (technique != "points").then_some(18.0 * cost),
            gpu_ms_prepass: Some(4.0 * cost),
            gpu_ms_opaque: Some(120.0 * cost),
            cpu_ms_main: Some(0.9),
            cpu_ms_extract: Some(0.3),
            cpu_ms_render: Some(1.4),
            main_thread_ms: Some(1.2),
            flip_mean: Some(flip),
            flip_p95: Some(flip * 3.0),
            block_rmse: Some(block),
            vram_mb: Some(14.0 + instances as f64 * 3.2e-5),
            vram_surfels_mb: Some(4.2),
            rss_mb: Some(460.0 + instances as f64 * 1e-4),
            startup_s: Some(0.9),
            ..timed(row.clone(), cpu_ms * cost / 1e3, cpu_ms * cost * 0.6)
        }
    })
}

/// Two species, three techniques and variants of them, 1k to 1M trees, with what could not run.
pub fn sample_results() -> Results {
    let mut rows: Vec<Row> = STOCK.iter().map(|figures| peer("stock", *figures)).collect();
    for instances in [100_000, 1_000_000] {
        rows.push(Row {
            status: "2.8e9 triangles a frame: above the 60 s a frame may take".into(),
            runs: 0,
            ..row("stock", instances)
        });
    }
    rows.extend(LOD.iter().map(|figures| peer("lod", *figures)));
    rows.push(Row {
        status: "7,000,001 entities need 11 GB of memory, this machine has 8 GB".into(),
        runs: 0,
        ..row("lod", 1_000_000)
    });
    rows.push(peer("stock+msaa4", (1_000, 29.0, 18_000.0, Some(0.0356), Some(0.0015), 2_900.0)));
    rows.push(peer("lod+msaa4", (1_000, 22.3, 13_500.0, Some(0.0518), Some(0.0050), 1_300.0)));
    rows.push(peer("lod+prepass", (1_000, 2.6, 1_308.0, Some(0.0985), Some(0.0292), 934.0)));
    rows.push(Row {
        status: "meshlets need 64-bit atomics on textures, which this software driver lacks".into(),
        runs: 0,
        ..row("meshlet", 1_000)
    });
    rows.extend(points("points", 1.0, 0.0760, 0.0033));
    rows.extend(points("points+temporal", 1.25, 0.0450, 0.0019));
    // The oak: alpha-masked leaves.
    let oak = [
        peer("stock+prepass", (1_000, 11.8, 5_804.0, Some(0.0791), Some(0.0030), 633.0)),
        peer("lod+prepass", (1_000, 4.9, 2_588.0, Some(0.0982), Some(0.0236), 665.0)),
    ];
    let oak = oak.into_iter().chain(points("points", 1.1, 0.0750, 0.0030).take(1));
    rows.extend(oak.map(|row| Row { species: "eztree_oak_large".into(), ..row }));
    Results {
        schema: SCHEMA,
        machine: Machine {
            adapter: "llvmpipe (LLVM 15.0.6, 256 bits)".into(),
            driver: "llvmpipe Mesa 22.3.6".into(),
            backend: "Vulkan".into(),
            os: "Debian GNU/Linux 12".into(),
            cpu: "AMD EPYC 7B13".into(),
            cores: 2,
            memory_mb: 7_957,
        },
        command: "treeline bench --scene baseline --instances 1k,10k,100k,1M --techniques stock,lod,points --out out".into(),
        rows,
    }
}
