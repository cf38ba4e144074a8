//! Sixteen lanes, 32 registers: AVX-512, and with AVX-512 VNNI.
//!
//! A multiply-add takes one operand from memory and broadcasts it: a tile needs no register for its
//! activations.

use super::{Dot, DotKernel, Kernel, MOST_INT16, Simd};
use std::arch::x86_64::*;

/// Proof that this machine has AVX-512 F, BW, DQ and VL (every AVX-512 processor since 2017), AVX2
/// and FMA.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Avx512(());

impl Avx512 {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<Avx512> {
        let found = is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && is_x86_feature_detected!("avx2")
            && is_x86_feature_detected!("fma");
        found.then_some(Avx512(()))
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter<K: Kernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
        fn inner<K: Kernel>(simd: Avx512, kernel: K) -> K::Output {
            kernel.run(simd)
        }
        // SAFETY: an `Avx512` exists only where `detect` has found all of these features.
        unsafe { inner(self, kernel) }
    }
}

/// A mask of the first `min(n, 16)` lanes.
#[inline(always)]
fn mask(n: usize) -> __mmask16 {
    ((1u32 << n.min(16)) - 1) as __mmask16
}

impl Simd for Avx512 {
    type F32 = __m512;
    const LANES: usize = 16;
    const TILE_PIXELS: [usize; 4] = [0, 9, 9, 9];
    const LONG_TILE: (usize, usize) = (1, 26);

    #[inline(always)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        self.enter(kernel)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_set1_ps(x) }
    }

    #[inline(always)]
    fn load(self, src: &[f32]) -> __m512 {
        assert!(src.len() >= 16);
        // SAFETY: the slice has sixteen values, the load is unaligned, `self` proves AVX-512 F.
        unsafe { _mm512_loadu_ps(src.as_ptr()) }
    }

    #[inline(always)]
    fn load_partial(self, src: &[f32]) -> __m512 {
        // SAFETY: the mask selects no lane beyond `src`, masked-off lanes are not read, `self`
        // proves AVX-512 F.
        unsafe { _mm512_maskz_loadu_ps(mask(src.len()), src.as_ptr()) }
    }

    #[inline(always)]
    fn store(self, v: __m512, dst: &mut [f32]) {
        assert!(dst.len() >= 16);
        // SAFETY: the slice has room for sixteen values, the store is unaligned, `self` proves
        // AVX-512 F.
        unsafe { _mm512_storeu_ps(dst.as_mut_ptr(), v) }
    }

    #[inline(always)]
    fn store_partial(self, v: __m512, dst: &mut [f32]) {
        // SAFETY: the mask selects no lane beyond `dst`, masked-off lanes are not written, `self`
        // proves AVX-512 F.
        unsafe { _mm512_mask_storeu_ps(dst.as_mut_ptr(), mask(dst.len()), v) }
    }

    #[inline(always)]
    fn store_bytes(self, v: __m512, dst: &mut [u8]) {
        assert!(dst.len() >= 16);
        // SAFETY: the slice has room for sixteen bytes, the store is unaligned, `self` proves
        // AVX-512 F. `max` makes NaN 0.
        unsafe {
            let rounded = _mm512_cvtps_epi32(_mm512_max_ps(v, _mm512_setzero_ps()));
            _mm_storeu_si128(dst.as_mut_ptr().cast(), _mm512_cvtusepi32_epi8(rounded));
        }
    }

    #[inline(always)]
    fn store_int16(self, v: __m512, dst: &mut [i16]) {
        assert!(dst.len() >= 16);
        let most = f32::from(MOST_INT16);
        // SAFETY: the slice has room for sixteen values, the store is unaligned, `self` proves
        // AVX-512 F.
        unsafe {
            let held = _mm512_min_ps(
                _mm512_max_ps(v, _mm512_set1_ps(-most)),
                _mm512_set1_ps(most),
            );
            _mm256_storeu_si256(
                dst.as_mut_ptr().cast(),
                _mm512_cvtepi32_epi16(_mm512_cvtps_epi32(held)),
            );
        }
    }

    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_add_ps(a, b) }
    }

    #[inline(always)]
    fn sub(self, a: __m512, b: __m512) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_sub_ps(a, b) }
    }

    #[inline(always)]
    fn mul_add(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }

    #[inline(always)]
    fn prefetch<T>(self, src: &[T], ahead: usize) {
        // SAFETY: a prefetch has no effect that a program could see, whatever the address; every
        // x86-64 has it.
        unsafe { _mm_prefetch::<_MM_HINT_T1>(src.as_ptr().wrapping_add(ahead).cast()) }
    }

    #[inline(always)]
    fn max(self, a: __m512, b: __m512) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_max_ps(a, b) }
    }
}

/// Proof that this machine has AVX-512 VNNI beside what [`Avx512`] needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Avx512Vnni(Avx512);

impl Avx512Vnni {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<Avx512Vnni> {
        if is_x86_feature_detected!("avx512vnni") {
            Avx512::detect().map(Avx512Vnni)
        } else {
            None
        }
    }

    /// The token of AVX-512 alone.
    #[inline]
    pub(crate) fn base(self) -> Avx512 {
        self.0
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx512vnni,avx2,fma")]
        fn inner<K: DotKernel>(dot: Avx512Vnni, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: an `Avx512Vnni` exists only where `detect` has found all of these features.
        unsafe { inner(self, kernel) }
    }
}

impl Dot for Avx512Vnni {
    type Float = Avx512;
    type I32 = __m512i;
    type Sums = __m512i;
    type Step = [u8; 4];
    type Bytes = __m512i;
    type Pairs = __m512i;
    type Weights = __m512i;
    const TILE_GROUPS: [usize; 4] = [0, 9, 9, 7];

    #[inline(always)]
    fn float(self) -> Avx512 {
        self.0
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> __m512i {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_set1_epi32(i32::from_ne_bytes(x)) }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> __m512i {
        self.0.load_quads(weights)
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> __m512i {
        self.0.load_sums(from)
    }

    #[inline(always)]
    fn dot(self, x: __m512i, w: __m512i, sum: __m512i) -> __m512i {
        // SAFETY: `self` proves AVX-512 VNNI.
        unsafe { _mm512_dpbusd_epi32(sum, x, w) }
    }

    #[inline(always)]
    fn of_pixel(self, sums: __m512i, _: usize) -> __m512i {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> __m512i {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_set1_epi32(bytemuck::cast(x)) }
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> __m512i {
        self.0.load_int16(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: __m512i, w: __m512i, sum: __m512i) -> __m512i {
        // SAFETY: `self` proves AVX-512 VNNI.
        unsafe { _mm512_dpwssd_epi32(sum, x, w) }
    }

    #[inline(always)]
    fn to_f32(self, sum: __m512i) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_cvtepi32_ps(sum) }
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

/// Without VNNI bytes are widened to 16 bits, even and odd ones apart. `maddubs` is one
/// instruction, but saturates.
impl Dot for Avx512 {
    type Float = Avx512;
    type I32 = __m512i;
    type Sums = __m512i;
    type Step = [u8; 4];
    type Bytes = [__m512i; 2];
    type Pairs = __m512i;
    type Weights = [__m512i; 2];
    const TILE_GROUPS: [usize; 4] = [0, 9, 9, 7];

    #[inline(always)]
    fn float(self) -> Avx512 {
        self
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> [__m512i; 2] {
        // SAFETY: `self` proves AVX-512 F and BW.
        unsafe {
            let all = _mm512_set1_epi32(i32::from_ne_bytes(x));
            [
                _mm512_and_si512(all, _mm512_set1_epi16(0xff)),
                _mm512_srli_epi16::<8>(all),
            ]
        }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> [__m512i; 2] {
        let all = self.load_quads(weights);
        // SAFETY: `self` proves AVX-512 BW.
        unsafe {
            [
                _mm512_srai_epi16::<8>(_mm512_slli_epi16::<8>(all)),
                _mm512_srai_epi16::<8>(all),
            ]
        }
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> __m512i {
        self.load_sums(from)
    }

    #[inline(always)]
    fn dot(self, x: [__m512i; 2], w: [__m512i; 2], sum: __m512i) -> __m512i {
        // SAFETY: `self` proves AVX-512 F and BW.
        unsafe {
            let even = _mm512_add_epi32(sum, _mm512_madd_epi16(x[0], w[0]));
            _mm512_add_epi32(even, _mm512_madd_epi16(x[1], w[1]))
        }
    }

    #[inline(always)]
    fn of_pixel(self, sums: __m512i, _: usize) -> __m512i {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> __m512i {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_set1_epi32(bytemuck::cast(x)) }
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> __m512i {
        self.load_int16(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: __m512i, w: __m512i, sum: __m512i) -> __m512i {
        // SAFETY: `self` proves AVX-512 F and BW.
        unsafe { _mm512_add_epi32(sum, _mm512_madd_epi16(x, w)) }
    }

    #[inline(always)]
    fn to_f32(self, sum: __m512i) -> __m512 {
        // SAFETY: `self` proves AVX-512 F.
        unsafe { _mm512_cvtepi32_ps(sum) }
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

impl Avx512 {
    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
        fn inner<K: DotKernel>(dot: Avx512, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: an `Avx512` exists only where `detect` has found all of these features.
        unsafe { inner(self, kernel) }
    }

    #[inline(always)]
    fn load_quads(self, weights: &[[i8; 4]]) -> __m512i {
        assert!(weights.len() >= 16);
        // SAFETY: the slice has sixteen times four bytes, the load is unaligned, `self` proves
        // AVX-512 F.
        unsafe { _mm512_loadu_si512(weights.as_ptr().cast()) }
    }

    #[inline(always)]
    fn load_int16(self, pairs: &[[i16; 2]]) -> __m512i {
        assert!(pairs.len() >= 16);
        // SAFETY: the slice has sixteen pairs, the load is unaligned, `self` proves AVX-512 F.
        unsafe { _mm512_loadu_si512(pairs.as_ptr().cast()) }
    }

    #[inline(always)]
    fn load_sums(self, from: &[i32]) -> __m512i {
        assert!(from.len() >= 16);
        // SAFETY: the slice has sixteen values, the load is unaligned, `self` proves AVX-512 F.
        unsafe { _mm512_loadu_si512(from.as_ptr().cast()) }
    }
}
