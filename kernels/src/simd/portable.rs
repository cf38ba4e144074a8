//! Four lanes through the crate `wide`: SSE2 on x86-64, NEON on aarch64, plain Rust elsewhere.

use super::Simd;
use wide::f32x4;

/// The instruction set of the compiler's target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Portable;

impl Simd for Portable {
    type F32 = f32x4;
    const LANES: usize = 4;
    const TILE_PIXELS: [usize; 4] = [0, 8, 6, 4];

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
