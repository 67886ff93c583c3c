//! The panel (F1): what is drawn and how, what it costs, and every key.

use super::{FlyArgs, camera::FlyCamera, graph::FrameTimes, window::KEYS, world::Roster};
use bevy::prelude::*;
use bevy_egui::{EguiContexts, egui};
use bevy_treeline::{
    CullingView, DebugView, NearMeshes, SplatShape, TreelineCounters, TreelineSettings,
    landscape::{Planting, PlantingCounters, PlantingSettings, Sky, TerrainCounters, TerrainLod},
};

/// What the panel holds beyond the settings themselves.
#[derive(Resource)]
pub struct Panel {
    /// Shown.
    pub open: bool,
    /// Culling stays where it was.
    pub frozen: bool,
    /// Time of day, hours.
    pub hour: f32,
    /// 0 summer to 1 autumn.
    season: f32,
    /// What is drawn of the forest.
    technique: Technique,
    shown: Vec<bool>,
}

/// What is drawn of the forest.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Technique {
    Crossfade,
    Points,
    Off,
}

impl Panel {
    pub fn new(args: &FlyArgs) -> Self {
        Self {
            open: false,
            frozen: false,
            hour: args.hour,
            season: args.season,
            technique: if args.no_forest { Technique::Off } else { Technique::Crossfade },
            shown: vec![],
        }
    }
}

/// Every debug view with its caption, in the order of the key.
const VIEWS: &[(DebugView, &str)] = &[
    (DebugView::Off, "off"),
    (DebugView::PointsAndTriangles, "points red, triangles blue"),
    (DebugView::PrefixLength, "N as heat"),
    (DebugView::PointsPerPixel, "points per pixel"),
    (DebugView::FadeBand, "fade band"),
    (DebugView::Tiles, "tiles"),
    (DebugView::SurfelNormals, "surfel normals"),
    (DebugView::AmbientVisibility, "ambient visibility"),
    (DebugView::Albedo, "albedo"),
];

/// The view after `view`.
pub fn next_view(view: DebugView) -> DebugView {
    let at = VIEWS.iter().position(|(v, _)| *v == view).unwrap_or(0);
    VIEWS[(at + 1) % VIEWS.len()].0
}

/// What the panel reads and writes.
#[derive(bevy::ecs::system::SystemParam)]
pub struct Everything<'w, 's> {
    near: ResMut<'w, NearMeshes>,
    sky: ResMut<'w, Sky>,
    planting: Option<ResMut<'w, Planting>>,
    planting_settings: ResMut<'w, PlantingSettings>,
    planting_counters: Res<'w, PlantingCounters>,
    terrain: ResMut<'w, TerrainLod>,
    terrain_counters: Res<'w, TerrainCounters>,
    counters: Res<'w, TreelineCounters>,
    times: Res<'w, FrameTimes>,
    roster: Res<'w, Roster>,
    camera: Single<
        'w,
        's,
        (&'static mut TreelineSettings, &'static Camera, &'static GlobalTransform),
        With<FlyCamera>,
    >,
}

pub fn show(mut contexts: EguiContexts, mut panel: ResMut<Panel>, all: Everything) -> Result {
    let mut all = all;
    let panel = &mut *panel;
    if panel.open {
        let context = contexts.ctx_mut()?;
        egui::Window::new("treeline").default_width(300.0).default_pos((12.0, 12.0)).show(
            context,
            |ui| {
                egui::ScrollArea::vertical().show(ui, |ui| {
                    all.times.show(ui);
                    ui.collapsing("Drawing", |ui| drawing(ui, panel, &mut all));
                    ui.collapsing("Budgets", |ui| budgets(ui, &mut all));
                    ui.collapsing("Landscape", |ui| landscape(ui, panel, &mut all));
                    ui.collapsing("Counters", |ui| counters(ui, &all));
                    ui.collapsing("Keys", keys);
                });
            },
        );
    }
    apply(panel, &mut all);
    Ok(())
}

fn drawing(ui: &mut egui::Ui, panel: &mut Panel, all: &mut Everything) {
    ui.horizontal(|ui| {
        ui.radio_value(&mut panel.technique, Technique::Crossfade, "points and near meshes");
        ui.radio_value(&mut panel.technique, Technique::Points, "points");
        ui.radio_value(&mut panel.technique, Technique::Off, "off");
    });
    let settings = &mut *all.camera.0;
    let mut edited = settings.clone();
    let slider = |value, range| egui::Slider::new(value, range);
    ui.add(slider(&mut edited.quality, 0.05..=16.0).logarithmic(true).text("points per pixel (q)"));
    egui::ComboBox::from_label("splat shape")
        .selected_text(format!("{:?}", edited.splat_shape))
        .show_ui(ui, |ui| {
            for shape in [SplatShape::Cells, SplatShape::Discs, SplatShape::Squares] {
                ui.selectable_value(&mut edited.splat_shape, shape, format!("{shape:?}"));
            }
        });
    ui.add(slider(&mut edited.overlap_gain, 0.0..=1.0).text("overlap"));
    ui.add(slider(&mut edited.contrast, 0.0..=1.0).text("contrast correction"));
    ui.add(slider(&mut edited.min_mesh_distance, 0.0..=150.0).text("meshes to at least, m"));
    ui.add(slider(&mut edited.fade_width, 0.0..=0.9).text("fade band"));
    ui.add(slider(&mut edited.fade_jitter, 0.0..=0.9).text("jitter of the band"));
    let caption = VIEWS.iter().find(|(v, _)| *v == edited.debug_view).map_or("off", |v| v.1);
    egui::ComboBox::from_label("debug view").selected_text(caption).show_ui(ui, |ui| {
        for (view, name) in VIEWS {
            ui.selectable_value(&mut edited.debug_view, *view, *name);
        }
    });
    ui.checkbox(&mut panel.frozen, "freeze culling here");
    if edited != *settings {
        *settings = edited;
    }
}

fn budgets(ui: &mut egui::Ui, all: &mut Everything) {
    let mut edited = all.camera.0.clone();
    ui.add(
        egui::Slider::new(&mut edited.point_capacity_millions, 0.5..=128.0)
            .logarithmic(true)
            .text("points at most, millions"),
    );
    if edited != *all.camera.0 {
        *all.camera.0 = edited;
    }
    ui.add(egui::Slider::new(&mut all.near.max_trees, 0..=1000).text("near meshes at most"));
    ui.add(
        egui::Slider::new(&mut all.terrain.error_px, 0.25..=8.0)
            .text("error of the ground, pixels"),
    );
    ui.add(
        egui::Slider::new(&mut all.planting_settings.tree_distance_m, 200.0..=16_000.0)
            .logarithmic(true)
            .text("trees up to, m"),
    );
    ui.add(
        egui::Slider::new(&mut all.planting_settings.cover_distance_m, 0.0..=400.0)
            .text("ground cover up to, m"),
    );
}

fn landscape(ui: &mut egui::Ui, panel: &mut Panel, all: &mut Everything) {
    ui.add(egui::Slider::new(&mut panel.hour, 0.0..=24.0).text("time of day"));
    let season = ui.add(egui::Slider::new(&mut panel.season, 0.0..=1.0).text("season"));
    if (season.drag_stopped() || (season.changed() && !season.dragged()))
        && let Some(planting) = &mut all.planting
    {
        planting.set_season(panel.season);
    }
    let mut visibility = all.sky.visibility_m.unwrap_or(20_000.0);
    let slider = egui::Slider::new(&mut visibility, 500.0..=100_000.0);
    if ui.add(slider.logarithmic(true).text("visibility, m")).changed() {
        all.sky.visibility_m = Some(visibility);
    }
    let Some(planting) = &mut all.planting else { return };
    panel.shown.resize(all.roster.0.len(), true);
    ui.label("species");
    ui.columns(2, |columns| {
        for (i, (name, shown)) in all.roster.0.iter().zip(&mut panel.shown).enumerate() {
            if columns[i % 2].checkbox(shown, name).changed() {
                planting.set_shown(i, *shown);
            }
        }
    });
}

fn counters(ui: &mut egui::Ui, all: &Everything) {
    let eye = all.camera.2.translation();
    let views = all.counters.all();
    let c = views.values().next().copied().unwrap_or_default();
    let (planting, terrain) = (&all.planting_counters, &all.terrain_counters);
    let million = |n: u32| format!("{:.2} M", f64::from(n) / 1e6);
    let rows: Vec<(&str, String)> = vec![
        ("at", format!("{:.0}, {:.0}, {:.0}", eye.x, eye.y, eye.z)),
        ("trees resident", c.instances_seen.to_string()),
        ("in skipped tiles", c.culled_tiles.to_string()),
        ("outside the frustum", c.culled_frustum.to_string()),
        ("less than a point", c.culled_small.to_string()),
        ("as mesh, fading", format!("{}, {}", c.as_mesh, c.in_fade)),
        ("near meshes, left out", format!("{}, {}", all.near.len(), all.near.left_as_points())),
        ("points", million(c.points)),
        ("work items, overflow", format!("{}, {}", c.items, c.item_overflow)),
        ("pixels covered", million(c.covered_pixels)),
        ("read by points", format!("{:.1} MB", c.bytes_read() as f64 / 1e6)),
        ("tiles of trees, cover", format!("{}, {}", planting.tree_tiles, planting.cover_tiles)),
        ("tiles pending", planting.pending.to_string()),
        ("chunks, triangles", format!("{}, {} k", terrain.chunks, terrain.triangles / 1000)),
        ("chunks pending", terrain.pending.to_string()),
        (
            "main thread, ms",
            format!("trees {:.2}, ground {:.2}", planting.main_thread_ms, terrain.main_thread_ms),
        ),
    ];
    egui::Grid::new("counters").striped(true).show(ui, |ui| {
        for (name, value) in rows {
            ui.label(name);
            ui.monospace(value);
            ui.end_row();
        }
    });
}

fn keys(ui: &mut egui::Ui) {
    egui::Grid::new("keys").show(ui, |ui| {
        for (key, does) in KEYS {
            ui.monospace(*key);
            ui.label(*does);
            ui.end_row();
        }
    });
}

/// Carries the panel's own values over, each only when it differs: a change of a resource makes work.
fn apply(panel: &mut Panel, all: &mut Everything) {
    if all.sky.time.hour != panel.hour {
        all.sky.time.hour = panel.hour;
    }
    let most = if panel.technique == Technique::Points {
        0
    } else if all.near.max_trees == 0 {
        NearMeshes::default().max_trees
    } else {
        all.near.max_trees
    };
    if all.near.max_trees != most {
        all.near.max_trees = most;
    }
    let (settings, camera, transform) = &mut *all.camera;
    let enabled = panel.technique != Technique::Off;
    if settings.enabled != enabled {
        settings.enabled = enabled;
    }
    if panel.frozen != settings.culling_view.is_some() {
        settings.culling_view = panel.frozen.then(|| CullingView::of(camera, transform));
    }
}
