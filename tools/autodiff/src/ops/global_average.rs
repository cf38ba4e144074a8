//! Global average pooling: the mean over all positions of a map.
//!
//! Shapes: `[batch, H, W, C] -> [batch, C]`. Backwards every position gets `g / (H W)`.

use super::map::SumRows;
use crate::tape::Operation;
use crate::{Tape, Tensor, Var};

struct GlobalAverage {
    x: Var,
}

impl Tape<'_> {
    /// The mean over positions of `x` (`[batch, H, W, C]`): `[batch, C]`.
    pub fn global_average(&mut self, x: Var) -> Var {
        let maps = self.value(x).maps("global_average");
        let mut out = self.compute.tensor(&[maps.batch, maps.channels]);
        let input = self.value(x).data();
        self.compute.each(out.data_mut(), maps.channels, |i, out| {
            let mut sums = vec![0.0; maps.channels];
            let x = &input[i * maps.image()..][..maps.image()];
            self.compute.isa().run(SumRows { x, sums: &mut sums });
            out.iter_mut()
                .zip(sums)
                .for_each(|(out, sum)| *out = (sum / maps.size.area() as f64) as f32);
        });
        self.record(out, &[x], GlobalAverage { x })
    }
}

impl Operation for GlobalAverage {
    fn backward(&self, tape: &mut Tape, _: &Tensor, mut gradient: Tensor) {
        let maps = tape.value(self.x).maps("global_average");
        let factor = 1.0 / maps.size.area() as f32;
        gradient.data_mut().iter_mut().for_each(|g| *g *= factor);
        let share = super::tile::repeat(tape.compute, &gradient, maps.size);
        tape.add_gradient(self.x, share);
        tape.compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        check(&[noise(&[3, 2, 4, 5], 1)], 0.25, 1e-5, |tape, v| {
            tape.global_average(v[0])
        });
    }
}
