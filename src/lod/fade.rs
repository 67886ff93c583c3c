//! The crossfade between mesh and points, as a function of distance (Bærentzen 2005, §5).
//!
//! Coming nearer, at the switch distance `D` the mesh starts to fade in over the complete points; in the middle of
//! the band it is complete and the points start to fade out; at the near end only the mesh is left. So every pixel
//! is covered by a complete representation at any distance.

/// Distances of one instance's band, in world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FadeBand {
    /// Nearer than this only the mesh is drawn.
    pub near: f32,
    /// Here both are complete.
    pub middle: f32,
    /// Farther than this only points are drawn: the instance's switch distance.
    pub far: f32,
}

/// What is drawn of an instance: shares of 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FadeState {
    /// Coverage of the mesh (dithered).
    pub mesh: f32,
    /// Share of the prefix that is drawn.
    pub points: f32,
}

/// Distances between which points thin out to nothing, away from the eye. Default: none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRange {
    /// Up to here all points are drawn, world units.
    pub begin: f32,
    /// From here on none is.
    pub end: f32,
}

impl Default for ViewRange {
    fn default() -> Self {
        Self { begin: f32::MAX, end: f32::MAX }
    }
}

impl ViewRange {
    /// The range `begin..end`, moved to where it makes sense: `0 ≤ begin ≤ end`; what is not a number bounds nothing.
    pub fn new(begin: f32, end: f32) -> Self {
        let end = if end.is_nan() { f32::MAX } else { end.clamp(0.0, f32::MAX) };
        let begin = if begin.is_nan() { end } else { begin.clamp(0.0, end) };
        Self { begin, end }
    }

    /// True if it ends somewhere.
    pub fn is_bounded(&self) -> bool {
        self.end < f32::MAX
    }

    /// Share of the points that is drawn at distance `d`, 1 to 0. A range of no width ends at once.
    pub fn share(&self, d: f32) -> f32 {
        1.0 - ramp(d, self.begin, self.end)
    }
}

/// The band of an instance.
///
/// * `d0` – the paper's `s Z0`, with the instance's scale.
/// * `min_mesh_distance` – the least distance up to which meshes are drawn, world units.
/// * `width` – of the band, as a share of the switch distance, 0 to 0.9.
/// * `jitter` – the most by which an instance's switch distance is moved nearer, as a share, 0 to 0.9; `hash` in
///   [0, 1) says how much of it, so that no ring sweeps the landscape.
pub fn fade_band(d0: f32, min_mesh_distance: f32, width: f32, jitter: f32, hash: f32) -> FadeBand {
    let far = d0.max(min_mesh_distance) * (1.0 - jitter * hash);
    FadeBand { near: far * (1.0 - width), middle: far * (1.0 - 0.5 * width), far }
}

/// The shares at distance `d`. A band of width 0 switches at once.
pub fn fade_state(band: FadeBand, d: f32) -> FadeState {
    FadeState {
        mesh: 1.0 - ramp(d, band.middle, band.far),
        points: ramp(d, band.near, band.middle),
    }
}

/// 0 up to `from`, 1 from `to` on.
fn ramp(d: f32, from: f32, to: f32) -> f32 {
    if to - from < 1e-6 {
        if d >= to { 1.0 } else { 0.0 }
    } else {
        ((d - from) / (to - from)).clamp(0.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn one_of_both_is_always_complete(d in 0.0f32..200.0, width in 0.0f32..0.9, jitter in 0.0f32..0.9, hash in 0.0f32..1.0) {
            let band = fade_band(30.0, 15.0, width, jitter, hash);
            let state = fade_state(band, d);
            prop_assert!(state.mesh == 1.0 || state.points == 1.0, "{band:?} {d} {state:?}");
        }

        #[test]
        fn both_shares_change_steadily(d in 1.0f32..60.0) {
            let band = fade_band(30.0, 15.0, 0.25, 0.2, 0.5);
            let (a, b) = (fade_state(band, d), fade_state(band, d + 0.01));
            prop_assert!((a.mesh - b.mesh).abs() < 0.01 && (a.points - b.points).abs() < 0.01);
            prop_assert!(a.mesh >= b.mesh && a.points <= b.points);
        }
    }

    #[test]
    fn a_view_range_thins_points_to_nothing() {
        let range = ViewRange::new(100.0, 200.0);
        let shares = [50.0, 100.0, 150.0, 200.0, 900.0].map(|d| range.share(d));
        assert_eq!(shares, [1.0, 1.0, 0.5, 0.0, 0.0]);
        assert_eq!([99.0, 100.0].map(|d| ViewRange::new(100.0, 100.0).share(d)), [1.0, 0.0]);
        assert_eq!(ViewRange::default().share(1e30), 1.0);
        assert!(range.is_bounded() && !ViewRange::default().is_bounded());
    }

    #[test]
    fn absurd_view_ranges_are_moved_to_where_they_make_sense() {
        for (begin, end, right) in [
            (300.0, 200.0, (200.0, 200.0)),
            (-5.0, 7.0, (0.0, 7.0)),
            (-5.0, -7.0, (0.0, 0.0)),
            (f32::NAN, 7.0, (7.0, 7.0)),
            (3.0, f32::NAN, (3.0, f32::MAX)),
            (3.0, f32::INFINITY, (3.0, f32::MAX)),
        ] {
            let range = ViewRange::new(begin, end);
            assert_eq!((range.begin, range.end), right);
        }
    }

    #[test]
    fn the_least_mesh_distance_counts_too() {
        assert_eq!(fade_band(3.0, 15.0, 0.2, 0.0, 0.0).far, 15.0);
        assert_eq!(fade_band(40.0, 15.0, 0.2, 0.0, 0.0).far, 40.0);
    }
}
