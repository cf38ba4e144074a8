//! Flights as their users see them: the same bytes every time, exact boxes, events that happen.

use crate::draw::Show;
use crate::flight::RATE;
use crate::raster::Bounds;
use crate::{Difficulty, Flight, FlightConfig, FrameBuffer, TargetKind, TruthBox};

fn config(seed: u64, difficulty: Difficulty) -> FlightConfig {
    FlightConfig {
        seed,
        difficulty,
        ..Default::default()
    }
}

fn small(seed: u64, difficulty: Difficulty) -> FlightConfig {
    FlightConfig {
        width: 192,
        height: 108,
        frames: 40,
        ..config(seed, difficulty)
    }
}

/// Every frame's truth is known without painting the ground.
fn visible(flight: &Flight, index: usize) -> f32 {
    let show = Show {
        target: true,
        shade: false,
        lens: false,
    };
    flight.draw(flight.seconds(index), show).1.visible
}

#[test]
fn frames_of_one_seed_are_the_same_bytes_in_any_order() {
    for seed in [1, 5, 12] {
        let (a, b) = (
            Flight::new(small(seed, Difficulty::Hard)),
            Flight::new(small(seed, Difficulty::Hard)),
        );
        let mut frame = FrameBuffer::default();
        let mut other = FrameBuffer::default();
        let in_order: Vec<_> = (0..a.len())
            .map(|i| (a.render(i, &mut frame), frame.clone()))
            .collect();
        for i in [39, 0, 17, 3, 17] {
            let truth = b.render(i, &mut other);
            assert!(
                in_order[i].0 == truth && in_order[i].1 == other,
                "seed {seed} frame {i}"
            );
        }
        assert_ne!(in_order[0].1.data, in_order[1].1.data);
    }
}

#[test]
fn flights_of_different_seeds_differ() {
    let mut frame = FrameBuffer::default();
    let mut pictures = Vec::new();
    for seed in 0..6 {
        Flight::new(small(seed, Difficulty::Easy)).render(0, &mut frame);
        assert!(!pictures.contains(&frame.data));
        pictures.push(frame.data.clone());
    }
}

/// Bounds and number of the pixels that the target changes.
fn changed(flight: &Flight, index: usize) -> Option<(Bounds, usize)> {
    let draw = |target| {
        flight
            .draw(
                flight.seconds(index),
                Show {
                    target,
                    shade: false,
                    lens: false,
                },
            )
            .0
    };
    let with = draw(true);
    let without = draw(false);
    let mut bounds = Bounds::EMPTY;
    let mut count = 0;
    for (at, _) in with
        .pixels
        .iter()
        .zip(&without.pixels)
        .enumerate()
        .filter(|(_, (a, b))| a != b)
    {
        let (x, y) = ((at % with.width) as f32, (at / with.width) as f32);
        bounds.include(x, y);
        bounds.include(x + 1.0, y + 1.0);
        count += 1;
    }
    (count > 0).then_some((bounds, count))
}

#[test]
fn true_box_bounds_the_pixels_that_the_target_changes() {
    let mut checked = 0;
    for seed in 0..60 {
        let flight = Flight::unpainted(config(seed, Difficulty::ALL[seed as usize % 3]));
        for index in [0, 20, 75] {
            let (_, truth) = flight.draw(
                flight.seconds(index),
                Show {
                    target: true,
                    shade: false,
                    lens: false,
                },
            );
            if truth.visible < 0.999 {
                continue;
            }
            let Some((found, _)) = changed(&flight, index) else {
                panic!("seed {seed}: no target")
            };
            let TruthBox { x, y, w, h } = truth.bbox;
            let off = [
                found.left - x,
                found.top - y,
                found.right - (x + w),
                found.bottom - (y + h),
            ];
            // Whole pixels against continuous edges: less than one pixel outward, and thin ends may
            // not fill a sample.
            assert!(
                off.iter().all(|d| d.abs() < 1.3),
                "seed {seed} frame {index} {:?}: {off:?}",
                flight.target()
            );
            checked += 1;
        }
    }
    assert!(
        checked > 120,
        "only {checked} frames had the target in full view"
    );
}

#[test]
fn visible_share_is_the_share_of_the_targets_pixels_that_change() {
    let mut hidden = 0;
    let mut partial = 0;
    for seed in 0..40 {
        let flight = Flight::unpainted(config(seed, Difficulty::Hard));
        for &seconds in &flight.occlusions {
            for step in [-16, -8, 0, 8, 16] {
                let index = ((seconds * RATE) as i32 + step).max(0) as usize;
                let (frame, truth) = flight.draw(
                    flight.seconds(index),
                    Show {
                        target: true,
                        shade: false,
                        lens: false,
                    },
                );
                let Some(mask) = frame.mask else {
                    panic!("seed {seed}: no mask")
                };
                let shown = truth.visible * mask.total;
                let count = changed(&flight, index).map_or(0, |(_, count)| count) as f32;
                // Pixels on the outline change whole but count in part.
                let outline = 2.0 * (truth.bbox.w + truth.bbox.h) + 8.0;
                assert!(
                    count >= 0.9 * shown - 4.0,
                    "seed {seed} frame {index}: {count} of {shown}"
                );
                assert!(
                    count <= shown + outline,
                    "seed {seed} frame {index}: {count} of {shown}"
                );
                hidden += usize::from(truth.visible < 0.1);
                partial += usize::from((0.1..0.9).contains(&truth.visible));
            }
        }
    }
    assert!(
        hidden > 20 && partial > 10,
        "{hidden} hidden, {partial} partly hidden"
    );
}

#[test]
fn planned_occlusion_hides_the_target_and_ends() {
    let mut flights = 0;
    for seed in 0..30 {
        let flight = Flight::unpainted(config(seed, Difficulty::Medium));
        let Some(&seconds) = flight.occlusions.first() else {
            continue;
        };
        let at = (seconds * RATE) as usize;
        let least = (at - 10..at + 10)
            .map(|i| visible(&flight, i))
            .fold(1.0, f32::min);
        assert!(
            least < 0.3,
            "seed {seed} {:?} {:?}: {least}",
            flight.biome(),
            flight.target()
        );
        // Someone on foot needs a while to come out again.
        let seen = (at..flight.len())
            .step_by(4)
            .any(|i| visible(&flight, i) > 0.7);
        assert!(
            seen || flight.target() == TargetKind::Person,
            "seed {seed}: never seen again"
        );
        flights += 1;
    }
    assert!(
        flights > 20,
        "only {flights} of 30 flights have an occlusion"
    );
}

#[test]
fn target_of_a_hard_flight_leaves_the_view_and_returns() {
    for seed in 0..12 {
        let flight = Flight::unpainted(config(seed, Difficulty::Hard));
        let exit = flight
            .plan
            .exits
            .first()
            .expect("a hard flight of 300 frames has an exit");
        let inside = (exit.from * RATE) as usize + 2;
        let (_, truth) = flight.draw(
            flight.seconds(inside),
            Show {
                target: true,
                shade: true,
                lens: false,
            },
        );
        assert_eq!(truth.visible, 0.0, "seed {seed}");
        assert!(truth.bbox.x > 640.0 || truth.bbox.x + truth.bbox.w < 0.0);
        let back =
            (((exit.until + 1.0) * RATE) as usize..flight.len()).any(|i| visible(&flight, i) > 0.5);
        assert!(back, "seed {seed}: the target does not come back");
    }
}

#[test]
fn target_of_an_easy_flight_is_never_hidden() {
    for seed in 0..12 {
        let flight = Flight::unpainted(config(seed, Difficulty::Easy));
        for index in (0..flight.len()).step_by(23) {
            let seen = visible(&flight, index);
            assert!(
                seen > 0.6,
                "seed {seed} {:?} frame {index}: {seen}",
                flight.biome()
            );
        }
    }
}

#[test]
fn first_frame_shows_the_whole_target_at_a_usable_size() {
    for seed in 0..200 {
        let flight = Flight::unpainted(FlightConfig {
            frames: 150,
            ..config(seed, Difficulty::ALL[seed as usize % 3])
        });
        let (_, truth) = flight.draw(
            0.0,
            Show {
                target: true,
                shade: true,
                lens: true,
            },
        );
        let b = truth.bbox;
        let about = format!(
            "seed {seed} {:?} {:?}: {b:?} {}",
            flight.biome(),
            flight.target(),
            truth.visible
        );
        assert!(truth.visible > 0.97, "{about}");
        assert!(
            b.x >= 0.0 && b.y >= 0.0 && b.x + b.w <= 640.0 && b.y + b.h <= 360.0,
            "{about}"
        );
        assert!(
            (15.0..=120.0).contains(&b.w.max(b.h)) && b.w.min(b.h) >= 6.0,
            "{about}"
        );
    }
}

#[test]
fn extreme_sizes_and_seeds_render() {
    let sizes = [
        (64, 48),
        (1, 1),
        (641, 361),
        (33, 300),
        (500, 20),
        (1280, 720),
        (0, 7),
    ];
    let mut frame = FrameBuffer::default();
    for difficulty in Difficulty::ALL {
        for seed in 0..50 {
            let (width, height) = sizes[seed as usize % sizes.len()];
            let seed = if seed % 10 == 9 {
                u64::MAX - seed
            } else {
                seed
            };
            let config = FlightConfig {
                width,
                height,
                frames: 160,
                seed,
                difficulty,
                ..Default::default()
            };
            let paint = width * height < 4000 || seed == 2;
            let flight = if paint {
                Flight::new(config)
            } else {
                Flight::unpainted(config)
            };
            for index in [0, 81, 159, usize::MAX] {
                let truth = flight.render(index, &mut frame);
                assert_eq!(frame.data.len(), 3 * frame.width * frame.height);
                assert!((0.0..=1.0).contains(&truth.visible));
                assert!(truth.bbox.w.is_finite() && truth.bbox.w > 0.0);
            }
        }
    }
}

#[test]
fn long_flight_goes_round_a_country_that_repeats() {
    let config = FlightConfig {
        width: 96,
        height: 64,
        frames: 30_000,
        ..config(4, Difficulty::Medium)
    };
    let flight = Flight::new(config);
    let mut frame = FrameBuffer::default();
    for index in [0, 9_999, 29_999] {
        flight.render(index, &mut frame);
        let mean = frame.data.iter().map(|&b| f64::from(b)).sum::<f64>() / frame.data.len() as f64;
        assert!((30.0..225.0).contains(&mean), "frame {index}: mean {mean}");
    }
}

#[test]
fn difficulty_is_read_from_the_name_that_it_displays() {
    for difficulty in Difficulty::ALL {
        assert_eq!(difficulty.to_string().parse(), Ok(difficulty));
    }
    let error = "mild".parse::<Difficulty>().unwrap_err();
    assert_eq!(error, "expected easy, medium or hard, found \"mild\"");
}
