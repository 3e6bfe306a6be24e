//! The SIMD levels of this machine, chosen at run time.

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
use fearless_simd::x86::{Avx2, Avx512};

gs_core::choices! {
    /// An instruction set the kernels are compiled for.
    #[derive(PartialOrd, Ord)]
    #[non_exhaustive]
    pub enum SimdLevel {
        /// The instructions that every machine of the target has: SSE2 on x86-64 and NEON on AArch64,
        /// with 4 lanes each; SIMD128 on WebAssembly, if the compiler was told to use it; no vectors
        /// otherwise.
        Baseline = "baseline",
        /// AVX2 with FMA, 8 lanes.
        Avx2 = "avx2",
        /// AVX-512 of Ice Lake and later, 16 lanes.
        Avx512 = "avx512",
    }
}

/// A level that this machine has. [`dispatch`] compiles its body for each.
#[derive(Debug, Clone, Copy)]
pub enum Level {
    Baseline(baseline::Simd),
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx2(Avx2),
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    Avx512(Avx512),
}

/// Evaluates an expression with the instructions of a level: `dispatch!(level, simd => f(simd))`.
///
/// `fearless_simd::dispatch!` compiles the expression for SSE4.2 and without vectors, too: two
/// fifths of the crate's build time, for few machines.
macro_rules! dispatch {
    ($level:expr, $simd:ident => $body:expr) => {{
        match $level {
            $crate::level::Level::Baseline($simd) => fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $body,
            ),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            $crate::level::Level::Avx2($simd) => fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $body,
            ),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            $crate::level::Level::Avx512($simd) => fearless_simd::Simd::vectorize(
                $simd,
                #[inline(always)]
                || $body,
            ),
        }
    }};
}
pub(crate) use dispatch;

#[cfg(all(any(target_arch = "x86", target_arch = "x86_64"), target_feature = "sse2"))]
mod baseline {
    pub(crate) use fearless_simd::x86::Sse2 as Simd;

    pub(super) fn token() -> Simd {
        fearless_simd::Level::baseline().as_sse2().expect("SSE2 is among the target's features")
    }
}

#[cfg(target_arch = "aarch64")]
mod baseline {
    pub(crate) use fearless_simd::aarch64::Neon as Simd;

    pub(super) fn token() -> Simd {
        fearless_simd::Level::baseline().as_neon().expect("NEON is among the target's features")
    }
}

#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod baseline {
    pub(crate) use fearless_simd::wasm32::WasmSimd128 as Simd;

    pub(super) fn token() -> Simd {
        fearless_simd::Level::baseline().as_wasm_simd128().expect("SIMD128 is among the target's features")
    }
}

#[cfg(not(any(
    all(any(target_arch = "x86", target_arch = "x86_64"), target_feature = "sse2"),
    target_arch = "aarch64",
    all(target_arch = "wasm32", target_feature = "simd128"),
)))]
mod baseline {
    pub(crate) use fearless_simd::Fallback as Simd;

    pub(super) fn token() -> Simd {
        let fearless_simd::Level::Fallback(token) = fearless_simd::Level::baseline() else {
            unreachable!("this target has no vectors")
        };
        token
    }
}

impl SimdLevel {
    /// The levels this machine has, slowest first. Never empty.
    pub fn available() -> Vec<Self> {
        Self::ALL.into_iter().filter(|level| level.instructions().is_some()).collect()
    }

    /// The fastest level this machine has.
    pub fn best() -> Self {
        *Self::available().last().expect("the baseline is everywhere")
    }

    /// The level for the kernels, if this machine has it.
    pub(crate) fn instructions(self) -> Option<Level> {
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let detected = fearless_simd::Level::new();
        match self {
            Self::Baseline => Some(Level::Baseline(baseline::token())),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx2 => detected.as_avx2().map(Level::Avx2),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx512 => detected.as_avx512().map(Level::Avx512),
            #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
            Self::Avx2 | Self::Avx512 => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use gs_core::Choice as _;

    use super::*;

    #[test]
    fn names_survive_a_round_trip() {
        for level in SimdLevel::available() {
            assert_eq!(SimdLevel::from_name(&level.to_string()), Some(level));
        }
        assert_eq!(SimdLevel::from_name("mmx"), None);
        assert!(SimdLevel::available().contains(&SimdLevel::Baseline));
    }
}
