//! Vectors on every instruction set, through two small flat traits: [`Simd`] for `f32`, [`Dot`] for
//! integer dot products.
//!
//! A kernel is a struct of its arguments that implements [`Kernel`] (or [`DotKernel`]). Its body is
//! written once, generic over the trait, and compiled once per instruction set:
//!
//! ```
//! use kernels::Isa;
//! use kernels::simd::{Kernel, Simd};
//!
//! /// `y += a x`, element by element.
//! struct Axpy<'a> {
//!     a: f32,
//!     x: &'a [f32],
//!     y: &'a mut [f32],
//! }
//!
//! impl Kernel for Axpy<'_> {
//!     type Output = ();
//!
//!     #[inline(always)]
//!     fn run<S: Simd>(self, simd: S) {
//!         let a = simd.splat(self.a);
//!         for (x, y) in self.x.chunks(S::LANES).zip(self.y.chunks_mut(S::LANES)) {
//!             let sum = simd.mul_add(a, simd.load_partial(x), simd.load_partial(y));
//!             simd.store_partial(sum, y);
//!         }
//!     }
//! }
//!
//! let (x, mut y) = ([1.0; 21], [0.5; 21]);
//! Isa::detect().run(Axpy { a: 2.0, x: &x, y: &mut y });
//! assert_eq!(y, [2.5; 21]);
//! ```
//!
//! **Dispatch.** [`Isa::run`](crate::Isa::run) is a `match` over the instruction sets that
//! detection has found. Each arm calls one function compiled with `#[target_feature]`, once per
//! call of a kernel: a layer or a part of one, never a row.
//!
//! **Inlining.** An intrinsic is one instruction only if it is inlined into such a function.
//! Therefore everything below the entry is `#[inline(always)]`: the body, what it calls in hot
//! loops, and every method of the traits. Whatever is not inlined falls back to the compiler's
//! baseline, which is correct but slow. Large kernels enter once more for each of their stages
//! ([`Simd::call`]), so that the compiler optimizes one hot loop at a time.
//!
//! **A new instruction set** is a file here with a token type that only its `detect` makes; the
//! token implements [`Dot`] and [`Simd`], or uses another token's. `isa.rs` then needs its variant
//! of [`Isa`](crate::Isa), its place in `Isa::available`, slowest first, an arm in each `match`,
//! and the speeds that the plan of algorithms weighs. SVE does not fit, as vectors have a length
//! that is known when compiling ([`Simd::LANES`]).
//!
//! **Safety.** A token such as `Avx2` exists only if detection has found the instructions, so that
//! methods on it are safe. All intrinsics are in this folder, and so is all `unsafe` code of the
//! repository except that of the C interface.

#![allow(unsafe_code)]

use bytemuck::Pod;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;

#[cfg(target_arch = "x86_64")]
pub use avx2::{Avx2, Avx2Vnni};
#[cfg(target_arch = "x86_64")]
pub use avx512::{Avx512, Avx512Vnni};
#[cfg(target_arch = "aarch64")]
pub use neon::{NeonDot, NeonMatrix};
pub(crate) use portable::Line;
pub use portable::Portable;

/// Largest magnitude that [`Simd::store_int16`] writes: 14 bits.
///
/// The spare bit lets the other factor of a product be twice as large before sums overflow.
pub const MOST_INT16: i16 = (1 << 14) - 1;

/// A computation whose body is compiled once per instruction set.
pub trait Kernel {
    /// What it returns.
    type Output;

    /// The body. Implementations are `#[inline(always)]`, and so is everything that their hot loops
    /// call.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Operations on a vector of `f32`. `self` is the proof that the instructions exist.
pub trait Simd: Copy + Send + Sync + 'static {
    /// One vector.
    type F32: Copy;

    /// Lanes of one vector.
    const LANES: usize;

    /// Most pixels of a register tile that is 1, 2 or 3 vectors of output channels wide (`[0]` is
    /// unused).
    ///
    /// Accumulators, weights and one broadcast value then just fit the registers. One pixel more
    /// would spill accumulators to memory, which halves the speed.
    const TILE_PIXELS: [usize; 4];

    /// The register tile of weights that are made in registers: vectors of output channels, and
    /// most pixels.
    ///
    /// One vector uses each weight most often, but needs one load per product, which only AVX-512
    /// folds into the multiply-add.
    const LONG_TILE: (usize, usize);

    /// Runs a stage of a larger kernel in a function of its own, which the compiler optimizes
    /// separately.
    fn call<K: Kernel>(self, kernel: K) -> K::Output;

    /// All lanes `x`.
    fn splat(self, x: f32) -> Self::F32;

    /// The first `LANES` values of `src`. Panics if it is shorter.
    fn load(self, src: &[f32]) -> Self::F32;

    /// The first `min(src.len(), LANES)` values of `src`; the other lanes are 0.
    fn load_partial(self, src: &[f32]) -> Self::F32;

    /// Writes the first `LANES` values of `dst`. Panics if it is shorter.
    fn store(self, v: Self::F32, dst: &mut [f32]);

    /// Writes the first `min(dst.len(), LANES)` values of `dst`.
    fn store_partial(self, v: Self::F32, dst: &mut [f32]);

    /// Writes as many lanes as `dst` has room for; a whole vector is the fast case.
    #[inline(always)]
    fn write(self, v: Self::F32, dst: &mut [f32]) {
        if dst.len() >= Self::LANES {
            self.store(v, dst)
        } else {
            self.store_partial(v, dst)
        }
    }

    /// Writes all lanes to the first `LANES` values of `dst`, rounded to nearest (ties to even) and
    /// clamped to 0..=255. NaN becomes 0. Panics if `dst` is shorter.
    fn store_bytes(self, v: Self::F32, dst: &mut [u8]);

    /// Writes all lanes to the first `LANES` values of `dst`, rounded to nearest (ties to even) and
    /// clamped to `-MOST_INT16..=MOST_INT16`. Panics if `dst` is shorter.
    fn store_int16(self, v: Self::F32, dst: &mut [i16]);

    /// `a + b`.
    fn add(self, a: Self::F32, b: Self::F32) -> Self::F32;

    /// `a - b`.
    fn sub(self, a: Self::F32, b: Self::F32) -> Self::F32;

    /// `a * b + c`, rounded once where the instruction set has FMA.
    fn mul_add(self, a: Self::F32, b: Self::F32, c: Self::F32) -> Self::F32;

    /// The larger value of each pair; `b` where `a` is NaN.
    fn max(self, a: Self::F32, b: Self::F32) -> Self::F32;

    /// Prefetches the cache line that is `ahead` values after the start of `src` into the L2 cache.
    /// `ahead` may lie past the end of `src`: callers prefetch what follows it in memory. A no-op
    /// without the instruction.
    #[inline(always)]
    fn prefetch<T>(self, _src: &[T], _ahead: usize) {}

    /// All lanes 0.
    #[inline(always)]
    fn zero(self) -> Self::F32 {
        self.splat(0.0)
    }
}

/// A computation with integer dot products whose body is compiled once per instruction set.
pub trait DotKernel {
    /// What it returns.
    type Output;

    /// The body. Implementations are `#[inline(always)]`, and so is everything that their hot loops
    /// call.
    fn run<D: Dot>(self, dot: D) -> Self::Output;
}

/// Integer dot products, summed in `i32`: of `u8` activations with `i8` weights, four at a time,
/// and of `i16` pairs. `self` is the proof that the instructions exist.
///
/// Integers have one right answer: every instruction set gives the same sums.
pub trait Dot: Copy + Send + Sync + 'static {
    /// The same instruction set on `f32`, with as many lanes.
    type Float: Simd;

    /// A vector of sums.
    type I32: Copy;

    /// A vector of sums for each of [`PIXELS`](Self::PIXELS) pixels.
    type Sums: Copy;

    /// The activations that one dot product takes of one pixel.
    type Step: Pod;

    /// The activations that one dot product takes of all its pixels.
    type Bytes: Copy;

    /// The weights that one dot product takes, as many per lane.
    type Weights: Copy;

    /// A pair of `i16` per lane.
    type Pairs: Copy;

    /// Pixels of one dot product of bytes: two where the instruction set multiplies matrices.
    const PIXELS: usize = 1;

    /// Fours of activations in a [`Step`](Self::Step), and of weights per lane.
    const QUADS: usize = size_of::<Self::Step>() / 4;

    /// [`Simd::TILE_PIXELS`] for dot products of bytes, in groups of [`PIXELS`](Self::PIXELS).
    const TILE_GROUPS: [usize; 4];

    /// Steps of one pixel that [`load_run`](Self::load_run) brings: 4 where a dot product takes a
    /// quarter of a register, and [`PIXELS`](Self::PIXELS) is 1; else 1.
    const RUN: usize = 1;

    /// What [`activations`](Self::activations) subtracts from each, so that it fits a signed byte.
    /// Sums start from this, times the weights, to make up for it.
    const OFFSET: i32 = 0;

    /// The token for `f32`.
    fn float(self) -> Self::Float;

    /// The activations of two pixels; of the first only, if [`PIXELS`](Self::PIXELS) is 1.
    fn activations(self, pixels: [Self::Step; 2]) -> Self::Bytes;

    /// The activations of one pixel's first [`RUN`](Self::RUN) steps. Panics if there are fewer.
    #[inline(always)]
    fn load_run(self, steps: &[Self::Step]) -> Self::Bytes {
        self.activations([steps[0]; 2])
    }

    /// The weights of `LANES` lanes, [`QUADS`](Self::QUADS) fours each. Panics if `weights` is
    /// shorter.
    fn load(self, weights: &[[i8; 4]]) -> Self::Weights;

    /// The first `LANES` sums of `from`, for each pixel. Panics if it is shorter.
    fn sums(self, from: &[i32]) -> Self::Sums;

    /// Sums of 0 for one pixel.
    #[inline(always)]
    fn zero(self) -> Self::I32 {
        self.of_pixel(self.sums(&[0; 64]), 0)
    }

    /// `sums + x[0] w[0] + x[1] w[1] + ...` in every lane for every pixel, with
    /// [`OFFSET`](Self::OFFSET) subtracted from each `x`.
    fn dot(self, x: Self::Bytes, w: Self::Weights, sums: Self::Sums) -> Self::Sums;

    /// [`dot`](Self::dot) of step number `STEP` of a run; `STEP` is below [`RUN`](Self::RUN).
    #[inline(always)]
    fn dot_in_run<const STEP: usize>(
        self,
        run: Self::Bytes,
        w: Self::Weights,
        sums: Self::Sums,
    ) -> Self::Sums {
        self.dot(run, w, sums)
    }

    /// The sums of one of the [`PIXELS`](Self::PIXELS) pixels.
    fn of_pixel(self, sums: Self::Sums, pixel: usize) -> Self::I32;

    /// The same pair in every lane.
    fn splat_pair(self, x: [i16; 2]) -> Self::Pairs;

    /// The first `LANES` pairs. Panics if `pairs` is shorter.
    fn load_pairs(self, pairs: &[[i16; 2]]) -> Self::Pairs;

    /// `sum + x[0] w[0] + x[1] w[1]` in every lane.
    fn dot_pairs(self, x: Self::Pairs, w: Self::Pairs, sum: Self::I32) -> Self::I32;

    /// The sums, rounded to `f32`.
    fn to_f32(self, sum: Self::I32) -> <Self::Float as Simd>::F32;

    /// [`Simd::call`] for a kernel of dot products.
    fn call<K: DotKernel>(self, kernel: K) -> K::Output;
}

/// Clears the upper halves of the vector registers; a no-op without AVX.
///
/// Call it after code of other crates that uses AVX. If they leave the upper halves in use, every
/// SSE instruction after them merges with what is there, and runs several times slower.
pub fn clear_upper_halves() {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx") {
        #[target_feature(enable = "avx")]
        fn clear() {
            std::arch::x86_64::_mm256_zeroupper();
        }
        // SAFETY: AVX was just detected.
        unsafe { clear() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Isa;

    /// Compares every operation with its scalar meaning, at every partial length.
    struct Check;

    impl Kernel for Check {
        type Output = ();

        #[inline(always)]
        fn run<S: Simd>(self, s: S) {
            let n = S::LANES;
            let a: Vec<f32> = (0..n).map(|i| i as f32 - 2.5).collect();
            let b: Vec<f32> = (0..n).map(|i| 1.5 - 0.25 * i as f32).collect();
            let (va, vb) = (s.load(&a), s.load(&b));
            let check = |v: S::F32, f: &dyn Fn(usize) -> f32| {
                let mut out = vec![f32::NAN; n];
                s.store(v, &mut out);
                assert_eq!(out, (0..n).map(f).collect::<Vec<_>>());
            };
            check(s.splat(7.0), &|_| 7.0);
            check(s.zero(), &|_| 0.0);
            check(s.add(va, vb), &|i| a[i] + b[i]);
            check(s.sub(va, vb), &|i| a[i] - b[i]);
            check(s.mul_add(va, vb, va), &|i| a[i] * b[i] + a[i]);
            check(s.max(va, vb), &|i| a[i].max(b[i]));
            check(s.max(s.splat(f32::NAN), vb), &|i| b[i]);
            let mut bytes = vec![7; n];
            s.store_bytes(va, &mut bytes);
            let rounded = |x: f32| x.round_ties_even().clamp(0.0, 255.0) as u8; // -2.5, -1.5, ..
            assert_eq!(bytes, a.iter().map(|x| rounded(*x)).collect::<Vec<_>>());
            for (x, expected) in [
                (f32::NAN, 0),
                (-1e30, 0),
                (1e30, 255),
                (f32::INFINITY, 255),
                (254.5, 254),
            ] {
                s.store_bytes(s.splat(x), &mut bytes);
                assert!(bytes.iter().all(|byte| *byte == expected), "{x}: {bytes:?}");
            }
            let mut narrow = vec![7; n];
            s.store_int16(va, &mut narrow);
            assert_eq!(
                narrow,
                a.iter()
                    .map(|x| x.round_ties_even() as i16)
                    .collect::<Vec<_>>()
            );
            for (x, expected) in [
                (-1e30, -MOST_INT16),
                (16383.4, MOST_INT16),
                (f32::INFINITY, MOST_INT16),
            ] {
                s.store_int16(s.splat(x), &mut narrow);
                assert!(narrow.iter().all(|x| *x == expected), "{x}: {narrow:?}");
            }
            s.store_int16(s.splat(f32::NAN), &mut narrow);
            assert!(narrow.iter().all(|x| x.abs() <= MOST_INT16), "{narrow:?}");
            for len in 0..=n + 1 {
                let partial: Vec<f32> = (0..len).map(|i| i as f32 + 1.0).collect();
                check(s.load_partial(&partial), &|i| {
                    partial.get(i).copied().unwrap_or(0.0)
                });
                let mut out = vec![-1.0; len];
                s.store_partial(va, &mut out);
                let expected: Vec<_> = (0..len)
                    .map(|i| a.get(i).copied().unwrap_or(-1.0))
                    .collect();
                assert_eq!(out, expected);
            }
        }
    }

    /// Compares dot products with plain sums, extremes included.
    struct CheckDot;

    impl DotKernel for CheckDot {
        type Output = ();

        #[inline(always)]
        fn run<D: Dot>(self, dot: D) {
            let n = D::Float::LANES;
            let byte = |i: usize| [0u8, 255, 128, 1, 77, 254, 13, 200][i % 8];
            let weight = |i: usize| [-128i8, 127, -127, 1, -1, 0, 55, -90][i % 8];
            let weights: Vec<[i8; 4]> = (0..n * D::QUADS)
                .map(|l| {
                    [
                        weight(l),
                        weight(3 * l + 1),
                        weight(5 * l + 2),
                        weight(l / 2),
                    ]
                })
                .collect();
            let start: Vec<i32> = (0..n as i32).map(|l| 1000 * l - 5000).collect();
            for first in 0..8 {
                let quad = |i: usize| [byte(i), byte(i + 1), byte(i + 2), byte(i + 5)];
                let pixels: [Vec<[u8; 4]>; 2] = [0, 3]
                    .map(|pixel| (0..D::QUADS).map(|q| quad(first + pixel + 2 * q)).collect());
                let step = |pixel: &Vec<[u8; 4]>| *bytemuck::from_bytes(pixel.as_flattened());
                let x = dot.activations([step(&pixels[0]), step(&pixels[1])]);
                let w = dot.load(&weights);
                let sums = dot.dot(x, w, dot.dot(x, w, dot.sums(&start)));
                for (p, pixel) in pixels.iter().enumerate().take(D::PIXELS) {
                    let mut found = vec![f32::NAN; n];
                    dot.float()
                        .store(dot.to_f32(dot.of_pixel(sums, p)), &mut found);
                    let product = |w: &[[i8; 4]]| -> i32 {
                        let terms = pixel.as_flattened().iter().zip(w.as_flattened());
                        terms
                            .map(|(x, w)| (i32::from(*x) - D::OFFSET) * i32::from(*w))
                            .sum()
                    };
                    let lanes = weights.chunks(D::QUADS).zip(&start);
                    let expected: Vec<f32> =
                        lanes.map(|(w, s)| (s + 2 * product(w)) as f32).collect();
                    assert_eq!(found, expected, "pixel {p}");
                }
            }
            // Each step of a run equals the same step on its own.
            let steps: Vec<D::Step> = (0..D::RUN)
                .map(|s| {
                    let bytes: Vec<u8> = (0..4 * D::QUADS).map(|i| byte(5 * s + i)).collect();
                    *bytemuck::from_bytes(&bytes)
                })
                .collect();
            let (run, w) = (dot.load_run(&steps), dot.load(&weights));
            let from = dot.sums(&start);
            let of_steps = [
                dot.dot_in_run::<0>(run, w, from),
                dot.dot_in_run::<1>(run, w, from),
                dot.dot_in_run::<2>(run, w, from),
                dot.dot_in_run::<3>(run, w, from),
            ];
            for (step, sums) in steps.iter().zip(of_steps) {
                let alone = dot.dot(dot.activations([*step; 2]), w, from);
                let lanes = [sums, alone].map(|sums| {
                    let mut lanes = vec![f32::NAN; n];
                    dot.float()
                        .store(dot.to_f32(dot.of_pixel(sums, 0)), &mut lanes);
                    lanes
                });
                assert_eq!(lanes[0], lanes[1]);
            }
            let int16 = |i: usize| [32767i16, -32768, 1, -1, 12345, -777, 0, 16383][i % 8];
            let pairs: Vec<[i16; 2]> = (0..n).map(|l| [int16(3 * l), int16(l + 5)]).collect();
            for first in 0..8 {
                let x = [
                    int16(first).clamp(-MOST_INT16, MOST_INT16),
                    int16(first + 3) / 4,
                ];
                let lanes = dot.load_pairs(&pairs);
                let mut found = vec![f32::NAN; n];
                let sum =
                    dot.dot_pairs(dot.splat_pair(x), lanes, dot.of_pixel(dot.sums(&start), 0));
                dot.float().store(dot.to_f32(sum), &mut found);
                let product = |w: &[i16; 2]| {
                    (0..2)
                        .map(|i| i32::from(x[i]) * i32::from(w[i]))
                        .sum::<i32>()
                };
                let expected: Vec<f32> = pairs
                    .iter()
                    .zip(&start)
                    .map(|(w, s)| (s + product(w)) as f32)
                    .collect();
                assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn operations_on_every_isa_equal_their_scalar_meaning() {
        for isa in Isa::available() {
            isa.run(Check);
            isa.run_dot(CheckDot);
        }
    }

    struct ShortLoad;

    impl Kernel for ShortLoad {
        type Output = ();

        fn run<S: Simd>(self, s: S) {
            s.load(&vec![0.0; S::LANES - 1]);
        }
    }

    #[test]
    fn short_slices_are_refused_on_every_isa() {
        for isa in Isa::available() {
            assert!(
                std::panic::catch_unwind(|| isa.run(ShortLoad)).is_err(),
                "{isa}"
            );
        }
    }
}
