//! The tracker's behavior through its public API, on rendered frames.

use track_cpu::error::TrackError;
use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::{
    BBox, ChannelOrder, Frame, FrameSize, Isa, Model, Plane, Precision, SearchRegion, SizeChange,
    Track, Tracker, TrackerOptions,
};

/// Size of most frames.
const WIDTH: usize = 320;
const HEIGHT: usize = 240;

/// A frame of stripes with a bright cross whose middle is at (`cx`, `cy`).
fn scene(width: usize, height: usize, cx: i64, cy: i64) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(width * height * 3);
    for y in 0..height as i64 {
        for x in 0..width as i64 {
            let dx = (x - cx).abs();
            let dy = (y - cy).abs();
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

/// A frame of the usual size.
fn usual(data: &[u8]) -> Frame<'_> {
    rgb(data, WIDTH, HEIGHT)
}

/// A scene of the usual size with the cross at its place in frame `i`.
fn moving(i: i64) -> Vec<u8> {
    let (cx, cy) = path(i);
    scene(WIDTH, HEIGHT, cx, cy)
}

/// Middle of the cross in frame `i`.
fn path(i: i64) -> (i64, i64) {
    (120 + 7 * i, 90 + 3 * i)
}

/// The cross's true box.
fn cross_box((cx, cy): (i64, i64)) -> BBox {
    BBox::new((cx - 19) as f32, (cy - 13) as f32, 39.0, 27.0)
}

fn tracker(threads: usize) -> Tracker {
    with(|options| options.threads = threads)
}

/// A tracker of the standard model with changed options.
fn with(change: impl FnOnce(&mut TrackerOptions)) -> Tracker {
    let model = Model::builtin(Isa::detect());
    let mut options = TrackerOptions::of(&model);
    change(&mut options);
    Tracker::with_options(model, options)
}

/// The tracks of all frames but the first.
fn follow(tracker: &mut Tracker, frames: i64) -> Vec<Track> {
    tracker
        .init(&usual(&moving(0)), cross_box(path(0)))
        .unwrap();
    (1..frames)
        .map(|i| tracker.update(&usual(&moving(i))).unwrap())
        .collect()
}

fn assert_on_target(i: i64, track: &Track, truth: BBox, least: f32) {
    let iou = track.bbox.iou(&truth);
    assert!(iou > least, "frame {i}: {track:?}, IoU {iou}");
}

#[test]
fn moving_target_is_followed() {
    let tracks = follow(&mut tracker(1), 15);

    for (i, track) in (1..).zip(&tracks) {
        assert_on_target(i, track, cross_box(path(i)), 0.5);
        assert!(track.score > 0.2 && track.score <= 1.0, "{track:?}");
    }
}

#[test]
fn vote_on_the_reported_box_steers_no_search() {
    let tracks = |voting| follow(&mut with(|options| options.config.voting = voting), 15);
    let own = tracks(0.0);
    let voted = tracks(1.0);

    let scores = |tracks: &[Track]| tracks.iter().map(|track| track.score).collect::<Vec<_>>();
    assert_eq!(scores(&own), scores(&voted));
    for (i, (own, voted)) in (1..).zip(own.iter().zip(&voted)) {
        assert_ne!(own.bbox, voted.bbox, "frame {i}");
        assert_on_target(i, voted, cross_box(path(i)), 0.5);
    }
}

/// A frame of stripes with a checkerboard disc, whose look changes with `turned` in `[0, 1]`.
fn turning(cx: i64, cy: i64, turned: f64) -> Vec<u8> {
    let mut rgb = scene(WIDTH, HEIGHT, -1000, -1000);
    for y in cy - 18..=cy + 18 {
        for x in cx - 18..=cx + 18 {
            let dx = x - cx;
            let dy = y - cy;
            if dx * dx + dy * dy > 18 * 18 {
                continue;
            }
            let first = if (dx.div_euclid(6) + dy.div_euclid(6)) % 2 == 0 {
                [240.0, 60.0, 30.0]
            } else {
                [30.0, 20.0, 60.0]
            };
            let last = if dy.div_euclid(9) % 2 == 0 {
                [20.0, 90.0, 230.0]
            } else {
                [240.0, 240.0, 120.0]
            };
            let pixel = &mut rgb[3 * (y as usize * WIDTH + x as usize)..][..3];
            for c in 0..3 {
                pixel[c] = (first[c] + turned * (last[c] - first[c])) as u8;
            }
        }
    }
    rgb
}

fn disc_box(cx: i64, cy: i64) -> BBox {
    BBox::new((cx - 18) as f32, (cy - 18) as f32, 37.0, 37.0)
}

/// Mean score times IoU of the last ten of 60 frames, in which the disc changes its look.
fn score_of_changed_look(template_update: f64) -> f32 {
    let mut tracker = with(|options| options.config.template_update = template_update);
    let mut sum = 0.0;
    for i in 0..60i64 {
        let (cx, cy) = (100 + i, 90 + i / 2);
        let pixels = turning(cx, cy, i as f64 / 59.0);
        if i == 0 {
            tracker.init(&usual(&pixels), disc_box(cx, cy)).unwrap();
            continue;
        }
        let track = tracker.update(&usual(&pixels)).unwrap();
        if i >= 50 {
            sum += track.score * track.bbox.iou(&disc_box(cx, cy));
        }
    }
    sum / 10.0
}

#[test]
fn changing_look_with_template_update_scores_higher() {
    let fixed = score_of_changed_look(0.0);
    let updated = score_of_changed_look(0.5);

    assert!(
        updated > 1.2 * fixed,
        "score times IoU {fixed} without, {updated} with template update"
    );
}

/// Last IoU for a disc that leaps one and a half sides; the search region reaches one.
fn iou_after_leap(online_filter: f64) -> f32 {
    let mut tracker = with(|options| options.config.online_filter = online_filter);
    let mut last = 0.0;
    for i in 0..16i64 {
        let leap = if i < 12 { 0 } else { 56 };
        let (cx, cy) = (80 + i + leap, 90 + i);
        let pixels = turning(cx, cy, 0.0);
        let truth = disc_box(cx, cy);
        if i == 0 {
            tracker.init(&usual(&pixels), truth).unwrap();
        } else {
            last = tracker.update(&usual(&pixels)).unwrap().bbox.iou(&truth);
        }
    }
    last
}

#[test]
fn target_that_leaps_out_of_the_search_region_is_found_with_a_filter_only() {
    let without = iou_after_leap(0.0);
    let with = iou_after_leap(0.6);

    assert!(without < 0.1, "overlap {without} without a filter");
    assert!(with > 0.6, "overlap {with} with a filter");
}

#[test]
fn adaptive_search_of_a_calm_target_uses_smaller_crops_and_follows_as_well() {
    let mut tracker = with(|options| options.search = SearchRegion::Adaptive);
    let place = |i: i64| {
        if i < 12 {
            (120 + i, 90)
        } else {
            (140 + 9 * (i - 12), 90 + 5 * (i - 12))
        }
    };
    let picture = |i: i64| scene(WIDTH, HEIGHT, place(i).0, place(i).1);
    tracker
        .init(&usual(&picture(0)), cross_box(place(0)))
        .unwrap();

    let mut small = Vec::new();
    for i in 1..24 {
        let track = tracker.update(&usual(&picture(i))).unwrap();
        assert_on_target(i, &track, cross_box(place(i)), 0.5);
        small.push(tracker.last_crop().len() == 239 * 239 * 3);
    }

    let start = &small[..3];
    let calm = &small[3..11];
    let restless = &small[12..];
    assert!(start.iter().all(|small| !small), "{small:?}");
    assert!(
        calm.iter().filter(|small| **small).count() >= 4,
        "{small:?}"
    );
    assert!(restless.iter().any(|small| !small), "{small:?}");
}

#[test]
fn boxes_with_any_number_of_threads_are_the_same_bits() {
    let once = follow(&mut tracker(1), 6);

    for threads in [1, 2, 5] {
        assert_eq!(follow(&mut tracker(threads), 6), once, "{threads} threads");
    }
}

#[test]
fn boxes_on_every_isa_are_nearly_the_same() {
    let weights = Model::builtin_weights();
    let share = weights.header.tracker.online_filter;
    // In int8 one instruction set rounds to bytes what another rounds to 16 bits: outputs differ by
    // 2 % of their RMS. The filter's bump is broad, so that this may decide between two neighboring
    // cells with nearly the same boxes.
    for (precision, online_filter, least) in [
        (Precision::F32, share, 0.999),
        (Precision::Int8, 0.0, 0.98),
        (Precision::Int8, share, 0.9),
    ] {
        let tracker = |isa| {
            let model = Model::with_precision(&weights, isa, precision).unwrap();
            let mut options = TrackerOptions::of(&model);
            options.config.online_filter = online_filter;
            Tracker::with_options(model, options)
        };
        let best = follow(&mut tracker(Isa::detect()), 6);
        for isa in Isa::available() {
            let found = follow(&mut tracker(isa), 6);

            for (a, b) in found.iter().zip(&best) {
                let iou = a.bbox.iou(&b.bbox);
                let name = precision.name();
                assert!(iou > least, "{isa} {name}: {a:?}, expected {b:?}");
            }
        }
    }
}

#[test]
fn tracker_after_another_init_forgets_the_past() {
    let mut used = tracker(1);
    follow(&mut used, 4);

    let again = follow(&mut used, 4);

    assert_eq!(again, follow(&mut tracker(1), 4));
}

#[test]
fn tracker_after_a_refused_init_keeps_its_target() {
    let mut a = tracker(1);
    let mut b = tracker(1);
    follow(&mut a, 3);
    follow(&mut b, 3);
    let next = moving(3);

    let refused = a.init(&usual(&next), BBox::new(f32::NAN, 0.0, 1.0, 1.0));

    assert!(matches!(refused, Err(TrackError::BadBox { .. })));
    assert_eq!(a.update(&usual(&next)), b.update(&usual(&next)));
}

#[test]
fn update_without_a_target_is_an_error() {
    let pixels = moving(0);

    let result = tracker(1).update(&usual(&pixels));

    assert_eq!(result, Err(TrackError::NoTarget));
}

#[test]
fn trackers_of_one_model_do_not_disturb_each_other() {
    let model = Model::builtin(Isa::detect());
    let mut a = Tracker::new(model.clone());
    let mut b = Tracker::new(model);
    let upper = |i: i64| (80 + 4 * i, 60);
    let lower = |i: i64| (240 - 4 * i, 170);
    let picture = |i: i64| {
        let mut pixels = scene(WIDTH, HEIGHT, upper(i).0, upper(i).1);
        let other = scene(WIDTH, HEIGHT, lower(i).0, lower(i).1);
        pixels[120 * WIDTH * 3..].copy_from_slice(&other[120 * WIDTH * 3..]);
        pixels
    };
    let first = picture(0);
    a.init(&usual(&first), cross_box(upper(0))).unwrap();
    b.init(&usual(&first), cross_box(lower(0))).unwrap();

    for i in 1..8 {
        let pixels = picture(i);
        let track_a = a.update(&usual(&pixels)).unwrap();
        let track_b = b.update(&usual(&pixels)).unwrap();
        assert_on_target(i, &track_a, cross_box(upper(i)), 0.5);
        assert_on_target(i, &track_b, cross_box(lower(i)), 0.5);
    }
}

#[test]
fn frames_in_any_channel_order_and_stride_give_the_same_boxes() {
    let expected = follow(&mut tracker(1), 3);
    type Convert = fn(&[u8]) -> Vec<u8>;
    let cases: [(ChannelOrder, usize, Convert); 4] = [
        (ChannelOrder::Bgr, WIDTH * 3, |p| vec![p[2], p[1], p[0]]),
        (ChannelOrder::Rgba, WIDTH * 4, |p| {
            vec![p[0], p[1], p[2], 255]
        }),
        (ChannelOrder::Bgra, WIDTH * 4, |p| vec![p[2], p[1], p[0], 0]),
        (ChannelOrder::Rgb, WIDTH * 3 + 7, |p| p.to_vec()),
    ];
    for (order, stride, convert) in cases {
        let converted = |i: i64| {
            let mut data = Vec::new();
            for row in moving(i).chunks(WIDTH * 3) {
                data.extend(row.chunks(3).flat_map(convert));
                data.resize(data.len().next_multiple_of(stride), 77);
            }
            data
        };
        fn view(data: &[u8], stride: usize, order: ChannelOrder) -> Frame<'_> {
            Frame::with_stride(data, WIDTH, HEIGHT, stride, order).unwrap()
        }
        let mut tracker = tracker(1);
        let first = converted(0);
        tracker
            .init(&view(&first, stride, order), cross_box(path(0)))
            .unwrap();

        for (i, expected) in (1..).zip(&expected) {
            let data = converted(i);
            let track = tracker.update(&view(&data, stride, order)).unwrap();
            assert_eq!(track, *expected, "{order:?}");
        }
    }
}

/// A frame of YUV whose chroma comes from the first pixel that shares it, as planes with `gap`
/// bytes behind each row.
fn yuv(rgb: &[u8], order: ChannelOrder, gap: usize) -> Vec<(Vec<u8>, usize)> {
    let convert = |x: usize, y: usize| -> [u8; 3] {
        let [r, g, b] = [0, 1, 2].map(|i| i32::from(rgb[3 * (y * WIDTH + x) + i]));
        [
            (66 * r + 129 * g + 25 * b + 4224) >> 8,
            (-38 * r - 74 * g + 112 * b + 32896) >> 8,
            (112 * r - 94 * g - 18 * b + 32896) >> 8,
        ]
        .map(|value| value as u8)
    };
    let luma = |x: usize, y: usize| convert(x.min(WIDTH - 1), y)[0];
    let chroma = |x: usize, y: usize| convert(x, y).last_chunk::<2>().copied().unwrap();
    let (halves, rows) = ((0..WIDTH).step_by(2), (0..HEIGHT).step_by(2));
    let whole: Vec<u8> = (0..HEIGHT)
        .flat_map(|y| (0..WIDTH).map(move |x| luma(x, y)))
        .collect();
    let half = |channel: usize| -> Vec<u8> {
        let (halves, rows) = (halves.clone(), rows.clone());
        let places = rows.flat_map(|y| halves.clone().map(move |x| (x, y)));
        places.map(|(x, y)| chroma(x, y)[channel]).collect()
    };
    let (u, v) = (half(0), half(1));
    let pairs = |a: &[u8], b: &[u8]| -> Vec<u8> {
        let pairs = a.iter().zip(b);
        pairs.flat_map(|(a, b)| [*a, *b]).collect()
    };
    let planes = match order {
        ChannelOrder::Nv12 => vec![whole, pairs(&u, &v)],
        ChannelOrder::Nv21 => vec![whole, pairs(&v, &u)],
        ChannelOrder::I420 => vec![whole, u, v],
        _ => {
            let places = (0..HEIGHT).flat_map(|y| halves.clone().map(move |x| (x, y)));
            let groups = places.flat_map(|(x, y)| {
                let ([u, v], first, second) = (chroma(x, y), luma(x, y), luma(x + 1, y));
                if order == ChannelOrder::Yuyv {
                    [first, u, second, v]
                } else {
                    [u, first, v, second]
                }
            });
            vec![groups.collect()]
        }
    };
    let heights = [HEIGHT, HEIGHT.div_ceil(2), HEIGHT.div_ceil(2)];
    let padded = planes.into_iter().zip(heights).map(|(plane, rows)| {
        let row = plane.len() / rows;
        let padded = plane
            .chunks(row)
            .flat_map(|row| [row, &vec![9; gap]].concat());
        (padded.collect(), row + gap)
    });
    padded.collect()
}

fn planes(planes: &[(Vec<u8>, usize)], order: ChannelOrder) -> Frame<'_> {
    let lent = planes.iter().map(|(data, stride)| Plane {
        data,
        stride: *stride,
    });
    Frame::from_planes(&lent.collect::<Vec<_>>(), WIDTH, HEIGHT, order).unwrap()
}

#[test]
fn frames_of_yuv_give_the_boxes_of_the_converted_ones_in_every_mode() {
    for (order, gap) in [
        (ChannelOrder::Nv12, 0),
        (ChannelOrder::Nv21, 6),
        (ChannelOrder::I420, 3),
        (ChannelOrder::Yuyv, 0),
        (ChannelOrder::Uyvy, 5),
    ] {
        let model = Model::builtin(Isa::detect());
        let flying = || FlightTracker::new(model.clone(), FlightOptions::new(&model)).unwrap();
        let (mut plain, mut expected_plain) = (tracker(1), tracker(1));
        let (mut flight, mut expected_flight) = (flying(), flying());
        for i in 0..6 {
            let data = yuv(&moving(i), order, gap);
            let frame = planes(&data, order);
            let rgb = frame.to_rgb();
            let converted = Frame::new(&rgb, WIDTH, HEIGHT, ChannelOrder::Rgb).unwrap();
            if i == 0 {
                let bbox = cross_box(path(0));
                for (tracker, frame) in [(&mut plain, &frame), (&mut expected_plain, &converted)] {
                    tracker.init(frame, bbox).unwrap();
                }
                for (tracker, frame) in [(&mut flight, &frame), (&mut expected_flight, &converted)]
                {
                    tracker.init(frame, bbox).unwrap();
                }
                continue;
            }

            let track = plain.update(&frame).unwrap();
            let flown = flight.update(&frame, Budget::Searches(2)).unwrap();

            assert_eq!(
                track,
                expected_plain.update(&converted).unwrap(),
                "{order:?}"
            );
            let expected = expected_flight.update(&converted, Budget::Searches(2));
            assert_eq!(flown, expected.unwrap(), "{order:?}");
            assert_on_target(i, &track, cross_box(path(i)), 0.5);
        }
    }
}

#[test]
fn target_in_gray_frames_is_followed() {
    let gray = |i: i64| -> Vec<u8> { moving(i).chunks(3).map(|p| p[0]).collect() };
    fn view(data: &[u8]) -> Frame<'_> {
        Frame::new(data, WIDTH, HEIGHT, ChannelOrder::Gray).unwrap()
    }
    let mut tracker = tracker(1);
    tracker.init(&view(&gray(0)), cross_box(path(0))).unwrap();

    for i in 1..8 {
        let track = tracker.update(&view(&gray(i))).unwrap();
        assert_on_target(i, &track, cross_box(path(i)), 0.5);
    }
}

/// A frame of the usual size, stretched to twice the width and three times the height.
fn stretched(data: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(6 * data.len());
    for row in data.chunks(WIDTH * 3) {
        let wide: Vec<u8> = row.chunks(3).flat_map(|p| [p, p].concat()).collect();
        out.extend(wide.repeat(3));
    }
    out
}

#[test]
fn target_in_frames_of_another_size_is_followed_in_their_pixels() {
    let mut tracker = tracker(1);
    follow(&mut tracker, 4);
    assert_eq!(tracker.size_change(), None);
    let (width, height) = (2 * WIDTH, 3 * HEIGHT);

    let mut changes = Vec::new();
    for i in 4..8 {
        let pixels = stretched(&moving(i));
        let track = tracker.update(&rgb(&pixels, width, height)).unwrap();
        let BBox { x, y, w, h } = cross_box(path(i));
        let truth = BBox::new(2.0 * x, 3.0 * y, 2.0 * w, 3.0 * h);
        assert_on_target(i, &track, truth, 0.5);
        changes.push(tracker.size_change());
    }

    let change = SizeChange {
        from: FrameSize {
            width: WIDTH,
            height: HEIGHT,
        },
        to: FrameSize { width, height },
    };
    assert_eq!(changes, [Some(change), None, None, None]);
    assert_eq!(change.from.to_string(), "320x240");
}

#[test]
fn target_in_frames_of_absurd_sizes_keeps_a_box_within_them() {
    let mut tracker = tracker(1);
    follow(&mut tracker, 1);
    for (w, h) in [(400, 300), (200, 150), (1, 1), (2000, 3), (320, 240)] {
        let track = tracker.update(&rgb(&scene(w, h, 120, 90), w, h)).unwrap();

        let center = track.bbox.center();
        assert!(center.cx >= 0.0 && center.cx <= w as f32, "{track:?}");
        assert!(center.cy >= 0.0 && center.cy <= h as f32, "{track:?}");
        assert!(track.bbox.w <= w as f32, "{track:?} in {w}x{h}");
        assert!(track.bbox.h <= h as f32, "{track:?} in {w}x{h}");
    }
}

/// A noisy frame of 160x120 pixels with a bright square of 6x6 pixels at (`x`, `y`).
fn with_small_target(x: usize, y: usize) -> Vec<u8> {
    let mut rgb = Vec::with_capacity(160 * 120 * 3);
    for row in 0..120 {
        for column in 0..160 {
            let inside = (x..x + 6).contains(&column) && (y..y + 6).contains(&row);
            let noise = ((row * 7919 + column * 104_729 + row * column * 31) % 23) as u8;
            let ground = [90 + noise, 110 + noise, 80 + noise];
            rgb.extend(if inside { [230, 60, 50] } else { ground });
        }
    }
    rgb
}

#[test]
fn target_of_six_pixels_keeps_a_box_of_about_six_pixels() {
    let mut tracker = tracker(1);
    let first = with_small_target(20, 40);
    tracker
        .init(&rgb(&first, 160, 120), BBox::new(20.0, 40.0, 6.0, 6.0))
        .unwrap();

    for i in 1..30 {
        let x = 20 + 2 * i;
        let pixels = with_small_target(x, 40);
        let track = tracker.update(&rgb(&pixels, 160, 120)).unwrap();
        let BBox { w, h, .. } = track.bbox;
        assert!((4.0..9.0).contains(&w), "frame {i}: {track:?}");
        assert!((4.0..9.0).contains(&h), "frame {i}: {track:?}");
        let truth = BBox::new(x as f32, 40.0, 6.0, 6.0);
        assert_on_target(i as i64, &track, truth, 0.4);
    }
}

#[test]
fn odd_first_box_gives_finite_boxes_within_the_bounds() {
    let pixels = scene(160, 120, 80, 60);
    let frame = rgb(&pixels, 160, 120);
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
            let BBox { w, h, .. } = track.bbox;
            assert!(track.bbox.is_finite(), "{bbox:?} gave {track:?}");
            assert!(track.score.is_finite(), "{bbox:?} gave {track:?}");
            assert!((2.0..=160.0).contains(&w), "{bbox:?} gave {track:?}");
            assert!((2.0..=120.0).contains(&h), "{bbox:?} gave {track:?}");
        }
    }
}

#[test]
fn invalid_first_box_is_refused() {
    let pixels = scene(160, 120, 80, 60);
    let frame = rgb(&pixels, 160, 120);
    for bbox in [
        BBox::new(f32::NAN, 0.0, 5.0, 5.0),
        BBox::new(0.0, f32::INFINITY, 5.0, 5.0),
        BBox::new(0.0, 0.0, 0.0, 5.0),
        BBox::new(0.0, 0.0, 5.0, -1.0),
    ] {
        let refused = tracker(1).init(&frame, bbox);

        assert!(
            matches!(refused, Err(TrackError::BadBox { .. })),
            "{bbox:?}"
        );
    }
}

#[test]
fn first_box_outside_the_frame_is_refused() {
    let pixels = scene(160, 120, 80, 60);
    let frame = rgb(&pixels, 160, 120);
    for bbox in [
        BBox::new(160.0, 0.0, 5.0, 5.0),
        BBox::new(0.0, -9.0, 5.0, 5.0),
        BBox::new(-5.0, 3.0, 5.0, 5.0),
    ] {
        let refused = tracker(1).init(&frame, bbox);

        let outside = matches!(refused, Err(TrackError::BoxOutside { .. }));
        assert!(outside, "{bbox:?}");
    }
}

#[test]
fn first_box_in_shares_of_the_frame_is_refused_with_a_hint() {
    let pixels = scene(160, 120, 80, 60);
    let frame = rgb(&pixels, 160, 120);
    for bbox in [
        BBox::new(0.4, 0.4, 0.2, 0.25),
        BBox::new(0.0, 0.0, 1.0, 1.0),
    ] {
        let refused = tracker(1).init(&frame, bbox).unwrap_err().to_string();

        assert!(refused.contains("multiply left and width"), "{refused}");
    }
    let single = rgb(&pixels[..3], 1, 1);
    assert_eq!(
        tracker(1).init(&single, BBox::new(0.0, 0.0, 1.0, 1.0)),
        Ok(()),
        "the whole frame, in pixels"
    );
}

#[test]
fn target_in_black_frames_keeps_a_finite_box() {
    let mut tracker = tracker(1);
    follow(&mut tracker, 1);
    let black = vec![0; WIDTH * HEIGHT * 3];

    for _ in 0..50 {
        let track = tracker.update(&usual(&black)).unwrap();
        assert!(track.bbox.is_finite(), "{track:?}");
        assert!(track.bbox.w <= WIDTH as f32, "{track:?}");
        assert!(track.bbox.h <= HEIGHT as f32, "{track:?}");
    }
}

#[test]
fn first_frame_that_is_black_gives_a_finite_box() {
    let mut tracker = tracker(1);
    let black = vec![0; WIDTH * HEIGHT * 3];
    tracker.init(&usual(&black), cross_box(path(0))).unwrap();

    let track = tracker.update(&usual(&black)).unwrap();

    assert!(track.bbox.is_finite(), "{track:?}");
}
