//! `ope render`.

use crate::args::RenderArgs;
use ope::Error;
use ope::render::Flights;

/// Writes rendered flights as a benchmark.
pub fn run(args: &RenderArgs) -> Result<(), Error> {
    let flights = Flights {
        seed: args.seed,
        count: args.count,
        frames: args.frames,
        size: args.size,
        difficulty: args.difficulty,
    };
    flights.write(&args.out, |line| eprintln!("{line}"))
}
