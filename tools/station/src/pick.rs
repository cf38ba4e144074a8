//! A box drawn by hand: one picture on a web page of this machine, until a box is drawn in it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::command::{Command, Outcome};
use crate::error::Error;
use crate::http::{self, HttpOptions};
use crate::hub::{Hub, Limits};
use crate::picture::{FrameBox, Picture};
use crate::report::Report;
use crate::say::say;

/// Time between two checks for a box; the picture is as new as the last check.
const TICK: Duration = Duration::from_millis(100);
/// How long the page may take to show the end.
const LINGER: Duration = Duration::from_millis(200);

/// Shows a picture until a box is drawn in it that `accept` does not refuse, and returns that box.
///
/// Only this machine can reach the page, at an address with a token, which is written to standard
/// error and given to `show`.
///
/// # Errors
/// If the page cannot be served.
pub fn pick(
    picture: &Picture,
    show: impl FnOnce(&str),
    mut accept: impl FnMut(FrameBox) -> Result<(), String>,
) -> Result<FrameBox, Error> {
    let hub = Arc::new(Hub::new(Limits::default()));
    let options = HttpOptions {
        address: Some("127.0.0.1:0".into()),
        ..HttpOptions::default()
    };
    let page = http::start(&options, &hub)?;
    say!("draw a box around the target on that page");
    if let Some(page) = &page {
        show(&page.url);
    }
    let publish = || {
        let report = Report {
            size: picture.size(),
            room: 1,
            taken: Some(Instant::now()),
            ..Report::default()
        };
        hub.publish(report, picture);
    };
    let drawn = loop {
        hub.tell(|pulse| pulse.frame(Instant::now()));
        publish();
        std::thread::sleep(TICK);
        let mut drawn = None;
        for pending in hub.take_commands(true) {
            let outcome = match pending.command {
                Command::Stop { .. } => Ok(Outcome::Done),
                Command::Start { target, .. } => target.in_frame(picture.size()).and_then(|bbox| {
                    accept(bbox)?;
                    drawn = Some(bbox);
                    Ok(Outcome::Started(1))
                }),
            };
            pending.resolve(outcome.unwrap_or_else(Outcome::Refused));
        }
        if let Some(drawn) = drawn {
            break drawn;
        }
    };
    hub.tell(|pulse| pulse.ended());
    publish();
    std::thread::sleep(LINGER);
    hub.stop();
    Ok(drawn)
}
