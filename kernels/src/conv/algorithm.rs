//! How a convolution is computed, and the plan: which algorithm is expected to be fastest for a
//! shape.
//!
//! The plan is arithmetic, not a measurement at load time, so that the same model computes the same
//! bits in every run. It compares estimates in one unit, a multiply-accumulate of the `f32`
//! register tile ([`Algorithm::cost`]).
//!
//! A new algorithm is a variant of [`Algorithm`] with a cost, listed in [`Algorithm::ALL`] or
//! `integers` for the benchmark, a variant of `Weights`, and an arm in each `match` of `conv.rs`.

use super::{ConvShape, fold, winograd};
use crate::quant::Quantization;
use crate::{Isa, Size};

/// An algorithm, with what it has to know about its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Algorithm {
    /// Register tiles over the input in place.
    Direct,
    /// Patches copied into a matrix, then one matrix product by faer, which picks its own
    /// instruction set.
    Im2col,
    /// Winograd's algorithm over tiles of `points x points` inputs; 4 to 9 times fewer
    /// multiplications.
    Winograd {
        /// Points along one side of a tile.
        points: Points,
        /// What the products are computed in.
        arithmetic: Arithmetic,
    },
    /// Register tiles over bytes: inputs are quantized as given, weights to `i8`. An approximation.
    Int8(Quantization),
}

/// Side of a tile of inputs in Winograd's algorithm: the number of points at which polynomials are
/// multiplied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Points {
    /// Tiles of 6 x 6 inputs.
    Six = 6,
    /// Tiles of 8 x 8 inputs.
    Eight = 8,
    /// Tiles of 10 x 10 inputs.
    Ten = 10,
}

impl Points {
    /// The number.
    pub const fn count(self) -> usize {
        self as usize
    }
}

/// What Winograd's algorithm multiplies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Arithmetic {
    /// Single precision.
    F32,
    /// Pairs of 16-bit integers, for inputs in the range of this quantization.
    /// An approximation, about three times closer than [`Algorithm::Int8`].
    Int16(Quantization),
}

impl Algorithm {
    /// All algorithms in `f32`.
    pub const ALL: [Algorithm; 5] = [
        Algorithm::Direct,
        Algorithm::Im2col,
        Algorithm::winograd(Points::Six),
        Algorithm::winograd(Points::Eight),
        Algorithm::winograd(Points::Ten),
    ];

    /// All algorithms in integers, for inputs in the range of `input`.
    pub const fn integers(input: Quantization) -> [Algorithm; 3] {
        [
            Algorithm::Int8(input),
            Algorithm::winograd_int16(Points::Six, input),
            Algorithm::winograd_int16(Points::Eight, input),
        ]
    }

    /// Winograd's algorithm in `f32`.
    pub const fn winograd(points: Points) -> Algorithm {
        Algorithm::Winograd {
            points,
            arithmetic: Arithmetic::F32,
        }
    }

    /// Winograd's algorithm on 16-bit integers, for inputs in the range of `input`.
    pub const fn winograd_int16(points: Points, input: Quantization) -> Algorithm {
        Algorithm::Winograd {
            points,
            arithmetic: Arithmetic::Int16(input),
        }
    }

    /// This algorithm if it supports `shape`, else [`Algorithm::Direct`].
    pub fn supported(self, shape: &ConvShape) -> Algorithm {
        match self {
            Algorithm::Winograd { points, arithmetic }
                if !winograd::fits(shape, points, arithmetic) =>
            {
                Algorithm::Direct
            }
            supported => supported,
        }
    }

    /// The algorithm in `f32` that is expected to be fastest for an input of `size`.
    pub fn plan(shape: &ConvShape, size: Size) -> Algorithm {
        let candidates = Algorithm::ALL
            .into_iter()
            .filter(|a| *a != Algorithm::Im2col);
        Algorithm::cheapest(candidates, shape, |a| a.cost(1, shape, size))
    }

    /// The algorithm that is expected to be fastest for an input of `size` whose values lie in the
    /// range of `input`, where integers are accurate enough.
    pub fn plan_integers(
        isa: Isa,
        shape: &ConvShape,
        size: Size,
        input: Quantization,
    ) -> Algorithm {
        let candidates = [Algorithm::plan(shape, size)]
            .into_iter()
            .chain(Algorithm::integers(input));
        Algorithm::cheapest(candidates, shape, |a| a.cost(a.speed(isa), shape, size))
    }

    /// Products of this algorithm in the time of one in `f32`.
    fn speed(self, isa: Isa) -> u64 {
        match self {
            Algorithm::Int8(_) => isa.int8_speed(),
            Algorithm::Winograd {
                arithmetic: Arithmetic::Int16(_),
                ..
            } => isa.int16_speed(),
            _ => 1,
        }
    }

    fn cheapest(
        candidates: impl Iterator<Item = Algorithm>,
        shape: &ConvShape,
        cost: impl Fn(Algorithm) -> u64,
    ) -> Algorithm {
        candidates
            .filter(|a| a.supported(shape) == *a)
            .min_by_key(|a| cost(*a))
            .expect("direct supports every shape")
    }

    /// An estimate of the time for an input of `size`, in multiply-accumulates of the `f32`
    /// register tile.
    ///
    /// `speed` products of this algorithm take as long as one of those. The constants were fitted
    /// to measurements (Zen 4, AVX-512): the estimates are within a tenth of the clock for most
    /// layers of the network, and order the algorithms as the clock does.
    fn cost(self, speed: u64, shape: &ConvShape, size: Size) -> u64 {
        const POINT: u64 = 8; // to transform one input point of a tile, per channel
        const OUTPUT: u64 = 32; // to transform one output of a tile, per channel
        const WEIGHT: u64 = 4; // to read or to compute one transformed weight
        let out = shape.out_size(size);
        let points = match self {
            Algorithm::Direct | Algorithm::Im2col => return shape.macs(size),
            Algorithm::Int8(_) => {
                // Bytes go four at a time, and reach 15/16 of their peak.
                let steps = (shape.kernel * shape.in_channels).div_ceil(4);
                let macs = out.area() * shape.out_channels * shape.kernel * 4 * steps;
                return macs as u64 * 16 / 15 / speed;
            }
            Algorithm::Winograd { points, .. } => points,
        };
        let shape = fold::unstrided(shape);
        let side = winograd::rows_per_tile(&shape, points.count());
        let tiles = (out.h.div_ceil(side) * out.w.div_ceil(side)) as u64;
        let points = (points.count() * points.count()) as u64;
        let outputs = (side * side) as u64;
        let product = (shape.in_channels * shape.out_channels) as u64;
        let channels = (shape.in_channels + shape.out_channels) as u64;
        // Few input channels leave registers free to do half of the transforms there.
        let saved = if winograd::is_short(&shape) { 2 } else { 1 };
        let transforms = (points * POINT + outputs * OUTPUT) * channels / saved;
        // 16-bit integers also halve the memory traffic, so `speed` divides the whole estimate.
        (tiles * (points * product + transforms) + points * WEIGHT * product) / speed
    }

    /// The algorithm in `f32` whose [`name`](Self::name) is `name`.
    pub fn from_name(name: &str) -> Option<Algorithm> {
        Algorithm::ALL
            .into_iter()
            .find(|algorithm| algorithm.name() == name)
    }

    /// Its name in reports and options.
    pub fn name(self) -> &'static str {
        use Arithmetic::{F32, Int16};
        match self {
            Algorithm::Direct => "direct",
            Algorithm::Im2col => "im2col",
            Algorithm::Int8(_) => "int8",
            Algorithm::Winograd { points, arithmetic } => match (points, arithmetic) {
                (Points::Six, F32) => "winograd6",
                (Points::Eight, F32) => "winograd8",
                (Points::Ten, F32) => "winograd10",
                (Points::Six, Int16(_)) => "winograd6-int16",
                (Points::Eight, Int16(_)) => "winograd8-int16",
                (Points::Ten, Int16(_)) => "winograd10-int16",
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(kernel: usize, stride: usize, in_channels: usize, out_channels: usize) -> ConvShape {
        ConvShape {
            in_channels,
            out_channels,
            kernel,
            stride,
            pad: 0,
            relu: true,
        }
    }

    #[test]
    fn plan_of_the_networks_layers_is_the_fastest_measured() {
        let direct = Algorithm::Direct;
        let [six, eight, ten] = [Points::Six, Points::Eight, Points::Ten].map(Algorithm::winograd);
        for (kernel, stride, (in_channels, out_channels), side, expected) in [
            (11, 2, (3, 48), 303, ten),
            (5, 1, (48, 128), 73, ten),
            (3, 1, (128, 192), 34, six),
            (3, 1, (192, 192), 32, eight),
            (3, 1, (192, 128), 30, eight),
            (3, 1, (128, 128), 19, eight),
            (1, 1, (128, 4), 17, direct),
        ] {
            let shape = shape(kernel, stride, in_channels, out_channels);

            let plan = Algorithm::plan(&shape, Size::square(side));

            assert_eq!(plan, expected, "{shape:?}");
        }
    }

    #[test]
    fn plan_in_integers_takes_them_where_the_isa_is_faster_in_them() {
        let input = Quantization {
            scale: 1.0,
            zero_point: 0,
        };
        let int8 = Algorithm::Int8(input);
        let int16 = Algorithm::winograd_int16(Points::Eight, input);
        let [eight, ten] = [Points::Eight, Points::Ten].map(Algorithm::winograd);
        for isa in Isa::available() {
            let plan = |kernel, stride, in_channels, out_channels, side| {
                let shape = shape(kernel, stride, in_channels, out_channels);
                Algorithm::plan_integers(isa, &shape, Size::square(side), input)
            };

            let inner = [plan(3, 1, 192, 192, 32), plan(3, 1, 64, 64, 19)];
            let first = plan(11, 2, 3, 16, 303); // few channels: transforms cost more than products

            let expected = match (isa.int8_speed(), isa.int16_speed()) {
                (4, 2) => ([int16; 2], int8),
                (1, 2) => ([int16; 2], ten),
                (4 | 8, 1) => ([int8; 2], int8),
                _ => ([eight; 2], ten),
            };
            assert_eq!((inner, first), expected, "{isa}");
        }
    }

    #[test]
    fn every_name_leads_back_to_its_algorithm() {
        for algorithm in Algorithm::ALL {
            assert_eq!(Algorithm::from_name(algorithm.name()), Some(algorithm));
        }
        assert_eq!(Algorithm::from_name("fft"), None);
    }
}
