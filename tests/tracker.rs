//! The tracker's behavior through its public face, on rendered frames.

use track_cpu::error::TrackError;
use track_cpu::{
    BBox, ChannelOrder, Frame, Isa, Model, Precision, SearchRegion, Track, TrackConfig, Tracker,
    TrackerOptions,
};

/// A frame of stripes with a bright cross whose middle is at (`cx`, `cy`).
fn scene(width: usize, height: usize, cx: i64, cy: i64) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(width * height * 3);
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            let (dx, dy) = ((x - cx).abs(), (y - cy).abs());
            let cross = (dx < 20 && dy < 6) || (dx < 6 && dy < 14);
            let ground = [
                70 + (x % 13) as u8,
                90 + ((x + 2 * y) % 17) as u8,
                60 + (y % 11) as u8,
            ];
            rgb.extend(if cross { [230, 60, 40] } else { ground });
        }
    }
    rgb
}

fn rgb(data: &[u8], width: usize, height: usize) -> Frame<'_> {
    Frame::new(data, width, height, ChannelOrder::Rgb).unwrap()
}

fn cross_box(cx: i64, cy: i64) -> BBox {
    BBox::new((cx - 19) as f32, (cy - 13) as f32, 39.0, 27.0)
}

fn tracker(threads: usize) -> Tracker {
    let model = Model::builtin(Isa::detect());
    let options = TrackerOptions {
        threads,
        ..TrackerOptions::of(&model)
    };
    Tracker::with_options(model, options)
}

fn path(i: i64) -> (i64, i64) {
    (120 + 7 * i, 90 + 3 * i)
}

fn follow(tracker: &mut Tracker, frames: i64) -> Vec<Track> {
    let (cx, cy) = path(0);
    tracker
        .init(&rgb(&scene(320, 240, cx, cy), 320, 240), cross_box(cx, cy))
        .unwrap();
    let step = |i| {
        let (cx, cy) = path(i);
        tracker
            .update(&rgb(&scene(320, 240, cx, cy), 320, 240))
            .unwrap()
    };
    (1..frames).map(step).collect()
}

#[test]
fn follows_a_moving_target() {
    for (i, track) in follow(&mut tracker(1), 15).iter().enumerate() {
        let (cx, cy) = path(i as i64 + 1);
        let iou = track.bbox.iou(&cross_box(cx, cy));
        assert!(iou > 0.5, "frame {}: {track:?}, IoU {iou}", i + 1);
        assert!(track.score > 0.2 && track.score <= 1.0, "{track:?}");
    }
}

/// A frame of stripes with a disc of a checkerboard whose colors and pattern are `turned` from one look (0) to another (1).
fn turning(width: usize, height: usize, cx: i64, cy: i64, turned: f64) -> Vec<u8> {
    let mut rgb = scene(width, height, -1000, -1000);
    for y in cy - 18..=cy + 18 {
        for x in cx - 18..=cx + 18 {
            let (dx, dy) = (x - cx, y - cy);
            if dx * dx + dy * dy > 18 * 18 {
                continue;
            }
            let first = if (dx.div_euclid(6) + dy.div_euclid(6)) % 2 == 0 {
                [240.0, 60.0, 30.0]
            } else {
                [30.0, 20.0, 60.0]
            };
            let then = if dy.div_euclid(9) % 2 == 0 {
                [20.0, 90.0, 230.0]
            } else {
                [240.0, 240.0, 120.0]
            };
            for (c, pixel) in rgb[3 * (y as usize * width + x as usize)..][..3]
                .iter_mut()
                .enumerate()
            {
                *pixel = (first[c] + turned * (then[c] - first[c])) as u8;
            }
        }
    }
    rgb
}

#[test]
fn the_template_learns_a_look_that_changes() {
    let model = Model::builtin(Isa::detect());
    let last_scores = |template_update| {
        let config = TrackConfig {
            template_update,
            ..model.config()
        };
        let mut tracker = Tracker::with_options(
            model.clone(),
            TrackerOptions {
                config,
                ..TrackerOptions::of(&model)
            },
        );
        let mut last = 0.0;
        for i in 0..60i64 {
            let (cx, cy) = (100 + i, 90 + i / 2);
            let pixels = turning(320, 240, cx, cy, i as f64 / 59.0);
            let frame = rgb(&pixels, 320, 240);
            let truth = BBox::new((cx - 18) as f32, (cy - 18) as f32, 37.0, 37.0);
            if i == 0 {
                tracker.init(&frame, truth).unwrap();
            } else {
                let track = tracker.update(&frame).unwrap();
                if i >= 50 {
                    last += track.score * track.bbox.iou(&truth);
                }
            }
        }
        last / 10.0
    };
    let (fixed, learning) = (last_scores(0.0), last_scores(0.5));
    assert!(
        learning > 1.2 * fixed,
        "score times IoU {fixed} with the first frame's template, {learning} with later looks"
    );
}

#[test]
fn a_target_that_leaps_out_of_the_search_region_is_found_by_its_filter() {
    let model = Model::builtin(Isa::detect());
    let last_overlap = |online_filter| {
        let config = TrackConfig {
            online_filter,
            ..model.config()
        };
        let mut tracker = Tracker::with_options(
            model.clone(),
            TrackerOptions {
                config,
                ..TrackerOptions::of(&model)
            },
        );
        let mut last = 0.0;
        for i in 0..16i64 {
            // One and a half sides in one frame; the search region reaches one.
            let (cx, cy) = if i < 12 {
                (80 + i, 90 + i)
            } else {
                (80 + i + 56, 90 + i)
            };
            let pixels = turning(320, 240, cx, cy, 0.0);
            let frame = rgb(&pixels, 320, 240);
            let truth = BBox::new((cx - 18) as f32, (cy - 18) as f32, 37.0, 37.0);
            if i == 0 {
                tracker.init(&frame, truth).unwrap();
            } else {
                last = tracker.update(&frame).unwrap().bbox.iou(&truth);
            }
        }
        last
    };
    assert!(
        last_overlap(0.0) < 0.1,
        "without a filter it is lost: overlap {}",
        last_overlap(0.0)
    );
    assert!(last_overlap(0.6) > 0.6, "overlap {}", last_overlap(0.6));
}

#[test]
fn adaptive_search_looks_at_less_and_follows_as_well() {
    let model = Model::builtin(Isa::detect());
    let options = TrackerOptions {
        search: SearchRegion::Adaptive,
        ..TrackerOptions::of(&model)
    };
    let mut tracker = Tracker::with_options(model, options);
    let place = |i: i64| {
        if i < 12 {
            (120 + i, 90)
        } else {
            (140 + 9 * (i - 12), 90 + 5 * (i - 12))
        }
    };
    let mut small = Vec::new();
    for i in 0..24 {
        let (cx, cy) = place(i);
        let pixels = scene(320, 240, cx, cy);
        let frame = rgb(&pixels, 320, 240);
        if i == 0 {
            tracker.init(&frame, cross_box(cx, cy)).unwrap();
            continue;
        }
        let track = tracker.update(&frame).unwrap();
        assert!(
            track.bbox.iou(&cross_box(cx, cy)) > 0.5,
            "frame {i}: {track:?}"
        );
        small.push(tracker.last_crop().len() == 239 * 239 * 3);
    }
    assert!(
        small[..3].iter().all(|small| !small),
        "it begins with the whole region: {small:?}"
    );
    assert!(
        small[3..11].iter().filter(|small| **small).count() >= 4,
        "while all is calm: {small:?}"
    );
    assert!(
        small[12..].iter().any(|small| !small),
        "not when the target starts off: {small:?}"
    );
}

#[test]
fn same_bits_with_any_number_of_threads_and_every_time() {
    let once = follow(&mut tracker(1), 6);
    for threads in [1, 2, 5] {
        assert_eq!(follow(&mut tracker(threads), 6), once, "{threads} threads");
    }
}

#[test]
fn every_isa_gives_the_same_boxes() {
    let weights = Model::builtin_weights();
    let share = weights.header.tracker.online_filter;
    // In int8 a value that `f32` rounds differently may become the next byte; the filter's bump is broad, so that this may
    // decide between two neighboring cells, whose boxes are nearly the same.
    for (precision, online_filter, least) in [
        (Precision::F32, share, 0.999),
        (Precision::Int8, 0.0, 0.99),
        (Precision::Int8, share, 0.9),
    ] {
        let tracker = |isa| {
            let model = Model::with_precision(&weights, isa, precision).unwrap();
            let config = TrackConfig {
                online_filter,
                ..model.config()
            };
            let options = TrackerOptions {
                config,
                ..TrackerOptions::of(&model)
            };
            Tracker::with_options(model, options)
        };
        let best = follow(&mut tracker(Isa::detect()), 6);
        for isa in Isa::available() {
            for (a, b) in follow(&mut tracker(isa), 6).iter().zip(&best) {
                assert!(
                    a.bbox.iou(&b.bbox) > least,
                    "{isa} {}: {a:?}, expected {b:?}",
                    precision.name()
                );
            }
        }
    }
}

#[test]
fn init_again_forgets_the_past() {
    let mut used = tracker(1);
    follow(&mut used, 4);
    assert_eq!(follow(&mut used, 4), follow(&mut tracker(1), 4));
}

#[test]
fn a_refused_init_keeps_the_target() {
    let mut a = tracker(1);
    follow(&mut a, 3);
    let frame = scene(320, 240, 141, 99);
    let refused = a.init(&rgb(&frame, 320, 240), BBox::new(f32::NAN, 0.0, 1.0, 1.0));
    assert!(matches!(refused, Err(TrackError::BadBox { .. })));
    let mut b = tracker(1);
    follow(&mut b, 3);
    assert_eq!(
        a.update(&rgb(&frame, 320, 240)),
        b.update(&rgb(&frame, 320, 240))
    );
}

#[test]
fn update_needs_a_target() {
    let data = scene(64, 48, 30, 20);
    assert_eq!(
        tracker(1).update(&rgb(&data, 64, 48)),
        Err(TrackError::NoTarget)
    );
}

#[test]
fn trackers_share_a_model_without_disturbing_each_other() {
    let model = Model::builtin(Isa::detect());
    let (mut a, mut b) = (Tracker::new(model.clone()), Tracker::new(model));
    let frame = |i: i64| {
        let mut data = scene(320, 240, 80 + 4 * i, 60);
        let other = scene(320, 240, 240 - 4 * i, 170);
        data[120 * 320 * 3..].copy_from_slice(&other[120 * 320 * 3..]);
        data
    };
    let first = frame(0);
    a.init(&rgb(&first, 320, 240), cross_box(80, 60)).unwrap();
    b.init(&rgb(&first, 320, 240), cross_box(240, 170)).unwrap();
    for i in 1..8 {
        let data = frame(i);
        let (ta, tb) = (
            a.update(&rgb(&data, 320, 240)).unwrap(),
            b.update(&rgb(&data, 320, 240)).unwrap(),
        );
        assert!(
            ta.bbox.iou(&cross_box(80 + 4 * i, 60)) > 0.5,
            "frame {i}: {ta:?}"
        );
        assert!(
            tb.bbox.iou(&cross_box(240 - 4 * i, 170)) > 0.5,
            "frame {i}: {tb:?}"
        );
    }
}

#[test]
fn channel_order_and_stride_do_not_matter() {
    let expected = follow(&mut tracker(1), 3);
    type Convert = fn(&[u8]) -> Vec<u8>;
    let cases: [(ChannelOrder, usize, Convert); 4] = [
        (ChannelOrder::Bgr, 320 * 3, |p| vec![p[2], p[1], p[0]]),
        (ChannelOrder::Rgba, 320 * 4, |p| vec![p[0], p[1], p[2], 255]),
        (ChannelOrder::Bgra, 320 * 4, |p| vec![p[2], p[1], p[0], 0]),
        (ChannelOrder::Rgb, 320 * 3 + 7, |p| p.to_vec()),
    ];
    for (order, stride, convert) in cases {
        let mut tracker = tracker(1);
        let frame = |i| {
            let (cx, cy) = path(i);
            let mut data = Vec::new();
            for row in scene(320, 240, cx, cy).chunks(320 * 3) {
                data.extend(row.chunks(3).flat_map(convert));
                data.resize(data.len().next_multiple_of(stride), 77);
            }
            data
        };
        let first = frame(0);
        fn view(data: &[u8], stride: usize, order: ChannelOrder) -> Frame<'_> {
            Frame::with_stride(data, 320, 240, stride, order).unwrap()
        }
        tracker
            .init(&view(&first, stride, order), cross_box(120, 90))
            .unwrap();
        for i in 1..3 {
            let data = frame(i);
            let track = tracker.update(&view(&data, stride, order)).unwrap();
            assert_eq!(track, expected[i as usize - 1], "{order:?}");
        }
    }
}

#[test]
fn gray_frames_are_tracked() {
    let gray = |i| {
        let (cx, cy) = path(i);
        scene(320, 240, cx, cy)
            .chunks(3)
            .map(|p| p[0])
            .collect::<Vec<u8>>()
    };
    let mut tracker = tracker(1);
    fn view(data: &[u8]) -> Frame<'_> {
        Frame::new(data, 320, 240, ChannelOrder::Gray).unwrap()
    }
    tracker.init(&view(&gray(0)), cross_box(120, 90)).unwrap();
    for i in 1..8 {
        let (cx, cy) = path(i);
        let track = tracker.update(&view(&gray(i))).unwrap();
        assert!(
            track.bbox.iou(&cross_box(cx, cy)) > 0.5,
            "frame {i}: {track:?}"
        );
    }
}

#[test]
fn the_frame_may_change_its_size() {
    let mut tracker = tracker(1);
    tracker
        .init(
            &rgb(&scene(320, 240, 120, 90), 320, 240),
            cross_box(120, 90),
        )
        .unwrap();
    for (w, h) in [(400, 300), (200, 150), (1, 1), (2000, 3), (320, 240)] {
        let track = tracker.update(&rgb(&scene(w, h, 120, 90), w, h)).unwrap();
        let center = track.bbox.center();
        assert!(
            center.cx >= 0.0 && center.cx <= w as f32 && center.cy >= 0.0 && center.cy <= h as f32
        );
        assert!(
            track.bbox.w <= w as f32 && track.bbox.h <= h as f32,
            "{track:?} in {w}x{h}"
        );
    }
}

#[test]
fn odd_boxes_end_well() {
    let (w, h) = (160, 120);
    let data = scene(w, h, 80, 60);
    let frame = rgb(&data, w, h);
    for bbox in [
        BBox::new(80.0, 60.0, 1.0, 1.0),
        BBox::new(80.2, 60.7, 0.01, 0.01),
        BBox::new(-50.0, -50.0, 51.0, 51.0),
        BBox::new(159.0, 119.0, 1000.0, 1000.0),
        BBox::new(-1e6, -1e6, 1e7, 1e7),
        BBox::new(0.0, 0.0, 160.0, 0.5),
        BBox::new(-1e38, -1e38, 2e38, 2e38),
    ] {
        let mut tracker = tracker(1);
        tracker.init(&frame, bbox).unwrap();
        for _ in 0..3 {
            let track = tracker.update(&frame).unwrap();
            assert!(
                track.bbox.is_finite() && track.score.is_finite(),
                "{bbox:?} gave {track:?}"
            );
            assert!(
                track.bbox.w >= 10.0 && track.bbox.w <= 160.0 && track.bbox.h <= 120.0,
                "{track:?}"
            );
        }
    }
    for bbox in [
        BBox::new(f32::NAN, 0.0, 5.0, 5.0),
        BBox::new(0.0, f32::INFINITY, 5.0, 5.0),
        BBox::new(0.0, 0.0, 0.0, 5.0),
        BBox::new(0.0, 0.0, 5.0, -1.0),
    ] {
        assert!(
            matches!(
                tracker(1).init(&frame, bbox),
                Err(TrackError::BadBox { .. })
            ),
            "{bbox:?}"
        );
    }
    for bbox in [
        BBox::new(160.0, 0.0, 5.0, 5.0),
        BBox::new(0.0, -9.0, 5.0, 5.0),
        BBox::new(-5.0, 3.0, 5.0, 5.0),
    ] {
        assert!(
            matches!(
                tracker(1).init(&frame, bbox),
                Err(TrackError::BoxOutside { .. })
            ),
            "{bbox:?}"
        );
    }
}

#[test]
fn black_frames_end_well() {
    let mut tracker = tracker(1);
    tracker
        .init(
            &rgb(&scene(320, 240, 120, 90), 320, 240),
            cross_box(120, 90),
        )
        .unwrap();
    let black = vec![0; 320 * 240 * 3];
    for _ in 0..50 {
        let track = tracker.update(&rgb(&black, 320, 240)).unwrap();
        assert!(
            track.bbox.is_finite() && track.bbox.w <= 320.0 && track.bbox.h <= 240.0,
            "{track:?}"
        );
    }
    tracker
        .init(&rgb(&black, 320, 240), cross_box(120, 90))
        .unwrap();
    assert!(
        tracker
            .update(&rgb(&black, 320, 240))
            .unwrap()
            .bbox
            .is_finite()
    );
}
