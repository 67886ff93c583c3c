//! Trees through Bevy's asset server and through `TreeBaker`, in apps without a renderer.

use bevy::{
    asset::{
        AssetPath, LoadState, UntypedAssetId,
        saver::{SavedAsset, save_using_saver},
    },
    ecs::system::RunSystemOnce,
    prelude::*,
    tasks::block_on,
};
use bevy_treeline::{
    BakeSettings, CacheLocation, TreeAsset, TreeBaker, TreeImpostor, TreeLoaderSettings,
    TreelinePlugin,
    asset::{NearMesh, SourceReference, TreeData, read_treeline, write_treeline},
    bake::{BakeContext, BakeFailed, BakeTasks, TreeSaver, bake_file, model_of_entities},
};
use std::{
    fs,
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

fn tree(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/trees").join(name)
}

/// An asset folder with the spruce in it as `oak.glb`, and beside it a place for the cache.
struct Disk(tempfile::TempDir);

impl Disk {
    fn new() -> Self {
        let disk = Self(tempfile::tempdir().expect("a temporary folder"));
        fs::create_dir(disk.asset("")).expect("the folder is writable");
        fs::copy(tree("spruce.glb"), disk.asset("oak.glb")).expect("the folder is writable");
        disk
    }

    fn asset(&self, name: &str) -> PathBuf {
        self.0.path().join("assets").join(name)
    }

    fn cache(&self) -> PathBuf {
        self.0.path().join("cache")
    }

    fn cached(&self) -> usize {
        fs::read_dir(self.cache()).map_or(0, Iterator::count)
    }

    /// Bakes `oak.glb` and writes it as an asset that refers to `source`.
    fn write_tree(&self, name: &str, source: &str) -> TreeData {
        let baked =
            bake_file(&self.asset("oak.glb"), &settings(), &BakeContext::default(), &|_, _| ());
        let baked = baked.expect("it bakes");
        let mut data = TreeData::clone(&baked.data);
        let content_hash = baked.model.content_hash;
        data.source = Some(SourceReference { path: source.into(), content_hash });
        write_treeline(&self.asset(name), &data).expect("the folder is writable");
        data
    }

    fn app(&self) -> App {
        let mut app = App::new();
        let file_path = self.asset("").to_str().expect("UTF-8").to_owned();
        app.add_plugins((MinimalPlugins, TransformPlugin))
            .add_plugins(AssetPlugin { file_path, ..default() })
            .add_plugins((bevy::image::ImagePlugin::default(), bevy::mesh::MeshPlugin))
            .init_asset::<StandardMaterial>()
            .add_plugins(TreelinePlugin {
                cache: CacheLocation::Folder(self.cache()),
                bake: settings(),
                ..default()
            });
        app.finish();
        app.cleanup();
        app
    }
}

fn settings() -> BakeSettings {
    BakeSettings { ldi_size: 48, ..default() }
}

/// Updates until it is so; fails after a while.
#[track_caller]
fn wait(app: &mut App, what: &str, mut so: impl FnMut(&mut App) -> bool) {
    let start = Instant::now();
    while !so(app) {
        assert!(start.elapsed() < Duration::from_secs(30), "still waiting: {what}");
        app.update();
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Waits until a tree and all that belongs to it is there.
#[track_caller]
fn wait_for_tree(app: &mut App, tree: &Handle<TreeAsset>) -> TreeAsset {
    wait(app, "the tree", |app| {
        let server = app.world().resource::<AssetServer>();
        if let LoadState::Failed(error) = server.load_state(tree) {
            panic!("{error}");
        }
        server.is_loaded_with_dependencies(tree)
    });
    app.world().resource::<Assets<TreeAsset>>().get(tree).expect("it is loaded").clone()
}

/// Waits until loading has failed, and says why.
#[track_caller]
fn wait_for_failure(app: &mut App, id: impl Into<UntypedAssetId>) -> String {
    let (id, mut why) = (id.into(), String::new());
    wait(app, "a failure", |app| match app.world().resource::<AssetServer>().load_state(id) {
        LoadState::Failed(error) => {
            why = error.to_string();
            true
        }
        LoadState::Loaded => panic!("it loads"),
        _ => false,
    });
    why
}

fn load(app: &App, name: &str) -> Handle<TreeAsset> {
    app.world().resource::<AssetServer>().load(name.to_owned())
}

/// Asserts that each part of a near mesh is there, and counts the triangles.
#[track_caller]
fn near_triangles(app: &App, tree: &TreeAsset) -> usize {
    let world = app.world();
    let near = world.resource::<Assets<NearMesh>>().get(tree.near_mesh.as_ref().expect("a mesh"));
    let parts = &near.expect("it is loaded").parts;
    let triangles = parts.iter().map(|part| {
        assert!(world.resource::<Assets<StandardMaterial>>().contains(&part.material));
        let mesh = world.resource::<Assets<Mesh>>().get(&part.mesh).expect("it is loaded");
        mesh.indices().expect("triangles").len() / 3
    });
    triangles.sum()
}

#[test]
fn a_model_bakes_as_it_loads_and_has_its_mesh_for_near() {
    let disk = Disk::new();
    let mut app = disk.app();
    let handle = load(&app, "oak.glb");
    app.world_mut().spawn(TreeImpostor::new(handle.clone()));
    let tree = wait_for_tree(&mut app, &handle);
    let statistics = &tree.data.statistics;
    assert_eq!((statistics.ldi_size, statistics.triangles), (48, 30_534));
    assert!(tree.data.point_count() > 1000);
    assert_eq!(near_triangles(&app, &tree), 30_534);
    assert_eq!(disk.cached(), 1);
}

#[test]
fn settings_of_a_load_win_over_those_of_the_plugin() {
    let disk = Disk::new();
    let mut app = disk.app();
    let server = app.world().resource::<AssetServer>().clone();
    let load = server.load_builder().with_settings(|settings: &mut TreeLoaderSettings| {
        settings.points_only = true;
        settings.bake = Some(BakeSettings { ldi_size: 24, ..default() });
    });
    let tree = wait_for_tree(&mut app, &load.load("oak.glb"));
    assert!(tree.near_mesh.is_none());
    assert_eq!(tree.data.statistics.ldi_size, 24);
}

#[test]
fn a_second_app_with_the_same_cache_bakes_nothing() {
    let disk = Disk::new();
    let load_once = || {
        let mut app = disk.app();
        let handle = load(&app, "oak.glb");
        wait_for_tree(&mut app, &handle).data
    };
    let first = load_once();
    assert_eq!(disk.cached(), 1);
    // Durations are part of the statistics: a second bake would not take the same microseconds.
    assert_eq!(load_once(), first);
    assert_eq!(disk.cached(), 1);
    fs::remove_dir_all(disk.cache()).expect("it is there");
    let again = load_once();
    assert_ne!(again.statistics.seconds, first.statistics.seconds);
    assert_eq!((&again.hot, &again.cold), (&first.hot, &first.cold));
}

#[test]
fn a_baked_file_finds_its_model_also_in_another_folder() {
    let disk = Disk::new();
    for (name, source) in [("oak.treeline", "oak.glb"), ("baked/oak.treeline", "../oak.glb")] {
        let written = disk.write_tree(name, source);
        let mut app = disk.app();
        let handle = load(&app, name);
        let tree = wait_for_tree(&mut app, &handle);
        assert_eq!(tree.data.as_ref(), &written);
        assert_eq!(near_triangles(&app, &tree), 30_534, "{name}");
    }
    assert_eq!(disk.cached(), 0);
}

#[test]
fn a_baked_file_without_its_model_gives_the_points_all_the_same() {
    let disk = Disk::new();
    disk.write_tree("lonely.treeline", "lost/elm.glb");
    let mut app = disk.app();
    let handle = load(&app, "lonely.treeline");
    app.world_mut().spawn(TreeImpostor::new(handle.clone()));
    wait(&mut app, "the points", |app| app.world().resource::<AssetServer>().is_loaded(&handle));
    let tree = app.world().resource::<Assets<TreeAsset>>().get(&handle).expect("loaded").clone();
    assert!(tree.data.point_count() > 1000);
    let near = tree.near_mesh.expect("a reference");
    let why = wait_for_failure(&mut app, &near);
    assert!(why.contains("lost/elm.glb"), "{why}");
    for _ in 0..5 {
        app.update();
    }
}

#[test]
fn damaged_files_are_failures_that_name_them_and_the_app_runs_on() {
    let disk = Disk::new();
    disk.write_tree("good.treeline", "oak.glb");
    let good = fs::read(disk.asset("good.treeline")).expect("just written");
    let mut damaged: Vec<Vec<u8>> =
        [0, 3, 40, good.len() / 2, good.len() - 1].iter().map(|&n| good[..n].to_vec()).collect();
    for i in 0..24 {
        let mut bytes = good.clone();
        bytes[i * (good.len() - 1) / 23] ^= 1 << (i % 8);
        damaged.push(bytes);
    }
    let mut app = disk.app();
    let handles: Vec<_> = damaged
        .iter()
        .enumerate()
        .map(|(i, bytes)| {
            let name = format!("bad{i}.treeline");
            fs::write(disk.asset(&name), bytes).expect("the folder is writable");
            let handle = load(&app, &name);
            app.world_mut().spawn(TreeImpostor::new(handle.clone()));
            (name, handle)
        })
        .collect();
    for (name, handle) in &handles {
        let why = wait_for_failure(&mut app, handle);
        assert!(why.contains(name), "{why} lacks {name}");
    }
    let handle = load(&app, "good.treeline");
    wait_for_tree(&mut app, &handle);
}

#[test]
fn models_that_cannot_be_used_are_failures_that_name_them() {
    let disk = Disk::new();
    fs::write(disk.asset("junk.glb"), "this is no model").expect("the folder is writable");
    fs::write(disk.asset("text.obj"), "v 0 0 0\n").expect("the folder is writable");
    let mut app = disk.app();
    for (name, fault) in [("junk.glb", "malformed"), ("text.obj", "no mesh"), ("lost.glb", "")] {
        let handle = load(&app, name);
        let why = wait_for_failure(&mut app, &handle);
        assert!(why.contains(name) && why.contains(fault), "{why}");
    }
    assert_eq!(disk.cached(), 0);
}

#[test]
fn files_that_models_refer_to_are_found_beside_them_however_many_load_at_once() {
    let disk = Disk::new();
    fs::create_dir(disk.asset("woods")).expect("the folder is writable");
    let green = image::RgbaImage::from_pixel(4, 4, image::Rgba([10, 200, 30, 255]));
    green.save(disk.asset("woods/green.png")).expect("the folder is writable");
    let material = "newmtl leaf\nmap_Kd green.png\n";
    fs::write(disk.asset("woods/leaf.mtl"), material).expect("the folder is writable");
    let mut app = disk.app();
    let mut handles = vec![];
    for i in 0..12 {
        let name = format!("woods/oak{i}.obj");
        let text = format!(
            "mtllib leaf.mtl\nusemtl leaf\nv 0 0 0\nv 1 0 0\nv 0 {} 0.2\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n",
            i + 1
        );
        fs::write(disk.asset(&name), text).expect("the folder is writable");
        handles.push(load(&app, &name));
    }
    for handle in &handles {
        let tree = wait_for_tree(&mut app, handle);
        let [r, g, b] = tree.data.surfel(0).expect("a point").albedo;
        assert!(r.abs_diff(10) < 3 && g.abs_diff(200) < 3 && b.abs_diff(30) < 3, "{r} {g} {b}");
        assert_eq!(near_triangles(&app, &tree), 1);
        let near = app
            .world()
            .resource::<Assets<NearMesh>>()
            .get(tree.near_mesh.as_ref().expect("a mesh"));
        let material = near.expect("loaded").parts[0].material.clone();
        let material =
            app.world().resource::<Assets<StandardMaterial>>().get(&material).expect("loaded");
        let texture = material.base_color_texture.as_ref().expect("a texture");
        assert!(app.world().resource::<Assets<Image>>().contains(texture));
    }
}

#[test]
fn a_saved_tree_loads_again() {
    let disk = Disk::new();
    let mut app = disk.app();
    let handle = load(&app, "oak.glb");
    let tree = wait_for_tree(&mut app, &handle);
    let server = app.world().resource::<AssetServer>().clone();
    let path = AssetPath::from("saved.treeline");
    let saved = SavedAsset::from_asset(&tree);
    block_on(save_using_saver(server, &TreeSaver, &path, saved, &())).expect("it is saved");
    assert_eq!(&read_treeline(&disk.asset("saved.treeline")).expect("a tree"), tree.data.as_ref());
    let mut app = disk.app();
    let handle = load(&app, "saved.treeline");
    let again = wait_for_tree(&mut app, &handle);
    assert_eq!(again.data, tree.data);
    assert_eq!(near_triangles(&app, &again), 30_534);
}

/// What `BakeFailed` said.
#[derive(Resource, Default)]
struct Failures(Vec<BakeFailed>);

fn bake(
    app: &mut App,
    start: impl FnOnce(&mut TreeBaker) -> Handle<TreeAsset> + Send + Sync + 'static,
) -> Handle<TreeAsset> {
    let mut start = Some(start);
    let system = move |mut baker: TreeBaker| start.take().map(|start| start(&mut baker));
    app.world_mut().run_system_once(system).expect("its parameters are there").expect("first run")
}

#[test]
fn a_file_outside_the_asset_folder_is_baked_and_a_failure_is_sent() {
    let disk = Disk::new();
    let mut app = disk.app();
    app.init_resource::<Failures>().add_systems(
        Update,
        |mut messages: MessageReader<BakeFailed>, mut failures: ResMut<Failures>| {
            failures.0.extend(messages.read().cloned());
        },
    );
    let good = bake(&mut app, |baker| baker.bake_file(tree("birch.glb"), baker.default_settings()));
    let lost = bake(&mut app, |baker| {
        baker.bake_file("nowhere/lost.glb".into(), baker.default_settings())
    });
    let zero = BakeSettings { ldi_size: 0, ..default() };
    let wrong = bake(&mut app, move |baker| baker.bake_file(tree("birch.glb"), zero));
    for handle in [&lost, &wrong, &good] {
        app.world_mut().spawn(TreeImpostor::new(handle.clone()));
    }
    assert_eq!(app.world().resource::<BakeTasks>().running(), 3);
    wait(&mut app, "all bakes", |app| app.world().resource::<BakeTasks>().running() == 0);
    app.update();
    let failures = &app.world().resource::<Failures>().0;
    assert_eq!(failures.len(), 2, "{failures:?}");
    for (handle, part) in [(&lost, "nowhere/lost.glb"), (&wrong, "ldi_size")] {
        let failure = failures.iter().find(|f| f.tree == handle.id()).expect("it failed");
        assert!(failure.error.contains(part), "{}", failure.error);
        let kept = app.world().resource::<BakeTasks>().failure(handle);
        assert_eq!(kept, Some(failure.error.as_str()));
    }
    let tree = app.world().resource::<Assets<TreeAsset>>().get(&good).expect("it is baked").clone();
    assert_eq!(near_triangles(&app, &tree), 35_619);
    assert!(app.world().resource::<BakeTasks>().failure(&good).is_none());
}

#[test]
fn an_entity_tree_is_a_model_with_the_transforms_of_its_children() {
    let disk = Disk::new();
    let mut app = disk.app();
    let world = app.world_mut();
    let cube = world.resource_mut::<Assets<Mesh>>().add(Cuboid::new(2.0, 2.0, 2.0));
    let mut paint = |color: Color| world.resource_mut::<Assets<StandardMaterial>>().add(color);
    let (red, blue) = (paint(Color::srgb(1.0, 0.0, 0.0)), paint(Color::srgb(0.0, 0.0, 1.0)));
    let part = |material: &Handle<StandardMaterial>, transform| {
        (Mesh3d(cube.clone()), MeshMaterial3d(material.clone()), transform)
    };
    // Where the root stands does not matter; what hangs below it does, through an entity without a mesh, and mirrored.
    let root = world.spawn(part(&red, Transform::from_xyz(100.0, 0.0, 0.0))).id();
    let branch = Transform::from_xyz(0.0, 10.0, 0.0)
        .with_rotation(Quat::from_rotation_z(0.5 * std::f32::consts::PI));
    let branch = world.spawn((ChildOf(root), branch)).id();
    let mirrored = Transform::from_xyz(4.0, 0.0, 0.0).with_scale(Vec3::new(-1.0, 0.5, 0.5));
    world.spawn((ChildOf(branch), part(&blue, mirrored)));
    world.spawn((ChildOf(root), Mesh3d(cube.clone()), Transform::from_xyz(50.0, 0.0, 0.0)));

    let model = model_of_entities(world, root).expect("a model");
    // The child without a material is not drawn, and so no part of it.
    assert_eq!((model.triangle_count(), model.meshes.len(), model.materials.len()), (24, 2, 2));
    let bounds = model.bounds();
    assert!(bounds.min.distance(Vec3::splat(-1.0)) < 1e-4, "{bounds:?}");
    assert!(bounds.max.distance(Vec3::new(1.0, 15.0, 1.0)) < 1e-4, "{bounds:?}");

    let handle =
        bake(&mut app, |baker| baker.bake_model(model, BakeSettings { ldi_size: 64, ..default() }));
    wait(&mut app, "the bake", |app| app.world().resource::<BakeTasks>().running() == 0);
    let tree =
        app.world().resource::<Assets<TreeAsset>>().get(&handle).expect("it is baked").clone();
    assert_eq!(near_triangles(&app, &tree), 24);
    // 6 sides of 4, and 2 of 1 and 4 of 2 square units.
    assert!((tree.data.surface_area / 34.0 - 1.0).abs() < 0.05, "{}", tree.data.surface_area);
    let mut blue_points = 0;
    for surfel in (0..tree.data.point_count()).filter_map(|i| tree.data.surfel(i)) {
        let is_upper = surfel.position.y > 6.0;
        assert_eq!(surfel.albedo, if is_upper { [0, 0, 255] } else { [255, 0, 0] });
        let middle = Vec3::Y * if is_upper { 14.0 } else { 0.0 };
        let outward = surfel.position - middle;
        assert!(surfel.normal.dot(outward) > 0.0 && surfel.face_normal.dot(outward) > 0.0);
        blue_points += usize::from(is_upper);
    }
    assert!(blue_points > 50);
    assert_eq!(disk.cached(), 0, "models without a file are not cached");
}
