//! The two buffers of instances, and writes to them: places, and looks.
//!
//! In: packed instances; out: buffers that grow by a copy on the GPU. Cost: a write for those that follow each other.

use super::UNIT;
use crate::gpu::types::{GpuTreeInstance, GpuTreeLook, GpuTreePlace};
use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor},
    renderer::{RenderDevice, RenderQueue},
};

/// Instances of a write at most: bounds the memory that holds them meanwhile.
const WRITE_INSTANCES: usize = 1 << 19;
const PLACE_BYTES: u64 = size_of::<GpuTreePlace>() as u64;
const LOOK_BYTES: u64 = size_of::<GpuTreeLook>() as u64;
/// Byte offset of species, flag and scale within a look.
const SPECIES_OFFSET: u64 = std::mem::offset_of!(GpuTreeLook, species_scale) as u64;

/// What shaders read of instances. Two buffers, since a device binds only so much of one.
pub(in crate::render) struct InstanceBuffers {
    pub places: Buffer,
    pub looks: Buffer,
}

impl InstanceBuffers {
    /// Bytes of an instance in the larger of the two.
    pub(super) const MOST_BYTES: u64 =
        if PLACE_BYTES > LOOK_BYTES { PLACE_BYTES } else { LOOK_BYTES };

    /// With room for so many, and what is in `old`.
    pub(super) fn new(instances: u64, old: Option<&Self>, writer: &Writer) -> Self {
        let buffer = |label, bytes: u64| {
            writer.device.create_buffer(&BufferDescriptor {
                label: Some(label),
                size: instances * bytes,
                usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            })
        };
        let new = Self {
            places: buffer("treeline_places", PLACE_BYTES),
            looks: buffer("treeline_looks", LOOK_BYTES),
        };
        if let Some(old) = old {
            let label = Some("treeline_grow_instances");
            let mut encoder =
                writer.device.create_command_encoder(&CommandEncoderDescriptor { label });
            for (old, new) in [(&old.places, &new.places), (&old.looks, &new.looks)] {
                encoder.copy_buffer_to_buffer(old, 0, new, 0, old.size());
            }
            // At once: what is written to the new buffers from here on has to come later.
            writer.queue.submit([encoder.finish()]);
        }
        new
    }

    /// Writes instances from `first` on.
    pub(super) fn write(&self, first: u32, instances: &[GpuTreeInstance], queue: &RenderQueue) {
        let places: Vec<GpuTreePlace> = instances.iter().map(|tree| tree.place).collect();
        let looks: Vec<GpuTreeLook> = instances.iter().map(|tree| tree.look).collect();
        let first = u64::from(first);
        queue.write_buffer(&self.places, first * PLACE_BYTES, bytemuck::cast_slice(&places));
        queue.write_buffer(&self.looks, first * LOOK_BYTES, bytemuck::cast_slice(&looks));
    }

    /// Writes `species_scale` of an instance.
    pub(super) fn write_species(&self, index: u32, word: u32, queue: &RenderQueue) {
        let at = u64::from(index) * LOOK_BYTES + SPECIES_OFFSET;
        queue.write_buffer(&self.looks, at, &word.to_le_bytes());
    }
}

/// Writes to the buffers, those that follow each other as one.
pub(super) struct Writer<'a> {
    pub device: &'a RenderDevice,
    pub queue: &'a RenderQueue,
    first: u32,
    pub data: Vec<GpuTreeInstance>,
}

impl<'a> Writer<'a> {
    pub fn new(device: &'a RenderDevice, queue: &'a RenderQueue) -> Self {
        Self { device, queue, first: 0, data: vec![] }
    }

    /// Goes on at `first`, on a unit.
    pub fn seek(&mut self, first: u32, buffers: Option<&InstanceBuffers>) {
        let padded = self.data.len().next_multiple_of(UNIT as usize);
        let follows = self.first as usize + padded == first as usize;
        if !follows || padded >= WRITE_INSTANCES {
            self.flush(buffers);
            self.first = first;
        } else {
            self.data.resize(padded, GpuTreeInstance::default());
        }
    }

    pub fn flush(&mut self, buffers: Option<&InstanceBuffers>) {
        if let Some(buffers) = buffers.filter(|_| !self.data.is_empty()) {
            buffers.write(self.first, &self.data, self.queue);
        }
        self.data.clear();
    }
}
