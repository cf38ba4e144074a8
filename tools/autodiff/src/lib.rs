//! Reverse-mode automatic differentiation over `f32` batches, for the trainer.
//!
//! A [`Tape`] records a computation while it runs. [`Tape::backward`] walks it in reverse and
//! accumulates the gradients in the [`Parameters`]. An [`Optimizer`](optim::Optimizer) then updates
//! the parameters. Maps are `[batch, height, width, channels]`.
//!
//! ```
//! use autodiff::optim::{Optimizer, Sgd};
//! use autodiff::{Compute, Mode, Parameters, Tape, Tensor};
//!
//! let compute = Compute::new(1)?;
//! let mut parameters = Parameters::new();
//! let weights = parameters.add("weights", Tensor::zeros(&[1, 2]));
//! let bias = parameters.add("bias", Tensor::zeros(&[1]));
//! let mut sgd = Sgd::new(0.5);
//! for _ in 0..200 {
//!     parameters.clear_gradients();
//!     let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
//!     let x = tape.constant(Tensor::new(&[3, 2], vec![1.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
//!     let truth = tape.constant(Tensor::new(&[3, 1], vec![3.0, 0.0, 2.0])); // 2 a - b + 1
//!     let (w, b) = (tape.parameter(weights), tape.parameter(bias));
//!     let y = tape.linear(x, w, b);
//!     let loss = tape.mean_square(y, truth, &[true; 3]);
//!     tape.backward(loss);
//!     sgd.step(&compute, &mut parameters, 0.2);
//! }
//! let found = &parameters[weights].value;
//! assert!((found.data()[0] - 2.0).abs() < 0.01 && (found.data()[1] + 1.0).abs() < 0.01);
//! # Ok::<(), autodiff::ThreadError>(())
//! ```
//!
//! | what | where |
//! |---|---|
//! | tape, variables, the backward pass | [`Tape`], `tape.rs` |
//! | operations: forward, backward and gradient check together | `ops/`, one file each |
//! | losses with gradients in closed form | `losses/`, one file each |
//! | SGD, AdamW, clipping, learning rates | [`optim`] |
//! | threads, instruction set, buffers | [`Compute`], `compute.rs` |
//! | processes that share a batch | [`ProcessGroup`], `processes.rs` |
//!
//! The same machine, values and calls give the same bits, on any number of threads. Another number
//! of processes rounds differently.

#![forbid(unsafe_code)]

#[cfg(test)]
mod check;
mod compute;
mod losses;
mod ops;
pub mod optim;
mod parameters;
mod processes;
mod tape;
mod tensor;
mod vector;

pub use compute::{Compute, ThreadError};
pub use losses::{BoxDecoder, Focal};
pub use ops::{Conv2d, RunningStatistics};
pub use parameters::{Parameter, ParameterId, Parameters, StateError};
pub use processes::{OneProcess, ProcessGroup};
pub use tape::{Gradients, Mode, Tape, Var};
pub use tensor::Tensor;
