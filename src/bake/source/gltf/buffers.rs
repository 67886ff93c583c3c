//! Buffers and accessors: JSON + bytes → numbers. Every range is checked against the bytes there are before it is read.
//!
//! Done here rather than by the crate's readers: those trust the file (counts of zero, sparse data out of order) and know
//! no quantised positions (KHR_mesh_quantization).

use super::super::uri::{self, Uri};
use super::super::{Files, SourceError};
use super::{MAX_VERTICES, malformed};
use gltf::accessor::{Accessor, DataType, Dimensions};
use gltf::{Document, buffer};
use std::borrow::Cow;

/// The bytes of every buffer of a document.
pub(super) struct Buffers<'a> {
    /// The document they belong to.
    pub document: &'a Document,
    file: &'a str,
    data: Vec<Cow<'a, [u8]>>,
}

/// Where elements lie in the bytes of a view.
#[derive(Clone, Copy)]
struct Layout<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
    count: usize,
}

impl<'a> Layout<'a> {
    fn elements(self) -> impl Iterator<Item = &'a [u8]> {
        let Self { bytes, stride, size, count } = self;
        (0..count).map(move |i| &bytes[i * stride..i * stride + size])
    }
}

impl<'a> Buffers<'a> {
    /// Finds every buffer: the BIN chunk, data URIs, files.
    pub fn read<'f: 'a>(
        document: &'a Document,
        bin: Option<Cow<'a, [u8]>>,
        files: &mut Files<'f>,
    ) -> Result<Self, SourceError> {
        let file = files.file;
        let mut bin = bin;
        let mut data = Vec::new();
        for buffer in document.buffers() {
            let index = buffer.index();
            let place = format!("buffer {index}");
            let (place, bytes) = match buffer.source() {
                buffer::Source::Bin => match bin.take() {
                    Some(bytes) if index == 0 => (format!("{place} (the BIN chunk)"), bytes),
                    _ => {
                        return Err(malformed(file, place, "it has neither a URI nor a BIN chunk"));
                    }
                },
                buffer::Source::Uri(text) => {
                    match uri::resolve(text).map_err(|problem| malformed(file, &place, problem))? {
                        Uri::Data(bytes) => (format!("{place} (a data: URI)"), bytes.into()),
                        Uri::Path(path) => {
                            (format!("{place} (file `{path}`)"), files.require(&path)?.into())
                        }
                    }
                }
            };
            let (needed, available) = (buffer.length() as u64, bytes.len() as u64);
            if needed > available {
                let file = file.to_owned();
                return Err(SourceError::BufferRange { file, place, needed, available });
            }
            data.push(bytes);
        }
        Ok(Self { document, file, data })
    }

    /// The bytes of a view.
    pub fn view(&self, view: &buffer::View) -> Result<&[u8], SourceError> {
        let bytes = &self.data[view.buffer().index()];
        let place = format!("buffer view {}", view.index());
        self.slice(bytes, view.offset(), Some(view.length()), &place)
    }

    /// `bytes[offset..offset + length]`, or an error that names `place`. No length (an overflow) is more than any.
    fn slice<'b>(
        &self,
        bytes: &'b [u8],
        offset: usize,
        length: Option<usize>,
        place: &str,
    ) -> Result<&'b [u8], SourceError> {
        let end = length.and_then(|length| offset.checked_add(length));
        end.and_then(|end| bytes.get(offset..end)).ok_or_else(|| SourceError::BufferRange {
            file: self.file.to_owned(),
            place: place.to_owned(),
            needed: end.map_or(u64::MAX, |end| end as u64),
            available: bytes.len() as u64,
        })
    }

    /// `count` elements of `size` bytes from `offset` in a view.
    fn layout(
        &self,
        view: &buffer::View,
        offset: usize,
        size: usize,
        count: usize,
        place: &str,
    ) -> Result<Layout<'_>, SourceError> {
        let stride = view.stride().unwrap_or(size);
        if stride < size {
            let problem = format!("its elements of {size} bytes are {stride} bytes apart");
            return Err(malformed(self.file, place, problem));
        }
        let length = match count.checked_sub(1) {
            Some(rest) => rest.checked_mul(stride).and_then(|n| n.checked_add(size)),
            None => Some(0),
        };
        let place = format!("{place} in buffer view {}", view.index());
        let bytes = self.slice(self.view(view)?, offset, length, &place)?;
        Ok(Layout { bytes, stride, size, count })
    }

    /// Every element of an accessor, sparse ones included, through `decode`.
    fn elements<T: Copy>(
        &self,
        accessor: &Accessor,
        place: &str,
        zero: T,
        decode: impl Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, SourceError> {
        let (size, count) = (accessor.size(), accessor.count());
        let mut values: Vec<T> = match accessor.view() {
            Some(view) => {
                let layout = self.layout(&view, accessor.offset(), size, count, place)?;
                layout.elements().map(&decode).collect()
            }
            // Sparse over zeros: the only case where the bytes there are do not bound the count.
            None if count > MAX_VERTICES => {
                return Err(malformed(self.file, place, format!("it has {count} elements")));
            }
            None => vec![zero; count],
        };
        let Some(sparse) = accessor.sparse() else { return Ok(values) };
        let (indices, replacements) = (sparse.indices(), sparse.values());
        let index_size = indices.index_type().size();
        let at =
            self.layout(&indices.view(), indices.offset(), index_size, sparse.count(), place)?;
        let by =
            self.layout(&replacements.view(), replacements.offset(), size, sparse.count(), place)?;
        for (index, value) in at.elements().zip(by.elements()) {
            let index = unsigned(index);
            let Some(slot) = values.get_mut(index as usize) else {
                let problem = format!("its sparse index {index} is not below {count}");
                return Err(malformed(self.file, place, problem));
            };
            *slot = decode(value);
        }
        Ok(values)
    }

    /// An accessor of vectors as floats. Normalised integers become −1 to 1, others keep their values; vectors of four
    /// may be stored as three (the fourth is 1). `always_normalized` is for colours, whose integers are fractions even
    /// where a file forgets to say so.
    pub fn vectors<const N: usize>(
        &self,
        accessor: &Accessor,
        place: &str,
        always_normalized: bool,
    ) -> Result<Vec<[f32; N]>, SourceError> {
        let components = match accessor.dimensions() {
            Dimensions::Vec2 => 2,
            Dimensions::Vec3 => 3,
            Dimensions::Vec4 => 4,
            _ => 0,
        };
        if components != N && !(N == 4 && components == 3) {
            let problem = format!("it holds {:?}s, not Vec{N}s", accessor.dimensions());
            return Err(malformed(self.file, place, problem));
        }
        let data_type = accessor.data_type();
        let size = data_type.size();
        let scale = match data_type {
            _ if !accessor.normalized() && !always_normalized => 1.0,
            DataType::I8 => 127.0,
            DataType::U8 => 255.0,
            DataType::I16 => 32767.0,
            DataType::U16 => 65535.0,
            DataType::U32 | DataType::F32 => 1.0,
        };
        self.elements(accessor, place, [0.0; N], |bytes| {
            let mut vector = [1.0; N];
            for (out, bytes) in vector.iter_mut().zip(bytes.chunks_exact(size)) {
                *out = match data_type {
                    DataType::F32 => f32::from_bits(unsigned(bytes)),
                    DataType::I8 => f32::from(bytes[0] as i8) / scale,
                    DataType::I16 => f32::from(unsigned(bytes) as i16) / scale,
                    DataType::U8 | DataType::U16 | DataType::U32 => unsigned(bytes) as f32 / scale,
                };
                // The most negative integer has no positive twin: both it and its neighbour are −1 (glTF 2.0 §3.11).
                if scale > 1.0 {
                    *out = out.max(-1.0);
                }
            }
            vector
        })
    }

    /// An accessor of vertex numbers.
    pub fn indices(&self, accessor: &Accessor, place: &str) -> Result<Vec<u32>, SourceError> {
        let kind = (accessor.dimensions(), accessor.data_type());
        match kind {
            (Dimensions::Scalar, DataType::U8 | DataType::U16 | DataType::U32) => {
                self.elements(accessor, place, 0, unsigned)
            }
            (dimensions, data_type) => {
                let problem =
                    format!("it holds {dimensions:?}s of {data_type:?}, not of U8, U16 or U32");
                Err(malformed(self.file, place, problem))
            }
        }
    }
}

/// Up to four bytes as a little-endian number.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}
