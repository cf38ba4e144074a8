//! Eight lanes, sixteen registers: AVX2 with FMA, and with AVX-VNNI.

use super::{Dot, DotKernel, Kernel, MOST_INT16, Simd};
use std::arch::x86_64::*;
#[cfg(not(feature = "evex"))]
use std::arch::x86_64::{_mm256_dpbusd_avx_epi32 as dpbusd, _mm256_dpwssd_avx_epi32 as dpwssd};

#[cfg(feature = "evex")]
use evex::{dpbusd, dpwssd};

/// Proof that this machine has AVX2 and FMA.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Avx2(());

impl Avx2 {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<Avx2> {
        (is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")).then_some(Avx2(()))
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter<K: Kernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn inner<K: Kernel>(simd: Avx2, kernel: K) -> K::Output {
            kernel.run(simd)
        }
        // SAFETY: an `Avx2` exists only where `detect` has found AVX2 and FMA.
        unsafe { inner(self, kernel) }
    }
}

/// `MASK[8 - n..16 - n]` selects the first `n` lanes.
static MASK: [i32; 16] = [-1, -1, -1, -1, -1, -1, -1, -1, 0, 0, 0, 0, 0, 0, 0, 0];

/// A mask of the first `min(n, 8)` lanes.
#[inline(always)]
fn mask(_proof: Avx2, n: usize) -> __m256i {
    let from = &MASK[8 - n.min(8)..][..8];
    // SAFETY: `from` is eight `i32`, the load is unaligned, and `_proof` proves AVX2.
    unsafe { _mm256_loadu_si256(from.as_ptr().cast()) }
}

impl Simd for Avx2 {
    type F32 = __m256;
    const LANES: usize = 8;
    const TILE_PIXELS: [usize; 4] = [0, 8, 6, 4];
    const LONG_TILE: (usize, usize) = (2, 6);

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        self.enter(kernel)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_set1_ps(x) }
    }

    #[inline(always)]
    fn load(self, src: &[f32]) -> __m256 {
        assert!(src.len() >= 8);
        // SAFETY: the slice has eight values, the load is unaligned, `self` proves AVX2.
        unsafe { _mm256_loadu_ps(src.as_ptr()) }
    }

    #[inline(always)]
    fn load_partial(self, src: &[f32]) -> __m256 {
        // SAFETY: the mask selects no lane beyond `src`, masked-off lanes are not read, `self`
        // proves AVX2.
        unsafe { _mm256_maskload_ps(src.as_ptr(), mask(self, src.len())) }
    }

    #[inline(always)]
    fn store(self, v: __m256, dst: &mut [f32]) {
        assert!(dst.len() >= 8);
        // SAFETY: the slice has room for eight values, the store is unaligned, `self` proves AVX2.
        unsafe { _mm256_storeu_ps(dst.as_mut_ptr(), v) }
    }

    #[inline(always)]
    fn store_partial(self, v: __m256, dst: &mut [f32]) {
        // SAFETY: the mask selects no lane beyond `dst`, masked-off lanes are not written, `self`
        // proves AVX2.
        unsafe { _mm256_maskstore_ps(dst.as_mut_ptr(), mask(self, dst.len()), v) }
    }

    #[inline(always)]
    fn store_bytes(self, v: __m256, dst: &mut [u8]) {
        assert!(dst.len() >= 8);
        // SAFETY: the slice has room for eight bytes, the store is unaligned, `self` proves AVX2.
        // `max` makes NaN 0.
        unsafe {
            let held = _mm256_min_ps(_mm256_max_ps(v, _mm256_setzero_ps()), _mm256_set1_ps(255.0));
            let rounded = _mm256_cvtps_epi32(held);
            let halves = _mm_packs_epi32(
                _mm256_castsi256_si128(rounded),
                _mm256_extracti128_si256::<1>(rounded),
            );
            _mm_storel_epi64(dst.as_mut_ptr().cast(), _mm_packus_epi16(halves, halves));
        }
    }

    #[inline(always)]
    fn store_int16(self, v: __m256, dst: &mut [i16]) {
        assert!(dst.len() >= 8);
        let most = f32::from(MOST_INT16);
        // SAFETY: the slice has room for eight values, the store is unaligned, `self` proves AVX2.
        unsafe {
            let held = _mm256_min_ps(
                _mm256_max_ps(v, _mm256_set1_ps(-most)),
                _mm256_set1_ps(most),
            );
            let rounded = _mm256_cvtps_epi32(held);
            let narrow = _mm_packs_epi32(
                _mm256_castsi256_si128(rounded),
                _mm256_extracti128_si256::<1>(rounded),
            );
            _mm_storeu_si128(dst.as_mut_ptr().cast(), narrow);
        }
    }

    #[inline(always)]
    fn add(self, a: __m256, b: __m256) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_add_ps(a, b) }
    }

    #[inline(always)]
    fn sub(self, a: __m256, b: __m256) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_sub_ps(a, b) }
    }

    #[inline(always)]
    fn mul_add(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        // SAFETY: `self` proves FMA.
        unsafe { _mm256_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    fn prefetch<T>(self, src: &[T], ahead: usize) {
        // SAFETY: a prefetch has no effect that a program could see, whatever the address; every
        // x86-64 has it.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(src.as_ptr().wrapping_add(ahead).cast()) }
    }

    #[inline(always)]
    fn max(self, a: __m256, b: __m256) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_max_ps(a, b) }
    }
}

/// Proof that this machine has AVX-VNNI beside what [`Avx2`] needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Avx2Vnni(Avx2);

impl Avx2Vnni {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<Avx2Vnni> {
        let found = if cfg!(feature = "evex") {
            is_x86_feature_detected!("avx512vnni") && is_x86_feature_detected!("avx512vl")
        } else {
            is_x86_feature_detected!("avxvnni")
        };
        if found {
            Avx2::detect().map(Avx2Vnni)
        } else {
            None
        }
    }

    /// The token of AVX2 alone.
    #[inline]
    pub(crate) fn base(self) -> Avx2 {
        self.0
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[cfg_attr(not(feature = "evex"), target_feature(enable = "avx2,fma,avxvnni"))]
        #[cfg_attr(feature = "evex", target_feature(enable = "avx2,fma"))]
        fn inner<K: DotKernel>(dot: Avx2Vnni, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: an `Avx2Vnni` exists only where `detect` has found all of these features.
        unsafe { inner(self, kernel) }
    }
}

impl Dot for Avx2Vnni {
    type Float = Avx2;
    type I32 = __m256i;
    type Sums = __m256i;
    type Step = [u8; 4];
    type Bytes = __m256i;
    type Pairs = __m256i;
    type Weights = __m256i;
    const TILE_GROUPS: [usize; 4] = [0, 8, 6, 4];

    #[inline(always)]
    fn float(self) -> Avx2 {
        self.0
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> __m256i {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_set1_epi32(i32::from_ne_bytes(x)) }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> __m256i {
        self.0.load_quads(weights)
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> __m256i {
        self.0.load_sums(from)
    }

    #[inline(always)]
    fn dot(self, x: __m256i, w: __m256i, sum: __m256i) -> __m256i {
        // SAFETY: `self` proves the instruction in the encoding that this build uses.
        unsafe { dpbusd(sum, x, w) }
    }

    #[inline(always)]
    fn of_pixel(self, sums: __m256i, _: usize) -> __m256i {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> __m256i {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_set1_epi32(bytemuck::cast(x)) }
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> __m256i {
        self.0.load_int16(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: __m256i, w: __m256i, sum: __m256i) -> __m256i {
        // SAFETY: `self` proves the instruction in the encoding that this build uses.
        unsafe { dpwssd(sum, x, w) }
    }

    #[inline(always)]
    fn to_f32(self, sum: __m256i) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_cvtepi32_ps(sum) }
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

/// Without VNNI bytes are widened to 16 bits, even and odd ones apart. `maddubs` is one
/// instruction, but saturates.
impl Dot for Avx2 {
    type Float = Avx2;
    type I32 = __m256i;
    type Sums = __m256i;
    type Step = [u8; 4];
    type Bytes = [__m256i; 2];
    type Pairs = __m256i;
    type Weights = [__m256i; 2];
    const TILE_GROUPS: [usize; 4] = [0, 8, 4, 2];

    #[inline(always)]
    fn float(self) -> Avx2 {
        self
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> [__m256i; 2] {
        // SAFETY: `self` proves AVX2.
        unsafe {
            let all = _mm256_set1_epi32(i32::from_ne_bytes(x));
            [
                _mm256_and_si256(all, _mm256_set1_epi16(0xff)),
                _mm256_srli_epi16::<8>(all),
            ]
        }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> [__m256i; 2] {
        let all = self.load_quads(weights);
        // SAFETY: `self` proves AVX2.
        unsafe {
            [
                _mm256_srai_epi16::<8>(_mm256_slli_epi16::<8>(all)),
                _mm256_srai_epi16::<8>(all),
            ]
        }
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> __m256i {
        self.load_sums(from)
    }

    #[inline(always)]
    fn dot(self, x: [__m256i; 2], w: [__m256i; 2], sum: __m256i) -> __m256i {
        // SAFETY: `self` proves AVX2.
        unsafe {
            let even = _mm256_add_epi32(sum, _mm256_madd_epi16(x[0], w[0]));
            _mm256_add_epi32(even, _mm256_madd_epi16(x[1], w[1]))
        }
    }

    #[inline(always)]
    fn of_pixel(self, sums: __m256i, _: usize) -> __m256i {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> __m256i {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_set1_epi32(bytemuck::cast(x)) }
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> __m256i {
        self.load_int16(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: __m256i, w: __m256i, sum: __m256i) -> __m256i {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_add_epi32(sum, _mm256_madd_epi16(x, w)) }
    }

    #[inline(always)]
    fn to_f32(self, sum: __m256i) -> __m256 {
        // SAFETY: `self` proves AVX2.
        unsafe { _mm256_cvtepi32_ps(sum) }
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

impl Avx2 {
    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn inner<K: DotKernel>(dot: Avx2, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: an `Avx2` exists only where `detect` has found AVX2 and FMA.
        unsafe { inner(self, kernel) }
    }

    #[inline(always)]
    fn load_quads(self, weights: &[[i8; 4]]) -> __m256i {
        assert!(weights.len() >= 8);
        // SAFETY: the slice has eight times four bytes, the load is unaligned, `self` proves AVX2.
        unsafe { _mm256_loadu_si256(weights.as_ptr().cast()) }
    }

    #[inline(always)]
    fn load_int16(self, pairs: &[[i16; 2]]) -> __m256i {
        assert!(pairs.len() >= 8);
        // SAFETY: the slice has eight pairs, the load is unaligned, `self` proves AVX2.
        unsafe { _mm256_loadu_si256(pairs.as_ptr().cast()) }
    }

    #[inline(always)]
    fn load_sums(self, from: &[i32]) -> __m256i {
        assert!(from.len() >= 8);
        // SAFETY: the slice has eight values, the load is unaligned, `self` proves AVX2.
        unsafe { _mm256_loadu_si256(from.as_ptr().cast()) }
    }
}

/// AVX-VNNI's instructions in the encoding of AVX-512 VNNI, on AVX2's registers only.
#[cfg(feature = "evex")]
mod evex {
    use std::arch::asm;
    use std::arch::x86_64::__m256i;

    /// `_mm256_dpbusd_avx_epi32` in the other encoding.
    ///
    /// # Safety
    /// The machine has AVX-512 VNNI and VL.
    #[inline]
    #[target_feature(enable = "avx")]
    pub unsafe fn dpbusd(mut sum: __m256i, x: __m256i, w: __m256i) -> __m256i {
        // SAFETY: the caller vouches for the instruction; registers only.
        unsafe {
            asm!(
                "{{evex}} vpdpbusd {sum}, {x}, {w}",
                sum = inout(ymm_reg) sum,
                x = in(ymm_reg) x,
                w = in(ymm_reg) w,
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        sum
    }

    /// `_mm256_dpwssd_avx_epi32` in the other encoding.
    ///
    /// # Safety
    /// The machine has AVX-512 VNNI and VL.
    #[inline]
    #[target_feature(enable = "avx")]
    pub unsafe fn dpwssd(mut sum: __m256i, x: __m256i, w: __m256i) -> __m256i {
        // SAFETY: the caller vouches for the instruction; registers only.
        unsafe {
            asm!(
                "{{evex}} vpdpwssd {sum}, {x}, {w}",
                sum = inout(ymm_reg) sum,
                x = in(ymm_reg) x,
                w = in(ymm_reg) w,
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        sum
    }
}
