//! The points at which polynomials are multiplied, and the matrices `B^T`, `G` and `A^T` that
//! follow from them.
//!
//! `a` points: 0, then pairs `q, -q`, then infinity. Pairs halve the work: even and odd powers are
//! summed once, and their sum and difference are the values at `q` and `-q`. Sources as in
//! `winograd/mod.rs`.
//!
//! ```text
//! G[i][j]   = q_i^j             the kernel's value at point i
//! B^T[i]    = coefficients of the product of x - q over all other finite points q
//! A^T[j][i] = share_i * q_i^j   share_i = 1 / product of q_i's distances to them
//! ```

use crate::simd::{Portable, Simd};

/// The positive points of the pairs: two for 6 points, three for 8, four for 10.
///
/// They are fractions whose denominators are powers of two, so that the matrices are exact in
/// `f32`. Of all sets of four, these have the smallest error.
pub const fn pairs(points: usize) -> [f32; MAX_PAIRS] {
    match points {
        10 => [0.5, 0.875, 1.25, 2.5],
        _ => [1.0, 2.0, 0.5, 0.0],
    }
}

/// Largest side of a kernel, and of a tile's outputs.
pub const MAX_KERNEL: usize = 6;

/// Most pairs of points.
const MAX_PAIRS: usize = 4;

/// Powers of the pairs' positive points, times the pair's share: `[pair][exponent]`.
const fn shared_powers(points: usize) -> [[f32; MAX_KERNEL]; MAX_PAIRS] {
    let mut powers = [[0.0; MAX_KERNEL]; MAX_PAIRS];
    let mut pair = 0;
    while pair < (points - 2) / 2 {
        powers[pair][0] = share(points, 1 + 2 * pair);
        let mut exponent = 1;
        while exponent < MAX_KERNEL {
            powers[pair][exponent] = powers[pair][exponent - 1] * pairs(points)[pair];
            exponent += 1;
        }
        pair += 1;
    }
    powers
}

/// Coefficients, by rising powers of `z`, of the product of `z - q^2` over all pairs `q, -q` but
/// pair number `skip`.
const fn product(points: usize, skip: usize) -> [f32; MAX_PAIRS + 1] {
    let mut coefficients = [0.0; MAX_PAIRS + 1];
    coefficients[0] = 1.0;
    let mut pair = 0;
    while pair < (points - 2) / 2 {
        if pair != skip {
            let square = pairs(points)[pair] * pairs(points)[pair];
            let mut power = MAX_PAIRS;
            while power > 0 {
                coefficients[power] = coefficients[power - 1] - square * coefficients[power];
                power -= 1;
            }
            coefficients[0] *= -square;
        }
        pair += 1;
    }
    coefficients
}

/// Row `i` of `G`: the kernel's value at point `i`, by powers of the point; at infinity its last
/// tap.
pub fn kernel_row(points: usize, kernel: usize, i: usize) -> [f32; MAX_KERNEL] {
    let mut row = [0.0; MAX_KERNEL];
    if i == points - 1 {
        row[kernel - 1] = 1.0;
        return row;
    }
    for (j, value) in row[..kernel].iter_mut().enumerate() {
        *value = point(points, i).powi(j as i32);
    }
    row
}

/// Point `i`; 0 for the one at infinity.
#[inline(always)]
pub(super) fn point(points: usize, i: usize) -> f32 {
    match i {
        _ if i == 0 || i == points - 1 => 0.0,
        _ if i % 2 == 1 => pairs(points)[(i - 1) / 2],
        _ => -pairs(points)[(i - 1) / 2],
    }
}

/// The factor of the product at point `i` in the outputs: 1 / the product of its distances to the
/// other finite points.
pub const fn share(points: usize, i: usize) -> f32 {
    if i == points - 1 {
        return 1.0;
    }
    let pair = if i == 0 { MAX_PAIRS } else { (i - 1) / 2 };
    let (coefficients, square) = (
        product(points, pair),
        if i == 0 { 0.0 } else { pairs(points)[pair] },
    );
    let square = square as f64 * square as f64;
    let mut value = 0.0;
    let mut power = MAX_PAIRS + 1;
    while power > 0 {
        power -= 1;
        value = value * square + coefficients[power] as f64;
    }
    (1.0 / if i == 0 { value } else { 2.0 * square * value }) as f32
}

/// `B^T d` for one line of inputs.
#[inline(always)]
pub(super) fn input_points<S: Simd, const A: usize>(simd: S, d: &[S::F32; A]) -> [S::F32; A] {
    let count = const { (A - 2) / 2 };
    let all = const { product(A, MAX_PAIRS) };
    let others = const { [product(A, 0), product(A, 1), product(A, 2), product(A, 3)] };
    // Every row of B^T has only even or only odd powers, but for the factor x of its own pair's
    // sum.
    let mut t = [simd.zero(); A];
    t[0] = every_other::<S, A>(simd, &all, count + 1, d, 0);
    t[A - 1] = every_other::<S, A>(simd, &all, count + 1, d, 1);
    for p in 0..count {
        let point = const { pairs(A) }[p];
        let even = every_other::<S, A>(simd, &others[p], count, d, 2);
        let odd = every_other::<S, A>(simd, &others[p], count, d, 1);
        t[1 + 2 * p] = simd.mul_add(simd.splat(point), odd, even);
        t[2 + 2 * p] = simd.mul_add(simd.splat(-point), odd, even);
    }
    t
}

/// Every other value of `d` from `first` on, times its coefficient; the last coefficient is 1.
#[inline(always)]
fn every_other<S: Simd, const A: usize>(
    simd: S,
    coefficients: &[f32; MAX_PAIRS + 1],
    terms: usize,
    d: &[S::F32; A],
    first: usize,
) -> S::F32 {
    let mut sum = d[first + 2 * terms - 2];
    for k in 0..terms - 1 {
        sum = simd.mul_add(simd.splat(coefficients[k]), d[first + 2 * k], sum);
    }
    sum
}

/// `A^T m` for one line of products: `y[j] = sum over points i of share_i * q_i^j * m[i]`.
#[inline(always)]
pub(super) fn output_values<S: Simd, const A: usize, const M: usize>(
    simd: S,
    m: &[S::F32; A],
) -> [S::F32; M] {
    let (count, powers) = const { ((A - 2) / 2, shared_powers(A)) };
    let mut y = [simd.zero(); M];
    y[0] = simd.mul_add(simd.splat(const { share(A, 0) }), m[0], y[0]);
    y[M - 1] = simd.add(y[M - 1], m[A - 1]);
    for p in 0..count {
        let (even, odd) = (
            simd.add(m[1 + 2 * p], m[2 + 2 * p]),
            simd.sub(m[1 + 2 * p], m[2 + 2 * p]),
        );
        for j in 0..M {
            y[j] = simd.mul_add(
                simd.splat(powers[p][j]),
                if j % 2 == 0 { even } else { odd },
                y[j],
            );
        }
    }
    y
}

/// `B^T`, one row per point.
pub(super) fn input_matrix(points: usize) -> Vec<Vec<f32>> {
    match points {
        6 => input_rows::<6>(),
        8 => input_rows::<8>(),
        _ => unreachable!("{points} points"),
    }
}

/// `B^T` for `A` points: the transforms of the unit vectors are its columns.
fn input_rows<const A: usize>() -> Vec<Vec<f32>> {
    let column = |j: usize| {
        let unit: [_; A] = std::array::from_fn(|i| Portable.splat(f32::from(u8::from(i == j))));
        input_points(Portable, &unit).map(|value| {
            let mut lanes = [0.0; Portable::LANES];
            Portable.store(value, &mut lanes);
            lanes[0]
        })
    };
    let columns: Vec<[f32; A]> = (0..A).map(column).collect();
    (0..A)
        .map(|i| columns.iter().map(|column| column[i]).collect())
        .collect()
}
