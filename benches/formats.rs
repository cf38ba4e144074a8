//! Times `update` on frames of a camera's format: median milliseconds where the frame is read in
//! place, and where it is converted to RGB first.
//!
//! ```text
//! cargo bench --bench formats [-- MODEL]
//! ```
//!
//! Rendered frames lie in memory; both ways take turns on each of them.

use scenes::{Flight, FlightConfig, FrameBuffer};
use std::time::Instant;
use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};

/// Frames of a clip, which is shown forwards and backwards in turn.
const FRAMES: usize = 8;

/// Updates per row, after a tenth as many to warm up.
const UPDATES: usize = 60;

struct Clip {
    width: usize,
    height: usize,
    rgb: Vec<FrameBuffer>,
    target: BBox,
}

impl Clip {
    fn render(width: usize, height: usize) -> Clip {
        let flight = Flight::new(FlightConfig {
            width,
            height,
            frames: FRAMES,
            ..FlightConfig::default()
        });
        let mut rgb = vec![FrameBuffer::default(); FRAMES];
        let truths = rgb.iter_mut().enumerate();
        let truths: Vec<_> = truths.map(|(i, frame)| flight.render(i, frame)).collect();
        let first = truths[0].bbox;
        Clip {
            width,
            height,
            rgb,
            target: BBox::new(first.x, first.y, first.w, first.h),
        }
    }

    /// The frames in an order; chroma comes from the first pixel that shares it.
    fn frames(&self, order: ChannelOrder) -> Vec<Vec<u8>> {
        let frames = self.rgb.iter().map(|frame| &frame.data);
        match order {
            ChannelOrder::Nv12 => frames.map(|rgb| self.nv12(rgb)).collect(),
            ChannelOrder::Yuyv => frames.map(|rgb| yuyv(rgb)).collect(),
            _ => frames.cloned().collect(),
        }
    }

    fn nv12(&self, rgb: &[u8]) -> Vec<u8> {
        let mut out: Vec<u8> = rgb.chunks_exact(3).map(|pixel| yuv(pixel)[0]).collect();
        for row in rgb.chunks_exact(3 * self.width).step_by(2) {
            out.extend(row.chunks_exact(6).flat_map(|pair| yuv(pair)[1..].to_vec()));
        }
        out
    }
}

fn yuyv(rgb: &[u8]) -> Vec<u8> {
    let group = |pair: &[u8]| {
        let ([y0, u, v], [y1, ..]) = (yuv(pair), yuv(&pair[3..]));
        [y0, u, y1, v]
    };
    rgb.chunks_exact(6).flat_map(group).collect()
}

/// BT.601, limited range.
fn yuv(rgb: &[u8]) -> [u8; 3] {
    let [r, g, b] = [0, 1, 2].map(|i| i32::from(rgb[i]));
    [
        (66 * r + 129 * g + 25 * b + 4224) >> 8,
        (-38 * r - 74 * g + 112 * b + 32896) >> 8,
        (112 * r - 94 * g - 18 * b + 32896) >> 8,
    ]
    .map(|value| value as u8)
}

enum Mode {
    Plain(Box<Tracker>),
    Flight(Box<FlightTracker>),
}

impl Mode {
    fn init(&mut self, frame: &Frame<'_>, target: BBox) {
        match self {
            Mode::Plain(tracker) => tracker.init(frame, target),
            Mode::Flight(tracker) => tracker.init(frame, target),
        }
        .expect("a target in its frame");
    }

    fn update(&mut self, frame: &Frame<'_>) -> BBox {
        match self {
            Mode::Plain(tracker) => tracker.update(frame).map(|track| track.bbox),
            Mode::Flight(tracker) => {
                let track = tracker.update(frame, Budget::Searches(2));
                track.map(|track| track.bbox)
            }
        }
        .expect("a target")
    }
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Milliseconds of init and update in place, and of update behind a conversion.
fn measure(clip: &Clip, order: ChannelOrder, make: impl Fn() -> Mode) -> [f64; 3] {
    let data = clip.frames(order);
    let frame = |i: usize| {
        let at = i % (2 * FRAMES - 2);
        let bytes = &data[at.min(2 * FRAMES - 2 - at)];
        Frame::new(bytes, clip.width, clip.height, order).expect("a frame of its size")
    };
    let (mut lent, mut converted) = (make(), make());
    let mut inits = Vec::new();
    for _ in 0..5 {
        let start = Instant::now();
        lent.init(&frame(0), clip.target);
        inits.push(1e3 * start.elapsed().as_secs_f64());
    }
    converted.init(&frame(0), clip.target);
    let (mut in_place, mut behind) = (Vec::new(), Vec::new());
    for i in 1..=UPDATES + UPDATES / 10 {
        let start = Instant::now();
        let found = lent.update(&frame(i));
        let first = 1e3 * start.elapsed().as_secs_f64();

        let start = Instant::now();
        let rgb = frame(i).to_rgb();
        let rgb = Frame::new(&rgb, clip.width, clip.height, ChannelOrder::Rgb);
        let expected = converted.update(&rgb.expect("a frame of its size"));
        let second = 1e3 * start.elapsed().as_secs_f64();

        assert_eq!(found, expected, "boxes of frame {i} in {order:?}");
        if i > UPDATES / 10 {
            in_place.push(first);
            behind.push(second);
        }
    }
    [inits, in_place, behind].map(median)
}

fn main() {
    let args: Vec<String> = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with("--"))
        .collect();
    println!(
        "{:10} {:7} {:10} {:5} {:>8} {:>9} {:>10}",
        "model", "mode", "size", "order", "init ms", "update ms", "converted"
    );
    let orders = [ChannelOrder::Rgb, ChannelOrder::Nv12, ChannelOrder::Yuyv];
    for (width, height) in [(1280, 720), (1920, 1080), (3840, 2160)] {
        let clip = Clip::render(width, height);
        for name in ["drmim-p50", "drmim-p75"] {
            if !args.is_empty() && !args.iter().any(|argument| argument == name) {
                continue;
            }
            let weights = Model::find(Some(name.as_ref())).expect("a built-in model");
            let model =
                Model::from_weights(&weights, Isa::detect()).expect("the built-in model runs");
            for mode in ["plain", "flight"] {
                for order in orders {
                    let [init, update, converted] = measure(&clip, order, || match mode {
                        "plain" => Mode::Plain(Box::new(Tracker::new(model.clone()))),
                        _ => {
                            let options = FlightOptions::new(&model);
                            let tracker = FlightTracker::new(model.clone(), options);
                            Mode::Flight(Box::new(tracker.expect("the default options")))
                        }
                    });
                    let size = format!("{width}x{height}");
                    let order = format!("{order:?}");
                    println!(
                        "{name:10} {mode:7} {size:10} {order:5} {init:8.2} {update:9.2} \
                         {converted:10.2}"
                    );
                }
            }
        }
    }
}
