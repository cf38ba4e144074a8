//! What a convolution computes: its channels, kernel, stride and padding.

use crate::Size;

/// The sizes of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConvShape {
    /// Input channels.
    pub in_channels: usize,
    /// Output channels.
    pub out_channels: usize,
    /// Side of the square kernel.
    pub kernel: usize,
    /// Stride in both directions.
    pub stride: usize,
    /// Zero padding on all four sides.
    pub pad: usize,
    /// Whether negative outputs become 0.
    pub relu: bool,
}

impl ConvShape {
    /// Size of the output for an input of `size`.
    ///
    /// Panics if the padded input is smaller than the kernel.
    pub fn out_size(&self, size: Size) -> Size {
        let side = |n: usize| {
            assert!(
                n + 2 * self.pad >= self.kernel,
                "input side {n} is smaller than the kernel {}",
                self.kernel
            );
            (n + 2 * self.pad - self.kernel) / self.stride + 1
        };
        Size {
            h: side(size.h),
            w: side(size.w),
        }
    }

    /// Multiply-accumulates for an input of `size`.
    pub fn macs(&self, size: Size) -> u64 {
        (self.out_size(size).area() * self.out_channels * self.window()) as u64
    }

    /// Input values that one output depends on: `k * k * Cin`.
    pub(super) fn window(&self) -> usize {
        self.kernel * self.kernel * self.in_channels
    }

    /// Size of the input with its padding.
    pub(super) fn padded(&self, size: Size) -> Size {
        Size {
            h: size.h + 2 * self.pad,
            w: size.w + 2 * self.pad,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "smaller than the kernel")]
    fn input_below_the_kernel_is_refused() {
        let shape = ConvShape {
            in_channels: 1,
            out_channels: 1,
            kernel: 3,
            stride: 1,
            pad: 0,
            relu: false,
        };

        shape.out_size(Size { h: 2, w: 9 });
    }
}
