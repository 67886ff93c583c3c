//! What a view remembers: two pictures that change places each frame, and their depths.

use super::TreelineTaa;
use crate::gpu::types::GpuTemporalSettings;
use bevy::{
    platform::collections::HashMap,
    prelude::*,
    render::{
        camera::ExtractedCamera,
        render_resource::*,
        renderer::{RenderDevice, RenderQueue},
        view::{ExtractedView, RetainedViewEntity},
    },
};

/// Colours, and the number of frames in alpha.
pub(super) const COLOR_FORMAT: TextureFormat = TextureFormat::Rgba16Float;
pub(super) const DEPTH_FORMAT: TextureFormat = TextureFormat::R32Float;

/// A picture of the past.
pub(super) struct Picture {
    pub color: TextureView,
    pub depth: TextureView,
}

/// The past of one view.
pub(in crate::render) struct History {
    pictures: [Picture; 2],
    pub(super) settings: Buffer,
    size: UVec2,
    /// Part of the target that the view draws: what was elsewhere is no past.
    viewport: (UVec2, UVec2),
    turn: usize,
    used: bool,
}

impl History {
    /// What to read.
    pub(super) fn past(&self) -> &Picture {
        &self.pictures[1 - self.turn]
    }

    /// What to write.
    pub(super) fn present(&self) -> &Picture {
        &self.pictures[self.turn]
    }
}

/// Histories by view; a view that is not drawn any more gives its own back.
#[derive(Resource, Default)]
pub(in crate::render) struct Histories(pub(super) HashMap<RetainedViewEntity, History>);

fn picture(device: &RenderDevice, size: UVec2) -> Picture {
    let view = |label, format| {
        let texture = device.create_texture(&TextureDescriptor {
            label: Some(label),
            size: Extent3d { width: size.x, height: size.y, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: TextureDimension::D2,
            format,
            usage: TextureUsages::TEXTURE_BINDING | TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        texture.create_view(&default())
    };
    Picture {
        color: view("treeline_history", COLOR_FORMAT),
        depth: view("treeline_history_depth", DEPTH_FORMAT),
    }
}

/// Makes the past of every view that wants one, turns it over, and writes its settings.
pub(in crate::render) fn prepare_history(
    mut histories: ResMut<Histories>,
    cameras: Query<(&ExtractedView, &ExtractedCamera, &TreelineTaa)>,
    device: Res<RenderDevice>,
    queue: Res<RenderQueue>,
) {
    for history in histories.0.values_mut() {
        history.used = false;
    }
    for (view, camera, taa) in &cameras {
        let Some(size) = camera.physical_target_size.filter(|size| size.min_element() > 0) else {
            continue;
        };
        let viewport = camera
            .viewport
            .as_ref()
            .map_or((UVec2::ZERO, size), |v| (v.physical_position, v.physical_size));
        let key = view.retained_view_entity;
        let fits = histories.0.get(&key).is_some_and(|history| history.size == size);
        if !fits {
            let settings = device.create_buffer(&BufferDescriptor {
                label: Some("treeline_temporal_settings"),
                size: size_of::<GpuTemporalSettings>() as u64,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let pictures = [picture(&device, size), picture(&device, size)];
            let new = History { pictures, settings, size, viewport, turn: 0, used: true };
            histories.0.insert(key, new);
        }
        let Some(history) = histories.0.get_mut(&key) else { continue };
        let reset = taa.reset || !fits || history.viewport != viewport;
        history.viewport = viewport;
        history.turn = 1 - history.turn;
        history.used = true;
        let in_range = |value: f32, low: f32, high: f32, default: f32| {
            if value.is_nan() { default } else { value.clamp(low, high) }
        };
        let default = TreelineTaa::default();
        let data = GpuTemporalSettings {
            frames_at_rest: in_range(taa.frames_at_rest, 1.0, 1000.0, default.frames_at_rest),
            frames_in_motion: in_range(taa.frames_in_motion, 1.0, 1000.0, default.frames_in_motion),
            clip: in_range(taa.clip, 0.5, 100.0, default.clip),
            reset: reset.into(),
        };
        queue.write_buffer(&history.settings, 0, bytemuck::bytes_of(&data));
    }
    histories.0.retain(|_, history| history.used);
}
