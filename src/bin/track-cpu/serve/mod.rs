//! `serve` and `replay`: the tracker inside the live program of the crate `station`.
//!
//! | file | what happens there |
//! |---|---|
//! | `args.rs` | both command lines |
//! | `engine.rs` | the tracker, run the same way by both |
//! | `feed.rs` | which input is read how |
//! | `replay.rs` | a flight log done again, box for box |

pub mod args;
mod engine;
mod feed;
pub mod replay;

use station::Station;

use crate::exit::Failure;
use crate::follow::check_pixels;
use args::ServeArgs;
use engine::TrackerEngine;

/// Runs `serve`.
pub fn run(args: &ServeArgs) -> Result<(), Failure> {
    if let Some(bbox) = args.init {
        check_pixels(bbox)?;
    }
    let model = args.engine.model(args.model.name())?;
    let (feed, repeats) = feed::open(args).map_err(station::Error::Source)?;
    let options = args.options(&model, repeats);
    let mut engine = TrackerEngine::new(model, &args.engine, args.mode, &args.threshold)?;
    let station = Station::new(options);
    let stop = station.stopper();
    ctrlc::set_handler(stop).map_err(|error| station::Error::output("signals", error))?;
    Ok(station.run(&mut engine, feed)?)
}
