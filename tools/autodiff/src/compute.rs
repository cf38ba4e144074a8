//! The resources of a tape: instruction set, worker threads, the processes that share the batch,
//! and buffers that are reused between steps. Only this file uses rayon.
//!
//! Work is split into parts, mostly the images of the batch. The number of parts does not depend on
//! the number of threads, one thread computes each part, and sums over parts run in the order of
//! the parts. So results have the same bits on any number of threads.

use crate::{OneProcess, ProcessGroup, Tensor};
use kernels::conv::{Algorithm, ConvShape};
use kernels::{Isa, Size};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Instruction set, worker threads, processes, and buffers that are reused in the next step.
#[derive(Debug)]
pub struct Compute {
    isa: Isa,
    winograd: bool,
    processes: Arc<dyn ProcessGroup>,
    workers: rayon::ThreadPool,
    scratch: Vec<Mutex<Vec<f32>>>, // one per worker
    buffers: Mutex<HashMap<usize, Shelf>>,
}

/// The system refused to start the worker threads.
#[derive(Debug, thiserror::Error)]
#[error("cannot start {threads} worker threads: {source}")]
pub struct ThreadError {
    threads: usize,
    source: rayon::ThreadPoolBuildError,
}

/// Buffers of one length.
#[derive(Debug, Default)]
struct Shelf {
    free: Vec<Vec<f32>>,
    lent: usize,
    used: bool, // in this step
}

impl Compute {
    /// Largest number of threads.
    pub const MAX_THREADS: usize = kernels::par::Threads::MAX;

    /// `threads` workers, held between 1 and [`MAX_THREADS`](Self::MAX_THREADS), on the machine's
    /// fastest instruction set.
    ///
    /// # Errors
    /// If the system refuses to start the threads.
    pub fn new(threads: usize) -> Result<Compute, ThreadError> {
        Compute::with_isa(threads, Isa::detect())
    }

    /// As [`new`](Self::new), but on a given instruction set.
    ///
    /// # Errors
    /// If the system refuses to start the threads.
    pub fn with_isa(threads: usize, isa: Isa) -> Result<Compute, ThreadError> {
        let threads = threads.clamp(1, Self::MAX_THREADS);
        let builder = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .thread_name(|i| format!("autodiff-{i}"));
        let workers = builder
            .build()
            .map_err(|source| ThreadError { threads, source })?;
        let scratch = (0..threads).map(|_| Mutex::default()).collect();
        Ok(Compute {
            isa,
            winograd: false,
            processes: Arc::new(OneProcess),
            workers,
            scratch,
            buffers: Mutex::default(),
        })
    }

    /// Allows Winograd's algorithm for convolutions for which it is expected to be faster.
    ///
    /// A step then takes little more than half the time. Values are off by about 1e-5 of their RMS
    /// in place of 1e-7: irrelevant for training, but too much for a comparison with gradients of
    /// other code. So it is off by default.
    pub fn with_winograd(self) -> Compute {
        Compute {
            winograd: true,
            ..self
        }
    }

    /// Shares the batch of each tape with other processes: a tape's inputs are this process's part
    /// of the batch, and losses, their gradients and batch statistics are those of the whole.
    ///
    /// A loss's value, and what [`backward`](crate::Tape::backward) adds to a parameter's gradient,
    /// are this process's share: [`Parameters::add_up`](crate::Parameters::add_up) completes the
    /// gradients.
    pub fn with_processes(self, processes: Arc<dyn ProcessGroup>) -> Compute {
        Compute { processes, ..self }
    }

    /// The processes that share the batch.
    pub fn processes(&self) -> &dyn ProcessGroup {
        &*self.processes
    }

    /// The algorithm for a convolution of inputs of `size`.
    pub(crate) fn algorithm(&self, shape: &ConvShape, size: Size) -> Algorithm {
        if self.winograd {
            Algorithm::plan(shape, size)
        } else {
            Algorithm::Direct
        }
    }

    /// Whether Winograd's algorithm may be taken.
    pub(crate) fn winograd(&self) -> bool {
        self.winograd
    }

    /// Number of worker threads.
    pub fn threads(&self) -> usize {
        self.workers.current_num_threads()
    }

    /// The instruction set that the hot loops run on.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Calls `work(i, part)` for each part of `len` values of `out`, in parallel. The last part may
    /// be shorter.
    pub(crate) fn each<T: Send>(
        &self,
        out: &mut [T],
        len: usize,
        work: impl Fn(usize, &mut [T]) + Sync,
    ) {
        self.workers.install(|| {
            let parts = out.par_chunks_mut(len).enumerate().with_max_len(1);
            parts.for_each(|(i, part)| work(i, part));
        });
    }

    /// As [`each`](Self::each), over parts of two slices side by side.
    pub(crate) fn each2<T: Send, U: Send>(
        &self,
        (a, a_len): (&mut [T], usize),
        (b, b_len): (&mut [U], usize),
        work: impl Fn(usize, &mut [T], &mut [U]) + Sync,
    ) {
        self.workers.install(|| {
            let parts = a
                .par_chunks_mut(a_len)
                .zip(b.par_chunks_mut(b_len))
                .enumerate()
                .with_max_len(1);
            parts.for_each(|(i, (a, b))| work(i, a, b));
        });
    }

    /// The calling worker's `len` values of scratch space, of no particular content. Call within
    /// [`each`](Self::each), once at a time.
    pub(crate) fn scratch<R>(&self, len: usize, work: impl FnOnce(&mut [f32]) -> R) -> R {
        let mut space = lock(&self.scratch[rayon::current_thread_index().unwrap_or(0)]);
        if space.len() < len {
            space.resize(len, 0.0);
        }
        work(&mut space[..len])
    }

    /// A tensor of no particular content: every value must be written.
    pub(crate) fn tensor(&self, shape: &[usize]) -> Tensor {
        let len = shape.iter().product();
        let mut shelves = lock(&self.buffers);
        let shelf = shelves.entry(len).or_default();
        shelf.lent += 1;
        shelf.used = true;
        let data = shelf.free.pop();
        drop(shelves);
        let mut data = data.unwrap_or_else(|| vec![0.0; len]);
        if cfg!(debug_assertions) {
            data.fill(f32::NAN);
        }
        Tensor::new(shape, data)
    }

    /// A tensor of zeros.
    pub(crate) fn zeros(&self, shape: &[usize]) -> Tensor {
        let mut tensor = self.tensor(shape);
        tensor.data_mut().fill(0.0);
        tensor
    }

    /// Takes a tensor's buffer back. Never keeps more than were lent, so that nothing piles up.
    pub(crate) fn recycle(&self, tensor: Tensor) {
        let data = tensor.into_data();
        if let Some(shelf) = lock(&self.buffers).get_mut(&data.len())
            && shelf.lent > 0
        {
            shelf.lent -= 1;
            shelf.free.push(data);
        }
    }

    /// Ends a step: drops buffers of lengths that it did not use.
    pub(crate) fn end_step(&self) {
        lock(&self.buffers).retain(|_, shelf| {
            shelf.lent = 0;
            std::mem::take(&mut shelf.used)
        });
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_visits_every_part_once() {
        for threads in [1, 3] {
            let compute = Compute::new(threads).unwrap();
            assert_eq!(compute.threads(), threads);
            let mut out = vec![0; 10];
            compute.each(&mut out, 4, |i, part| {
                part.iter_mut()
                    .for_each(|v| *v += 10 * (i + 1) + part_len(i))
            });
            assert_eq!(out, [14, 14, 14, 14, 24, 24, 24, 24, 32, 32]);
        }
        fn part_len(i: usize) -> usize {
            if i == 2 { 2 } else { 4 }
        }
    }

    #[test]
    fn lent_buffers_are_reused_and_freed_when_unused() {
        let compute = Compute::new(1).unwrap();
        let kept = |len| {
            lock(&compute.buffers)
                .get(&len)
                .map_or(0, |shelf: &Shelf| shelf.free.len())
        };
        let tensor = compute.tensor(&[2, 3]);
        compute.recycle(tensor);
        compute.recycle(Tensor::zeros(&[6]));
        compute.recycle(Tensor::zeros(&[7]));
        assert_eq!((kept(6), kept(7)), (1, 0), "only what was lent");
        compute.end_step();
        assert_eq!(kept(6), 1, "used in this step");
        compute.end_step();
        assert_eq!(kept(6), 0, "not used in this one");
    }

    #[test]
    fn scratch_grows_to_the_requested_length() {
        let compute = Compute::new(2).unwrap();
        let mut out = [0; 4];
        compute.each(&mut out, 1, |i, part| {
            part[0] = compute.scratch(i + 1, |space| space.len())
        });
        assert_eq!(out, [1, 2, 3, 4]);
    }
}
