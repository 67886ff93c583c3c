//! Small buffers back from the GPU, some frames later, without waiting.
//!
//! A stage copies a buffer into a staging slot while it records ([`ReadbackRing::copy`]); after the frame is submitted
//! the slots are mapped ([`ReadbackRing::map_recorded`]); the receiver is called as soon as the device has been polled,
//! which Bevy does every frame. Several slots are in flight, so nothing ever blocks.

use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, MapMode},
    renderer::RenderDevice,
};
use std::sync::{
    Arc,
    mpsc::{Receiver, Sender, channel},
};

/// Slots at most: copies in flight, one per view and frame. Beyond that a copy is skipped (its counters are lost).
const MAX_SLOTS: usize = 256;

type OnBytes<K> = Arc<dyn Fn(K, &[u8]) + Send + Sync>;

/// A ring of staging buffers of one size; `K` tells what a slot's bytes belong to.
pub struct ReadbackRing<K> {
    size: u64,
    slots: Vec<Buffer>,
    recorded: Vec<(usize, K)>,
    on_bytes: OnBytes<K>,
    free_sender: Sender<usize>,
    free: Receiver<usize>,
}

impl<K: Send + Sync + 'static> ReadbackRing<K> {
    /// A ring for buffers of `size` bytes (a multiple of 4). `on_bytes` is called on whatever thread polls the device.
    pub fn new(size: u64, on_bytes: impl Fn(K, &[u8]) + Send + Sync + 'static) -> Self {
        let (free_sender, free) = channel();
        Self {
            size,
            slots: vec![],
            recorded: vec![],
            on_bytes: Arc::new(on_bytes),
            free_sender,
            free,
        }
    }

    /// Records a copy of the first bytes of `source` (usage `COPY_SRC`).
    pub fn copy(
        &mut self,
        device: &RenderDevice,
        encoder: &mut CommandEncoder,
        source: &Buffer,
        tag: K,
    ) {
        let index = match self.free.try_recv() {
            Ok(index) => index,
            Err(_) if self.slots.len() < MAX_SLOTS => {
                self.slots.push(device.create_buffer(&BufferDescriptor {
                    label: Some("treeline_readback"),
                    size: self.size,
                    usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                }));
                self.slots.len() - 1
            }
            Err(_) => return,
        };
        encoder.copy_buffer_to_buffer(source, 0, &self.slots[index], 0, self.size);
        self.recorded.push((index, tag));
    }

    /// Asks for the bytes of everything recorded. Call it after the recorded commands were submitted.
    pub fn map_recorded(&mut self) {
        for (index, tag) in self.recorded.drain(..) {
            let (buffer, free, on_bytes) =
                (self.slots[index].clone(), self.free_sender.clone(), self.on_bytes.clone());
            self.slots[index].slice(..).map_async(MapMode::Read, move |result| {
                // A lost device maps nothing; its slots are not used again.
                if result.is_ok() {
                    on_bytes(tag, &buffer.slice(..).get_mapped_range());
                    buffer.unmap();
                    // The ring may be gone (the app is closing): nobody waits for the slot then.
                    let _ = free.send(index);
                }
            });
        }
    }
}
