//! Which instruction set a kernel runs on: detection, and the one dispatch table.
//!
//! | name | `f32` lanes | `u8 x i8` products | found on |
//! |---|---|---|---|
//! | `portable` | 4: SSE2 or NEON | widened to 16 bits | every x86-64 and aarch64, and as plain Rust elsewhere |
//! | `avx2` | 8, with FMA | widened to 16 bits | Haswell (2013), Zen and later |
//! | `avx2-vnni` | 8, with FMA | 4 per lane | Alder Lake, N100 and later, Zen 5 |
//! | `avx512` | 16, with FMA | widened to 16 bits | Skylake-X |
//! | `avx512-vnni` | 16, with FMA | 4 per lane | Ice Lake, Zen 4 and later |
//! | `neon-dotprod` | 4 | 4 per lane (`sdot`) | Cortex-A76: Raspberry Pi 5, RK3588, Orin |
//! | `neon-i8mm` | 4 | 8 per lane (`usmmla`) | Cortex-A510, A710, X2 and later |

#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx2Vnni, Avx512, Avx512Vnni};
use crate::simd::{Dot, DotKernel, Kernel, Portable, Simd};
#[cfg(target_arch = "aarch64")]
use crate::simd::{NeonDot, NeonMatrix};

/// An instruction set that this machine has.
///
/// Only detection makes the tokens inside, so an `Isa` is the proof that its instructions exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// The baseline of the compiler's target: SSE2 on x86-64, NEON on aarch64.
    Portable(Portable),
    /// NEON with dot products of bytes.
    #[cfg(target_arch = "aarch64")]
    NeonDot(NeonDot),
    /// NEON with matrix products of bytes (i8mm).
    #[cfg(target_arch = "aarch64")]
    NeonMatrix(NeonMatrix),
    /// AVX2 with FMA: 8 lanes, 16 registers.
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    /// AVX2 with dot products of bytes (AVX-VNNI).
    #[cfg(target_arch = "x86_64")]
    Avx2Vnni(Avx2Vnni),
    /// AVX-512 F/BW/DQ/VL: 16 lanes, 32 registers.
    #[cfg(target_arch = "x86_64")]
    Avx512(Avx512),
    /// AVX-512 with dot products of bytes (AVX-512 VNNI).
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni(Avx512Vnni),
}

/// A name that is not one of this machine's instruction sets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IsaError {
    found: String,
}

impl std::fmt::Display for IsaError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<_> = Isa::available().iter().map(|isa| isa.name()).collect();
        write!(
            f,
            "isa '{}' is not available on this machine, expected one of: {}",
            self.found,
            names.join(", ")
        )
    }
}

impl std::error::Error for IsaError {}

impl Isa {
    /// All instruction sets of this machine, slowest first.
    pub fn available() -> Vec<Isa> {
        let all = [
            Some(Isa::Portable(Portable)),
            #[cfg(target_arch = "aarch64")]
            NeonDot::detect().map(Isa::NeonDot),
            #[cfg(target_arch = "aarch64")]
            NeonMatrix::detect().map(Isa::NeonMatrix),
            #[cfg(target_arch = "x86_64")]
            Avx2::detect().map(Isa::Avx2),
            #[cfg(target_arch = "x86_64")]
            Avx2Vnni::detect().map(Isa::Avx2Vnni),
            #[cfg(target_arch = "x86_64")]
            Avx512::detect().map(Isa::Avx512),
            #[cfg(target_arch = "x86_64")]
            Avx512Vnni::detect().map(Isa::Avx512Vnni),
        ];
        all.into_iter().flatten().collect()
    }

    /// The fastest instruction set of this machine.
    pub fn detect() -> Isa {
        *Isa::available()
            .last()
            .expect("every machine has the portable set")
    }

    /// The instruction set whose [`name`](Self::name) is `name`, in upper or lower case.
    ///
    /// # Errors
    /// If this machine has no such set; the message lists those that it has.
    pub fn from_name(name: &str) -> Result<Isa, IsaError> {
        let found = Isa::available()
            .into_iter()
            .find(|isa| isa.name().eq_ignore_ascii_case(name));
        found.ok_or_else(|| IsaError { found: name.into() })
    }

    /// Its name in reports and options.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Portable(_) => "portable",
            #[cfg(target_arch = "aarch64")]
            Isa::NeonDot(_) => "neon-dotprod",
            #[cfg(target_arch = "aarch64")]
            Isa::NeonMatrix(_) => "neon-i8mm",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2(_) => "avx2",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2Vnni(_) => "avx2-vnni",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512(_) => "avx512",
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512Vnni(_) => "avx512-vnni",
        }
    }

    /// Runs a kernel in its version for this instruction set: the dispatch table.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Isa::Portable(simd) => kernel.run(simd),
            #[cfg(target_arch = "aarch64")]
            Isa::NeonDot(_) | Isa::NeonMatrix(_) => kernel.run(Portable),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2(simd) => simd.enter(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2Vnni(dot) => dot.base().enter(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512(simd) => simd.enter(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512Vnni(dot) => dot.base().enter(kernel),
        }
    }

    /// Runs a kernel of integer products in its version for this instruction set.
    #[inline]
    pub fn run_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        match self {
            Isa::Portable(dot) => kernel.run(dot),
            #[cfg(target_arch = "aarch64")]
            Isa::NeonDot(dot) => dot.enter_dot(kernel),
            #[cfg(target_arch = "aarch64")]
            Isa::NeonMatrix(dot) => dot.enter_dot(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2(dot) => dot.enter_dot(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2Vnni(dot) => dot.enter_dot(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512(dot) => dot.enter_dot(kernel),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512Vnni(dot) => dot.enter_dot(kernel),
        }
    }

    /// Products of bytes ([`Dot::dot`]) in the time of one product of `f32`.
    pub(crate) fn int8_speed(self) -> u64 {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2Vnni(_) | Isa::Avx512Vnni(_) => 4,
            #[cfg(target_arch = "aarch64")]
            Isa::NeonDot(_) => 4,
            #[cfg(target_arch = "aarch64")]
            Isa::NeonMatrix(_) => 8,
            _ => 1,
        }
    }

    /// Products of `i16` ([`Dot::dot_pairs`]) in the time of one product of `f32`.
    ///
    /// Every x86 processor has an instruction for two of them; NEON has none that would be faster
    /// than `f32`.
    pub(crate) fn int16_speed(self) -> u64 {
        if cfg!(target_arch = "x86_64") { 2 } else { 1 }
    }

    /// Whether a network runs faster in integers than in `f32`.
    pub fn has_fast_integers(self) -> bool {
        self.int8_speed() > 1 || self.int16_speed() > 1
    }

    /// Lanes of one vector; packed weights are padded to a multiple of it.
    pub fn lanes(self) -> usize {
        struct Lanes;
        impl Kernel for Lanes {
            type Output = usize;
            fn run<S: Simd>(self, _: S) -> usize {
                S::LANES
            }
        }
        self.run(Lanes)
    }

    /// Most pixels of a register tile with this many vectors of channels ([`Simd::TILE_PIXELS`]).
    pub(crate) fn tile_pixels(self, vectors: usize) -> usize {
        struct Pixels(usize);
        impl Kernel for Pixels {
            type Output = usize;
            fn run<S: Simd>(self, _: S) -> usize {
                S::TILE_PIXELS[self.0]
            }
        }
        self.run(Pixels(vectors))
    }

    /// The long register tile ([`Simd::LONG_TILE`]): vectors of channels, and most pixels.
    pub(crate) fn long_tile(self) -> (usize, usize) {
        struct LongTile;
        impl Kernel for LongTile {
            type Output = (usize, usize);
            fn run<S: Simd>(self, _: S) -> (usize, usize) {
                S::LONG_TILE
            }
        }
        self.run(LongTile)
    }

    /// What a dot product subtracts from each activation ([`Dot::OFFSET`]), and its step in fours
    /// ([`Dot::QUADS`]).
    pub(crate) fn dot_offset_and_quads(self) -> (i32, usize) {
        struct OffsetAndQuads;
        impl DotKernel for OffsetAndQuads {
            type Output = (i32, usize);
            fn run<D: Dot>(self, _: D) -> (i32, usize) {
                (D::OFFSET, D::QUADS)
            }
        }
        self.run_dot(OffsetAndQuads)
    }
}

impl std::fmt::Display for Isa {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lead_back_and_an_unknown_one_lists_the_known() {
        for isa in Isa::available() {
            assert_eq!(Isa::from_name(isa.name()), Ok(isa));
        }
        let message = Isa::from_name("mmx").unwrap_err().to_string();
        assert!(
            message.contains("mmx") && message.contains("portable"),
            "{message}"
        );
    }
}
