//! Small baked plants in the program itself: what a window shows while the full ones are baked.
//!
//! Made with `treeline bake --species NAME --ldi 96` (seed 1), one a species; the test below checks that they are there
//! and of the right size.

use bevy_treeline::asset::{TreeData, format::decode};

macro_rules! shipped {
    ($($name:literal),*) => {
        /// Every species and its file.
        const FILES: &[(&str, &[u8])] = &[
            $(($name, include_bytes!(concat!("../../../../assets/baked/", $name, ".treeline")))),*
        ];
    };
}

shipped!(
    "aspen",
    "birch",
    "dead_tree",
    "fern",
    "fir",
    "flower",
    "grass_tuft",
    "maple",
    "oak",
    "poplar",
    "scots_pine",
    "shrub",
    "spruce",
    "willow"
);

/// The small plant of a species; `None` for one that does not ship.
pub fn shipped(species: &str) -> Option<TreeData> {
    let (_, file) = FILES.iter().find(|(name, _)| *name == species)?;
    decode(file).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_species_ships_a_small_plant() {
        for name in bevy_treeline::species::species_names() {
            let plant = shipped(name).unwrap_or_else(|| panic!("{name} does not ship"));
            assert!(plant.point_count() > 1000 && plant.is_shaded(), "{name}");
            let height = bevy_treeline::species::preset(name).expect("listed").height_m();
            let ratio = plant.bounds.max.y / height;
            assert!((0.8..1.25).contains(&ratio), "{name} is {ratio} of its height: bake it again");
        }
    }
}
