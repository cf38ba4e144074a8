//! Dot products of bytes on aarch64: `sdot` and `usmmla`. `f32` is [`Portable`] there, which is
//! NEON.
//!
//! - `sdot` (ARMv8.2 dotprod: Cortex-A76, Raspberry Pi 5, RK3588, Orin and later) multiplies four
//!   pairs per lane. It can take the same four activations in all lanes from any quarter of a
//!   register, so that one load brings four steps and nothing is broadcast.
//! - `usmmla` (ARMv8.6 i8mm: Cortex-A510, A710, X2 and later) multiplies matrices: eight pairs per
//!   lane.

use super::{Dot, DotKernel, Portable};
use std::arch::aarch64::*;
use std::arch::asm;

/// Proof that this machine has the dotprod instructions beside NEON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NeonDot(());

impl NeonDot {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<NeonDot> {
        std::arch::is_aarch64_feature_detected!("dotprod").then_some(NeonDot(()))
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "neon,dotprod")]
        fn inner<K: DotKernel>(dot: NeonDot, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: a `NeonDot` exists only where `detect` has found dotprod; NEON is part of
        // aarch64.
        unsafe { inner(self, kernel) }
    }
}

/// Proof that this machine has the i8mm instructions beside NEON.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NeonMatrix(());

impl NeonMatrix {
    /// The proof, if the machine has the instructions.
    pub fn detect() -> Option<NeonMatrix> {
        std::arch::is_aarch64_feature_detected!("i8mm").then_some(NeonMatrix(()))
    }

    /// Runs `kernel` in a function that is compiled with these instructions.
    #[inline]
    pub(crate) fn enter_dot<K: DotKernel>(self, kernel: K) -> K::Output {
        #[inline(never)]
        #[target_feature(enable = "neon,i8mm")]
        fn inner<K: DotKernel>(dot: NeonMatrix, kernel: K) -> K::Output {
            kernel.run(dot)
        }
        // SAFETY: a `NeonMatrix` exists only where `detect` has found i8mm; NEON is part of
        // aarch64.
        unsafe { inner(self, kernel) }
    }
}

/// `sdot` multiplies signed bytes, so that 128 is subtracted from each activation.
impl Dot for NeonDot {
    type Float = Portable;
    type I32 = int32x4_t;
    type Sums = int32x4_t;
    type Step = [u8; 4];
    type Bytes = int8x16_t;
    type Pairs = int16x8_t;
    type Weights = int8x16_t;
    // Nine pixels x two vectors would leave too few registers for their runs.
    const TILE_GROUPS: [usize; 4] = [0, 9, 8, 7];
    const RUN: usize = 4;
    const OFFSET: i32 = 128;

    #[inline(always)]
    fn float(self) -> Portable {
        Portable
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> int8x16_t {
        let lower = u32::from_ne_bytes(x) ^ 0x8080_8080;
        // SAFETY: NEON is part of aarch64.
        unsafe { vreinterpretq_s8_u32(vdupq_n_u32(lower)) }
    }

    #[inline(always)]
    fn load_run(self, steps: &[[u8; 4]]) -> int8x16_t {
        assert!(steps.len() >= 4);
        // SAFETY: the slice has four times four bytes, the load is unaligned, NEON is part of
        // aarch64.
        unsafe { vreinterpretq_s8_u8(veorq_u8(vld1q_u8(steps.as_ptr().cast()), vdupq_n_u8(128))) }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> int8x16_t {
        assert!(weights.len() >= 4);
        // SAFETY: the slice has four times four bytes, the load is unaligned, NEON is part of
        // aarch64.
        unsafe { vld1q_s8(weights.as_ptr().cast()) }
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> int32x4_t {
        assert!(from.len() >= 4);
        // SAFETY: the slice has four values, the load is unaligned, NEON is part of aarch64.
        unsafe { vld1q_s32(from.as_ptr()) }
    }

    #[inline(always)]
    fn dot(self, x: int8x16_t, w: int8x16_t, mut sum: int32x4_t) -> int32x4_t {
        // The intrinsic `vdotq_s32` is not stable.
        // SAFETY: `self` proves dotprod; registers only.
        unsafe {
            asm!(
                "sdot {sum:v}.4s, {x:v}.16b, {w:v}.16b",
                sum = inout(vreg) sum,
                x = in(vreg) x,
                w = in(vreg) w,
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        sum
    }

    #[inline(always)]
    fn dot_in_run<const STEP: usize>(
        self,
        run: int8x16_t,
        w: int8x16_t,
        mut sum: int32x4_t,
    ) -> int32x4_t {
        // SAFETY: `self` proves dotprod; registers only.
        unsafe {
            asm!(
                "sdot {sum:v}.4s, {w:v}.16b, {run:v}.4b[{step}]",
                sum = inout(vreg) sum,
                w = in(vreg) w,
                run = in(vreg) run,
                step = const STEP,
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        sum
    }

    #[inline(always)]
    fn of_pixel(self, sums: int32x4_t, _: usize) -> int32x4_t {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> int16x8_t {
        splat_pair(x)
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> int16x8_t {
        load_pairs(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: int16x8_t, w: int16x8_t, sum: int32x4_t) -> int32x4_t {
        dot_pairs(x, w, sum)
    }

    #[inline(always)]
    fn to_f32(self, sum: int32x4_t) -> wide::f32x4 {
        to_f32(sum)
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

/// `usmmla` multiplies a matrix of 2 pixels x 8 activations with one of 8 x 2 channels, and gives
/// four sums. A vector of four channels for two pixels takes two registers: the first two channels
/// of both pixels, and the last two.
impl Dot for NeonMatrix {
    type Float = Portable;
    type I32 = int32x4_t;
    type Sums = [int32x4_t; 2];
    type Step = [u8; 8];
    type Bytes = uint8x16_t;
    type Pairs = int16x8_t;
    type Weights = [int8x16_t; 2];
    const PIXELS: usize = 2;
    const TILE_GROUPS: [usize; 4] = [0, 9, 5, 3];

    #[inline(always)]
    fn float(self) -> Portable {
        Portable
    }

    #[inline(always)]
    fn activations(self, [first, second]: [[u8; 8]; 2]) -> uint8x16_t {
        // SAFETY: NEON is part of aarch64.
        unsafe {
            vcombine_u8(
                vcreate_u8(u64::from_ne_bytes(first)),
                vcreate_u8(u64::from_ne_bytes(second)),
            )
        }
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> [int8x16_t; 2] {
        assert!(weights.len() >= 8);
        // SAFETY: the slice has eight times four bytes, the loads are unaligned, NEON is part of
        // aarch64.
        unsafe {
            [
                vld1q_s8(weights.as_ptr().cast()),
                vld1q_s8(weights[4..].as_ptr().cast()),
            ]
        }
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> [int32x4_t; 2] {
        assert!(from.len() >= 4);
        // SAFETY: the slice has four values, the load is unaligned, NEON is part of aarch64.
        unsafe {
            let channels = vreinterpretq_s64_s32(vld1q_s32(from.as_ptr()));
            let (first, others) = (
                vdupq_laneq_s64::<0>(channels),
                vdupq_laneq_s64::<1>(channels),
            );
            [vreinterpretq_s32_s64(first), vreinterpretq_s32_s64(others)]
        }
    }

    #[inline(always)]
    fn dot(self, x: uint8x16_t, w: [int8x16_t; 2], sums: [int32x4_t; 2]) -> [int32x4_t; 2] {
        let [mut first, mut others] = sums;
        // The intrinsic `vusmmlaq_s32` is not stable.
        // SAFETY: `self` proves i8mm; registers only.
        unsafe {
            asm!(
                "usmmla {first:v}.4s, {x:v}.16b, {w0:v}.16b",
                "usmmla {others:v}.4s, {x:v}.16b, {w1:v}.16b",
                first = inout(vreg) first,
                others = inout(vreg) others,
                x = in(vreg) x,
                w0 = in(vreg) w[0],
                w1 = in(vreg) w[1],
                options(pure, nomem, nostack, preserves_flags)
            );
        }
        [first, others]
    }

    #[inline(always)]
    fn of_pixel(self, [first, others]: [int32x4_t; 2], pixel: usize) -> int32x4_t {
        // SAFETY: NEON is part of aarch64.
        unsafe {
            let (first, others) = (vreinterpretq_s64_s32(first), vreinterpretq_s64_s32(others));
            let both = if pixel == 0 {
                vzip1q_s64(first, others)
            } else {
                vzip2q_s64(first, others)
            };
            vreinterpretq_s32_s64(both)
        }
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> int16x8_t {
        splat_pair(x)
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> int16x8_t {
        load_pairs(pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: int16x8_t, w: int16x8_t, sum: int32x4_t) -> int32x4_t {
        dot_pairs(x, w, sum)
    }

    #[inline(always)]
    fn to_f32(self, sum: int32x4_t) -> wide::f32x4 {
        to_f32(sum)
    }

    #[inline(always)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        self.enter_dot(kernel)
    }
}

/// [`Dot::splat_pair`] of both tokens.
#[inline(always)]
fn splat_pair(x: [i16; 2]) -> int16x8_t {
    // SAFETY: NEON is part of aarch64.
    unsafe { vreinterpretq_s16_s32(vdupq_n_s32(bytemuck::cast(x))) }
}

/// [`Dot::load_pairs`] of both tokens.
#[inline(always)]
fn load_pairs(pairs: &[[i16; 2]]) -> int16x8_t {
    assert!(pairs.len() >= 4);
    // SAFETY: the slice has four pairs, the load is unaligned, NEON is part of aarch64.
    unsafe { vld1q_s16(pairs.as_ptr().cast()) }
}

/// [`Dot::dot_pairs`] of both tokens.
#[inline(always)]
fn dot_pairs(x: int16x8_t, w: int16x8_t, sum: int32x4_t) -> int32x4_t {
    // SAFETY: NEON is part of aarch64.
    unsafe {
        let low = vmull_s16(vget_low_s16(x), vget_low_s16(w));
        vaddq_s32(sum, vpaddq_s32(low, vmull_high_s16(x, w)))
    }
}

/// [`Dot::to_f32`] of both tokens.
#[inline(always)]
fn to_f32(sum: int32x4_t) -> wide::f32x4 {
    let mut lanes = [0; 4];
    // SAFETY: the slice has room for four values, NEON is part of aarch64.
    unsafe { vst1q_s32(lanes.as_mut_ptr(), sum) }
    wide::f32x4::from_i32x4(wide::i32x4::new(lanes))
}
