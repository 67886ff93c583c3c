//! Writes the three trees that ship with the crate: `cargo run --example make_trees [folder]` (default: `assets/trees`).

use bevy_treeline::species::{glb::write_glb, grow, preset};
use std::{env, error::Error, fs, path::PathBuf};

/// Species, seed (chosen by eye among the first) and leaf detail (a file of at most 1.5 MB).
const TREES: [(&str, u64, f32); 3] = [("oak", 1, 0.30), ("birch", 2, 0.40), ("spruce", 1, 0.31)];

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(env::args().nth(1).unwrap_or_else(|| "assets/trees".into()));
    fs::create_dir_all(&folder)?;
    for (name, seed, detail) in TREES {
        let tree = grow(&preset(name)?.with_leaf_detail(detail), seed, 0.0);
        let bytes = write_glb(&tree, name);
        let path = folder.join(name).with_extension("glb");
        fs::write(&path, &bytes)?;
        println!("{}: {} triangles, {} bytes", path.display(), tree.triangle_count(), bytes.len());
    }
    Ok(())
}
