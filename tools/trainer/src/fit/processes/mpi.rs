//! MPI: moves bytes between the processes that `mpirun` or `srun` started.
//!
//! `MPI_Allgather` and `MPI_Alltoall` compute nothing, so they promise the same bytes in every run;
//! `MPI_Allreduce` does not promise an order of its sums.

use crate::error::Error;
use autodiff::ProcessGroup;
use mpi::Threading;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator, CommunicatorCollectives};
use std::mem::ManuallyDrop;
use std::sync::Arc;

/// All processes that MPI started.
#[derive(Debug)]
struct World {
    rank: usize,
    size: usize,
}

impl ProcessGroup for World {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn gather(&self, own: &[u8], all: &mut [u8]) {
        SimpleCommunicator::world().all_gather_into(own, all);
    }

    fn exchange(&self, own: &[u8], received: &mut [u8]) {
        SimpleCommunicator::world().all_to_all_into(own, received);
    }
}

/// Calls `work` with the processes that MPI started; this one alone if it was started without.
///
/// An error in one of several processes is printed, and ends all of them with the exit code that
/// `code` gives.
///
/// # Errors
/// Those of `work` in a single process; if this process has joined before.
pub fn join<T>(
    code: impl FnOnce(&Error) -> u8,
    work: impl FnOnce(Arc<dyn ProcessGroup>) -> Result<T, Error>,
) -> Result<T, Error> {
    // Only the thread that runs the loop calls MPI; others compute and make samples.
    let (universe, _) = mpi::initialize_with_threading(Threading::Funneled)
        .ok_or_else(|| Error::option("train fit", "one run per process", "another one"))?;
    // Leaving MPI waits for all processes. After a panic the others would wait, too, forever: this
    // process ends without leaving, which makes MPI end the others.
    let universe = ManuallyDrop::new(universe);
    let world = SimpleCommunicator::world();
    let [rank, size] = [world.rank(), world.size()].map(|n| n as usize);
    let done = work(Arc::new(World { rank, size }));
    if let Err(error) = &done
        && size > 1
    {
        eprintln!("error: process {rank} of {size}: {error}");
        world.abort(code(error).into());
    }
    drop(ManuallyDrop::into_inner(universe));
    done
}
