//! Kernels compiled for several instruction sets and chosen at run time.
//!
//! A kernel is one `#[inline(always)]` function over plain loops. `Level::run` calls it inside a function that may use
//! the wider registers, so that the compiler vectorises the same code for each. As nothing is fused or reordered, every level gives the same bits.
#![allow(unsafe_code)] // calling a function that needs a CPU feature, after the check for that feature

/// An instruction set that this CPU has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Level(Set);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Set {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
}

impl Level {
    /// What every CPU of the target architecture has.
    pub const BASELINE: Self = Self(Set::Baseline);

    /// The widest set that this CPU has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self(Set::Avx2);
        }
        Self::BASELINE
    }

    /// Every set that this CPU has, for tests and benchmarks.
    pub fn available() -> Vec<Self> {
        let best = Self::best();
        if best == Self::BASELINE {
            vec![best]
        } else {
            vec![Self::BASELINE, best]
        }
    }

    /// Runs a kernel, compiled for this level.
    #[inline(always)]
    pub fn run<R>(self, kernel: impl FnOnce() -> R) -> R {
        match self.0 {
            Set::Baseline => kernel(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Set::Avx2` is private and made only in `best`, after the check that the CPU has AVX2.
            Set::Avx2 => unsafe { with_avx2(kernel) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn with_avx2<R>(kernel: impl FnOnce() -> R) -> R {
    kernel()
}
