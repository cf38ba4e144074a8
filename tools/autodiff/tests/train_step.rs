//! One training step, and five steps of SGD, of a narrow network against the reference
//! implementation's in `f64`.

mod network;

use autodiff::optim::{Optimizer, Sgd};
use autodiff::{BoxDecoder, Compute, Mode, Parameters, Tape, Tensor};
use kernels::Isa;
use network::{Batch, Config, DrMim, Losses};
use safetensors::SafeTensors;

const NARROW: Config = Config {
    backbone: [8, 16, 24, 24, 16],
    neck: 16,
    hidden: 32,
    flatten: Some(6),
};

/// The file of golden values, if the reference data are there.
fn golden() -> Option<Vec<u8>> {
    let path = testing::shared("golden/train_step.safetensors")?;
    Some(std::fs::read(path).unwrap())
}

struct Golden<'a> {
    tensors: SafeTensors<'a>,
    losses: Vec<serde_json::Value>, // of five steps
}

impl Golden<'_> {
    fn new(bytes: &[u8]) -> Golden<'_> {
        let (_, header) = SafeTensors::read_metadata(bytes).unwrap();
        let losses = &header.metadata().as_ref().unwrap()["losses_sgd_lr0.002_m0.9_wd5e-5"];
        Golden {
            tensors: SafeTensors::deserialize(bytes).unwrap(),
            losses: serde_json::from_str(losses).unwrap(),
        }
    }

    /// A tensor with channels innermost: `[a, b, h, w]` becomes `[a, h, w, b]`.
    fn get(&self, name: &str) -> Tensor {
        let view = self
            .tensors
            .tensor(name)
            .unwrap_or_else(|e| panic!("{name}: {e}"));
        let values = view
            .data()
            .chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        let values: Vec<f32> = values.collect();
        let [a, b, h, w] = view.shape()[..] else {
            return Tensor::new(view.shape(), values);
        };
        let moved = (0..values.len()).map(|i| {
            let (outer, y, x, inner) = (i / (b * h * w), i / (b * w) % h, i / b % w, i % b);
            values[((outer * b + inner) * h + y) * w + x]
        });
        Tensor::new(&[a, h, w, b], moved.collect())
    }

    /// The same values in the parameter's own shape (the statistics networks' 1x1 convolutions are
    /// linear layers here).
    fn like(&self, name: &str, shape: &[usize]) -> Tensor {
        Tensor::new(shape, self.get(name).into_data())
    }

    fn network(&self) -> (Parameters, DrMim) {
        let mut parameters = Parameters::new();
        let network = DrMim::new(&mut parameters, NARROW);
        for parameter in parameters.iter_mut() {
            parameter.value = self.like(
                &format!("init.{}", parameter.name()),
                parameter.value.shape(),
            );
        }
        let stored = self
            .tensors
            .names()
            .into_iter()
            .filter(|name| name.starts_with("init."))
            .count();
        assert_eq!(
            parameters.iter().len(),
            stored,
            "every parameter has its tensor"
        );
        (parameters, network)
    }

    fn batch(&self) -> Batch {
        Batch {
            template: self.get("in.z"),
            search: self.get("in.x"),
            second_template: self.get("in.z2"),
            positive: self
                .get("in.neg")
                .data()
                .iter()
                .map(|negative| *negative == 0.0)
                .collect(),
            labels: self.get("tgt.cls_gt"),
            quality: self.get("tgt.ctr_gt"),
            boxes: self.get("tgt.box_gt"),
            decoder: BoxDecoder::new(87.0),
        }
    }

    /// The losses' largest relative error, and that loss's name.
    fn loss_error(&self, tape: &Tape, losses: Losses, step: usize) -> (f64, String) {
        let named = [
            ("cls", losses.cls),
            ("ctr", losses.ctr),
            ("reg", losses.reg),
            ("mi_global", losses.mi_global),
            ("mi_local", losses.mi_local),
            ("idsim", losses.idsim),
            ("total", losses.total),
        ];
        worst(named.map(|(name, var)| {
            let expected = self.losses[step][name].as_f64().unwrap();
            let found = f64::from(tape.value(var).item());
            (
                (found / expected - 1.0).abs(),
                format!("loss {name} of step {step}"),
            )
        }))
    }
}

/// The largest of some errors.
fn worst(errors: impl IntoIterator<Item = (f64, String)>) -> (f64, String) {
    errors
        .into_iter()
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap()
}

fn norm(values: &[f32]) -> f64 {
    values
        .iter()
        .map(|v| f64::from(*v) * f64::from(*v))
        .sum::<f64>()
        .sqrt()
}

/// The norm of the difference over the expected norm, or over `floor` if that is larger.
fn error(found: &Tensor, expected: &Tensor, floor: f64) -> f64 {
    let difference: Vec<f32> = found
        .data()
        .iter()
        .zip(expected.data())
        .map(|(f, e)| f - e)
        .collect();
    norm(&difference) / norm(expected.data()).max(floor)
}

#[test]
fn training_step_equals_the_reference() {
    one_step_with(Compute::new(2).unwrap(), 1e-3);
}

/// Winograd's algorithm rounds differently, so some ReLUs and maxima choose the other side. Each of
/// them changes the gradients of the layers before it: two in E2 change that of its biases by 6 %.
/// `winograd_stays_near_the_direct_convolution` tests each convolution alone, more tightly.
#[test]
fn training_step_with_winograd_stays_near_the_reference() {
    one_step_with(Compute::new(2).unwrap().with_winograd(), 0.1);
}

fn one_step_with(compute: Compute, tolerance: f64) {
    let Some(bytes) = golden() else { return };
    let golden = Golden::new(&bytes);
    let (mut parameters, network) = golden.network();
    let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
    let mut batch = golden.batch();
    let (prediction, losses) = network.losses(&mut tape, &mut batch);
    for (var, name) in [
        (prediction.cls, "pred.cls_logit"),
        (prediction.ctr, "pred.ctr_logit"),
    ] {
        let expected = golden.like(name, tape.shape(var));
        assert!(error(tape.value(var), &expected, 0.0) < 1e-4, "{name}");
    }
    let (si, bi) = (
        tape.value(prediction.si).item(),
        tape.value(prediction.bi).item(),
    );
    let boxes = batch.decoder.boxes(tape.value(prediction.offsets), si, bi);
    assert!(
        error(&boxes, &golden.like("pred.box", boxes.shape()), 0.0) < 1e-4,
        "pred.box"
    );
    let (error_of_losses, name) = golden.loss_error(&tape, losses, 0);
    assert!(
        error_of_losses < 1e-4,
        "{name}: off by {error_of_losses:.1e}"
    );
    tape.backward(losses.total);

    for parameter in parameters.iter() {
        let (name, shape) = (parameter.name(), parameter.value.shape());
        let (found, expected, floor) = match &parameter.gradient {
            // Before a normalization a bias has no gradient but rounding errors; these are judged
            // by its weights' gradient.
            Some(gradient) => {
                let weights = name
                    .strip_suffix(".conv.bias")
                    .map(|layer| format!("grad.{layer}.conv.weight"));
                let floor = weights.map_or(0.0, |weights| norm(golden.get(&weights).data()));
                (
                    gradient,
                    golden.like(&format!("grad.{name}"), shape),
                    0.1 * floor,
                )
            }
            None => (
                &parameter.value,
                golden.like(&format!("bn1.{name}"), shape),
                0.0,
            ),
        };
        assert_eq!(
            parameter.gradient.is_none(),
            parameter.is_statistic(),
            "{name}"
        );
        let error = error(found, &expected, floor);
        assert!(error < tolerance, "{name}: off by {error:.1e} of its norm");
    }
}

/// In the fourth step one predicted edge comes within 0.0002 px of the true one, and one ReLU as
/// close to 0. The gradient jumps there, and `f32` rounding decides which side it takes. So the
/// test moves the true edge by some thousandths of a pixel, which is more than the rounding and
/// less than its own tolerances, and expects that one of eight such moves leads to the reference's
/// values.
#[test]
fn five_steps_equal_the_reference() {
    let Some(bytes) = golden() else { return };
    let golden = Golden::new(&bytes);
    let run = |isa, threads, moved| {
        let compute = Compute::with_isa(threads, isa).unwrap();
        let (mut parameters, network) = golden.network();
        parameters
            .iter_mut()
            .for_each(|parameter| parameter.decay = 5e-5);
        let mut batch = golden.batch();
        batch.boxes.data_mut()[4 * 58] += moved;
        let mut sgd = Sgd::new(0.9);
        let mut errors = Vec::new();
        for step in 0..5 {
            parameters.clear_gradients();
            let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
            let (_, losses) = network.losses(&mut tape, &mut batch.clone());
            errors.push(golden.loss_error(&tape, losses, step));
            tape.backward(losses.total);
            sgd.step(&compute, &mut parameters, 0.002);
        }
        for parameter in parameters
            .iter()
            .filter(|parameter| !parameter.is_statistic())
        {
            let expected = golden.like(
                &format!("param5.{}", parameter.name()),
                parameter.value.shape(),
            );
            errors.push((
                error(&parameter.value, &expected, 0.0),
                parameter.name().to_owned(),
            ));
        }
        (parameters, worst(errors))
    };
    for isa in Isa::available() {
        let mut errors = Vec::new();
        let follows = (1..=8).any(|i| {
            errors.push(run(isa, 2, 0.001 * i as f32).1);
            errors.last().unwrap().0 < 1e-3
        });
        assert!(follows, "{isa}: off by {errors:?}");
    }
    let isa = Isa::detect();
    assert!(
        run(isa, 2, 0.0).0.state().eq(run(isa, 3, 0.0).0.state()),
        "threads change no bit"
    );
}
