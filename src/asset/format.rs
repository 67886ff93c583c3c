//! The `.treeline` format: [`TreeData`] ↔ bytes. O(points); an encoded tree takes a third to two thirds of its memory.
//!
//! | section | version | optional | content |
//! |---|---|---|---|
//! | `HEAD` | 1 | no | box (6 × f32), LDI pixel, surface area, mean leaf area (f32), 0 (u32), number of points (u64) |
//! | `HOTS` | 1 | no | width of the lanes (u8), hot halves of the points in lanes |
//! | `COLD` | 1 | no | width of the lanes (u8), cold halves in lanes |
//! | `FACT` | 1 | yes | factors on area and on colour (32 × f32 each), mean colour (3 × f32) and shade (f32) of what is seen; found anew from the points where it is missing |
//! | `STAT` | 1 | yes | JSON: statistics and source |
//!
//! This is where the asset grows. A new kind of data is a new section: optional if the tree can be drawn well
//! without it, else required. An optional section (or version of one) that a reader does not know is skipped, and lost
//! when the tree is written again; a required one is an error. [`VERSION`] rises only if the container changes.

pub use super::sections::{MAGIC, VERSION};

use super::format_error::{FormatError, SectionId, SectionProblem};
use super::lanes::{LANE_WIDTHS, RECORD_BYTES, lanes_from_records, records_from_lanes};
use super::sections::{
    FLAG_OPTIONAL, Reader, Section, StoredSection, read_sections, write_sections,
};
use super::surfel::{SurfelCold, SurfelHot};
use super::thinning::Thinning;
use super::tree_data::{
    BakeStatistics, MAX_POINTS, SeenMean, SourceReference, TreeData, TreeDataError,
};
use crate::{
    lod::thinning::{FACTOR_LIMIT, FACTOR_STEPS},
    math::bounding::Aabb,
};
use bevy::math::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A section that this program knows.
#[derive(Clone, Copy)]
struct KnownSection {
    id: SectionId,
    version: u16,
    flags: u16,
}

const HEAD: KnownSection = KnownSection { id: SectionId(*b"HEAD"), version: 1, flags: 0 };
const HOTS: KnownSection = KnownSection { id: SectionId(*b"HOTS"), version: 1, flags: 0 };
const COLD: KnownSection = KnownSection { id: SectionId(*b"COLD"), version: 1, flags: 0 };
const FACT: KnownSection =
    KnownSection { id: SectionId(*b"FACT"), version: 1, flags: FLAG_OPTIONAL };
const STAT: KnownSection =
    KnownSection { id: SectionId(*b"STAT"), version: 1, flags: FLAG_OPTIONAL };
const KNOWN: [KnownSection; 5] = [HEAD, HOTS, COLD, FACT, STAT];

const HEAD_BYTES: u64 = 48;
const FACT_BYTES: u64 = (2 * FACTOR_STEPS as u64 + 4) * 4;
/// JSON of texts within `MAX_TEXT_BYTES` is smaller: a byte takes at most 6 (`\u0000`).
const MAX_STAT_BYTES: u64 = 32 << 20;

/// Content of `STAT`.
#[derive(Serialize, Deserialize)]
struct StatSection<'a> {
    statistics: Cow<'a, BakeStatistics>,
    source: Cow<'a, Option<SourceReference>>,
}

/// The bytes of a `.treeline` file. Equal trees give equal bytes, and [`decode`] gives the same tree back, with
/// durations in whole microseconds.
///
/// Tries three layouts of the points on rayon's threads and keeps the smallest of each half.
///
/// Does not check the tree: what [`TreeData::validate`] refuses is written, but [`decode`] refuses it.
pub fn encode(tree: &TreeData) -> Vec<u8> {
    let statistics = BakeStatistics {
        seconds: tree.statistics.seconds.to_microseconds(),
        ..tree.statistics.clone()
    };
    let stat =
        StatSection { statistics: Cow::Owned(statistics), source: Cow::Borrowed(&tree.source) };
    let stat = serde_json::to_vec(&stat).expect("structs of texts and numbers are JSON");
    let section =
        |known: KnownSection, raw: &[u8]| Section::new(known.id, known.version, known.flags, raw);
    // The smallest of the layouts; the first of equals, so that equal trees give equal bytes.
    let points = |known: KnownSection, records: &[[u32; 2]]| {
        LANE_WIDTHS
            .into_par_iter()
            .map(|width| section(known, &lanes_from_records(records, width)))
            .collect::<Vec<_>>()
            .into_iter()
            .min_by_key(Section::stored_bytes)
            .expect("there are three layouts")
    };
    let (hots, cold) = rayon::join(
        || points(HOTS, bytemuck::cast_slice(&tree.hot)),
        || points(COLD, bytemuck::cast_slice(&tree.cold)),
    );
    let (head, factors) = (section(HEAD, &encode_head(tree)), section(FACT, &encode_factors(tree)));
    write_sections(&[head, hots, cold, factors, section(STAT, &stat)])
}

/// The tree of a `.treeline` file's bytes.
///
/// # Errors
/// [`FormatError`], whatever the bytes are; never a panic. Takes no more memory than the tree and what zstd could
/// really have packed into the bytes given, at most 1 GiB a section.
pub fn decode(file: &[u8]) -> Result<TreeData, FormatError> {
    let sections = read_sections(file)?;
    sections.iter().try_for_each(check_known)?;
    let head = decode_head(&raw_of(&sections, &HEAD, HEAD_BYTES)?)?;
    let hot = decode_points(&sections, &HOTS, head.point_count, bytemuck::cast::<_, SurfelHot>)?;
    let cold = decode_points(&sections, &COLD, head.point_count, bytemuck::cast::<_, SurfelCold>)?;
    let stat = decode_stat(&sections)?;
    let tree = TreeData {
        bounds: head.bounds,
        pixel: head.pixel,
        surface_area: head.surface_area,
        mean_leaf_area: head.mean_leaf_area,
        area_factors: [1.0; FACTOR_STEPS],
        light_factors: [1.0; FACTOR_STEPS],
        seen_mean: SeenMean::default(),
        hot,
        cold,
        source: stat.source.into_owned(),
        statistics: stat.statistics.into_owned(),
    };
    tree.validate()?;
    if find(&sections, &FACT).is_none() {
        return Ok(tree.with_factors());
    }
    let Thinning { area, light, mean } = decode_factors(&raw_of(&sections, &FACT, FACT_BYTES)?)?;
    Ok(TreeData { area_factors: area, light_factors: light, seen_mean: mean, ..tree })
}

/// Refuses required sections that this program does not know, and known ones that are stored in a newer way.
fn check_known(section: &StoredSection) -> Result<(), FormatError> {
    let known = KNOWN.iter().find(|k| (k.id, k.version) == (section.id, section.version));
    let problem = match known {
        Some(known) if known.flags == section.flags => return Ok(()),
        Some(_) => SectionProblem::Flags { flags: section.flags },
        None if section.flags & FLAG_OPTIONAL != 0 => return Ok(()),
        None => SectionProblem::Unknown { version: section.version },
    };
    Err(FormatError::Section { section: section.id, problem })
}

/// The section of a known kind, if the file has one.
fn find<'a>(sections: &[StoredSection<'a>], known: &KnownSection) -> Option<StoredSection<'a>> {
    sections.iter().copied().find(|s| (s.id, s.version) == (known.id, known.version))
}

/// The content of a required section, `expected` bytes long.
fn raw_of(
    sections: &[StoredSection],
    known: &KnownSection,
    expected: u64,
) -> Result<Vec<u8>, FormatError> {
    find(sections, known)
        .ok_or(SectionProblem::Missing)
        .and_then(|section| section.raw_of(expected))
        .map_err(|problem| FormatError::Section { section: known.id, problem })
}

struct Head {
    bounds: Aabb,
    pixel: f32,
    surface_area: f32,
    mean_leaf_area: f32,
    point_count: u64,
}

fn encode_head(tree: &TreeData) -> Vec<u8> {
    let floats = [tree.pixel, tree.surface_area, tree.mean_leaf_area];
    let corners = [tree.bounds.min.to_array(), tree.bounds.max.to_array()];
    let numbers = corners.into_iter().flatten().chain(floats).flat_map(f32::to_le_bytes);
    let count = (tree.point_count() as u64).to_le_bytes();
    numbers.chain(0u32.to_le_bytes()).chain(count).collect()
}

fn decode_head(raw: &[u8]) -> Result<Head, FormatError> {
    let mut raw = Reader(raw);
    let mut number = || raw.array("`HEAD`").map(f32::from_le_bytes);
    let min = Vec3::new(number()?, number()?, number()?);
    let max = Vec3::new(number()?, number()?, number()?);
    let (pixel, surface_area, mean_leaf_area) = (number()?, number()?, number()?);
    let spare = u32::from_le_bytes(raw.array("`HEAD`")?);
    let point_count = u64::from_le_bytes(raw.array("`HEAD`")?);
    let refuse =
        |what, value: String, expected| Err(TreeDataError { what, value, expected }.into());
    if spare != 0 {
        return refuse("the spare number of `HEAD`", spare.to_string(), "0");
    }
    if point_count > MAX_POINTS {
        return refuse("the number of points", point_count.to_string(), "1 to 134,217,728");
    }
    Ok(Head { bounds: Aabb { min, max }, pixel, surface_area, mean_leaf_area, point_count })
}

fn encode_factors(tree: &TreeData) -> Vec<u8> {
    let SeenMean { color, shade } = tree.seen_mean;
    let factors = tree.area_factors.iter().chain(&tree.light_factors);
    factors.chain(&color).chain([&shade]).flat_map(|number| number.to_le_bytes()).collect()
}

fn decode_factors(raw: &[u8]) -> Result<Thinning, FormatError> {
    let mut raw = Reader(raw);
    let mut numbers = [0.0; 2 * FACTOR_STEPS + 4];
    for number in &mut numbers {
        *number = f32::from_le_bytes(raw.array("`FACT`")?);
        if !(0.0..=FACTOR_LIMIT).contains(number) {
            let (what, expected) = ("a factor of few points", "0 to 2.5");
            return Err(TreeDataError { what, value: number.to_string(), expected }.into());
        }
    }
    let table = |first: usize| std::array::from_fn(|step| numbers[first + step]);
    let [.., red, green, blue, shade] = numbers;
    let mean = SeenMean { color: [red, green, blue], shade };
    Ok(Thinning { area: table(0), light: table(FACTOR_STEPS), mean })
}

/// One half of the points.
fn decode_points<R>(
    sections: &[StoredSection],
    known: &KnownSection,
    count: u64,
    from_record: impl Fn([u32; 2]) -> R,
) -> Result<Vec<R>, FormatError> {
    let raw = raw_of(sections, known, 1 + count * RECORD_BYTES as u64)?;
    records_from_lanes(&raw, from_record).map_err(|width| FormatError::Section {
        section: known.id,
        problem: SectionProblem::Layout { width },
    })
}

fn decode_stat(sections: &[StoredSection]) -> Result<StatSection<'static>, FormatError> {
    let Some(section) = find(sections, &STAT) else {
        return Ok(StatSection { statistics: Cow::default(), source: Cow::default() });
    };
    section
        .raw_up_to(MAX_STAT_BYTES)
        .and_then(|json| {
            serde_json::from_slice(&json)
                .map_err(|error| SectionProblem::Json { reason: error.to_string() })
        })
        .map_err(|problem| FormatError::Section { section: STAT.id, problem })
}

#[cfg(test)]
#[path = "format_tests.rs"]
mod tests;
