//! Every rung of the ladder of instruction sets, in both precisions, follows a golden sequence to the same boxes.
//!
//! The boxes in `golden/rungs.txt` are those of the portable kernels in `f32`; `UPDATE_GOLDEN=1` writes them anew (after
//! another model was built in). `RUNGS_FRAMES`, `RUNGS_PRECISION` and `RUNGS_ISA` make the run shorter, for emulators.

use std::path::Path;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Precision, Tracker};

const FRAMES: usize = 12;
const SIZE: (usize, usize) = (320, 240);

/// The target in frame `i`: it moves and grows.
fn target(i: usize) -> BBox {
    let n = i as f32;
    BBox::new(90.0 + 6.0 * n, 70.0 + 3.0 * n, 40.0 + n, 26.0 + 0.5 * n)
}

/// Frame `i`, made of whole numbers only, so that it is the same on every machine: a block with a bright stripe on ground that
/// stays where it is.
fn picture(i: usize) -> Vec<u8> {
    let BBox { x, y, w, h } = target(i);
    let (cx, cy) = ((x + w / 2.0) as i32, (y + h / 2.0) as i32);
    let (half_w, half_h) = ((w / 2.0) as i32, (h / 2.0) as i32);
    let mut rgb = Vec::with_capacity(3 * SIZE.0 * SIZE.1);
    for y in 0..SIZE.1 as i32 {
        for x in 0..SIZE.0 as i32 {
            let noise = (x * 7919 + y * 104_729 + x * y * 31) % 23;
            let (u, v) = (x - cx, y - cy);
            rgb.extend(
                match u.abs() <= half_w && v.abs() <= half_h {
                    true if (half_w / 4..=half_w / 2).contains(&u) => [230, 220, 210],
                    true => [200 - 2 * v.abs(), 50 + noise / 4, 40],
                    false => {
                        let furrow = if (x + 2 * y) % 24 < 12 { 0 } else { 14 };
                        [70 + furrow + noise, 112 + furrow + noise, 90 + noise]
                    }
                }
                .map(|c| c as u8),
            );
        }
    }
    rgb
}

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

#[test]
fn same_boxes_on_every_rung() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/rungs.txt");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        let line = |b: BBox| format!("{:.3},{:.3},{:.3},{:.3}\n", b.x, b.y, b.w, b.h);
        let boxes = follow(Isa::available()[0], Precision::F32, FRAMES);
        std::fs::write(&path, boxes.into_iter().map(line).collect::<String>()).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    let golden: Vec<BBox> = text
        .lines()
        .map(|line| {
            let n: Vec<f32> = line.split(',').map(|n| n.parse().unwrap()).collect();
            BBox::new(n[0], n[1], n[2], n[3])
        })
        .collect();
    assert_eq!(golden.len(), FRAMES);
    for (i, bbox) in golden.iter().enumerate() {
        assert!(
            bbox.iou(&target(i)) > 0.6,
            "frame {i}: the golden box {bbox:?} is off the target"
        );
    }
    let frames = std::env::var("RUNGS_FRAMES")
        .map_or(FRAMES, |n| n.parse().unwrap())
        .clamp(2, FRAMES);
    let only = std::env::var("RUNGS_PRECISION").ok();
    let rungs = match std::env::var("RUNGS_ISA") {
        Ok(name) => vec![Isa::from_name(&name).unwrap()],
        Err(_) => Isa::available(),
    };
    for isa in rungs {
        for precision in [Precision::F32, Precision::Int8] {
            if only.as_ref().is_some_and(|only| only != precision.name()) {
                continue;
            }
            let least = if precision == Precision::F32 {
                0.99
            } else {
                0.9
            };
            let worst = follow(isa, precision, frames)
                .iter()
                .zip(&golden)
                .map(|(found, golden)| found.iou(golden))
                .fold(f32::INFINITY, f32::min);
            println!(
                "{isa} {}: lowest IoU with the golden boxes {worst:.4} over {frames} frames",
                precision.name()
            );
            assert!(
                worst >= least,
                "{isa} {}: IoU {worst} with the golden boxes",
                precision.name()
            );
        }
    }
}
