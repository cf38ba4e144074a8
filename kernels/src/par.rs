//! Threads, and the rows of a map split over them. The only file that names rayon.
//!
//! Work is split into contiguous blocks of output rows; every output value is computed by one thread in one order, so
//! results do not depend on the number of threads.

use std::sync::Arc;

/// A set of worker threads that kernels run on; of one thread it is the caller's own.
#[derive(Debug)]
pub struct Threads {
    workers: Option<Arc<rayon::ThreadPool>>,
    count: usize,
}

impl Threads {
    /// The most there can be.
    pub const MAX: usize = 256;

    /// `count` threads, held between 1 and [`MAX`](Self::MAX). Where the system refuses to start them, the caller's
    /// own thread does all the work.
    pub fn new(count: usize) -> Threads {
        let count = count.clamp(1, Self::MAX);
        let builder =
            rayon::ThreadPoolBuilder::new().num_threads(count).thread_name(|i| format!("kernel-{i}"));
        let workers = if count > 1 { builder.build().ok().map(Arc::new) } else { None };
        let count = if workers.is_some() { count } else { 1 };
        Threads { workers, count }
    }

    /// How many threads work.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Runs `work` on one of the threads. Kernels called within split their rows over all of them; enter once per frame, since
    /// entering wakes a worker.
    pub fn enter<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.workers {
            Some(workers) => workers.install(work),
            None => work(),
        }
    }

    /// Runs two works that do not depend on each other side by side, each on about half of the threads and in room of its own; on
    /// one thread one after the other, both in the first one's, which the cache then still holds. Call within [`enter`](Self::enter).
    pub fn both<T: Send>(
        &self,
        [room_a, room_b]: [&mut T; 2],
        a: impl FnOnce(&Threads, &mut T) + Send,
        b: impl FnOnce(&Threads, &mut T) + Send,
    ) {
        if self.count == 1 {
            a(self, room_a);
            b(self, room_a);
            return;
        }
        let some = |count: usize| Threads { workers: self.workers.clone(), count };
        let (first, second) = (some(self.count / 2), some(self.count - self.count / 2));
        rayon::join(|| a(&first, room_a), || b(&second, room_b));
    }

    /// Splits `out` into blocks of whole rows of `row_len` values, one per thread, and calls `work(first_row, block)`
    /// for each. Call within [`enter`](Self::enter).
    pub fn split_rows<T: Send>(&self, out: &mut [T], row_len: usize, work: impl Fn(usize, &mut [T]) + Sync) {
        self.split_rows_with(out, row_len, 1, &mut [], |first_row, block, _| work(first_row, block));
    }

    /// As [`split_rows`](Self::split_rows) at multiples of `unit` rows, and gives each thread its equal part of `scratch`.
    pub fn split_rows_with<T: Send>(
        &self,
        out: &mut [T],
        row_len: usize,
        unit: usize,
        scratch: &mut [f32],
        work: impl Fn(usize, &mut [T], &mut [f32]) + Sync,
    ) {
        assert!(row_len > 0 && out.len().is_multiple_of(row_len), "rows of {row_len} in {}", out.len());
        split(self.count, 0, out, row_len, unit, scratch, &work);
    }
}

fn split<T: Send>(
    threads: usize,
    first_row: usize,
    out: &mut [T],
    row_len: usize,
    unit: usize,
    scratch: &mut [f32],
    work: &(impl Fn(usize, &mut [T], &mut [f32]) + Sync),
) {
    let units = (out.len() / row_len).div_ceil(unit);
    let threads = threads.min(units);
    if threads <= 1 {
        if units > 0 {
            work(first_row, out, scratch);
        }
        return;
    }
    let left = threads / 2;
    let left_rows = units * left / threads * unit;
    let (a, b) = out.split_at_mut(left_rows * row_len);
    let (scratch_a, scratch_b) = scratch.split_at_mut(scratch.len() / threads * left);
    rayon::join(
        || split(left, first_row, a, row_len, unit, scratch_a, work),
        || split(threads - left, first_row + left_rows, b, row_len, unit, scratch_b, work),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_once() {
        for threads in [1, 2, 3, 5] {
            let all = Threads::new(threads);
            for rows in [0, 1, 2, 7, 16] {
                let mut out = vec![0usize; rows * 3];
                all.enter(|| {
                    all.split_rows(&mut out, 3, |first, block| {
                        for (i, row) in block.chunks_exact_mut(3).enumerate() {
                            row.iter_mut().for_each(|v| *v += first + i + 1);
                        }
                    });
                });
                let expected: Vec<_> = (0..rows).flat_map(|r| [r + 1; 3]).collect();
                assert_eq!(out, expected, "{threads} threads, {rows} rows");
            }
        }
    }

    #[test]
    fn side_by_side() {
        for threads in [1, 2, 3, 8] {
            let all = Threads::new(threads);
            let (mut a, mut b) = (vec![0; 4], vec![0; 4]);
            let mut counts = [0, 0];
            let [first, second] = &mut counts;
            let add = |row: usize, factor: usize, values: &mut [usize]| {
                values.iter_mut().enumerate().for_each(|(i, value)| *value += factor * (row + i));
            };
            all.enter(|| {
                all.both(
                    [&mut a, &mut b],
                    |threads, room| {
                        threads.split_rows_with(room, 1, 1, &mut [], |row, values, _| add(row, 1, values));
                        *first = threads.count();
                    },
                    |threads, room| {
                        threads.split_rows_with(room, 1, 1, &mut [], |row, values, _| add(row, 10, values));
                        *second = threads.count();
                    },
                );
            });
            let sum: usize = a.iter().chain(&b).sum();
            assert_eq!(sum, 66);
            assert_eq!(counts.iter().sum::<usize>(), threads.max(2));
        }
    }

    #[test]
    fn bounded() {
        assert_eq!(Threads::new(0).count(), 1);
    }
}
