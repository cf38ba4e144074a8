//! A stand-in for the tracking thread of a live station.

use std::sync::Arc;
use std::time::{Duration, Instant};

use station::{Command, Followed, Hub, Limits, Order, Outcome, Picture, Report, Tracked};

/// Width and height of its frames.
const SIZE: (usize, usize) = (64, 48);
/// Time between frames.
const PERIOD: Duration = Duration::from_millis(5);

/// A hub whose commands are carried out, and whose target is where the last one said.
pub fn hub() -> Arc<Hub> {
    let hub = Arc::new(Hub::new(Limits::default()));
    let kept = Arc::clone(&hub);
    std::thread::spawn(move || track(&hub));
    kept
}

fn track(hub: &Hub) {
    let (width, height) = SIZE;
    let picture = Picture {
        data: vec![90; 3 * width * height],
        width,
        height,
        order: Order::Rgb,
    };
    let mut target = None;
    for frame in 0.. {
        hub.tell(|pulse| pulse.frame(Instant::now()));
        for pending in hub.take_commands(true) {
            let outcome = match pending.command {
                Command::Stop { .. } => {
                    target = None;
                    Outcome::Done
                }
                Command::Start { target: asked, .. } => match asked.in_frame(SIZE) {
                    Ok(bbox) => {
                        target = Some(Followed {
                            id: 1,
                            start: frame,
                            track: Tracked::certain(bbox),
                        });
                        Outcome::Started(1)
                    }
                    Err(reason) => Outcome::Refused(reason),
                },
            };
            pending.resolve(outcome);
        }
        let report = Report {
            frame,
            size: SIZE,
            room: 2,
            targets: target.iter().cloned().collect(),
            taken: Some(Instant::now()),
            ..Report::default()
        };
        hub.publish(report, &picture);
        std::thread::sleep(PERIOD);
    }
}
