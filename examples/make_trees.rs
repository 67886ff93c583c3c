//! Writes the three trees that ship with the crate: `cargo run --example make_trees [folder]` (default: `assets/trees`).

use bevy_treeline::species::{glb::write_glb, grow, presets};
use std::{env, fs, io, path::PathBuf};

/// Chosen by eye among the first seeds.
const SEEDS: [u64; 3] = [1, 2, 1];

fn main() -> io::Result<()> {
    let folder = PathBuf::from(env::args().nth(1).unwrap_or_else(|| "assets/trees".into()));
    fs::create_dir_all(&folder)?;
    for ((name, shape), seed) in presets().into_iter().zip(SEEDS) {
        let tree = grow(&shape, seed);
        let bytes = write_glb(&tree, name);
        let path = folder.join(name).with_extension("glb");
        fs::write(&path, &bytes)?;
        println!("{}: {} triangles, {} bytes", path.display(), tree.triangle_count(), bytes.len());
    }
    Ok(())
}
