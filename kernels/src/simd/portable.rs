//! Four lanes through the crate `wide`: SSE2 on x86-64, NEON on aarch64, plain Rust elsewhere.

use super::{Dot, DotKernel, Kernel, MOST_INT16, Simd};
use wide::{f32x4, i16x8, i32x4, u16x8};

/// A cache line of 64 bytes: a `Vec` of them is aligned to lines, and bytemuck reads it as any type
/// of values.
pub(crate) type Line = wide::f32x16;

/// The baseline of the compiler's target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Portable;

impl Simd for Portable {
    type F32 = f32x4;
    const LANES: usize = 4;
    // aarch64 has 32 registers, SSE2 16.
    const TILE_PIXELS: [usize; 4] = if cfg!(target_arch = "aarch64") {
        [0, 9, 9, 8]
    } else {
        [0, 8, 6, 4]
    };
    const LONG_TILE: (usize, usize) = if cfg!(target_arch = "aarch64") {
        (2, 12)
    } else {
        (2, 6)
    };

    #[inline(never)]
    fn call<K: Kernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }

    #[inline(always)]
    fn splat(self, x: f32) -> f32x4 {
        f32x4::splat(x)
    }

    #[inline(always)]
    fn load(self, src: &[f32]) -> f32x4 {
        let (lanes, _) = src.split_first_chunk().expect("a whole vector");
        f32x4::new(*lanes)
    }

    #[inline(always)]
    fn load_partial(self, src: &[f32]) -> f32x4 {
        let mut lanes = [0.0; 4];
        let n = src.len().min(4);
        lanes[..n].copy_from_slice(&src[..n]);
        f32x4::new(lanes)
    }

    #[inline(always)]
    fn store(self, v: f32x4, dst: &mut [f32]) {
        let (lanes, _) = dst.split_first_chunk_mut().expect("a whole vector");
        *lanes = v.to_array();
    }

    #[inline(always)]
    fn store_partial(self, v: f32x4, dst: &mut [f32]) {
        let n = dst.len().min(4);
        dst[..n].copy_from_slice(&v.to_array()[..n]);
    }

    #[inline(always)]
    fn store_bytes(self, v: f32x4, dst: &mut [u8]) {
        let (bytes, _) = dst.split_first_chunk_mut::<4>().expect("a whole vector");
        *bytes = v.to_array().map(|x| x.round_ties_even() as u8); // the cast saturates
    }

    #[inline(always)]
    fn store_int16(self, v: f32x4, dst: &mut [i16]) {
        let (values, _) = dst.split_first_chunk_mut::<4>().expect("a whole vector");
        let most = f32::from(MOST_INT16);
        *values = v
            .to_array()
            .map(|x| x.clamp(-most, most).round_ties_even() as i16);
    }

    #[inline(always)]
    fn add(self, a: f32x4, b: f32x4) -> f32x4 {
        a + b
    }

    #[inline(always)]
    fn sub(self, a: f32x4, b: f32x4) -> f32x4 {
        a - b
    }

    #[inline(always)]
    fn mul_add(self, a: f32x4, b: f32x4, c: f32x4) -> f32x4 {
        a.mul_add(b, c)
    }

    #[inline(always)]
    fn max(self, a: f32x4, b: f32x4) -> f32x4 {
        a.max(b)
    }
}

/// Bytes are widened to 16 bits, even and odd ones apart.
impl Dot for Portable {
    type Float = Portable;
    type I32 = i32x4;
    type Sums = i32x4;
    type Step = [u8; 4];
    type Bytes = [i16x8; 2];
    type Pairs = i16x8;
    type Weights = [i16x8; 2];
    const TILE_GROUPS: [usize; 4] = [0, 8, 4, 2];

    #[inline(always)]
    fn float(self) -> Portable {
        self
    }

    #[inline(always)]
    fn activations(self, [x, _]: [[u8; 4]; 2]) -> [i16x8; 2] {
        let all: u16x8 = bytemuck::cast(i32x4::splat(i32::from_ne_bytes(x)));
        [bytemuck::cast((all << 8) >> 8), bytemuck::cast(all >> 8)]
    }

    #[inline(always)]
    fn load(self, weights: &[[i8; 4]]) -> [i16x8; 2] {
        let (quads, _) = weights.split_first_chunk::<4>().expect("a whole vector");
        let all: i16x8 = bytemuck::cast(*quads);
        [(all << 8) >> 8, all >> 8]
    }

    #[inline(always)]
    fn sums(self, from: &[i32]) -> i32x4 {
        let (lanes, _) = from.split_first_chunk().expect("a whole vector");
        i32x4::new(*lanes)
    }

    #[inline(always)]
    fn dot(self, x: [i16x8; 2], w: [i16x8; 2], sum: i32x4) -> i32x4 {
        sum + x[0].dot(w[0]) + x[1].dot(w[1])
    }

    #[inline(always)]
    fn of_pixel(self, sums: i32x4, _: usize) -> i32x4 {
        sums
    }

    #[inline(always)]
    fn splat_pair(self, x: [i16; 2]) -> i16x8 {
        bytemuck::cast([x; 4])
    }

    #[inline(always)]
    fn load_pairs(self, pairs: &[[i16; 2]]) -> i16x8 {
        let (pairs, _) = pairs.split_first_chunk::<4>().expect("a whole vector");
        bytemuck::cast(*pairs)
    }

    #[inline(always)]
    fn dot_pairs(self, x: i16x8, w: i16x8, sum: i32x4) -> i32x4 {
        sum + x.dot(w)
    }

    #[inline(always)]
    fn to_f32(self, sum: i32x4) -> f32x4 {
        f32x4::from_i32x4(sum)
    }

    #[inline(never)]
    fn call<K: DotKernel>(self, kernel: K) -> K::Output {
        kernel.run(self)
    }
}
