//! What can be wrong with the bytes of a `.treeline` file. Each message says what to do.

use super::tree_data::TreeDataError;
use std::fmt;

/// Why bytes are not a tree.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FormatError {
    /// The magic is wrong: another kind of file.
    #[error(
        "not a .treeline file (it starts with \"{}\"): give a file that `treeline bake` wrote",
        found.escape_ascii()
    )]
    NotTreeline {
        /// Its first bytes, at most 8.
        found: Vec<u8>,
    },
    /// Written by another version of this crate.
    #[error(
        "format version {found}, but this program reads {expected}: bake it again with `treeline bake`"
    )]
    Version {
        /// In the file.
        found: u32,
        /// [`VERSION`](super::format::VERSION).
        expected: u32,
    },
    /// The file ends too early.
    #[error(
        "cut off: {what} needs {needed} bytes, but {found} are left: copy it again or bake it again with `treeline bake`"
    )]
    Truncated {
        /// Which part.
        what: &'static str,
        /// Bytes it takes.
        needed: u64,
        /// Bytes there are.
        found: u64,
    },
    /// The file goes on after its last section.
    #[error("{bytes} bytes too long: copy it again or bake it again with `treeline bake`")]
    TooLong {
        /// Bytes after the last section.
        bytes: u64,
    },
    /// Bytes have changed since they were written.
    #[error(
        "{part} is damaged (wrong checksum): copy it again or bake it again with `treeline bake`"
    )]
    Checksum {
        /// The table, or a section.
        part: FilePart,
    },
    /// A section is not what this program can read.
    #[error("section {section}: {problem}: bake it again with `treeline bake`")]
    Section {
        /// Which.
        section: SectionId,
        /// What is wrong with it.
        problem: SectionProblem,
    },
    /// All bytes are as they were written, but what they say makes no tree.
    #[error("{0}: bake it again with `treeline bake`")]
    Value(#[from] TreeDataError),
}

/// Name of a section: four ASCII characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SectionId(pub [u8; 4]);

impl fmt::Display for SectionId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}`", self.0.escape_ascii())
    }
}

/// What a checksum is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FilePart {
    /// Header and table of sections.
    Table,
    /// The stored bytes of a section.
    Section(SectionId),
}

impl fmt::Display for FilePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Table => f.write_str("the table of sections"),
            Self::Section(id) => write!(f, "section {id}"),
        }
    }
}

/// What is wrong with a section.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SectionProblem {
    /// A tree needs it.
    #[error("missing")]
    Missing,
    /// It is there twice.
    #[error("there twice")]
    Duplicate,
    /// Required, and unknown to this program: written by a newer one.
    #[error("version {version} is unknown to this program and cannot be skipped")]
    Unknown {
        /// Version of the section.
        version: u16,
    },
    /// Flags of a newer program say that it is stored differently.
    #[error("unknown flags {flags:#06x}")]
    Flags {
        /// All flags.
        flags: u16,
    },
    /// Its length does not fit its content.
    #[error("{found} bytes, but {expected} are needed")]
    Length {
        /// According to the table or after decompression.
        found: u64,
        /// According to the number of points.
        expected: u64,
    },
    /// It claims to grow by more than it can, or more than is allowed.
    #[error("claims {raw} bytes, but at most {limit} are possible")]
    TooLarge {
        /// Length after decompression.
        raw: u64,
        /// What is allowed.
        limit: u64,
    },
    /// There is no memory for it.
    #[error("no memory for {raw} bytes")]
    Memory {
        /// Length after decompression.
        raw: u64,
    },
    /// Its points are arranged in an unknown way.
    #[error("points in lanes of {width} bytes, but 1, 2 or 8 are needed")]
    Layout {
        /// Bytes of a lane.
        width: u8,
    },
    /// zstd refuses it.
    #[error("cannot be decompressed ({reason})")]
    Compression {
        /// In zstd's words.
        reason: String,
    },
    /// The JSON in it is not what it should be.
    #[error("cannot be read ({reason})")]
    Json {
        /// In serde's words.
        reason: String,
    },
}
