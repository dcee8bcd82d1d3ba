//! Kernels compiled for several instruction sets and selected at run time.
//!
//! A kernel is an `#[inline(always)]` function of plain loops. [`Level::run`] inlines it into a
//! function that enables the wider registers, so that the compiler vectorises the same code once
//! per instruction set. No operation is fused or reordered: all levels produce identical bits.
#![allow(unsafe_code)] // Calls a function that requires a CPU feature after checking for it, and casts numbers after limiting them.

/// An instruction set that the running CPU supports; by default the baseline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Level(Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Set {
    #[default]
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// The baseline of the target architecture, which every CPU supports.
    pub const BASELINE: Self = Self(Set::Baseline);

    /// Returns the widest instruction set that this CPU supports.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self(Set::Avx2);
        }
        Self::BASELINE
    }

    /// Returns all instruction sets that this CPU supports, for tests and benchmarks.
    pub fn available() -> Vec<Self> {
        let best = Self::best();
        if best == Self::BASELINE {
            vec![best]
        } else {
            vec![Self::BASELINE, best]
        }
    }

    /// Returns the name of the instruction set.
    pub fn name(self) -> &'static str {
        match self.0 {
            Set::Baseline => "baseline",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "avx2",
        }
    }

    /// Runs a kernel with the instructions of this level.
    #[inline(always)]
    pub fn run<R>(self, kernel: impl FnOnce() -> R) -> R {
        match self.0 {
            Set::Baseline => kernel(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Set::Avx2` is private and constructed only in `best`, after checking that
            // the CPU has AVX2.
            Set::Avx2 => unsafe { with_avx2(kernel) },
        }
    }
}

/// Casts a number to a byte as `as u8` does: the fraction is dropped, numbers out of range become the nearest byte, and NaN becomes 0. Loops of these are
/// vectorised, unlike those of casts by the language.
#[inline(always)]
pub fn to_byte(value: f32) -> u8 {
    // Of two operands of which one is NaN, these return the other.
    #[expect(clippy::manual_clamp, reason = "a clamped NaN is NaN")]
    let value = value.max(0.0).min(255.0);
    // SAFETY: The value is from 0 to 255.
    let whole: i32 = unsafe { value.to_int_unchecked() };
    whole as u8
}

/// Casts a number to an index from 0 to `last` as `(value as usize).min(last)` does, without the instructions that casts by the language take for large numbers.
#[inline(always)]
pub fn to_index(value: f32, last: u16) -> usize {
    // Of two operands of which one is NaN, the first returns the other.
    let value = value.max(0.0).min(f32::from(last));
    // SAFETY: The value is from 0 to 65 535.
    let whole: i32 = unsafe { value.to_int_unchecked() };
    whole as usize
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<R>(kernel: impl FnOnce() -> R) -> R {
    kernel()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_cast_to_indices_as_by_the_language() {
        let mut values: Vec<f32> = (-40..1200).map(|i| 0.25 * i as f32).collect();
        values.extend([f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -0.0]);
        values.extend([65_535.0, 65_536.0, 1.0_f32.next_down(), 70e3_f32.next_up()]);
        for last in [0, 1, 63, 255, u16::MAX] {
            for &value in &values {
                let expected = (value as usize).min(usize::from(last));
                assert_eq!(to_index(value, last), expected, "{value} {last}");
            }
        }
    }

    #[test]
    fn numbers_are_cast_to_bytes_as_by_the_language() {
        let mut values: Vec<f32> = (-40..1200).map(|i| 0.25 * i as f32).collect();
        values.extend([f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -0.0]);
        values.extend([
            255.0_f32.next_down(),
            255.0_f32.next_up(),
            1.0_f32.next_down(),
        ]);
        let expected: Vec<u8> = values.iter().map(|&value| value as u8).collect();
        for level in Level::available() {
            let bytes: Vec<u8> = level.run(
                #[inline(always)]
                || values.iter().map(|&value| to_byte(value)).collect(),
            );
            assert_eq!(bytes, expected, "{}", level.name());
        }
    }
}
