//! Batches made ahead on worker threads, in order and independent of thread timing.

use super::{Dataset, Sample};
use crate::error::Error;
use autodiff::ProcessGroup;
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;

/// Request for a batch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Order {
    number: u64,
    search_size: usize,
}

/// The samples of each batch that one of several processes draws: an equal part, in the order of
/// ranks. Together the parts are the samples that a single process draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    whole: usize,
    first: usize,
    len: usize,
}

impl Part {
    /// All of a batch.
    pub fn all(batch: usize) -> Part {
        Part {
            whole: batch,
            first: 0,
            len: batch,
        }
    }

    /// This process's part of a batch.
    ///
    /// # Errors
    /// If the batch cannot be divided into equal parts.
    pub fn of(batch: usize, processes: &dyn ProcessGroup) -> Result<Part, Error> {
        let size = processes.size();
        if !batch.is_multiple_of(size) {
            let expected = format!("a multiple of {size}, the number of processes");
            return Err(Error::option("pairs per step", expected, batch));
        }
        let len = batch / size;
        Ok(Part {
            whole: batch,
            first: len * processes.rank(),
            len,
        })
    }

    /// Numbers of its samples in batch `number`.
    fn samples(self, number: u64) -> std::ops::Range<u64> {
        let first = number * self.whole as u64 + self.first as u64;
        first..first + self.len as u64
    }
}

/// Makes batches of a data set ahead of their use.
#[derive(Debug)]
pub struct Feed {
    orders: Option<Sender<Order>>,
    batches: Receiver<(u64, Vec<Sample>)>,
    early: BTreeMap<u64, Vec<Sample>>,
    next_order: u64,
    next_batch: u64,
    ahead: u64,
    workers: Vec<JoinHandle<()>>,
}

impl Feed {
    /// A part of each batch from number `first` on, made by `threads` threads, at most `ahead` of
    /// them waiting.
    pub fn new(
        dataset: Arc<Dataset>,
        part: Part,
        first: u64,
        threads: usize,
        ahead: usize,
    ) -> Feed {
        let (orders, inbox) = channel::<Order>();
        let (outbox, batches): (SyncSender<_>, _) = sync_channel(ahead.max(1));
        let inbox = Arc::new(Mutex::new(inbox));
        let work = || {
            let (dataset, inbox, outbox) = (dataset.clone(), inbox.clone(), outbox.clone());
            move || {
                loop {
                    let order = match inbox.lock() {
                        Ok(inbox) => inbox.recv(),
                        Err(_) => return,
                    };
                    let Ok(Order {
                        number,
                        search_size,
                    }) = order
                    else {
                        return;
                    };
                    let samples = part
                        .samples(number)
                        .map(|index| dataset.sample(index, search_size))
                        .collect();
                    if outbox.send((number, samples)).is_err() {
                        return;
                    }
                }
            }
        };
        let workers = (0..threads.max(1))
            .map(|_| std::thread::spawn(work()))
            .collect();
        Feed {
            orders: Some(orders),
            batches,
            early: BTreeMap::new(),
            next_order: first,
            next_batch: first,
            ahead: ahead.max(1) as u64,
            workers,
        }
    }

    /// The next batch; those ordered from here on have search crops of `search_size` pixels.
    ///
    /// Panics if a worker panicked.
    pub fn next(&mut self, search_size: impl Fn(u64) -> usize) -> Vec<Sample> {
        while self.next_order <= self.next_batch + self.ahead {
            let order = Order {
                number: self.next_order,
                search_size: search_size(self.next_order),
            };
            if let Some(orders) = &self.orders {
                // Sending fails only if all workers are gone, which `recv` below reports.
                let _ = orders.send(order);
            }
            self.next_order += 1;
        }
        while !self.early.contains_key(&self.next_batch) {
            let (number, samples) = self
                .batches
                .recv()
                .expect("data workers live until the feed is dropped");
            self.early.insert(number, samples);
        }
        self.next_batch += 1;
        self.early
            .remove(&(self.next_batch - 1))
            .expect("just seen")
    }

    /// How many batches are ready now.
    pub fn ready(&mut self) -> usize {
        while let Ok((number, samples)) = self.batches.try_recv() {
            self.early.insert(number, samples);
        }
        self.early.len()
    }
}

impl Drop for Feed {
    fn drop(&mut self) {
        self.orders = None;
        // Unblocks workers that wait for room.
        while self.batches.recv().is_ok() {}
        for worker in self.workers.drain(..) {
            let _ = worker.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Member;

    #[test]
    fn parts_of_all_processes_are_the_whole_batch_in_order() {
        for size in [1, 2, 3, 6] {
            for number in [0, 1, 7] {
                let parts = Member::group(size).into_iter().flat_map(|process| {
                    let part = Part::of(12, &process).unwrap();
                    part.samples(number)
                });

                assert!(parts.eq(Part::all(12).samples(number)), "{size}, {number}");
            }
        }
    }

    #[test]
    fn batch_without_equal_parts_is_refused() {
        let process = Member::group(3).remove(0);

        let refused = Part::of(16, &process).unwrap_err().to_string();

        assert_eq!(
            refused,
            "pairs per step: expected a multiple of 3, the number of processes, found 16"
        );
    }
}
