//! Processes that share the batch of a step, each with an equal part of it, in the order of their
//! ranks.
//!
//! What is of the whole batch (the statistics of a normalization, the count by which a loss is
//! divided, a parameter's gradient) is a sum over the processes. A [`ProcessGroup`] only moves
//! bytes; the sums are made here, always in the order of the ranks. So they have the same bits in
//! all processes and in every run.

use bytemuck::Pod;
use std::fmt::Debug;

/// The processes that share a batch.
///
/// Every process makes the same calls in the same order with as many bytes; a call returns when all
/// have made it.
pub trait ProcessGroup: Debug + Send + Sync {
    /// This process's place, from 0.
    fn rank(&self) -> usize;

    /// Number of processes.
    fn size(&self) -> usize;

    /// Fills `all` with the bytes that each process gives as `own`, in the order of ranks.
    fn gather(&self, own: &[u8], all: &mut [u8]);

    /// Sends part `i` of `own`, one of [`size`](Self::size) equal parts, to process `i`, and fills
    /// part `i` of `received` with what that process sends here.
    fn exchange(&self, own: &[u8], received: &mut [u8]);
}

/// This process alone.
#[derive(Clone, Copy, Debug, Default)]
pub struct OneProcess;

impl ProcessGroup for OneProcess {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn gather(&self, own: &[u8], all: &mut [u8]) {
        all.copy_from_slice(own);
    }

    fn exchange(&self, own: &[u8], received: &mut [u8]) {
        received.copy_from_slice(own);
    }
}

impl dyn ProcessGroup + '_ {
    /// Whether this is the process that writes files.
    pub fn is_first(&self) -> bool {
        self.rank() == 0
    }

    /// The values of all processes, in the order of ranks.
    pub fn all<T: Pod>(&self, own: &[T]) -> Vec<T> {
        let mut all = vec![T::zeroed(); self.size() * own.len()];
        self.gather(
            bytemuck::cast_slice(own),
            bytemuck::cast_slice_mut(&mut all),
        );
        all
    }

    /// The sums of the processes' values.
    pub fn sums(&self, own: &[f64]) -> Vec<f64> {
        let mut all = self.all(own);
        let (sums, others) = all.split_at_mut(own.len());
        for other in others.chunks_exact(own.len().max(1)) {
            sums.iter_mut().zip(other).for_each(|(sum, v)| *sum += v);
        }
        all.truncate(own.len());
        all
    }

    /// Adds the other processes' values to these.
    ///
    /// Each process sums one part for all and then gives it to the others: it sends and receives
    /// about twice the bytes of `values`, however many processes there are.
    pub fn add_up(&self, values: &mut [f32]) {
        if self.size() == 1 || values.is_empty() {
            return;
        }
        let part = values.len().div_ceil(self.size());
        let mut own = vec![0.0f32; part * self.size()];
        own[..values.len()].copy_from_slice(values);
        let mut received = vec![0.0f32; own.len()];
        self.exchange(
            bytemuck::cast_slice(&own),
            bytemuck::cast_slice_mut(&mut received),
        );
        let (sum, others) = received.split_at_mut(part);
        for other in others.chunks_exact(part) {
            sum.iter_mut().zip(other).for_each(|(sum, v)| *sum += v);
        }
        self.gather(
            bytemuck::cast_slice(sum),
            bytemuck::cast_slice_mut(&mut own),
        );
        values.copy_from_slice(&own[..values.len()]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The second of three processes, whose neighbors give 10 times and 100 times its values.
    #[derive(Debug)]
    struct Middle;

    impl ProcessGroup for Middle {
        fn rank(&self) -> usize {
            1
        }

        fn size(&self) -> usize {
            3
        }

        fn gather(&self, own: &[u8], all: &mut [u8]) {
            for (all, factor) in all.chunks_exact_mut(own.len()).zip([10.0, 1.0, 100.0]) {
                scale(own, all, factor);
            }
        }

        fn exchange(&self, own: &[u8], received: &mut [u8]) {
            let len = own.len() / 3;
            self.gather(&own[len..2 * len], received);
        }
    }

    fn scale(from: &[u8], to: &mut [u8], factor: f64) {
        if from.len().is_multiple_of(8) {
            let values: Vec<f64> = bytemuck::pod_collect_to_vec(from);
            let scaled: Vec<f64> = values.iter().map(|v| factor * v).collect();
            to.copy_from_slice(bytemuck::cast_slice(&scaled));
        } else {
            let values: Vec<f32> = bytemuck::pod_collect_to_vec(from);
            let scaled: Vec<f32> = values.iter().map(|v| factor as f32 * v).collect();
            to.copy_from_slice(bytemuck::cast_slice(&scaled));
        }
    }

    #[test]
    fn values_of_all_processes_come_in_the_order_of_ranks() {
        let group: &dyn ProcessGroup = &Middle;

        assert_eq!(
            group.all(&[1.0f64, 2.0]),
            [10.0, 20.0, 1.0, 2.0, 100.0, 200.0]
        );
        assert_eq!(group.sums(&[1.0, 2.0]), [111.0, 222.0]);
    }

    #[test]
    fn one_process_keeps_its_values() {
        let group: &dyn ProcessGroup = &OneProcess;
        let mut values = [1.0, -0.0];

        group.add_up(&mut values);

        assert_eq!(values.map(f32::to_bits), [1.0f32, -0.0].map(f32::to_bits));
        assert_eq!(group.sums(&[3.0]), [3.0]);
    }
}
