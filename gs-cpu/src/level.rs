//! The SIMD levels of this machine, chosen at run time.

use std::{fmt, str::FromStr};

use fearless_simd::Level;
use gs_core::Error;

/// An instruction set the kernels are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum SimdLevel {
    /// No vectors; works on any machine.
    Scalar,
    /// SSE4.2, 4 lanes.
    Sse42,
    /// AVX2 with FMA, 8 lanes.
    Avx2,
    /// AVX-512 of Ice Lake and later, 16 lanes.
    Avx512,
    /// The instruction set of the compiler's target on other architectures: NEON on AArch64,
    /// SIMD128 on WebAssembly.
    Native,
}

impl SimdLevel {
    /// The levels this machine has, slowest first. Never empty.
    pub fn available() -> Vec<Self> {
        let all = [Self::Scalar, Self::Sse42, Self::Avx2, Self::Avx512, Self::Native];
        all.into_iter().filter(|level| level.token().is_some()).collect()
    }

    /// The fastest level this machine has.
    pub fn best() -> Self {
        *Self::available().last().expect("the scalar level is everywhere")
    }

    /// A token that proves to the kernels that this machine has the level.
    #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
    pub(crate) fn token(self) -> Option<Level> {
        let detected = Level::new();
        match self {
            Self::Scalar => Some(Level::fallback()),
            Self::Sse42 => detected.as_sse4_2().map(Level::Sse4_2),
            Self::Avx2 => detected.as_avx2().map(Level::Avx2),
            Self::Avx512 => detected.as_avx512().map(Level::Avx512),
            Self::Native => None,
        }
    }

    /// A token that proves to the kernels that this machine has the level.
    #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
    pub(crate) fn token(self) -> Option<Level> {
        match self {
            Self::Scalar => Some(Level::fallback()),
            Self::Native => Some(Level::new()).filter(|level| !level.is_fallback()),
            _ => None,
        }
    }
}

const NAMES: [(SimdLevel, &str); 5] = [
    (SimdLevel::Scalar, "scalar"),
    (SimdLevel::Sse42, "sse4.2"),
    (SimdLevel::Avx2, "avx2"),
    (SimdLevel::Avx512, "avx512"),
    (SimdLevel::Native, "native"),
];

impl fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = NAMES.iter().find(|(level, _)| level == self).map_or("unknown", |(_, name)| name);
        f.pad(name)
    }
}

impl FromStr for SimdLevel {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        let found = NAMES.iter().find(|(_, n)| *n == name).map(|(level, _)| *level);
        found.ok_or_else(|| Error::setting("SIMD level", name, "one of scalar, sse4.2, avx2, avx512, native"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_a_round_trip() {
        for level in SimdLevel::available() {
            assert_eq!(level.to_string().parse::<SimdLevel>(), Ok(level));
        }
        assert!("mmx".parse::<SimdLevel>().is_err());
        assert!(SimdLevel::available().contains(&SimdLevel::Scalar));
    }
}
