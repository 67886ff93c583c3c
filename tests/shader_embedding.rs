//! Every shader loads from its clean `embedded://` path, and importable modules stay loaded. Needs no GPU.
use bevy::{
    app::{App, TaskPoolPlugin},
    asset::{AssetApp, AssetPlugin, AssetServer, Assets, Handle},
    shader::{Shader, ShaderImport, ShaderLoader},
};
use bevy_treeline::shaders::{self, ShaderLibraries};
use std::{
    thread::sleep,
    time::{Duration, Instant},
};

fn asset_app() -> App {
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), AssetPlugin::default()))
        .init_asset::<Shader>()
        .register_asset_loader(ShaderLoader);
    shaders::embed(&mut app);
    app
}

/// Updates until all are loaded; fails with the state of the first that is not.
fn wait_for(app: &mut App, handles: &[Handle<Shader>]) {
    let start = Instant::now();
    loop {
        app.update();
        let loaded = app.world().resource::<Assets<Shader>>();
        let Some(missing) = handles.iter().find(|h| !loaded.contains(*h)) else { return };
        let state = app.world().resource::<AssetServer>().get_load_state(missing);
        assert!(start.elapsed() < Duration::from_secs(20), "{:?}: {state:?}", missing.path());
        sleep(Duration::from_millis(5));
    }
}

#[test]
fn every_embedded_shader_loads() {
    assert_eq!(shaders::SURFEL, "embedded://bevy_treeline/shaders/lib/surfel.wgsl");
    let mut app = asset_app();
    let server = app.world().resource::<AssetServer>();
    let url = |path| format!("embedded://bevy_treeline/shaders/{path}");
    let handles: Vec<Handle<Shader>> =
        shaders::ALL.iter().map(|(path, _)| server.load(url(path))).collect();
    wait_for(&mut app, &handles);
}

#[test]
fn importable_modules_stay_loaded_under_their_import_path() {
    let mut app = asset_app();
    shaders::load_libraries(&mut app);
    let handles = app.world().resource::<ShaderLibraries>().0.clone();
    let with_import_path = shaders::ALL.iter().filter(|(_, s)| s.contains("#define_import_path"));
    assert_eq!(handles.len(), with_import_path.count());
    wait_for(&mut app, &handles);
    let loaded = app.world().resource::<Assets<Shader>>();
    for (_, shader) in loaded.iter() {
        let ShaderImport::Custom(path) = &shader.import_path else {
            panic!("{} is not importable", shader.path)
        };
        assert!(path.starts_with("bevy_treeline::"), "{path}");
    }
}

#[test]
fn without_an_asset_plugin_nothing_happens() {
    let mut app = App::new();
    shaders::embed(&mut app);
    shaders::load_libraries(&mut app);
    assert!(app.world().get_resource::<ShaderLibraries>().is_none());
}

#[test]
fn every_file_below_shaders_is_embedded() {
    fn visit(dir: &std::path::Path, found: &mut Vec<std::path::PathBuf>) {
        for path in
            std::fs::read_dir(dir).expect("shaders is readable").flatten().map(|entry| entry.path())
        {
            if path.is_dir() { visit(&path, found) } else { found.push(path) }
        }
    }
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let mut files = Vec::new();
    visit(&root, &mut files);
    for file in files {
        let path = file
            .strip_prefix(&root)
            .expect("below shaders")
            .to_str()
            .expect("UTF-8")
            .replace('\\', "/");
        assert!(
            shaders::ALL.iter().any(|(known, _)| *known == path),
            "shaders/{path} is missing in src/shaders.rs"
        );
    }
}
