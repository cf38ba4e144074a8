//! `serve` and `replay`: the tracker inside the live program of the crate `station`.
//!
//! | file | what happens there |
//! |---|---|
//! | `args.rs` | both command lines |
//! | `config.rs` | options out of a file |
//! | `engine.rs` | the tracker, run the same way by both |
//! | `feed.rs` | which input is read how |
//! | `pick.rs` | a box drawn by hand, for `track` |
//! | `video.rs` | the video with boxes, of `track` as well |
//! | `replay.rs` | a flight log done again, box for box |

pub mod args;
pub mod config;
mod engine;
mod feed;
pub mod pick;
pub mod replay;
pub mod video;

use station::commands::Place;
use station::{Engine, Station};
use track_cpu::{BBox, TrackError};

use crate::exit::Failure;
use crate::follow::note_flight;
use args::ServeArgs;
use engine::TrackerEngine;

/// Runs `serve`.
pub fn run(args: &ServeArgs) -> Result<(), Failure> {
    // Refused at the start, even where a client could name another target.
    if let Some(&BBox { x, y, w, h }) = args.init.iter().find(|bbox| bbox.is_in_shares()) {
        return Err(TrackError::Shares { x, y, w, h }.into());
    }
    let (given, room) = (args.init.len(), args.targets);
    if given > room {
        let reason = format!("{given} boxes, expected no more than --targets, which is {room}");
        return Err(station::Error::Refused(reason).into());
    }
    if args.input.as_os_str() == "-" && args.commands.contains(&Place::Stdin) {
        let reason = "standard input holds the frames, expected another place";
        return Err(station::Error::output("--commands -", reason).into());
    }
    let model = args.engine.model(args.model.name())?;
    note_flight(&model, &args.engine, args.mode);
    let (feed, repeats) = feed::open(args).map_err(station::Error::Source)?;
    let options = args.options(&model, repeats);
    let mut engines: Vec<Box<dyn Engine>> = Vec::new();
    for _ in 0..args.targets {
        let model = model.clone(); // shares the weights
        let engine = TrackerEngine::new(model, &args.engine, args.mode, &args.threshold)?;
        engines.push(Box::new(engine));
    }
    let station = Station::new(options);
    let stop = station.stopper();
    ctrlc::set_handler(stop).map_err(|error| station::Error::output("signals", error))?;
    Ok(station.run(engines, feed)?)
}
