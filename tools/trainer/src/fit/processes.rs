//! The processes of a run: one, or those that MPI started. Only this module and `mpi.rs` below it
//! know which.
//!
//! Each process draws its part of every batch ([`Part`](crate::data::feed::Part)), and all update
//! their parameters alike, by gradients of the whole batch. The first one alone writes files,
//! validates and prints.

#[cfg(feature = "mpi")]
mod mpi;

#[cfg(feature = "mpi")]
pub use self::mpi::join;

use super::Fit;
use crate::data::Dataset;
use crate::error::Error;
use autodiff::Compute;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Calls `work` with the processes of this run. With MPI, an error in one process ends all of them,
/// with the exit code that `code` gives.
///
/// # Errors
/// Those of `work`; if MPI started this program, which was built without it.
#[cfg(not(feature = "mpi"))]
pub fn join<T>(
    _code: impl FnOnce(&Error) -> u8,
    work: impl FnOnce(std::sync::Arc<dyn autodiff::ProcessGroup>) -> Result<T, Error>,
) -> Result<T, Error> {
    for name in ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"] {
        if let Some(size) = std::env::var(name).ok().filter(|size| size != "1") {
            let expected = format!("a program built with --features mpi for {size} processes");
            return Err(Error::option("mpirun", expected, "one without"));
        }
    }
    work(std::sync::Arc::new(autodiff::OneProcess))
}

/// Refuses a run that would not be the same in all processes: other options, weights, data or
/// instruction sets than the first process's. All processes return the same verdict, and none
/// before all have called.
///
/// # Errors
/// Names a process and what differs.
pub fn agree(fit: &Fit, dataset: &Dataset, compute: &Compute) -> Result<(), Error> {
    if compute.processes().size() == 1 {
        return Ok(());
    }
    let hash = |write: &dyn Fn(&mut DefaultHasher)| {
        let mut hasher = DefaultHasher::new();
        write(&mut hasher);
        hasher.finish()
    };
    let size = fit.position.options.architecture.search_size;
    let parts = [
        ("options", hash(&|h| format!("{:?}", fit.position).hash(h))),
        (
            "weights",
            hash(&|h| {
                for (name, value) in fit.parameters.state() {
                    name.hash(h);
                    value.data().iter().for_each(|v| v.to_bits().hash(h));
                }
            }),
        ),
        (
            "data",
            hash(&|h| {
                for index in 0..4 {
                    let sample = dataset.sample(index, size);
                    (sample.template, sample.search).hash(h);
                }
            }),
        ),
        ("instruction set", hash(&|h| compute.isa().name().hash(h))),
    ];
    let all = compute.processes().all(&parts.map(|(_, hash)| hash));
    let (first, others) = all.split_at(parts.len());
    for (rank, other) in others.chunks_exact(parts.len()).enumerate() {
        for ((what, _), (first, other)) in parts.iter().zip(first.iter().zip(other)) {
            if first != other {
                let process = format!("process {}", rank + 1);
                return Err(Error::option(
                    &process,
                    format!("the {what} of process 0"),
                    "others",
                ));
            }
        }
    }
    Ok(())
}
