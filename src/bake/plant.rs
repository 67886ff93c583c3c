//! Species → grown plant → points. The time of [`grow`] and of a bake; on the second start only the former.

use super::assemble::{BakeContext, BakeError, BakeStage, Baked, Progress, bake_model};
use super::settings::BakeSettings;
use super::source::model_of_plain_tree;
use crate::species::{Species, grow};
use std::{sync::Arc, time::Instant};

/// Grows a plant (see [`grow`]) and bakes it, or takes the points from the cache, where they lie under a hash of the plant's
/// vertices and the settings. `autumn` is 0 (summer) to 1.
///
/// # Errors
/// See [`BakeError`]; messages name the species and the seed.
pub fn bake_species(
    species: &Species,
    seed: u64,
    autumn: f32,
    settings: &BakeSettings,
    context: &BakeContext,
    progress: Progress,
) -> Result<Baked, BakeError> {
    settings.validate()?;
    progress(BakeStage::Loading, 0.0);
    let start = Instant::now();
    let name = format!("{} (seed {seed})", species.name);
    let model = model_of_plain_tree(&name, &grow(species, seed, autumn));
    let growing = start.elapsed().as_secs_f64();
    progress(BakeStage::Loading, 1.0);
    bake_model(Arc::new(model), None, settings, context, growing, progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::BakeCache;
    use crate::bake::{PeelBackend, near_mesh_sources};
    use crate::species::preset;

    #[test]
    fn a_grass_tuft_is_baked_once_and_then_taken_from_the_cache() {
        let folder = tempfile::tempdir().expect("the temporary folder is writable");
        let context =
            BakeContext { cache: Some(BakeCache::new(folder.path())), ..BakeContext::default() };
        let settings =
            BakeSettings { ldi_size: 64, backend: PeelBackend::Cpu, ..BakeSettings::default() };
        let tuft = preset("grass_tuft").expect("a preset");
        let bake = |seed, autumn| {
            bake_species(&tuft, seed, autumn, &settings, &context, &|_, _| ()).expect("it bakes")
        };
        let (first, second) = (bake(1, 0.0), bake(1, 0.0));
        assert!(!first.from_cache && second.from_cache);
        assert!(first.data.point_count() > 500, "{}", first.data.point_count());
        assert_eq!(first.data.hot, second.data.hot);
        assert!((first.data.bounds.max.y / tuft.height_m() - 1.0).abs() < 0.15);
        assert_eq!(near_mesh_sources(&second.model, true).len(), 1);
        // Other seeds and seasons are other plants.
        assert!(!bake(2, 0.0).from_cache && !bake(1, 1.0).from_cache);
    }
}
