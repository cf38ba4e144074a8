// The parts of the program that talk to a network, and a stand-in for its tracking thread.

#[path = "../../../src/bin/track-cpu/exit.rs"]
mod exit;
#[path = "../../../src/bin/track-cpu/font.rs"]
mod font;
#[path = "../../../src/bin/track-cpu/overlay.rs"]
mod overlay;
#[path = "../../../src/bin/track-cpu/report.rs"]
mod report;
#[path = "../../../src/bin/track-cpu/serve"]
mod serve {
    pub mod http;
    pub mod hub;
    pub mod mavlink;
    pub mod report;
}

use serve::hub::Hub;
use std::sync::Arc;

/// A hub whose commands are taken and whose target is where the last one said.
fn hub() -> Arc<Hub> {
    let hub = Arc::new(Hub::new());
    let kept = Arc::clone(&hub);
    std::thread::spawn(move || {
        let (width, height) = (64, 48);
        let order = track_cpu::ChannelOrder::Rgb;
        let image =
            track_cpu::source::Image { data: vec![90; 3 * width * height], width, height, order, name: None };
        let mut target = None;
        for frame in 0.. {
            for command in hub.take_commands() {
                target = command.bbox(&image.frame());
            }
            let state = track_cpu::State::Tracking;
            let track = target.map(|bbox| serve::report::Tracked {
                bbox,
                presence: Some(0.9),
                score: 0.8,
                state,
                searches: 1,
                candidates: Vec::new(),
            });
            let report = serve::report::Report { frame, size: (width, height), track, ..Default::default() };
            hub.publish(report, &image);
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
    });
    kept
}
