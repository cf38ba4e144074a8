//! Writes contact sheets of flights with their boxes drawn: `gallery DIR [--speed] [FIRST_SEED
//! COUNT [DIFFICULTY]]`.
//!
//! Each sheet shows one seed per row and six frames of its flight. `--speed` prints set-up times
//! and frames per second of one core's time instead.

use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use image::{Rgb, RgbImage};
use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer, TruthBox};

const COLUMNS: usize = 3;

fn outline(
    image: &mut RgbImage,
    b: &TruthBox,
    origin: (u32, u32),
    size: (u32, u32),
    color: [u8; 3],
) {
    let (x0, y0) = (b.x.round() as i64 - 1, b.y.round() as i64 - 1);
    let (x1, y1) = ((b.x + b.w).round() as i64, (b.y + b.h).round() as i64);
    let mut dot = |x: i64, y: i64| {
        if x >= 0 && y >= 0 && x < i64::from(size.0) && y < i64::from(size.1) {
            image.put_pixel(origin.0 + x as u32, origin.1 + y as u32, Rgb(color));
        }
    };
    for x in x0.max(-1)..=x1.min(i64::from(size.0)) {
        dot(x, y0);
        dot(x, y1);
    }
    for y in y0.max(-1)..=y1.min(i64::from(size.1)) {
        dot(x0, y);
        dot(x1, y);
    }
}

fn config(seed: u64, difficulty: Difficulty) -> FlightConfig {
    FlightConfig {
        seed,
        difficulty,
        ..Default::default()
    }
}

fn sheet(seeds: &[u64], difficulty: Difficulty, path: &Path) -> image::ImageResult<()> {
    let base = FlightConfig::default();
    let (w, h) = (base.width as u32, base.height as u32);
    let mut image = RgbImage::new(w * COLUMNS as u32, h * seeds.len() as u32);
    let mut frame = FrameBuffer::default();
    for (row, &seed) in seeds.iter().enumerate() {
        let flight = Flight::new(config(seed, difficulty));
        println!(
            "{}: seed {seed}, {:?}, {:?}",
            path.display(),
            flight.biome(),
            flight.target()
        );
        for column in 0..COLUMNS {
            let truth = flight.render(column * (flight.len() - 1) / COLUMNS.max(2), &mut frame);
            let origin = (column as u32 * w, row as u32 * h);
            for (at, pixel) in frame.data.chunks_exact(3).enumerate() {
                let (x, y) = (at as u32 % w, at as u32 / w);
                image.put_pixel(
                    origin.0 + x,
                    origin.1 + y,
                    Rgb([pixel[0], pixel[1], pixel[2]]),
                );
            }
            for b in &truth.distractors {
                outline(&mut image, b, origin, (w, h), [240, 190, 60]);
            }
            let color = if truth.visible > 0.5 {
                [60, 240, 90]
            } else {
                [250, 60, 60]
            };
            outline(&mut image, &truth.bbox, origin, (w, h), color);
        }
    }
    image.save(path)
}

/// Seconds this thread has run: its time on the CPU where the system tells, else the wall clock.
fn clock(start: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let busy = stat.and_then(|s| s.split(' ').next()?.parse::<f64>().ok());
    busy.map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

fn speed(seeds: std::ops::Range<u64>, difficulty: Difficulty) {
    let mut frame = FrameBuffer::default();
    let origin = Instant::now();
    for seed in seeds {
        let start = clock(origin);
        let flight = Flight::new(config(seed, difficulty));
        let ready = clock(origin);
        let setup = ready - start;
        let count = 60;
        for index in 0..count {
            flight.render(index * 5, &mut frame);
        }
        let rate = count as f64 / (clock(origin) - ready);
        println!(
            "seed {seed} {:?} {:?}: set up in {setup:.2} s, {rate:.0} frames/s",
            flight.biome(),
            flight.target()
        );
    }
}

fn main() -> ExitCode {
    let mut args: Vec<String> = std::env::args().skip(1).collect();
    let timing = args
        .iter()
        .position(|a| a == "--speed")
        .map(|at| args.remove(at))
        .is_some();
    let Some(dir) = args.first() else {
        eprintln!("usage: gallery DIR [--speed] [FIRST_SEED COUNT [easy|medium|hard]]");
        return ExitCode::FAILURE;
    };
    let number =
        |at: usize, default: u64| args.get(at).and_then(|a| a.parse().ok()).unwrap_or(default);
    let (first, count) = (number(1, 1), number(2, 12));
    let difficulty = args.get(3).and_then(|name| name.parse().ok());
    let difficulty = difficulty.unwrap_or(Difficulty::Medium);
    if timing {
        speed(first..first + count, difficulty);
        return ExitCode::SUCCESS;
    }
    let seeds: Vec<u64> = (first..first + count).collect();
    for group in seeds.chunks(3) {
        let path = Path::new(dir).join(format!("flights-{}.png", group[0]));
        if let Err(error) = sheet(group, difficulty, &path) {
            eprintln!("{}: {error}", path.display());
            return ExitCode::FAILURE;
        }
    }
    ExitCode::SUCCESS
}
