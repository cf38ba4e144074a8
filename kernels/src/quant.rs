//! Activations as bytes: `q = round(x / scale) + zero_point`, clamped to 0..=255.
//!
//! Shapes: `[n] -> [n]`. Cost: one pass over a map. Source: ONNX `QuantizeLinear`, which rounds to
//! nearest, ties to even.

use crate::Isa;
use crate::par::Threads;
use crate::simd::{Kernel, Simd};
use std::hash::{Hash, Hasher};

/// How real values become bytes: `x = scale * (q - zero_point)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantization {
    /// Distance between the values of neighboring bytes; above 0.
    pub scale: f32,
    /// The byte that stands for 0.
    pub zero_point: u8,
}

impl Eq for Quantization {} // a scale is never NaN

impl Hash for Quantization {
    fn hash<H: Hasher>(&self, state: &mut H) {
        (self.scale.to_bits(), self.zero_point).hash(state);
    }
}

impl Quantization {
    /// The identity on whole numbers from 0 to 255, such as pixels.
    pub const PIXELS: Quantization = Quantization {
        scale: 1.0,
        zero_point: 0,
    };

    /// The finest quantization whose range contains `low`, `high` and 0.
    pub fn of_range(low: f32, high: f32) -> Quantization {
        let (low, high) = (low.min(0.0), high.max(0.0));
        let scale = ((high - low) / 255.0).max(f32::MIN_POSITIVE);
        Quantization {
            scale,
            zero_point: (-low / scale).round() as u8,
        }
    }

    /// Quantizes a vector into `out`, or as much of it as `out` has room for.
    #[inline(always)]
    pub(crate) fn store<S: Simd>(self, simd: S, x: S::F32, out: &mut [u8]) {
        let (factor, zero) = (
            simd.splat(1.0 / self.scale),
            simd.splat(f32::from(self.zero_point)),
        );
        let q = simd.mul_add(x, factor, zero);
        if out.len() >= S::LANES {
            simd.store_bytes(q, out);
        } else {
            let mut lanes = [0; 64];
            simd.store_bytes(q, &mut lanes);
            out.copy_from_slice(&lanes[..out.len()]);
        }
    }

    /// The value that a byte stands for.
    pub fn value(&self, byte: u8) -> f32 {
        self.scale * (f32::from(byte) - f32::from(self.zero_point))
    }
}

/// Quantizes `rows` of `row_len` values each into the middle of `out`'s rows of `out_row_len`
/// bytes, from byte `offset` on.
struct Quantize<'a> {
    values: &'a [f32],
    row_len: usize,
    quantization: Quantization,
    out: &'a mut [u8],
    out_row_len: usize,
    offset: usize,
}

/// Where the rows of a map go: one after the other, or into the middle of longer rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rows {
    /// Values of a row.
    pub row_len: usize,
    /// Bytes from one row of the output to the next.
    pub out_row_len: usize,
    /// Bytes before a row's first value.
    pub offset: usize,
}

/// Quantizes the rows of `values` into those of `out`; bytes of `out` before and after a row's
/// values are kept.
///
/// Panics if `out` has fewer rows, or too short ones.
pub fn quantize(
    isa: Isa,
    threads: &Threads,
    values: &[f32],
    quantization: Quantization,
    rows: Rows,
    out: &mut [u8],
) {
    let Rows {
        row_len,
        out_row_len,
        offset,
    } = rows;
    assert!(row_len > 0 && offset + row_len <= out_row_len, "{rows:?}");
    let count = values.len() / row_len;
    assert_eq!(values.len(), count * row_len, "values of quantize");
    threads.split_rows(
        &mut out[..count * out_row_len],
        out_row_len,
        |first, out| {
            let values = &values[first * row_len..][..out.len() / out_row_len * row_len];
            isa.run(Quantize {
                values,
                row_len,
                quantization,
                out,
                out_row_len,
                offset,
            });
        },
    );
}

impl Kernel for Quantize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Quantize {
            values,
            row_len,
            quantization,
            out,
            out_row_len,
            offset,
        } = self;
        for (from, to) in values
            .chunks_exact(row_len)
            .zip(out.chunks_exact_mut(out_row_len))
        {
            let to = &mut to[offset..][..row_len];
            for (x, q) in from.chunks(S::LANES).zip(to.chunks_mut(S::LANES)) {
                let x = if x.len() == S::LANES {
                    simd.load(x)
                } else {
                    simd.load_partial(x)
                };
                quantization.store(simd, x, q);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::noise;

    #[test]
    fn quantized_rows_equal_the_reference_and_spare_their_surroundings() {
        let quantization = Quantization {
            scale: 0.007,
            zero_point: 100,
        };
        for isa in Isa::available() {
            for row_len in [1, 3, 4, 15, 16, 33, 64] {
                let values: Vec<f32> = noise(5 * row_len, 3).iter().map(|v| 2.0 * v).collect();
                let rows = Rows {
                    row_len,
                    out_row_len: row_len + 7,
                    offset: 3,
                };
                for count in [1, 2] {
                    let mut out = vec![9; 5 * rows.out_row_len];
                    let threads = Threads::new(count);
                    threads
                        .enter(|| quantize(isa, &threads, &values, quantization, rows, &mut out));
                    let expected = crate::reference::quantize(quantization, &values);
                    for (row, (out, expected)) in out
                        .chunks(rows.out_row_len)
                        .zip(expected.chunks(row_len))
                        .enumerate()
                    {
                        assert_eq!(out[..3], [9; 3], "before row {row}");
                        assert_eq!(out[3 + row_len..], [9; 4], "after row {row}");
                        for (found, expected) in out[3..].iter().zip(expected) {
                            // Multiplying by the inverse may fall on the other side of a tie.
                            assert!(
                                (f64::from(*found) - expected).abs() <= 0.501,
                                "{found}, {expected}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn quantization_of_a_range_contains_its_ends_and_zero() {
        for (low, high) in [
            (-1.0, 3.0),
            (0.0, 7.0),
            (2.0, 7.0),
            (-5.0, -1.0),
            (0.0, 0.0),
        ] {
            let q = Quantization::of_range(low, high);
            assert_eq!(q.value(q.zero_point), 0.0);
            assert!(
                q.value(0) <= low + q.scale && q.value(255) >= high - q.scale,
                "{q:?}"
            );
        }
    }

    #[test]
    fn quantized_pixels_keep_their_values() {
        let values: Vec<f32> = (0..=255).map(|v| v as f32).collect();
        for isa in Isa::available() {
            let mut out = vec![0; 256];
            let rows = Rows {
                row_len: 256,
                out_row_len: 256,
                offset: 0,
            };
            quantize(
                isa,
                &Threads::new(1),
                &values,
                Quantization::PIXELS,
                rows,
                &mut out,
            );
            assert!(
                out.iter().enumerate().all(|(i, q)| usize::from(*q) == i),
                "{isa}"
            );
        }
    }
}
