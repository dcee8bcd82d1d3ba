//! Numbers in messages and reports, as people write them.

/// Returns a number without the last digits, which rounding of binary numbers adds, and without minus zero: 0.0062 in place
/// of 0.006200000000000001.
pub(crate) fn plain(value: f64) -> f64 {
    let rounded = (value * 1e9).round() / 1e9;
    // Large numbers have no digits to lose.
    let kept = if value.abs() < 1e6 { rounded } else { value };
    kept + 0.0
}

/// Returns a number with this many digits after the point, without minus zero.
pub(crate) fn fixed(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
        _ => text,
    }
}

/// Returns `1 image`, `2 images`.
pub(crate) fn counted(count: u64, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

/// Returns a positive number with two significant digits.
pub(crate) fn significant(value: f64) -> String {
    if value >= 10.0 {
        fixed(value, 0)
    } else if value >= 1.0 {
        fixed(value, 1)
    } else {
        fixed(value, 2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_people_write_them() {
        assert_eq!(plain(0.006_200_000_000_000_001).to_string(), "0.0062");
        assert_eq!(plain(-0.0).to_string(), "0");
        assert_eq!(plain(-1e-12).to_string(), "0");
        assert_eq!(plain(-12.75).to_string(), "-12.75");
        assert_eq!(plain(1.5e300), 1.5e300);
        assert_eq!(fixed(-0.0004, 3), "0.000");
        assert_eq!(fixed(-0.0006, 3), "-0.001");
        assert_eq!(fixed(-0.4, 0), "0");
        assert_eq!(fixed(f64::NAN, 2), "NaN");
        assert_eq!(counted(1, "frame"), "1 frame");
        assert_eq!(counted(0, "frame"), "0 frames");
    }
}
