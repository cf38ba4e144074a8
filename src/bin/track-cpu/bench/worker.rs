//! `bench worker`: the network pass alone, driven from outside.
//!
//! Protocol: `READY` on a line. Then, for each line `N` on standard input, N passes, and on one
//! line N times in milliseconds, flushed.

use std::io::{BufRead, Write};
use std::time::Instant;

use kernels::par::Threads;
use track_cpu::net::Network;
use track_cpu::source::SourceError;

use crate::args::bench::NetworkArgs;
use crate::exit::Failure;

/// Most passes that one line may ask for.
const MAX_PASSES: usize = 1_000_000;

/// Serves until standard input ends.
pub fn run(args: &NetworkArgs) -> Result<(), Failure> {
    let model = super::model(args)?;
    let template_side = model.architecture().template_size;
    let search_side = model.architecture().search_size;
    let mut network = Network::with_threads(
        model,
        Threads::pinned(args.engine.threads, args.engine.cores()),
    );
    network.set_template(&noise(template_side));
    let crop = noise(search_side);
    for _ in 0..8 {
        network.search(&crop);
    }
    let mut out = std::io::stdout();
    let stdout = |error| Failure::stdout(&error);
    writeln!(out, "READY").map_err(stdout)?;
    for line in std::io::stdin().lock().lines() {
        let line = line.map_err(|error| SourceError::Io {
            path: "standard input".into(),
            error,
        })?;
        let passes = line
            .trim()
            .parse()
            .ok()
            .filter(|passes| *passes <= MAX_PASSES)
            .ok_or_else(|| {
                let reason =
                    format!("expected a number of passes up to {MAX_PASSES}, found {line:?}");
                SourceError::Format {
                    input: "standard input".into(),
                    reason,
                }
            })?;
        let time = |_| {
            let started = Instant::now();
            network.search(&crop);
            format!("{:.4}", started.elapsed().as_secs_f64() * 1e3)
        };
        let times: Vec<String> = (0..passes).map(time).collect();
        writeln!(out, "{}", times.join(" ")).map_err(stdout)?;
        out.flush().map_err(stdout)?;
    }
    Ok(())
}

/// A crop of `[side, side, 3]` pseudo-random pixels, the same every time.
fn noise(side: usize) -> Vec<u8> {
    let mut state = 1u32;
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    (0..3 * side * side).map(|_| next()).collect()
}
