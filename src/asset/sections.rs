//! The container of a `.treeline` file: named, compressed, checked sections. O(bytes).
//!
//! ```text
//! header   magic (8) | version u32 | number of sections u32
//! table    per section: id (4) | version u16 | flags u16 | stored length u64 | raw length u64 | checksum (8)
//! checksum of header and table (8)
//! sections their stored bytes (one zstd frame each), in the order of the table, without gaps
//! ```
//! All numbers are little-endian; a checksum is the first 8 bytes of BLAKE3. Nothing is allocated by a length of the
//! file before that length was held against the bytes there are, what zstd can do, and what the caller expects.

use super::format_error::{FilePart, FormatError, SectionId, SectionProblem};
use super::tree_data::TreeDataError;

/// First bytes of every file.
pub const MAGIC: [u8; 8] = *b"treeline";
/// Version of the container and of the meaning of its required sections. Other versions are refused.
pub const VERSION: u32 = 1;

/// Readers that do not know the section may skip it.
pub(super) const FLAG_OPTIONAL: u16 = 1;

/// Most sections of a file.
const MAX_SECTIONS: u32 = 64;
/// Most bytes of a section after decompression: 1 GiB of points and what describes them.
const MAX_RAW_BYTES: u64 = (1 << 30) + 4096;
/// Most that zstd can save: a block of 128 KiB of one value takes 4 bytes (RFC 8878, §3.1.1.2).
const MAX_RATIO: u64 = 128 * 1024 / 4;
/// For surfels of real trees, level 3 gives 6 to 12 % more bytes; 15 gives 1 % less in ten times the time.
const ZSTD_LEVEL: i32 = 9;

const HEADER_BYTES: usize = 16;
const ENTRY_BYTES: usize = 32;
const CHECKSUM_BYTES: usize = 8;

/// A section to write.
pub(super) struct Section {
    pub id: SectionId,
    pub version: u16,
    pub flags: u16,
    raw_bytes: u64,
    stored: Vec<u8>,
}

impl Section {
    /// A section that holds `raw`.
    pub(super) fn new(id: SectionId, version: u16, flags: u16, raw: &[u8]) -> Self {
        let stored = zstd::bulk::compress(raw, ZSTD_LEVEL)
            .expect("zstd takes any bytes, and its buffer holds the worst case");
        Self { id, version, flags, raw_bytes: raw.len() as u64, stored }
    }

    /// Bytes that it takes in the file, the table aside.
    pub(super) fn stored_bytes(&self) -> usize {
        self.stored.len()
    }
}

/// A section of a file, its stored bytes checked but not decompressed.
#[derive(Clone, Copy)]
pub(super) struct StoredSection<'a> {
    pub id: SectionId,
    pub version: u16,
    pub flags: u16,
    raw_bytes: u64,
    stored: &'a [u8],
}

fn checksum(bytes: &[u8]) -> [u8; CHECKSUM_BYTES] {
    *blake3::hash(bytes).as_bytes().first_chunk().expect("a BLAKE3 hash has 32 bytes")
}

/// The bytes of a file of these sections.
pub(super) fn write_sections(sections: &[Section]) -> Vec<u8> {
    let mut file = Vec::new();
    file.extend(MAGIC);
    file.extend(VERSION.to_le_bytes());
    file.extend((sections.len() as u32).to_le_bytes());
    for section in sections {
        file.extend(section.id.0);
        file.extend(section.version.to_le_bytes());
        file.extend(section.flags.to_le_bytes());
        file.extend((section.stored.len() as u64).to_le_bytes());
        file.extend(section.raw_bytes.to_le_bytes());
        file.extend(checksum(&section.stored));
    }
    file.extend(checksum(&file));
    sections.iter().for_each(|section| file.extend(&section.stored));
    file
}

/// The sections of a file, in its order, every checksum checked.
pub(super) fn read_sections(file: &[u8]) -> Result<Vec<StoredSection<'_>>, FormatError> {
    let mut rest = Reader(file);
    let magic = &file[..file.len().min(MAGIC.len())];
    if !MAGIC.starts_with(magic) {
        return Err(FormatError::NotTreeline { found: magic.to_vec() });
    }
    rest.take("the header", HEADER_BYTES as u64)?;
    let mut header = Reader(&file[MAGIC.len()..]);
    let found = u32::from_le_bytes(header.array("the version")?);
    if found != VERSION {
        return Err(FormatError::Version { found, expected: VERSION });
    }
    let count = u32::from_le_bytes(header.array("the number of sections")?);
    let table = rest.take("the table", u64::from(count) * ENTRY_BYTES as u64)?;
    let expected: [u8; CHECKSUM_BYTES] = rest.array("the table's checksum")?;
    if checksum(&file[..HEADER_BYTES + table.len()]) != expected {
        return Err(FormatError::Checksum { part: FilePart::Table });
    }
    if count > MAX_SECTIONS {
        let what = "the number of sections";
        return Err(TreeDataError { what, value: count.to_string(), expected: "at most 64" }.into());
    }

    let mut sections: Vec<StoredSection> = Vec::new();
    for entry in table.chunks_exact(ENTRY_BYTES) {
        let mut entry = Reader(entry);
        let id = SectionId(entry.array("an entry")?);
        let version = u16::from_le_bytes(entry.array("an entry")?);
        let flags = u16::from_le_bytes(entry.array("an entry")?);
        let stored_bytes = u64::from_le_bytes(entry.array("an entry")?);
        let raw_bytes = u64::from_le_bytes(entry.array("an entry")?);
        let expected: [u8; CHECKSUM_BYTES] = entry.array("an entry")?;
        if sections.iter().any(|s| s.id == id) {
            return Err(FormatError::Section { section: id, problem: SectionProblem::Duplicate });
        }
        let stored = rest.take("a section", stored_bytes)?;
        if checksum(stored) != expected {
            return Err(FormatError::Checksum { part: FilePart::Section(id) });
        }
        sections.push(StoredSection { id, version, flags, raw_bytes, stored });
    }
    match rest.0.len() as u64 {
        0 => Ok(sections),
        bytes => Err(FormatError::TooLong { bytes }),
    }
}

impl StoredSection<'_> {
    /// Decompressed; at most `limit` bytes.
    pub(super) fn raw_up_to(&self, limit: u64) -> Result<Vec<u8>, SectionProblem> {
        let (raw, stored) = (self.raw_bytes, self.stored.len() as u64);
        let limit = limit.min(MAX_RAW_BYTES).min(stored.saturating_mul(MAX_RATIO));
        if raw > limit {
            return Err(SectionProblem::TooLarge { raw, limit });
        }
        let mut buffer = Vec::new();
        let capacity = usize::try_from(raw).map_err(|_| SectionProblem::Memory { raw })?;
        buffer.try_reserve_exact(capacity).map_err(|_| SectionProblem::Memory { raw })?;
        // zstd writes no further than the buffer's capacity and takes no memory of its own for whole frames.
        zstd::bulk::Decompressor::new()
            .and_then(|mut zstd| zstd.decompress_to_buffer(self.stored, &mut buffer))
            .map_err(|error| SectionProblem::Compression { reason: error.to_string() })?;
        match buffer.len() as u64 {
            found if found == raw => Ok(buffer),
            found => Err(SectionProblem::Length { found, expected: raw }),
        }
    }

    /// Decompressed; exactly `expected` bytes.
    pub(super) fn raw_of(&self, expected: u64) -> Result<Vec<u8>, SectionProblem> {
        let found = self.raw_bytes;
        if found == expected {
            return self.raw_up_to(expected);
        }
        Err(SectionProblem::Length { found, expected })
    }
}

/// Takes bytes from the front.
pub(super) struct Reader<'a>(pub &'a [u8]);

impl<'a> Reader<'a> {
    /// The next `needed` bytes; `what` is for the message.
    pub(super) fn take(
        &mut self,
        what: &'static str,
        needed: u64,
    ) -> Result<&'a [u8], FormatError> {
        let split = usize::try_from(needed).ok().and_then(|n| self.0.split_at_checked(n));
        let Some((front, rest)) = split else {
            let found = self.0.len() as u64;
            return Err(FormatError::Truncated { what, needed, found });
        };
        self.0 = rest;
        Ok(front)
    }

    /// The next `N` bytes.
    pub(super) fn array<const N: usize>(
        &mut self,
        what: &'static str,
    ) -> Result<[u8; N], FormatError> {
        let bytes = self.take(what, N as u64)?;
        Ok(*bytes.first_chunk().expect("as many as were taken"))
    }
}

/// Makes the checksums of a changed file right again, so that tests reach what lies behind them.
#[cfg(test)]
pub(super) fn seal(file: &mut [u8]) {
    let Some(count) = file.get(12..16).and_then(|b| b.first_chunk()) else { return };
    let table_end =
        HEADER_BYTES + u32::from_le_bytes(*count).min(MAX_SECTIONS) as usize * ENTRY_BYTES;
    let mut start = table_end + CHECKSUM_BYTES;
    if start > file.len() {
        return;
    }
    for entry in (HEADER_BYTES..table_end).step_by(ENTRY_BYTES) {
        let length = *file[entry + 8..].first_chunk().expect("an entry has 32 bytes");
        let rest = file.len() - start;
        let end = start + (u64::from_le_bytes(length).min(rest as u64)) as usize;
        let sum = checksum(&file[start..end]);
        file[entry + 24..entry + 32].copy_from_slice(&sum);
        start = end;
    }
    let sum = checksum(&file[..table_end]);
    file[table_end..table_end + CHECKSUM_BYTES].copy_from_slice(&sum);
}
