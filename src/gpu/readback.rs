//! Small buffers back from the GPU, some frames later, without waiting.
//!
//! A stage copies a buffer into a staging slot while it records ([`ReadbackRing::copy`]); after the frame is submitted
//! the slots are mapped ([`ReadbackRing::map_recorded`]); the bytes arrive in [`ReadbackRing::drain`] as soon as the
//! device has been polled, which Bevy does every frame. Several slots are in flight, so nothing ever blocks.

use bevy::render::{
    render_resource::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, MapMode},
    renderer::RenderDevice,
};
use std::sync::mpsc::{Receiver, Sender, channel};

/// Slots at most: copies in flight, one per view and frame. Beyond that a copy is skipped (its counters are lost).
const MAX_SLOTS: usize = 256;

struct Slot<K> {
    buffer: Buffer,
    tag: Option<K>,
}

/// A ring of staging buffers of one size; `K` tells what a slot's bytes belong to.
pub struct ReadbackRing<K> {
    size: u64,
    slots: Vec<Slot<K>>,
    recorded: Vec<usize>,
    free: Vec<usize>,
    sender: Sender<(usize, bool)>,
    // `Receiver` is not `Sync`; it is only used with exclusive access.
    receiver: std::sync::Mutex<Receiver<(usize, bool)>>,
}

impl<K: Send + Sync> ReadbackRing<K> {
    /// A ring for buffers of `size` bytes (a multiple of 4).
    pub fn new(size: u64) -> Self {
        let (sender, receiver) = channel();
        Self {
            size,
            slots: vec![],
            recorded: vec![],
            free: vec![],
            sender,
            receiver: receiver.into(),
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
        let index = match self.free.pop() {
            Some(index) => index,
            None if self.slots.len() < MAX_SLOTS => {
                let buffer = device.create_buffer(&BufferDescriptor {
                    label: Some("treeline_readback"),
                    size: self.size,
                    usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                });
                self.slots.push(Slot { buffer, tag: None });
                self.slots.len() - 1
            }
            None => return,
        };
        encoder.copy_buffer_to_buffer(source, 0, &self.slots[index].buffer, 0, self.size);
        self.slots[index].tag = Some(tag);
        self.recorded.push(index);
    }

    /// Asks for the bytes of everything recorded. Call it after the recorded commands were submitted.
    pub fn map_recorded(&mut self) {
        for index in self.recorded.drain(..) {
            let sender = self.sender.clone();
            let done = move |result: Result<(), _>| {
                // The ring may be gone when the callback runs (the app is closing): nobody waits then.
                let _ = sender.send((index, result.is_ok()));
            };
            self.slots[index].buffer.slice(..).map_async(MapMode::Read, done);
        }
    }

    /// Everything that has arrived since the last call, oldest first.
    pub fn drain(&mut self, mut each: impl FnMut(K, &[u8])) {
        let receiver = self.receiver.get_mut().unwrap_or_else(|poisoned| poisoned.into_inner());
        while let Ok((index, mapped)) = receiver.try_recv() {
            let slot = &mut self.slots[index];
            if let (true, Some(tag)) = (mapped, slot.tag.take()) {
                each(tag, &slot.buffer.slice(..).get_mapped_range());
                slot.buffer.unmap();
            }
            self.free.push(index);
        }
    }
}
