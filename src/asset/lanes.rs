//! Lanes: records of 8 bytes → the first `width` bytes of each, then the next `width` of each, … and back. O(n).
//!
//! Bytes of one lane are the same part of the same field, so they are more alike than whole records, and zstd saves
//! more. Which width is best depends on the tree and its order: in lattice order two bytes (a coordinate, a pair of
//! colour channels) save 9 to 17 % against whole records; noisy colours want one byte; random orders of models with
//! few distinct normals and colours want whole records. So `encode` tries all of [`LANE_WIDTHS`].

/// Bytes of a record.
pub(super) const RECORD_BYTES: usize = 8;

/// Widths that are tried, in bytes; each divides a record.
pub(super) const LANE_WIDTHS: [u8; 3] = [8, 2, 1];

/// The width (one byte), then the lanes of `records`. Little-endian on every machine. `width` is of [`LANE_WIDTHS`].
pub(super) fn lanes_from_records(records: &[[u32; 2]], width: u8) -> Vec<u8> {
    let mut lanes = Vec::with_capacity(1 + records.len() * RECORD_BYTES);
    lanes.push(width);
    let width = usize::from(width);
    for start in (0..RECORD_BYTES).step_by(width) {
        for [low, high] in records {
            let bytes = (u64::from(*low) | u64::from(*high) << 32).to_le_bytes();
            lanes.extend_from_slice(&bytes[start..start + width]);
        }
    }
    lanes
}

/// The inverse of [`lanes_from_records`], each record turned into a point half by `from_record`. The width that is
/// none of [`LANE_WIDTHS`], if so. Bytes after the last whole record are ignored.
pub(super) fn records_from_lanes<R>(
    bytes: &[u8],
    from_record: impl Fn([u32; 2]) -> R,
) -> Result<Vec<R>, u8> {
    let (&width, lanes) = bytes.split_first().ok_or(0)?;
    if !LANE_WIDTHS.contains(&width) {
        return Err(width);
    }
    let (width, count) = (usize::from(width), lanes.len() / RECORD_BYTES);
    let starts: [usize; RECORD_BYTES] =
        std::array::from_fn(|byte| byte / width * width * count + byte % width);
    let word = |first: usize, i: usize| {
        let bytes = std::array::from_fn(|byte| lanes[starts[first + byte] + i * width]);
        u32::from_le_bytes(bytes)
    };
    Ok((0..count).map(|i| from_record([word(0, i), word(4, i)])).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_survive_and_bytes_of_one_place_lie_together() {
        let records = [[0x0403_0201, 0x0807_0605], [0x1413_1211, 0x1817_1615]];
        let starts = [[8, 1, 2, 3, 4, 5], [2, 1, 2, 0x11, 0x12, 3], [1, 1, 0x11, 2, 0x12, 3]];
        for (width, start) in std::iter::zip(LANE_WIDTHS, starts) {
            let lanes = lanes_from_records(&records, width);
            assert_eq!(lanes[..6], start);
            assert_eq!(records_from_lanes(&lanes, |r| r), Ok(records.to_vec()));
        }
    }

    #[test]
    fn an_unknown_width_is_refused() {
        for width in [0, 3, 4, 16, 255] {
            assert_eq!(records_from_lanes(&[width; 17], |r| r), Err(width));
        }
        assert_eq!(records_from_lanes(&[], |r| r), Err(0));
        assert_eq!(records_from_lanes(&[1], |r| r), Ok(vec![]));
    }
}
