//! From GPU memory to samples: waits for the GPU, maps buffers, decodes records.

use super::{
    GpuPeelError, GpuPeeler,
    pipelines::{DEPTH_MARGIN, NO_NORMAL},
    triangles::TriangleTable,
};
use crate::{
    bake::peel::{LdiViewport, PeelSample},
    math::octahedral,
};
use bytemuck::{Pod, Zeroable};
use std::{panic::AssertUnwindSafe, sync::mpsc, time::Duration};

/// `PeelRecord` of the shader: a kept fragment.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct GpuPeelRecord {
    cell: u32,
    depth: f32,
    triangle: u32,
    normal: u32,
    albedo: u32,
}

/// Bytes of a record.
pub(super) const RECORD_BYTES: u64 = size_of::<GpuPeelRecord>() as u64;

/// How long a map's callback may run late when another thread has polled for it.
const CALLBACK_PATIENCE: Duration = Duration::from_secs(30);

/// What one batch of layers left in `BatchHeader` of the shader.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct GpuLayerCount {
    /// Pixels with a fragment.
    pub(super) covered: u32,
    /// Records written.
    pub(super) kept: u32,
}

impl GpuPeeler {
    /// Waits for `submission`, then returns the first bytes of each buffer (mappable, written by it).
    pub(super) fn read_back<const N: usize>(
        &self,
        submission: wgpu::SubmissionIndex,
        buffers: [(&wgpu::Buffer, u64); N],
    ) -> Result<[Vec<u8>; N], GpuPeelError> {
        let (sender, receiver) = mpsc::channel();
        for (buffer, bytes) in buffers.iter().filter(|(_, bytes)| *bytes > 0) {
            let sender = sender.clone();
            buffer.map_async(wgpu::MapMode::Read, ..*bytes, move |mapped| {
                // A receiver that is gone has given up waiting.
                let _ = sender.send(mapped.is_ok());
            });
        }
        drop(sender);
        let wait = wgpu::PollType::Wait { submission_index: Some(submission), timeout: None };
        // wgpu panics here when the device is lost; a game that bakes in the background must survive that.
        let polled = std::panic::catch_unwind(AssertUnwindSafe(|| self.device.poll(wait)));
        if !matches!(polled, Ok(Ok(_))) {
            return Err(self.device_lost());
        }
        let mut mapped = Vec::with_capacity(N);
        for (buffer, bytes) in buffers {
            if bytes > 0 && receiver.recv_timeout(CALLBACK_PATIENCE) != Ok(true) {
                return Err(self.device_lost());
            }
            mapped.push((buffer, bytes));
        }
        Ok(std::array::from_fn(|i| {
            let (buffer, bytes) = mapped[i];
            if bytes == 0 {
                return Vec::new();
            }
            let data = buffer.get_mapped_range(..bytes).to_vec();
            buffer.unmap();
            data
        }))
    }
}

/// Turns the records of consecutive layers into samples. `first_layer` is the batch's first.
pub(super) fn decode_records(
    bytes: &[u8],
    counts: &[GpuLayerCount],
    first_layer: u32,
    direction: u8,
    viewport: &LdiViewport,
    triangles: &TriangleTable,
    samples: &mut Vec<PeelSample>,
) {
    let mut records = bytes.chunks_exact(RECORD_BYTES as usize);
    samples.reserve(records.len());
    for (layer, count) in std::iter::zip(first_layer.., counts) {
        for record in records.by_ref().take(count.kept as usize) {
            let record: GpuPeelRecord = bytemuck::pod_read_unaligned(record);
            samples.push(decode(record, layer as u16, direction, viewport, triangles));
        }
    }
}

fn decode(
    record: GpuPeelRecord,
    layer: u16,
    direction: u8,
    viewport: &LdiViewport,
    triangles: &TriangleTable,
) -> PeelSample {
    let cell = [record.cell as u16, (record.cell >> 16) as u16];
    let frame = viewport.direction;
    let [x, y] = cell.map(|c| (f32::from(c) + 0.5) * viewport.pixel);
    let z = (record.depth - DEPTH_MARGIN) / (1.0 - 2.0 * DEPTH_MARGIN) * viewport.depth;
    let triangle = record.triangle as usize;
    let face_normal = triangles.face_normals[triangle];
    let normal = match record.normal {
        NO_NORMAL => face_normal,
        packed => octahedral::decode_bits([packed & 0xffff, packed >> 16], 16, 16),
    };
    let [r, g, b, _] = record.albedo.to_le_bytes();
    PeelSample {
        position: viewport.origin + frame.right * x + frame.up * y + frame.forward * z,
        normal,
        face_normal,
        albedo: [r, g, b],
        material: triangles.materials[triangle],
        direction,
        layer,
        cell,
    }
}
