//! What draws the trees: one file a technique. A new one is a file here and a line in [`BUILT_IN`].

mod billboard;
mod lod;
mod meshlet;
mod points;
mod stock;
mod thin;

use super::{
    args::BenchArgs,
    row::Row,
    scenes::{BenchScene, SceneArg},
    tree::Tree,
};
use crate::options::{ToolError, ToolResult};
use bevy::{
    core_pipeline::prepass::{DepthPrepass, NormalPrepass},
    prelude::*,
    render::settings::WgpuFeatures,
};
use std::time::Duration;

/// A way to draw the trees of a scene.
pub trait Technique {
    /// Why it cannot run in a scene or on an adapter with these features, in words for `status`.
    fn can_run(&self, scene: SceneArg, _features: WgpuFeatures) -> Result<(), String> {
        match scene {
            // Its trees come and go with the camera, by means of this crate.
            SceneArg::Landscape => Err("cannot run: the landscape plants points only".into()),
            _ => Ok(()),
        }
    }

    /// Adds plugins; before the app is finished.
    fn build(&self, _app: &mut App) {}

    /// Puts the trees into the world. What it takes to bake them goes to `work.baking` and not into the start-up.
    fn plant(&mut self, app: &mut App, work: &mut Work) -> ToolResult;

    /// Adds to the camera.
    fn set_up_camera(&self, camera: &mut EntityWorldMut);

    /// Whether what it makes in the background is done.
    fn is_settled(&self, _app: &App, _camera: Entity) -> bool {
        true
    }

    /// Fills the columns that only this technique knows, after the last frame.
    fn read(&self, _app: &App, _camera: Entity, _row: &mut Row) {}
}

/// What a technique plants.
pub struct Work<'a> {
    pub args: &'a BenchArgs,
    pub tree: &'a Tree,
    pub scene: &'a dyn BenchScene,
    pub row: &'a mut Row,
    /// How long baking took, if it had to be done.
    pub baking: Duration,
}

impl Work<'_> {
    /// Places of the model.
    fn trees(&self) -> &[Transform] {
        self.scene.trees().unwrap_or_default()
    }
}

/// A technique or a variant of one.
struct Entry {
    name: &'static str,
    about: &'static str,
    make: fn(&[&str]) -> Made,
}

/// A technique, or which of its variants it does not know.
type Made = Result<Box<dyn Technique>, String>;

/// All techniques.
const BUILT_IN: &[Entry] = &[
    Entry {
        name: "points",
        about: "this crate: points, and meshes near the camera",
        make: points::make,
    },
    Entry {
        name: "stock",
        about: "Bevy: an entity a tree and material, full meshes",
        make: stock::make,
    },
    Entry {
        name: "lod",
        about: "Bevy with VisibilityRange: meshes thinned to 10 % and 2 %, then crossed billboards",
        make: lod::make,
    },
    Entry {
        name: "meshlet",
        about: "Bevy's meshlets (never part of this build)",
        make: meshlet::make,
    },
];

/// The technique of a name such as `lod+msaa4`.
///
/// # Errors
/// An unknown name or variant; the message lists what is known.
pub fn by_name(name: &str) -> Made {
    let mut parts = name.split('+').map(str::trim);
    let base = parts.next().unwrap_or_default();
    let variants: Vec<&str> = parts.collect();
    let Some(entry) = BUILT_IN.iter().find(|entry| entry.name == base) else {
        return Err(format!("`{base}` is no technique; there are\n{}", list()));
    };
    (entry.make)(&variants).map_err(|error| format!("{name}: {error}; there are\n{}", list()))
}

/// Every technique with its variants, a line each.
pub fn list() -> String {
    let lines = BUILT_IN.iter().map(|entry| {
        let variants = match entry.name {
            "points" => points::variants(),
            "meshlet" => vec![],
            _ => CameraVariants::NAMES.map(String::from).to_vec(),
        };
        let variants = variants.iter().map(|variant| format!("+{variant}")).collect::<Vec<_>>();
        format!("  {:8} {} {}", entry.name, entry.about, variants.join(" "))
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// What a user of Bevy changes at the camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraVariants {
    /// Four samples a pixel.
    msaa: bool,
    /// A prepass of depth and normals: of depth alone, it tears holes into meshes that fade (Bevy 0.19.1 does not dither there).
    prepass: bool,
}

impl CameraVariants {
    const NAMES: [&'static str; 2] = ["msaa4", "prepass"];

    fn parse(variants: &[&str]) -> Result<Self, String> {
        let mut out = Self::default();
        for variant in variants {
            match *variant {
                "msaa4" => out.msaa = true,
                "prepass" => out.prepass = true,
                other => return Err(format!("`{other}` is no variant of it")),
            }
        }
        Ok(out)
    }

    fn apply(self, camera: &mut EntityWorldMut) {
        camera.insert(if self.msaa { Msaa::Sample4 } else { Msaa::Off });
        if self.prepass {
            camera.insert((DepthPrepass, NormalPrepass));
        }
    }
}

/// [`by_name`] for a command's error.
pub fn chosen(name: &str) -> ToolResult<Box<dyn Technique>> {
    by_name(name).map_err(|error| ToolError::Message(format!("--techniques: {error}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_carry_variants_and_unknown_ones_list_the_known() {
        for name in [
            "points",
            "stock",
            "lod+msaa4",
            "stock+prepass+msaa4",
            "points+nearmeshes-off",
            "points+q0.5+mesh20+contrast1",
            "meshlet",
        ] {
            assert!(by_name(name).is_ok(), "{name}");
        }
        let unknown = ["", "voxels", "lod+fast", "points+fast", "stock+", "points+q", "points+q99"];
        for name in unknown {
            let Err(error) = by_name(name) else { panic!("{name} is no technique") };
            assert!(error.contains("lod") && error.contains("msaa4"), "{error}");
        }
    }
}
