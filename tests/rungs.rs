//! Every instruction set, in both precisions, gives the golden boxes of a rendered sequence.
//!
//! The boxes in `golden/rungs.txt` are those of the portable kernels in `f32`. `UPDATE_GOLDEN=1`
//! rewrites them, as a change of the built-in model needs. `RUNGS_FRAMES`, `RUNGS_PRECISION`
//! and `RUNGS_ISA` shorten the run for emulators.

use std::path::Path;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Precision, Tracker};

const FRAMES: usize = 12;
const SIZE: (usize, usize) = (320, 240);

/// The target's box in frame `i`: it moves and grows.
fn target(i: usize) -> BBox {
    let n = i as f32;
    BBox::new(90.0 + 6.0 * n, 70.0 + 3.0 * n, 40.0 + n, 26.0 + 0.5 * n)
}

/// Frame `i`: a block with a bright stripe on fixed ground.
///
/// Made of whole numbers only, so that it is the same on every machine.
fn picture(i: usize) -> Vec<u8> {
    let BBox { x, y, w, h } = target(i);
    let cx = (x + w / 2.0) as i32;
    let cy = (y + h / 2.0) as i32;
    let half_w = (w / 2.0) as i32;
    let half_h = (h / 2.0) as i32;
    let mut rgb = Vec::with_capacity(3 * SIZE.0 * SIZE.1);
    for y in 0..SIZE.1 as i32 {
        for x in 0..SIZE.0 as i32 {
            let noise = (x * 7919 + y * 104_729 + x * y * 31) % 23;
            let u = x - cx;
            let v = y - cy;
            let inside = u.abs() <= half_w && v.abs() <= half_h;
            let stripe = (half_w / 4..=half_w / 2).contains(&u);
            let furrow = if (x + 2 * y) % 24 < 12 { 0 } else { 14 };
            let color = if inside && stripe {
                [230, 220, 210]
            } else if inside {
                [200 - 2 * v.abs(), 50 + noise / 4, 40]
            } else {
                [70 + furrow + noise, 112 + furrow + noise, 90 + noise]
            };
            rgb.extend(color.map(|c| c as u8));
        }
    }
    rgb
}

/// The boxes of the first `frames` frames.
fn follow(isa: Isa, precision: Precision, frames: usize) -> Vec<BBox> {
    let model = Model::with_precision(&Model::builtin_weights(), isa, precision).unwrap();
    let mut tracker = Tracker::new(model);
    (0..frames)
        .map(|i| {
            let rgb = picture(i);
            let frame = Frame::new(&rgb, SIZE.0, SIZE.1, ChannelOrder::Rgb).unwrap();
            if i == 0 {
                tracker.init(&frame, target(0)).unwrap();
                return target(0);
            }
            tracker.update(&frame).unwrap().bbox
        })
        .collect()
}

/// The golden boxes; `UPDATE_GOLDEN=1` writes them first.
fn golden() -> Vec<BBox> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/rungs.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let line = |b: BBox| format!("{:.3},{:.3},{:.3},{:.3}\n", b.x, b.y, b.w, b.h);
        let boxes = follow(Isa::available()[0], Precision::F32, FRAMES);
        std::fs::write(&path, boxes.into_iter().map(line).collect::<String>()).unwrap();
    }
    let parse = |line: &str| {
        let n: Vec<f32> = line.split(',').map(|n| n.parse().unwrap()).collect();
        BBox::new(n[0], n[1], n[2], n[3])
    };
    let text = std::fs::read_to_string(&path).unwrap();
    text.lines().map(parse).collect()
}

/// Number of frames, precisions and instruction sets to test, as the environment asks.
fn asked() -> (usize, Vec<Precision>, Vec<Isa>) {
    let frames = std::env::var("RUNGS_FRAMES").map_or(FRAMES, |n| n.parse().unwrap());
    let precisions = match std::env::var("RUNGS_PRECISION") {
        Ok(name) => vec![Precision::from_name(&name).unwrap()],
        Err(_) => vec![Precision::F32, Precision::Int8],
    };
    let rungs = match std::env::var("RUNGS_ISA") {
        Ok(name) => vec![Isa::from_name(&name).unwrap()],
        Err(_) => Isa::available(),
    };
    (frames.clamp(2, FRAMES), precisions, rungs)
}

#[test]
fn golden_boxes_are_on_the_target() {
    let golden = golden();

    assert_eq!(golden.len(), FRAMES);
    for (i, bbox) in golden.iter().enumerate() {
        assert!(bbox.iou(&target(i)) > 0.6, "frame {i}: {bbox:?}");
    }
}

#[test]
fn boxes_on_every_isa_and_precision_are_the_golden_ones() {
    let golden = golden();
    let (frames, precisions, rungs) = asked();
    for isa in rungs {
        for precision in &precisions {
            let least = match precision {
                Precision::F32 => 0.99,
                Precision::Int8 => 0.9,
            };

            let found = follow(isa, *precision, frames);

            let ious = found.iter().zip(&golden).map(|(a, b)| a.iou(b));
            let worst = ious.fold(f32::INFINITY, f32::min);
            let name = precision.name();
            println!("{isa} {name}: lowest IoU {worst:.4} over {frames} frames");
            assert!(worst >= least, "{isa} {name}: lowest IoU {worst}");
        }
    }
}
