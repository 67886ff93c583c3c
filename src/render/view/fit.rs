//! What is done about work items that do not fit: less quality in later frames, evenly, until all do.
//!
//! In: counters that came back; out: a factor on the quality of a view. A frame that overflows lacks points; the next do not.

use crate::render::counters::ViewCounters;

/// Lowers the quality of a view evenly while it asks for more items than fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Share of the quality that is drawn, above 0, at most 1.
    pub factor: f32,
    /// Number of the newest counters that were looked at.
    seen: u64,
    /// Counters of frames before this one were drawn with another factor.
    changed: u64,
}

impl Default for Fit {
    fn default() -> Self {
        Self { factor: 1.0, seen: 0, changed: 0 }
    }
}

impl Fit {
    /// Looks at counters that came back; `now` is the number of the frame in preparation.
    pub fn update(&mut self, counters: &ViewCounters, capacity: u32, now: u64) {
        if counters.frame <= self.seen || counters.frame < self.changed {
            return;
        }
        self.seen = counters.frame;
        let items = counters.items as f32;
        let wanted = items + counters.item_overflow as f32;
        let factor = if counters.item_overflow > 0 {
            // A little less than what would fit: items of small trees do not shrink in proportion.
            self.factor * 0.95 * items / wanted
        } else {
            // Up again, slowly, while there is room.
            (self.factor * (0.9 * capacity as f32 / wanted.max(1.0)).clamp(1.0, 1.1)).min(1.0)
        };
        if factor != self.factor {
            (self.factor, self.changed) = (factor.max(1e-3), now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The factor after frames of a view that asks for `wanted` items at full quality, with counters two frames late.
    fn settled(fit: &mut Fit, wanted: f32, capacity: u32, frames: std::ops::Range<u64>) -> f32 {
        let mut drawn = [fit.factor; 3];
        for frame in frames {
            drawn.rotate_left(1);
            drawn[2] = fit.factor;
            let asked = (wanted * drawn[0]) as u32;
            let counters = ViewCounters {
                frame: frame - 2,
                items: asked.min(capacity),
                item_overflow: asked.saturating_sub(capacity),
                ..Default::default()
            };
            fit.update(&counters, capacity, frame);
        }
        fit.factor
    }

    #[test]
    fn quality_falls_until_all_fits_and_comes_back() {
        let mut fit = Fit::default();
        let fallen = settled(&mut fit, 5000.0, 1000, 3..60);
        assert!(5000.0 * fallen <= 1000.0 && 5000.0 * fallen > 800.0, "{fallen}");
        assert_eq!(settled(&mut fit, 500.0, 1000, 60..300), 1.0);
        assert_eq!(settled(&mut fit, 899.0, 1000, 300..400), 1.0);
    }
}
