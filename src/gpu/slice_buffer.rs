//! A growing GPU buffer of equal elements, of which thousands of owners have a slice each.
//!
//! In: lengths and contents; out: where each slice begins. Grown by a copy on the GPU, so nothing is written twice.
//! `allocate`, `release`: O(log slices).

use crate::math::slice_allocator::SliceAllocator;
use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor},
    renderer::{RenderDevice, RenderQueue},
};

/// The buffer and who has which part of it.
pub struct SliceBuffer {
    label: &'static str,
    stride: u64,
    slices: SliceAllocator,
    buffer: Buffer,
}

impl SliceBuffer {
    /// With room for `capacity` elements of `stride` bytes. It can be bound at once, also without a slice.
    pub fn new(label: &'static str, stride: u64, capacity: u32, device: &RenderDevice) -> Self {
        let slices = SliceAllocator::new(capacity.max(1));
        let buffer = create(label, u64::from(slices.capacity()) * stride, device);
        Self { label, stride, slices, buffer }
    }

    /// What shaders bind. Another one after an [`allocate`](Self::allocate) that made it grow.
    pub fn buffer(&self) -> &Buffer {
        &self.buffer
    }

    /// Elements in slices.
    pub fn used(&self) -> u32 {
        self.slices.used()
    }

    /// The begin of a new slice; `None` where the device allows no buffer as large.
    pub fn allocate(
        &mut self,
        length: u32,
        device: &RenderDevice,
        queue: &RenderQueue,
    ) -> Option<u32> {
        if let Some(begin) = self.slices.allocate(length) {
            return Some(begin);
        }
        let limits = device.limits();
        let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let most = (limit / self.stride).min(u32::MAX.into()) as u32;
        let now = self.slices.capacity();
        let wanted = now.saturating_add(length.max(now / 2)).min(most);
        if wanted > now {
            let grown = create(self.label, u64::from(wanted) * self.stride, device);
            let label = Some(self.label);
            let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor { label });
            encoder.copy_buffer_to_buffer(&self.buffer, 0, &grown, 0, self.buffer.size());
            // At once: what is written to the new buffer from here on has to come later.
            queue.submit([encoder.finish()]);
            self.buffer = grown;
            self.slices.grow(wanted);
        }
        self.slices.allocate(length)
    }

    /// Gives a slice back.
    pub fn release(&mut self, begin: u32, length: u32) {
        self.slices.release(begin, length);
    }

    /// Writes elements from `begin` on.
    pub fn write(&self, begin: u32, bytes: &[u8], queue: &RenderQueue) {
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffer, u64::from(begin) * self.stride, bytes);
        }
    }
}

fn create(label: &'static str, size: u64, device: &RenderDevice) -> Buffer {
    device.create_buffer(&BufferDescriptor {
        label: Some(label),
        size: size.max(16),
        usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    })
}
