//! Batches made ahead on worker threads, in order and independent of thread timing.

use super::{Dataset, Sample};
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
    /// Batches of `batch` samples from number `first` on, made by `threads` threads, at most
    /// `ahead` of them waiting.
    pub fn new(
        dataset: Arc<Dataset>,
        batch: usize,
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
                    let index = |i: usize| number * batch as u64 + i as u64;
                    let samples = (0..batch)
                        .map(|i| dataset.sample(index(i), search_size))
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
