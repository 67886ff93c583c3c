//! Figures as people read them: short counts, three digits that matter.

/// `1k`, `2.5k`, `10M`: three digits at most, rounded.
pub fn count(number: u64) -> String {
    let (divisor, unit) = match number {
        0..1_000 => return number.to_string(),
        1_000..999_500 => (1e3, "k"),
        999_500..999_500_000 => (1e6, "M"),
        _ => (1e9, "G"),
    };
    format!("{}{unit}", short(number as f64 / divisor))
}

/// Three digits that matter; whole numbers above 100, with a comma at each thousand.
pub fn figure(value: f64) -> String {
    let size = value.abs();
    if size >= 99.95 {
        return thousands(value.round() as i64);
    }
    if size == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    // Digits behind the point: 9.70, 0.0756, and never more than six.
    let digits = (2 - size.log10().floor() as i32).clamp(0, 6) as usize;
    format!("{value:.digits$}")
}

/// A figure that may be absent.
pub fn figure_or_dash(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), figure)
}

/// A mark on an axis: `0.05`, `20`, `5k`; no zeros that say nothing.
pub fn tick(value: f64) -> String {
    if value.abs() >= 999.5 { count(value.round() as u64) } else { short(value) }
}

/// Three digits that matter, without zeros at the end.
fn short(value: f64) -> String {
    let text = figure(value);
    if !text.contains('.') {
        return text;
    }
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn thousands(number: i64) -> String {
    let digits = number.unsigned_abs().to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    if number < 0 { format!("-{text}") } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_short() {
        for (number, expected) in [
            (0, "0"),
            (950, "950"),
            (1_000, "1k"),
            (2_500, "2.5k"),
            (12_345, "12.3k"),
            (999_499, "999k"),
            (999_500, "1M"),
            (10_000_000, "10M"),
            (2_000_000_000, "2G"),
        ] {
            assert_eq!(count(number), expected);
        }
    }

    #[test]
    fn figures_have_three_digits_that_matter() {
        for (value, expected) in [
            (0.0, "0"),
            (9.7, "9.70"),
            (50.64, "50.6"),
            (99.96, "100"),
            (43_782.4, "43,782"),
            (-1_234_567.0, "-1,234,567"),
            (0.0756, "0.0756"),
            (0.002_84, "0.00284"),
            (1e-9, "0.000000"),
        ] {
            assert_eq!(figure(value), expected);
        }
        assert_eq!(figure_or_dash(None), "–");
    }

    #[test]
    fn ticks_have_no_idle_zeros() {
        for (value, expected) in
            [(0.05, "0.05"), (0.5, "0.5"), (20.0, "20"), (5_000.0, "5k"), (2e6, "2M")]
        {
            assert_eq!(tick(value), expected);
        }
    }
}
