//! Bevy with `VisibilityRange`, as a user makes it who knows how: three meshes and crossed billboards, with dithered margins.

use super::{CameraVariants, Made, Technique, Work, billboard::Billboard, thin};
use crate::options::ToolResult;
use bevy::{camera::visibility::VisibilityRange, prelude::*};
use std::time::Instant;

/// Where levels change, metres; each within a tenth of that to either side.
const CHANGES_M: [f32; 3] = [40.0, 100.0, 200.0];
/// Width of the change, as a share of its distance, to either side.
const MARGINS: [f32; 3] = [0.1, 0.1, 0.05];
/// Triangles of the second and the third mesh, as a share of the first's.
const SHARES: [f32; 2] = [0.1, 0.02];
/// Where the last level ends, metres: nowhere.
const END_M: f32 = 1e6;

struct Lod {
    camera: CameraVariants,
}

pub fn make(variants: &[&str]) -> Made {
    Ok(Box::new(Lod { camera: CameraVariants::parse(variants)? }))
}

/// The range of a level.
fn range(level: usize) -> VisibilityRange {
    let change = |i: usize| {
        let (at, margin) = (CHANGES_M[i], CHANGES_M[i] * MARGINS[i]);
        at - margin..at + margin
    };
    VisibilityRange {
        start_margin: level.checked_sub(1).map_or(0.0..0.0, change),
        end_margin: if level < CHANGES_M.len() { change(level) } else { END_M..END_M },
        use_aabb: false,
    }
}

impl Technique for Lod {
    fn plant(&mut self, app: &mut App, work: &mut Work) -> ToolResult {
        let start = Instant::now();
        let parts = work.tree.parts(app.world_mut());
        let billboard = Billboard::bake(app, &parts, &work.tree.model.bounds())?;
        let world = app.world_mut();
        let mut meshes = vec![];
        for part in &parts {
            let thin = if part.is_leaf { thin::thin_leaves } else { thin::thin_wood };
            let mut levels = vec![part.mesh.clone()];
            levels.extend(SHARES.map(|share| thin(&part.mesh, share)));
            for (level, mesh) in levels.into_iter().enumerate() {
                let mesh = world.resource_mut::<Assets<Mesh>>().add(mesh);
                meshes.push((Mesh3d(mesh), MeshMaterial3d(part.material.clone()), range(level)));
            }
        }
        let mut material = billboard.material;
        material.base_color_texture =
            Some(world.resource_mut::<Assets<Image>>().add(billboard.texture));
        let board = (
            Mesh3d(world.resource_mut::<Assets<Mesh>>().add(billboard.mesh)),
            MeshMaterial3d(world.resource_mut::<Assets<StandardMaterial>>().add(material)),
            range(CHANGES_M.len()),
        );
        work.baking = start.elapsed();
        work.row.bake_s = Some(work.baking.as_secs_f64());

        let with = |(mesh, material, range): &(Mesh3d, MeshMaterial3d<_>, VisibilityRange),
                    place| {
            (mesh.clone(), material.clone(), range.clone(), place)
        };
        let mut entities = vec![];
        for place in work.trees() {
            entities.extend(meshes.iter().map(|level| with(level, *place)));
            // Its light is that of one direction.
            entities.push(with(&board, place.with_rotation(Quat::IDENTITY)));
        }
        world.spawn_batch(entities);
        Ok(())
    }

    fn set_up_camera(&self, camera: &mut EntityWorldMut) {
        self.camera.apply(camera);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_level_begins_where_the_one_before_ends() {
        let ranges: Vec<VisibilityRange> = (0..4).map(range).collect();
        assert_eq!(ranges[0].start_margin, 0.0..0.0);
        for pair in ranges.windows(2) {
            assert_eq!(pair[0].end_margin, pair[1].start_margin);
            assert!(pair[1].start_margin.end <= pair[1].end_margin.start);
        }
        assert_eq!(ranges[1].start_margin, 36.0..44.0);
        assert_eq!(ranges[2].end_margin, 190.0..210.0);
    }
}
