use super::*;
use crate::asset::format_error::FilePart;
use crate::asset::sections::seal;
use crate::asset::synthetic::synthetic_tree;
use proptest::prelude::*;

/// Where the table's entry of a section starts.
fn entry_of(file: &[u8], id: &[u8; 4]) -> usize {
    (16..).step_by(32).find(|&at| file[at..at + 4] == *id).expect("every tree has it")
}

/// Offset of a field in a table's entry.
const VERSION_FIELD: usize = 4;
const FLAGS_FIELD: usize = 6;
const STORED_FIELD: usize = 8;
const RAW_FIELD: usize = 16;

/// A file with bytes of an entry overwritten and its checksums made right again.
fn with_entry(id: &[u8; 4], field: usize, bytes: &[u8]) -> Vec<u8> {
    let mut file = encode(&synthetic_tree(300, 1));
    let at = entry_of(&file, id) + field;
    file[at..at + bytes.len()].copy_from_slice(bytes);
    seal(&mut file);
    file
}

fn section_problem(file: &[u8]) -> (String, SectionProblem) {
    match decode(file) {
        Err(FormatError::Section { section, problem }) => (section.to_string(), problem),
        other => panic!("not an error of a section: {other:?}"),
    }
}

/// A section before compression.
struct PlainSection {
    id: SectionId,
    version: u16,
    flags: u16,
    raw: Vec<u8>,
}

/// A file with other sections, all well packed.
fn with_sections(change: impl FnOnce(&mut Vec<PlainSection>)) -> Vec<u8> {
    let file = encode(&synthetic_tree(300, 1));
    let stored = read_sections(&file).expect("just written");
    let mut sections = stored
        .iter()
        .map(|s| PlainSection {
            id: s.id,
            version: s.version,
            flags: s.flags,
            raw: s.raw_up_to(u64::MAX).expect("just written"),
        })
        .collect();
    change(&mut sections);
    let packed = sections.iter().map(|s| Section::new(s.id, s.version, s.flags, &s.raw));
    write_sections(&packed.collect::<Vec<_>>())
}

#[test]
fn a_tree_survives_and_its_bytes_are_always_the_same() {
    for count in [1, 2, 3000] {
        let mut tree = synthetic_tree(count, 5);
        if count == 1 {
            tree.source = None;
            tree.statistics = BakeStatistics::default();
        }
        let file = encode(&tree);
        let back = decode(&file).expect("just written");
        assert_eq!(back, tree);
        assert_eq!(encode(&back), file);
    }
}

#[test]
fn durations_are_kept_to_the_microsecond() {
    let mut tree = synthetic_tree(10, 1);
    tree.statistics.seconds.peeling = 0.1 + 0.2 + 1e-10;
    let back = decode(&encode(&tree)).expect("just written");
    assert_eq!(back.statistics.seconds.peeling, 0.3);
    assert_eq!(encode(&back), encode(&tree));
}

#[test]
fn the_header_is_what_the_documentation_says() {
    let file = encode(&synthetic_tree(10, 1));
    assert_eq!(file[..8], MAGIC);
    assert_eq!(file[8..16], [1, 0, 0, 0, 5, 0, 0, 0]);
    assert_eq!(file[16..24], *b"HEAD\x01\x00\x00\x00");
    let stat = entry_of(&file, b"STAT");
    assert_eq!(file[stat..stat + 8], *b"STAT\x01\x00\x01\x00");
    let raw_length = |id| file[entry_of(&file, id) + RAW_FIELD];
    assert_eq!((raw_length(b"HEAD"), raw_length(b"HOTS"), raw_length(b"COLD")), (48, 81, 81));
}

#[test]
fn a_tree_that_compresses_as_far_as_zstd_can_is_still_read() {
    let mut tree = synthetic_tree(1, 1);
    tree.hot = vec![tree.hot[0]; 3_000_000];
    tree.cold = vec![tree.cold[0]; 3_000_000];
    let file = encode(&tree);
    assert!(file.len() < 20_000, "{} bytes", file.len());
    assert_eq!(decode(&file).expect("just written").hot, tree.hot);
}

#[test]
fn the_smallest_layout_of_each_half_is_chosen() {
    let tree = synthetic_tree(20_000, 1);
    let file = encode(&tree);
    let sections = read_sections(&file).expect("just written");
    for (id, records) in
        [(HOTS, bytemuck::cast_slice(&tree.hot)), (COLD, bytemuck::cast_slice(&tree.cold))]
    {
        let size = |width| {
            let lanes = lanes_from_records(records, width);
            Section::new(id.id, 1, 0, &lanes).stored_bytes()
        };
        let raw = find(&sections, &id).expect("just written").raw_up_to(u64::MAX);
        let chosen = raw.expect("just written")[0];
        assert!(LANE_WIDTHS.into_iter().all(|width| size(chosen) <= size(width)));
    }
    // The colours of a synthetic tree are noise, so no two bytes say anything about each other.
    let cold = find(&sections, &COLD).expect("just written").raw_up_to(u64::MAX);
    assert_eq!(cold.expect("just written")[0], 1);
}

#[test]
fn another_kind_of_file_is_refused_by_its_first_bytes() {
    let error = decode(b"ply\nformat ascii 1.0").expect_err("a mesh");
    assert_eq!(error, FormatError::NotTreeline { found: b"ply\nform".to_vec() });
    assert!(error.to_string().contains("starts with \"ply\\nform\""), "{error}");
    assert!(matches!(decode(b"tre"), Err(FormatError::Truncated { needed: 16, found: 3, .. })));
    assert!(matches!(decode(b""), Err(FormatError::Truncated { found: 0, .. })));
}

#[test]
fn another_version_is_refused_before_anything_else_is_read() {
    let mut file = encode(&synthetic_tree(10, 1));
    file[8] = 2;
    file.truncate(20);
    let error = decode(&file).expect_err("version 2");
    assert_eq!(error, FormatError::Version { found: 2, expected: VERSION });
    assert!(error.to_string().contains("bake it again with `treeline bake`"), "{error}");
}

#[test]
fn a_file_cut_off_anywhere_or_made_longer_is_refused() {
    let file = encode(&synthetic_tree(20, 1));
    for length in 0..file.len() {
        let error = decode(&file[..length]).expect_err("cut off");
        assert!(matches!(error, FormatError::Truncated { .. }), "{length} bytes: {error}");
    }
    let longer = [file.as_slice(), &[0; 3]].concat();
    assert_eq!(decode(&longer), Err(FormatError::TooLong { bytes: 3 }));
}

#[test]
fn every_flipped_bit_is_noticed() {
    let file = encode(&synthetic_tree(20, 1));
    for bit in 0..file.len() * 8 {
        let mut file = file.clone();
        file[bit / 8] ^= 1 << (bit % 8);
        assert!(decode(&file).is_err(), "bit {bit}");
    }
    let mut last = file;
    *last.last_mut().expect("not empty") ^= 1;
    let part = FilePart::Section(STAT.id);
    assert_eq!(decode(&last), Err(FormatError::Checksum { part }));
}

#[test]
fn an_unknown_optional_section_is_skipped_and_a_required_one_is_not() {
    let tree = synthetic_tree(300, 1);
    let new = |flags| PlainSection { id: SectionId(*b"VIEW"), version: 1, flags, raw: vec![1; 99] };
    let optional = with_sections(|s| s.insert(1, new(FLAG_OPTIONAL | 1 << 9)));
    assert_eq!(decode(&optional).as_ref(), Ok(&tree));
    let required = with_sections(|s| s.push(new(0)));
    let (id, problem) = section_problem(&required);
    assert_eq!((id.as_str(), problem), ("`VIEW`", SectionProblem::Unknown { version: 1 }));
}

#[test]
fn a_newer_version_of_a_section_is_skipped_only_if_it_is_optional() {
    let tree = decode(&with_entry(b"STAT", VERSION_FIELD, &[2])).expect("statistics are optional");
    assert_eq!((tree.statistics, tree.source), (BakeStatistics::default(), None));
    let (_, problem) = section_problem(&with_entry(b"COLD", VERSION_FIELD, &[2]));
    assert_eq!(problem, SectionProblem::Unknown { version: 2 });
    let (_, problem) = section_problem(&with_entry(b"COLD", FLAGS_FIELD, &[0x10]));
    assert_eq!(problem, SectionProblem::Flags { flags: 16 });
}

#[test]
fn factors_that_a_file_lacks_are_found_from_its_points() {
    let tree = synthetic_tree(300, 1);
    let without = with_sections(|s| s.retain(|s| s.id != FACT.id));
    let found = decode(&without).expect("they are optional");
    assert_eq!(found, tree.clone().with_factors());
    assert_ne!(found.area_factors, tree.area_factors);
    assert_eq!(decode(&encode(&found)), Ok(found));
}

#[test]
fn a_missing_or_repeated_section_is_named() {
    let missing = with_sections(|s| s.retain(|s| s.id != HOTS.id));
    assert_eq!(section_problem(&missing), ("`HOTS`".into(), SectionProblem::Missing));
    let twice = with_sections(|s| {
        let raw = s[2].raw.clone();
        s.push(PlainSection { id: COLD.id, version: 1, flags: 0, raw });
    });
    assert_eq!(section_problem(&twice), ("`COLD`".into(), SectionProblem::Duplicate));
    let many = with_sections(|s| {
        s.extend((0..70).map(|i| PlainSection {
            id: SectionId([b'X', b'X', b'X', i]),
            version: 1,
            flags: FLAG_OPTIONAL,
            raw: vec![],
        }));
    });
    assert!(matches!(decode(&many), Err(FormatError::Value(_))));
}

#[test]
fn a_huge_length_is_refused_before_memory_is_taken() {
    for huge in [u64::MAX, 1 << 63, 1 << 40, (1 << 30) + 1] {
        let (_, problem) = section_problem(&with_entry(b"HOTS", RAW_FIELD, &huge.to_le_bytes()));
        assert_eq!(problem, SectionProblem::Length { found: huge, expected: 2401 });
        let (_, problem) = section_problem(&with_entry(b"STAT", RAW_FIELD, &huge.to_le_bytes()));
        assert!(matches!(problem, SectionProblem::TooLarge { raw, .. } if raw == huge));
        let truncated = decode(&with_entry(b"HOTS", STORED_FIELD, &huge.to_le_bytes()));
        assert!(matches!(truncated, Err(FormatError::Truncated { needed, .. }) if needed == huge));
        // The same number of points, and of bytes of both halves, in agreement with each other.
        let mut file = with_sections(|s| s[0].raw[40..].copy_from_slice(&huge.to_le_bytes()));
        for id in [b"HOTS", b"COLD"] {
            let at = entry_of(&file, id) + RAW_FIELD;
            file[at..at + 8].copy_from_slice(&huge.wrapping_mul(8).wrapping_add(1).to_le_bytes());
        }
        seal(&mut file);
        assert!(matches!(decode(&file), Err(FormatError::Value(_))), "{huge}");
    }
    // Allowed as a number of points, but more than these few bytes can hold.
    let count = MAX_POINTS;
    let mut file = with_sections(|s| s[0].raw[40..].copy_from_slice(&count.to_le_bytes()));
    let at = entry_of(&file, b"HOTS") + RAW_FIELD;
    file[at..at + 8].copy_from_slice(&(count * 8 + 1).to_le_bytes());
    seal(&mut file);
    assert!(matches!(section_problem(&file).1, SectionProblem::TooLarge { .. }));
}

#[test]
fn a_section_that_grows_to_another_length_than_it_says_is_refused() {
    for wrong in [0u64, 1, 100, 1000] {
        let (_, problem) = section_problem(&with_entry(b"STAT", RAW_FIELD, &wrong.to_le_bytes()));
        let expected =
            matches!(problem, SectionProblem::Compression { .. } | SectionProblem::Length { .. });
        assert!(expected, "{wrong}: {problem}");
    }
}

#[test]
fn values_that_make_no_tree_are_named() {
    let with_head = |at: usize, value: f32| {
        let file = with_sections(|s| s[0].raw[at..at + 4].copy_from_slice(&value.to_le_bytes()));
        match decode(&file) {
            Err(FormatError::Value(error)) => error.what,
            other => panic!("not an error of a value: {other:?}"),
        }
    };
    assert_eq!(with_head(4, f32::NAN), "the box");
    assert_eq!(with_head(24, 0.0), "the LDI pixel");
    assert_eq!(with_head(28, f32::INFINITY), "the surface area");
    assert_eq!(with_head(32, -1.0), "the mean leaf area");
    assert_eq!(with_head(36, 1.0), "the spare number of `HEAD`");
    let json = with_sections(|s| s[4].raw = br#"{"statistics":3}"#.to_vec());
    let (id, problem) = section_problem(&json);
    assert!(id == "`STAT`" && matches!(problem, SectionProblem::Json { .. }));
    for wrong in [-0.1f32, 2.6, f32::NAN] {
        let factors = with_sections(|s| s[3].raw[8..12].copy_from_slice(&wrong.to_le_bytes()));
        assert!(matches!(decode(&factors), Err(FormatError::Value(_))), "{wrong}");
    }
    let lanes = with_sections(|s| s[1].raw[0] = 4);
    assert_eq!(section_problem(&lanes).1, SectionProblem::Layout { width: 4 });
    let shorter = with_sections(|s| s[2].raw.truncate(8));
    let (_, problem) = section_problem(&shorter);
    assert_eq!(problem, SectionProblem::Length { found: 8, expected: 2401 });
}

#[test]
fn what_is_no_tree_can_be_encoded_but_not_decoded() {
    let mut tree = synthetic_tree(10, 1);
    tree.cold.pop();
    tree.pixel = f32::NAN;
    tree.statistics.seconds.total = f64::NAN;
    assert!(decode(&encode(&tree)).is_err());
}

/// A change of a file's bytes.
#[derive(Clone, Debug)]
enum Damage {
    Flip(usize, u8),
    Cut(usize),
    Append(Vec<u8>),
    Overwrite(usize, u64),
    Remove(usize, usize),
}

impl Damage {
    fn apply(&self, file: &mut Vec<u8>) {
        let length = file.len().max(1);
        match *self {
            Self::Flip(at, bit) if !file.is_empty() => file[at % length] ^= 1 << bit,
            Self::Cut(at) => file.truncate(at % length),
            Self::Append(ref bytes) => file.extend(bytes),
            Self::Overwrite(at, value) => {
                let at = at % length;
                std::iter::zip(file.iter_mut().skip(at), value.to_le_bytes())
                    .for_each(|(old, new)| *old = new);
            }
            Self::Remove(at, count) => {
                let at = at % length;
                file.drain(at.min(file.len())..(at + count).min(file.len()));
            }
            Self::Flip(..) => {}
        }
    }
}

fn damage() -> impl Strategy<Value = Damage> {
    // Half of the places lie in the header and the table, where the lengths are.
    let at = || prop_oneof![0..160usize, any::<usize>()];
    let huge = prop_oneof![any::<u64>(), Just(u64::MAX), Just(1 << 63), Just(1 << 32), 0..9u64];
    prop_oneof![
        (at(), 0..8u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        at().prop_map(Damage::Cut),
        prop::collection::vec(any::<u8>(), 1..50).prop_map(Damage::Append),
        (at(), huge).prop_map(|(at, value)| Damage::Overwrite(at, value)),
        (at(), 1..40usize).prop_map(|(at, count)| Damage::Remove(at, count)),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn a_damaged_file_is_refused(damages in prop::collection::vec(damage(), 1..4)) {
        let whole = encode(&synthetic_tree(200, 1));
        let mut file = whole.clone();
        damages.iter().for_each(|d| d.apply(&mut file));
        prop_assert_eq!(decode(&file).is_ok(), file == whole);
    }

    #[test]
    fn a_forged_file_with_right_checksums_never_panics(damages in prop::collection::vec(damage(), 1..4)) {
        let mut file = encode(&synthetic_tree(200, 1));
        damages.iter().for_each(|d| d.apply(&mut file));
        seal(&mut file);
        if let Ok(tree) = decode(&file) {
            prop_assert!(tree.validate().is_ok());
            prop_assert_eq!(decode(&encode(&tree)), Ok(tree));
        }
    }

    #[test]
    fn any_bytes_are_refused(tail in prop::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(decode(&tail).is_err());
        let mut file = [MAGIC.as_slice(), &VERSION.to_le_bytes(), &[3, 0, 0, 0], &tail].concat();
        seal(&mut file);
        prop_assert!(decode(&file).is_err());
    }

    #[test]
    fn any_valid_tree_survives(
        words in prop::collection::vec(any::<[u32; 4]>(), 1..50),
        numbers in prop::array::uniform4(1e-6f32..1e6),
        micros in prop::array::uniform4(0..1_000_000_000_000u64),
        text in ".*",
        layers in prop::collection::vec(any::<u32>(), 0..64),
        counts in prop::array::uniform3(any::<u64>()),
        factors in prop::array::uniform32(0.0f32..2.5),
    ) {
        let mut tree = synthetic_tree(1, 1);
        tree.hot = words
            .iter()
            .map(|w| SurfelHot { position_xy: w[0], position_z_face: w[1] })
            .collect();
        tree.cold = words
            .iter()
            .map(|w| SurfelCold { normal_albedo_rg: w[2], albedo_b_misc: w[3] })
            .collect();
        [tree.pixel, tree.surface_area, tree.mean_leaf_area, tree.bounds.max.x] = numbers;
        let seconds = &mut tree.statistics.seconds;
        [seconds.loading, seconds.peeling, seconds.ordering, seconds.total] =
            micros.map(|m| m as f64 / 1e6);
        tree.statistics.warnings = vec![text.clone(), String::new()];
        tree.statistics.backend = text;
        tree.statistics.layers = layers;
        [tree.statistics.seed, tree.statistics.left_over, tree.statistics.triangles] = counts;
        (tree.area_factors, tree.light_factors[7], tree.seen_mean.shade) = (factors, factors[1], factors[2]);
        let file = encode(&tree);
        prop_assert_eq!(&encode(&decode(&file).expect("just written")), &file);
        prop_assert_eq!(decode(&file), Ok(tree));
    }
}
