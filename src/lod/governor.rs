//! A controller that keeps what a view costs within a budget by one factor on its quality.
//!
//! In: what a finished frame cost, and the factor that it was drawn with; out: the factor of the next frame. Costs
//! come back some frames late, are noisy, and are roughly in proportion to the factor. So each frame says by itself which
//! factor would have met the budget (`factor · budget / cost`), however long ago it was drawn: an estimate that does not
//! depend on what the controller did since, which is why delay does not make it oscillate. Estimates are smoothed in the log
//! domain, the factor follows them no faster than its limits, and rests once it is near. O(1).

/// Bounds of a [`Governor`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GovernorLimits {
    /// Least factor, above 0 and at most 1; the largest is 1.
    pub min_factor: f32,
    /// Octaves (doublings) by which the factor may rise in a second.
    pub rise_per_second: f32,
    /// Octaves by which it may fall in a second.
    pub fall_per_second: f32,
}

impl Default for GovernorLimits {
    fn default() -> Self {
        Self { min_factor: 0.1, rise_per_second: 0.5, fall_per_second: 3.0 }
    }
}

/// What a finished frame cost, in the unit of the budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Cost; 0 if nothing was in sight.
    pub cost: f32,
    /// Factor that it was drawn with.
    pub factor: f32,
}

/// Time over which estimates are averaged, seconds. Noise of ± 20 % a frame leaves ± 3 % at 60 frames a second.
const CALM_SECONDS: f32 = 0.3;
/// The same where an estimate is far from what was thought: a change of load, not noise.
const JUMP_SECONDS: f32 = 0.05;
/// That far, in octaves: no noise of ± 20 % reaches it.
const JUMP: f32 = 0.5;
/// The factor starts to move once it is off by this many octaves (6 %).
const DEADBAND: f32 = 0.084;
/// It rests once it has been within a quarter of that for this long: the average has then caught up.
const REST_SECONDS: f32 = 0.75;
/// Estimates count for no more octaves than this beyond the factor's range, so that an empty view is soon forgotten.
const BEYOND: f32 = 1.0;
/// Longest time that a step stands for, seconds: a hitch is one frame, not a reason to jump.
const LONGEST_STEP: f32 = 0.1;

/// The controller's state: one for each view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Governor {
    /// log2 of the factor.
    factor: f32,
    /// log2 of the factor that would meet the budget, once a frame has come back.
    estimate: Option<f32>,
    is_moving: bool,
    near_seconds: f32,
}

impl Governor {
    /// The factor of the next frame, from `min_factor` to 1.
    pub fn factor(&self) -> f32 {
        self.factor.exp2()
    }

    /// Moves on by a frame that took `seconds`. `measured` is a frame that has just come back, if one has; costs and
    /// budgets that are not numbers are passed over.
    pub fn step(
        &mut self,
        limits: &GovernorLimits,
        budget: f32,
        measured: Option<Measured>,
        seconds: f32,
    ) -> f32 {
        let seconds = if seconds > 0.0 { seconds.min(LONGEST_STEP) } else { 0.0 };
        #[expect(clippy::manual_clamp, reason = "`clamp` passes what is not a number on")]
        let lowest = limits.min_factor.max(1e-3).min(1.0).log2();
        if let Some(measured) = measured {
            self.learn(lowest, budget, measured, seconds);
        }
        let wanted = self.estimate.unwrap_or(self.factor).clamp(lowest, 0.0);
        if !self.is_moving && (wanted - self.factor).abs() > DEADBAND {
            (self.is_moving, self.near_seconds) = (true, 0.0);
        }
        if self.is_moving {
            let fall = limits.fall_per_second.max(0.0) * seconds;
            let rise = limits.rise_per_second.max(0.0) * seconds;
            self.factor += (wanted - self.factor).clamp(-fall, rise);
            // The ends are reached: full quality is full quality.
            let near = if wanted > lowest && wanted < 0.0 { DEADBAND / 4.0 } else { 0.0 };
            let is_near = (wanted - self.factor).abs() <= near;
            self.near_seconds = if is_near { self.near_seconds + seconds } else { 0.0 };
            self.is_moving = self.near_seconds < REST_SECONDS;
        }
        self.factor = self.factor.clamp(lowest, 0.0);
        self.factor()
    }

    fn learn(&mut self, lowest: f32, budget: f32, measured: Measured, seconds: f32) {
        let sensible = measured.cost >= 0.0 && measured.factor > 0.0 && budget >= 0.0;
        if !sensible {
            return;
        }
        // At least 10⁻⁶ of anything: neither nothing in sight nor a budget of nothing has a logarithm.
        let needed = measured.factor.log2() + (budget.max(1e-6) / measured.cost.max(1e-6)).log2();
        let needed = needed.clamp(lowest - BEYOND, BEYOND);
        let Some(estimate) = &mut self.estimate else {
            self.estimate = Some(needed);
            return;
        };
        let gap = needed - *estimate;
        let time = if gap.abs() > JUMP { JUMP_SECONDS } else { CALM_SECONDS };
        *estimate += gap * (1.0 - (-seconds / time).exp());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::hash::SplitMix64;
    use std::collections::VecDeque;

    /// A view whose cost is `fixed + load · factor^power`, times noise, and comes back `latency` frames later.
    struct View {
        governor: Governor,
        load: f32,
        fixed: f32,
        power: f32,
        noise: f32,
        latency: usize,
        random: SplitMix64,
        flying: VecDeque<Measured>,
    }

    const BUDGET: f32 = 1000.0;
    const FRAME: f32 = 1.0 / 60.0;

    impl View {
        fn new(load: f32, latency: usize) -> Self {
            Self {
                governor: Governor::default(),
                load,
                fixed: 0.0,
                power: 1.0,
                noise: 0.0,
                latency,
                random: SplitMix64(5),
                flying: VecDeque::new(),
            }
        }

        /// Draws `frames`; gives the true cost and the factor of each.
        fn draw(&mut self, frames: usize) -> Vec<(f32, f32)> {
            let limits = GovernorLimits::default();
            let frame = |_| {
                let factor = self.governor.factor();
                let cost = self.fixed + self.load * factor.powf(self.power);
                let noise = 1.0 + self.noise * self.random.range(-1.0, 1.0);
                self.flying.push_back(Measured { cost: cost * noise, factor });
                let back = (self.flying.len() > self.latency).then(|| self.flying.pop_front());
                self.governor.step(&limits, BUDGET, back.flatten(), FRAME);
                (cost, factor)
            };
            (0..frames).map(frame).collect()
        }
    }

    fn largest(run: &[(f32, f32)]) -> f32 {
        run.iter().map(|(cost, _)| *cost).fold(0.0, f32::max)
    }

    fn smallest(run: &[(f32, f32)]) -> f32 {
        run.iter().map(|(cost, _)| *cost).fold(f32::MAX, f32::min)
    }

    #[test]
    fn a_load_within_the_budget_is_drawn_in_full() {
        let run = View::new(900.0, 2).draw(200);
        assert!(run.iter().all(|(_, factor)| *factor == 1.0));
    }

    #[test]
    fn a_step_of_the_load_settles_at_once_and_stays() {
        for latency in [0, 1, 3] {
            let mut view = View::new(800.0, latency);
            view.draw(60);
            // Four times the budget and more: 1.7 octaves at 3 a second, and a little for the delay.
            view.load = 3200.0;
            let run = view.draw(300);
            assert!(largest(&run[48..]) <= BUDGET * 1.08, "{}", largest(&run[48..]));
            // Not below what the budget allows: no overshoot.
            assert!(smallest(&run) >= BUDGET * 0.93 && run[120..] == *vec![run[120]; 180]);
            // And back: slowly, and never above the budget.
            view.load = 1250.0;
            let run = view.draw(300);
            assert!(largest(&run) <= BUDGET * 1.03 && smallest(&run[200..]) >= BUDGET * 0.93);
            assert!(run[220..] == *vec![run[220]; 80]);
        }
    }

    #[test]
    fn noise_moves_nothing() {
        for latency in [1, 3] {
            let mut view = View::new(2500.0, latency);
            view.noise = 0.2;
            view.draw(120);
            let run = view.draw(3000);
            assert!(largest(&run) <= BUDGET * 1.12 && smallest(&run) >= BUDGET * 0.88);
            // A limit cycle would change direction all the time.
            let steps: Vec<f32> =
                run.windows(2).map(|w| w[1].1 - w[0].1).filter(|d| *d != 0.0).collect();
            let turns = steps.windows(2).filter(|w| w[0] * w[1] < 0.0).count();
            assert!(turns < 50, "{turns} turns in 50 seconds");
        }
    }

    #[test]
    fn a_cost_that_is_not_in_proportion_settles_too() {
        for (fixed, load, power) in [(600.0, 1600.0, 1.0), (0.0, 4000.0, 1.8), (0.0, 3000.0, 0.6)] {
            let mut view = View { fixed, power, ..View::new(load, 3) };
            let run = view.draw(600);
            let last = &run[300..];
            assert!(
                largest(last) <= BUDGET * 1.1 && smallest(last) >= BUDGET * 0.88,
                "{fixed} {power}: {last:?}"
            );
            assert!(last[200..] == *vec![last[200]; 100], "{fixed} {load} {power} never rests");
        }
    }

    #[test]
    fn a_change_is_no_faster_than_its_limits() {
        let mut view = View::new(1e6, 1);
        let run = view.draw(120);
        let limits = GovernorLimits::default();
        assert!(run.windows(2).all(|w| (w[1].1 / w[0].1).log2() >= -3.001 * FRAME));
        assert!((run[119].1 - limits.min_factor).abs() < 1e-4);
        view.load = 1.0;
        let run = view.draw(600);
        assert!(run.windows(2).all(|w| (w[1].1 / w[0].1).log2() <= 0.501 * FRAME));
        assert_eq!(run[599].1, 1.0);
    }

    #[test]
    fn nonsense_is_passed_over() {
        let limits = GovernorLimits::default();
        let mut governor = Governor::default();
        for (cost, factor, budget, seconds) in [
            (f32::NAN, 1.0, 1.0, 0.01),
            (5.0, f32::NAN, 1.0, 0.01),
            (5.0, 0.0, 1.0, 0.01),
            (5.0, 1.0, f32::NAN, 0.01),
            (-5.0, 1.0, 1.0, 0.01),
            (5.0, 1.0, 1.0, f32::NAN),
        ] {
            let factor = governor.step(&limits, budget, Some(Measured { cost, factor }), seconds);
            assert_eq!(factor, 1.0);
        }
        // Nothing in sight, and no budget at all.
        let mut governor = Governor::default();
        let nothing = Measured { cost: 0.0, factor: 1.0 };
        assert_eq!(governor.step(&limits, 5.0, Some(nothing), 0.1), 1.0);
        let some = Measured { cost: f32::INFINITY, factor: 1.0 };
        for _ in 0..100 {
            governor.step(&limits, 0.0, Some(some), 0.1);
        }
        assert!((governor.factor() - limits.min_factor).abs() < 1e-6);
    }
}
