//! Time of day in, light out: sun, sky, haze and ambient in the units of Bevy. Pure; O(1).
//!
//! The sun's place by the usual spherical triangle (declination after Cooper 1969); its light by air mass (Kasten & Young
//! 1989) through an air that takes blue before red; the sky's colours are fitted by eye to clear days.

use super::smoothstep;
use bevy::math::Vec3;
use std::f32::consts::TAU;

/// When and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOfDay {
    /// Solar time in hours, 0 to 24; others wrap. Default: 15.
    pub hour: f32,
    /// Degrees north, −90 to 90. Default: 47.
    pub latitude_deg: f32,
    /// 1 to 365. Default: 172, midsummer.
    pub day_of_year: f32,
}

impl Default for TimeOfDay {
    fn default() -> Self {
        Self { hour: 15.0, latitude_deg: 47.0, day_of_year: 172.0 }
    }
}

impl TimeOfDay {
    /// At an hour of a midsummer day.
    pub fn at(hour: f32) -> Self {
        Self { hour, ..Self::default() }
    }
}

/// The light of a moment. Colours are linear; those of the sky, haze and glow are luminances in cd/m² over 1000, to be
/// multiplied by 1000 × exposure, as Bevy's light units are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Daylight {
    /// Towards the light: the sun, or the moon while the sun is below the horizon. Unit; y is up, north is −z.
    pub light_direction: Vec3,
    /// Towards the sun, also below the horizon. Unit.
    pub sun_direction: Vec3,
    /// Colour of the direct light, its largest part 1.
    pub light_color: Vec3,
    /// Lux: about 13,000 at noon, which suits Bevy's default exposure; near 0 at dusk, a little moonlight at night.
    pub illuminance: f32,
    /// Colour of the light of the sky, its largest part 1.
    pub ambient_color: Vec3,
    /// Brightness for Bevy's ambient light, cd/m².
    pub ambient_brightness: f32,
    /// Sky straight up.
    pub zenith: Vec3,
    /// Sky near the horizon, and haze.
    pub horizon: Vec3,
    /// Added to the sky and haze towards the sun.
    pub glow: Vec3,
    /// Brightness of the sun's disc; 0 while it is down.
    pub disc: Vec3,
    /// 0 by day to 1 at night.
    pub night: f32,
}

impl Daylight {
    /// The light at a time.
    pub fn new(time: &TimeOfDay) -> Self {
        let sun = sun_direction(time);
        let height = sun.y;
        let air = air_mass(height.max(0.0));
        // What is left of red, green and blue after the air.
        let through = (Vec3::new(0.055, 0.105, 0.215) * -(air - 1.0).min(26.0)).map(f32::exp);
        let up = smoothstep(-0.015, 0.05, height);
        let sunlight = through * up;
        let night = 1.0 - smoothstep(-0.2, 0.02, height);
        let day = smoothstep(-0.1, 0.35, height);
        // Golden hour: low sun, not yet gone.
        let low = smoothstep(-0.14, 0.02, height) * (1.0 - smoothstep(0.05, 0.42, height));
        let moon = Vec3::new(0.35, 0.75, -0.55).normalize();
        let sun_is_up = height > -0.012;
        let moonlight = Vec3::new(0.62, 0.75, 1.0);
        let (light_direction, light) = if sun_is_up {
            (sun.with_y(sun.y.max(0.012)).normalize(), sunlight * 13_500.0)
        } else {
            (moon, moonlight * (220.0 * smoothstep(-0.03, -0.16, height)))
        };
        let illuminance = light.max_element();
        let light_color = if illuminance > 0.0 { light / illuminance } else { Vec3::ONE };
        let zenith = Vec3::new(0.0035, 0.006, 0.016)
            .lerp(Vec3::new(0.16, 0.40, 0.98), day)
            .lerp(Vec3::new(0.12, 0.19, 0.38), low * 0.6);
        let horizon = Vec3::new(0.007, 0.011, 0.024)
            .lerp(Vec3::new(0.85, 1.08, 1.32), day)
            .lerp(Vec3::new(0.78, 0.50, 0.34), low * 0.72);
        let glow = Vec3::new(1.0, 0.93, 0.78).lerp(Vec3::new(1.0, 0.42, 0.12), low.sqrt())
            * (0.32 * day).max(1.0 * low)
            * (1.0 - night);
        let ambient = zenith * 0.55 + horizon * 0.45;
        let brightest = ambient.max_element();
        // Weighted towards grey: the eye, and light from the ground.
        let ambient_color = (ambient / brightest).lerp(Vec3::ONE, 0.25);
        Self {
            light_direction,
            sun_direction: sun,
            light_color,
            illuminance,
            ambient_color,
            ambient_brightness: 880.0 * brightest.powf(0.85) + 26.0 * night,
            zenith,
            horizon,
            glow,
            disc: through * (60.0 * smoothstep(-0.02, 0.02, height)),
            night,
        }
    }

    /// Luminance of the sky in a direction, in the same unit as [`Self::horizon`]; what the sky's shader draws, without
    /// the disc.
    pub fn sky(&self, direction: Vec3) -> Vec3 {
        let up = direction.y.max(0.0);
        let towards = direction.dot(self.sun_direction).max(0.0);
        let sky = self.horizon.lerp(self.zenith, 1.0 - (-4.2 * up.powf(0.75)).exp());
        sky + self.glow * (0.55 * towards.powf(8.0) + 0.9 * towards.powf(64.0))
    }
}

fn sun_direction(time: &TimeOfDay) -> Vec3 {
    let finite = |value: f32, otherwise: f32| if value.is_finite() { value } else { otherwise };
    let hour = finite(time.hour, 12.0).rem_euclid(24.0);
    let latitude = finite(time.latitude_deg, 47.0).clamp(-90.0, 90.0).to_radians();
    let day = finite(time.day_of_year, 172.0);
    let declination = 23.45f32.to_radians() * (TAU * (284.0 + day) / 365.0).sin();
    let angle = (hour - 12.0) / 24.0 * TAU;
    let y = latitude.sin() * declination.sin() + latitude.cos() * declination.cos() * angle.cos();
    // East is +x, north is −z; the sun is in the south at noon.
    let east = -declination.cos() * angle.sin();
    let north =
        latitude.cos() * declination.sin() - latitude.sin() * declination.cos() * angle.cos();
    Vec3::new(east, y, -north).normalize_or(Vec3::Y)
}

/// Kasten & Young 1989; 1 at the zenith, about 38 at the horizon.
fn air_mass(sine: f32) -> f32 {
    let degrees = sine.clamp(0.0, 1.0).asin().to_degrees();
    1.0 / (sine + 0.505_72 * (degrees + 6.079_95).powf(-1.636_4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_rises_in_the_east_and_stands_in_the_south_at_noon() {
        let at = |hour| Daylight::new(&TimeOfDay::at(hour)).sun_direction;
        assert!(at(6.5).x > 0.7 && at(6.5).y > 0.0, "{}", at(6.5));
        assert!(at(12.0).z > 0.3 && at(12.0).y > 0.85, "{}", at(12.0));
        assert!(at(18.0).x < -0.7, "{}", at(18.0));
        assert!(at(0.0).y < -0.2, "{}", at(0.0));
    }

    #[test]
    fn evenings_are_golden_and_nights_are_dark_but_visible() {
        let noon = Daylight::new(&TimeOfDay::at(12.0));
        let evening = Daylight::new(&TimeOfDay::at(19.3));
        let night = Daylight::new(&TimeOfDay::at(0.0));
        assert!(noon.illuminance > 8000.0 && noon.light_color.z > 0.8, "{noon:?}");
        assert!(evening.light_color.z < 0.45 * evening.light_color.x, "{evening:?}");
        assert!(evening.illuminance < 0.6 * noon.illuminance, "{evening:?}");
        assert!(night.illuminance < 0.05 * noon.illuminance, "{night:?}");
        assert!(night.ambient_brightness > 20.0, "{night:?}");
        assert!(night.ambient_brightness < 0.1 * noon.ambient_brightness, "{night:?}");
    }

    #[test]
    fn light_changes_without_jumps_all_day() {
        let noon = Daylight::new(&TimeOfDay::at(12.0)).illuminance;
        let mut before = Daylight::new(&TimeOfDay::at(0.0));
        for minute in 1..1440 {
            let now = Daylight::new(&TimeOfDay::at(minute as f32 / 60.0));
            let jump = (now.illuminance - before.illuminance).abs();
            assert!(jump < 0.035 * noon, "minute {minute}: {jump} lux of {noon}");
            assert!(now.horizon.distance(before.horizon) < 0.1, "minute {minute}");
            assert!(now.light_direction.is_normalized() && now.light_direction.y > 0.0);
            assert!(now.horizon.is_finite() && now.ambient_brightness.is_finite());
            before = now;
        }
    }

    #[test]
    fn odd_times_are_times() {
        let odd = TimeOfDay { hour: f32::NAN, latitude_deg: 1e9, day_of_year: f32::INFINITY };
        assert!(Daylight::new(&odd).sun_direction.is_normalized());
        assert_eq!(Daylight::new(&TimeOfDay::at(30.0)), Daylight::new(&TimeOfDay::at(6.0)));
    }
}
