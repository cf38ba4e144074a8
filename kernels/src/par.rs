//! Threads, the processor cores they are pinned to, and maps split over them. The only file that
//! names rayon and core_affinity.
//!
//! Work is split into contiguous blocks of output rows, or of Winograd tiles. One thread computes
//! every output value, in one order: results have the same bits on any number of threads. Cost: one
//! fork and join per kernel call, a few microseconds; waking a sleeping pool costs more, so enter
//! it once per frame ([`Threads::enter`]).

use core_affinity::CoreId;
use std::ops::Range;
use std::str::FromStr;
use std::sync::Arc;

/// A pool of worker threads that kernels run on. A pool of one is the caller's own thread, unless
/// it is to be pinned.
#[derive(Debug)]
pub struct Threads {
    workers: Option<Arc<rayon::ThreadPool>>,
    count: usize,
}

impl Threads {
    /// The largest number of threads.
    pub const MAX: usize = 256;

    /// Starts `count` threads, clamped to `1..=MAX`. If the system refuses, the caller's own thread
    /// does all the work.
    pub fn new(count: usize) -> Threads {
        Threads::start(count, Cores::ANY)
    }

    /// Starts `count` threads, each pinned to one of `cores` in turn. A thread whose core the
    /// system refuses runs anywhere.
    ///
    /// With [`Cores::ANY`], as many threads as there are cores are pinned to one each. Otherwise
    /// the system may wake two of them on one core after a pause, such as the one before a camera's
    /// next frame, and leave them there for longer than a frame takes.
    pub fn pinned(count: usize, cores: Cores) -> Threads {
        let all = Cores::available();
        let one_each = cores == Cores::ANY && count > 1 && count == all.ids().count();
        Threads::start(count, if one_each { all } else { cores })
    }

    fn start(count: usize, cores: Cores) -> Threads {
        let count = count.clamp(1, Self::MAX);
        let ids: Vec<usize> = cores.ids().collect();
        let mut builder = rayon::ThreadPoolBuilder::new()
            .num_threads(count)
            .thread_name(|i| format!("kernel-{i}"));
        if cores != Cores::ANY {
            builder = builder.start_handler(move |i| {
                core_affinity::set_for_current(CoreId {
                    id: ids[i % ids.len()],
                });
            });
        }
        let needed = count > 1 || cores != Cores::ANY;
        let workers = if needed {
            builder.build().ok().map(Arc::new)
        } else {
            None
        };
        let count = if workers.is_some() { count } else { 1 };
        Threads { workers, count }
    }

    /// Number of threads.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Runs `work` on one of the threads. Kernels called from within split their rows over all of
    /// them.
    ///
    /// Enter once per frame: entering wakes a worker.
    pub fn enter<R: Send>(&self, work: impl FnOnce() -> R + Send) -> R {
        match &self.workers {
            Some(workers) => workers.install(work),
            None => work(),
        }
    }

    /// Runs two independent jobs side by side, each on half of the threads and with a buffer of its
    /// own.
    ///
    /// On one thread they run one after the other, both with the first buffer, which is then still
    /// in the cache. Call within [`enter`](Self::enter).
    pub fn both<T: Send>(
        &self,
        [buffer_a, buffer_b]: [&mut T; 2],
        a: impl FnOnce(&Threads, &mut T) + Send,
        b: impl FnOnce(&Threads, &mut T) + Send,
    ) {
        if self.count == 1 {
            a(self, buffer_a);
            b(self, buffer_a);
            return;
        }
        let part = |count: usize| Threads {
            workers: self.workers.clone(),
            count,
        };
        let first = part(self.count / 2);
        let second = part(self.count - self.count / 2);
        rayon::join(|| a(&first, buffer_a), || b(&second, buffer_b));
    }

    /// Splits `out` into one block of whole rows (of `row_len` values) per thread, and calls
    /// `work(first_row, block)` for each. Call within [`enter`](Self::enter).
    ///
    /// Panics if `out` is not whole rows.
    pub fn split_rows<T: Send>(
        &self,
        out: &mut [T],
        row_len: usize,
        work: impl Fn(usize, &mut [T]) + Sync,
    ) {
        self.split_rows_with(out, row_len, 1, &mut [], |first_row, block, _| {
            work(first_row, block)
        });
    }

    /// As [`split_rows`](Self::split_rows), in blocks of multiples of `unit` rows, with an equal
    /// part of `scratch` for each thread.
    ///
    /// Panics if `out` is not whole rows.
    pub fn split_rows_with<T: Send>(
        &self,
        out: &mut [T],
        row_len: usize,
        unit: usize,
        scratch: &mut [f32],
        work: impl Fn(usize, &mut [T], &mut [f32]) + Sync,
    ) {
        assert!(
            row_len > 0 && out.len().is_multiple_of(row_len),
            "rows of {row_len} in {}",
            out.len()
        );
        split(self.count, 0, out, row_len, unit, scratch, &work);
    }
}

/// Splits rows and scratch in two halves, recursively, until each thread has its block.
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
        || {
            split(
                threads - left,
                first_row + left_rows,
                b,
                row_len,
                unit,
                scratch_b,
                work,
            )
        },
    );
}

/// How a map is cut into tiles, which are counted along its rows.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    /// Values of a row of the map.
    pub row_len: usize,
    /// Rows of a tile, at most [`Tiling::ROWS`]; those at the bottom may have fewer.
    pub rows: usize,
    /// Values of a row of a tile; those at the right edge may have fewer.
    pub len: usize,
}

impl Tiling {
    /// Most rows of a tile.
    pub const ROWS: usize = 6;

    /// Tiles in a row.
    fn across(&self) -> usize {
        self.row_len.div_ceil(self.len)
    }
}

/// One thread's tiles, and the part of the map that they cover.
#[derive(Debug)]
pub struct ThreadTiles<'a> {
    /// First row of the map that the first tile covers.
    pub first_row: usize,
    /// The tiles, counted from the leftmost one in that row.
    pub tiles: Range<usize>,
    /// The outputs that they write.
    pub map: OutputPart<'a>,
    /// This thread's part of the scratch space.
    pub scratch: &'a mut [f32],
}

/// The outputs that consecutive tiles cover.
///
/// ```text
/// other thread's  | head head head     the right ends of the rows of the first tiles
/// body body body body body body body   whole rows
/// tail tail | other thread's           the left ends of the rows of the last tiles
/// ```
#[derive(Debug)]
pub struct OutputPart<'a> {
    tiling: Tiling,
    head: [&'a mut [f32]; Tiling::ROWS],
    body: &'a mut [f32],
    tail: [&'a mut [f32]; Tiling::ROWS],
}

/// The rows that a tile covers, each from the tile's first value on. Missing rows are empty.
#[derive(Debug)]
pub enum TileRows<'a> {
    /// Whole rows of the map, and the distance from one to the next.
    Whole(&'a mut [f32], usize),
    /// Rows that end where another thread's part begins.
    Cut([&'a mut [f32]; Tiling::ROWS]),
}

impl OutputPart<'_> {
    /// Rows of the map that the tiles cover.
    pub fn height(&self) -> usize {
        let shared =
            [&self.head, &self.tail].map(|rows| rows.iter().filter(|row| !row.is_empty()).count());
        self.body.len() / self.tiling.row_len + shared[0] + shared[1]
    }

    /// The rows of the tile in row of tiles `band` and column of tiles `column`, counted as in
    /// [`ThreadTiles::tiles`].
    #[inline(always)]
    pub fn tile(&mut self, band: usize, column: usize) -> TileRows<'_> {
        let Tiling { row_len, rows, len } = self.tiling;
        let (head, first) = (self.head[0].len(), column * len);
        let shared = usize::from(head > 0);
        if band < shared {
            let rows = self.head.each_mut();
            return TileRows::Cut(rows.map(|row| {
                if row.is_empty() {
                    row
                } else {
                    &mut row[head + first - row_len..]
                }
            }));
        }
        let start = (band - shared) * rows * row_len;
        if start < self.body.len() {
            return TileRows::Whole(&mut self.body[start + first..], row_len);
        }
        TileRows::Cut(self.tail.each_mut().map(|row| {
            if row.is_empty() {
                row
            } else {
                &mut row[first..]
            }
        }))
    }
}

impl Threads {
    /// Splits `out` into tiles, equally many per thread, and calls `work` with each thread's. Call
    /// within [`enter`](Self::enter).
    ///
    /// Threads may share a row of tiles, because small maps have only a few: whole rows of tiles
    /// per thread would be uneven.
    ///
    /// Panics if `out` is not whole rows, or a tile has more than [`Tiling::ROWS`] rows.
    pub fn split_tiles(
        &self,
        out: &mut [f32],
        tiling: Tiling,
        scratch: &mut [f32],
        work: impl Fn(ThreadTiles<'_>) + Sync,
    ) {
        let Tiling { row_len, rows, .. } = tiling;
        assert!(
            rows <= Tiling::ROWS && out.len().is_multiple_of(row_len),
            "{tiling:?} in {}",
            out.len()
        );
        let bands = out.len().div_ceil(rows * row_len);
        // No more threads than rows of tiles: then at most two threads share a row.
        let threads = self.count.min(bands);
        let map = OutputPart {
            tiling,
            head: Default::default(),
            body: out,
            tail: Default::default(),
        };
        split_tiles(threads, 0..bands * tiling.across(), map, scratch, &work);
    }
}

/// Splits tiles, their outputs and scratch in two halves, recursively, until each thread has its
/// tiles.
fn split_tiles(
    threads: usize,
    tiles: Range<usize>,
    map: OutputPart<'_>,
    scratch: &mut [f32],
    work: &(impl Fn(ThreadTiles<'_>) + Sync),
) {
    let Tiling { row_len, rows, len } = map.tiling;
    let across = map.tiling.across();
    if threads <= 1 {
        let skipped = tiles.start % across;
        let first_row = tiles.start / across * rows;
        return work(ThreadTiles {
            first_row,
            tiles: skipped..skipped + tiles.len(),
            map,
            scratch,
        });
    }
    // The cut goes through a row of tiles, or between two: `middle` is the first tile of the right
    // half.
    let left = threads / 2;
    let middle = tiles.start + tiles.len() * left / threads;
    let OutputPart {
        tiling,
        head,
        body,
        tail,
    } = map;
    let bands = middle / across - tiles.start.div_ceil(across); // whole rows of tiles on the left
    let (body_a, rest) = body.split_at_mut(bands * rows * row_len);
    let shared = if middle.is_multiple_of(across) {
        0
    } else {
        rows * row_len
    };
    let (band, body_b) = rest.split_at_mut(shared);
    // Each row of the shared row of tiles ends the left part and begins the right one.
    let mut ends = band
        .chunks_exact_mut(row_len)
        .map(|row| row.split_at_mut(middle % across * len));
    let (mut tail_a, mut head_b): ([&mut [f32]; Tiling::ROWS], _) = Default::default();
    for ((tail, head), (a, b)) in tail_a
        .iter_mut()
        .zip::<&mut [&mut [f32]; Tiling::ROWS]>(&mut head_b)
        .zip(&mut ends)
    {
        (*tail, *head) = (a, b);
    }
    let (scratch_a, scratch_b) = scratch.split_at_mut(scratch.len() / threads * left);
    let a = OutputPart {
        tiling,
        head,
        body: body_a,
        tail: tail_a,
    };
    let b = OutputPart {
        tiling,
        head: head_b,
        body: body_b,
        tail,
    };
    rayon::join(
        || split_tiles(left, tiles.start..middle, a, scratch_a, work),
        || split_tiles(threads - left, middle..tiles.end, b, scratch_b, work),
    );
}

/// A set of processor cores, by the system's numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cores([u64; 4]);

impl Cores {
    /// The empty set: threads run where the system puts them.
    pub const ANY: Cores = Cores([0; 4]);

    /// The cores that this process may run on.
    pub fn available() -> Cores {
        let mut cores = Cores::ANY;
        for core in core_affinity::get_core_ids().unwrap_or_default() {
            _ = cores.add(core.id);
        }
        cores
    }

    /// The cores' numbers, in ascending order.
    pub fn ids(self) -> impl Iterator<Item = usize> {
        (0..Threads::MAX).filter(move |id| self.0[id / 64] >> (id % 64) & 1 == 1)
    }

    /// Whether all of these are among `others`.
    pub fn within(self, others: Cores) -> bool {
        self.ids().all(|id| others.0[id / 64] >> (id % 64) & 1 == 1)
    }

    /// Adds core `id`; `None` if it is beyond the largest number.
    fn add(&mut self, id: usize) -> Option<()> {
        *self.0.get_mut(id / 64)? |= 1 << (id % 64);
        Some(())
    }
}

impl std::fmt::Display for Cores {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(
            &self
                .ids()
                .map(|id| id.to_string())
                .collect::<Vec<_>>()
                .join(","),
        )
    }
}

/// Parses a list in the syntax of `taskset`: `0,2,4-7`.
impl FromStr for Cores {
    type Err = String;

    fn from_str(text: &str) -> Result<Cores, String> {
        let parse = || {
            let mut cores = Cores::ANY;
            for part in text.split(',') {
                let (first, last) = part.split_once('-').unwrap_or((part, part));
                let (first, last): (usize, usize) =
                    (first.trim().parse().ok()?, last.trim().parse().ok()?);
                if first > last || last >= Threads::MAX {
                    return None;
                }
                (first..=last).try_for_each(|id| cores.add(id))?;
            }
            Some(cores)
        };
        parse().ok_or_else(|| format!("expected cores as in 2,3 or 4-7, found {text:?}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_on_any_number_of_threads_cover_the_map_evenly_and_once() {
        let (width, height, channels) = (23, 17, 2);
        let tiling = Tiling {
            row_len: width * channels,
            rows: 4,
            len: 5 * channels,
        };
        for count in 1..9 {
            let threads = Threads::new(count);
            let mut out = vec![0.0; height * tiling.row_len];
            let mut scratch = vec![0.0; count];
            let sizes = std::sync::Mutex::new(vec![]);
            threads.enter(|| {
                threads.split_tiles(&mut out, tiling, &mut scratch, |part| {
                    sizes.lock().unwrap().push(part.tiles.len());
                    assert!(part.first_row + part.map.height() <= height);
                    let mut map = part.map;
                    for tile in part.tiles {
                        let (band, column) = (tile / 5, tile % 5);
                        let mut rows: Vec<&mut [f32]> = match map.tile(band, column) {
                            TileRows::Whole(values, row_len) => {
                                values.chunks_mut(row_len).collect()
                            }
                            TileRows::Cut(rows) => rows.into(),
                        };
                        let first = part.first_row + 4 * band;
                        for (row, values) in (first..height.min(first + 4)).zip(&mut rows) {
                            let start = row * tiling.row_len + column * tiling.len;
                            let columns = tiling.len.min(tiling.row_len - column * tiling.len);
                            for (x, value) in values[..columns].iter_mut().enumerate() {
                                *value = (start + x) as f32;
                            }
                        }
                    }
                });
            });
            assert!(
                out.iter().enumerate().all(|(i, value)| *value == i as f32),
                "{count} threads"
            );
            let sizes = sizes.into_inner().unwrap();
            assert_eq!(
                (sizes.len(), sizes.iter().sum::<usize>()),
                (count.min(5), 25)
            );
            assert!(
                sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1,
                "{sizes:?}"
            );
        }
    }

    #[test]
    fn core_lists_parse_and_print_and_bad_ones_are_refused() {
        let cores: Cores = "0,2,4-6".parse().unwrap();
        assert!(cores.ids().eq([0, 2, 4, 5, 6]));
        assert_eq!(cores.to_string(), "0,2,4,5,6");
        assert!(
            "2,5".parse::<Cores>().unwrap().within(cores)
                && !"3".parse::<Cores>().unwrap().within(cores)
        );
        for bad in ["", "a", "3-1", "256", "1,", "-1", "99999999999999999999"] {
            assert!(bad.parse::<Cores>().is_err(), "{bad}");
        }
    }

    #[test]
    fn pinned_threads_stay_on_their_cores() {
        let all: Vec<usize> = Cores::available().ids().collect();
        let Some(last) = all.last() else { return };
        let only: Cores = last.to_string().parse().unwrap();
        for count in [1, 2] {
            let threads = Threads::pinned(count, only);
            assert_eq!(threads.count(), count);
            let found = threads.enter(|| rayon::broadcast(|_| Cores::available()));
            assert!(
                found.iter().all(|cores| *cores == only),
                "{count} threads: {found:?}"
            );
        }
        assert!(
            Cores::available().ids().eq(all),
            "the caller's own thread is not pinned"
        );
    }

    #[test]
    fn as_many_threads_as_cores_are_pinned_to_one_each() {
        let all: Vec<usize> = Cores::available().ids().collect();
        if all.len() < 2 {
            return;
        }
        let found = Threads::pinned(all.len(), Cores::ANY)
            .enter(|| rayon::broadcast(|_| Cores::available()));
        let mut held: Vec<usize> = found.into_iter().flat_map(Cores::ids).collect();
        held.sort_unstable();
        assert_eq!(held, all);
    }

    #[test]
    fn rows_on_any_number_of_threads_are_worked_on_once() {
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
    fn independent_jobs_share_all_threads() {
        for threads in [1, 2, 3, 8] {
            let all = Threads::new(threads);
            let (mut a, mut b) = (vec![0; 4], vec![0; 4]);
            let mut counts = [0, 0];
            let [first, second] = &mut counts;
            let add = |row: usize, factor: usize, values: &mut [usize]| {
                values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, value)| *value += factor * (row + i));
            };
            all.enter(|| {
                all.both(
                    [&mut a, &mut b],
                    |threads, buffer| {
                        threads.split_rows_with(buffer, 1, 1, &mut [], |row, values, _| {
                            add(row, 1, values)
                        });
                        *first = threads.count();
                    },
                    |threads, buffer| {
                        threads.split_rows_with(buffer, 1, 1, &mut [], |row, values, _| {
                            add(row, 10, values)
                        });
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
    fn zero_threads_become_one() {
        assert_eq!(Threads::new(0).count(), 1);
    }
}
