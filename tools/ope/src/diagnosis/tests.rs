use super::*;
use crate::results::Results;
use crate::score::Missing;
use sequences::dataset::Attributes;
use sequences::{Annotation, Convention, Notes, Sequence};
use testing::Folder;

/// A target that widens from 20 x 20 to 60 x 20 within 41 frames.
fn widening() -> Vec<Rect> {
    let width = |i: usize| 20.0 + i as f64;
    (0..41)
        .map(|i| Rect::new(100.0 - width(i) / 2.0, 50.0, width(i), 20.0))
        .collect()
}

/// The comparison of trackers by their boxes on one sequence `a`.
fn comparison(truth: &[Rect], trackers: &[Vec<Rect>]) -> Comparison {
    let folder = Folder::new("diagnosis");
    let mut results = Vec::new();
    for (i, boxes) in trackers.iter().enumerate() {
        let tracker = Results::create(&folder.join(&format!("t{i}"))).unwrap();
        tracker.write("a", boxes, &[]).unwrap();
        results.push(tracker);
    }
    Comparison::read(
        &[Annotation::new("a", truth.to_vec())],
        &results,
        Convention::Got10k,
        Missing::Refuse,
        Attributes::new(),
        &mut Notes::default(),
    )
    .unwrap()
}

#[test]
fn box_that_follows_half_of_the_aspect_has_a_slope_of_one_half() {
    let truth = widening();
    // Width and height change by the square root of what they should, at the true center.
    let half: Vec<Rect> = truth
        .iter()
        .map(|t| {
            let w = 20.0 * (t.w / 20.0).sqrt();
            Rect::new(t.x + (t.w - w) / 2.0, t.y, w, t.h)
        })
        .collect();

    let found = diagnose(&comparison(&truth, &[half, truth.clone()]));

    let [half, perfect] = &found.trackers[..] else {
        panic!("{found:?}");
    };
    assert_eq!((found.common_frames, found.visible_frames), (40, 40));
    assert!((half.shape.aspect.slope - 0.5).abs() < 1e-3, "{half:?}");
    assert!((half.shape.size.slope - 0.5).abs() < 1e-3, "{half:?}");
    assert!(half.shape.center_error < 1e-3, "{half:?}");
    assert!((perfect.shape.aspect.slope - 1.0).abs() < 1e-6);
    assert!(perfect.shape.aspect.rmse < 1e-6);
    assert!((perfect.shape.mean_iou - 1.0).abs() < 1e-6);
    assert!(perfect.losses.is_empty());
    // Aspects change by less than 0.1, to 0.25, to 0.5, and beyond.
    let short = comparison(&truth[..3], &[truth[..3].to_vec()]);
    let cells = diagnose(&short).trackers[0].shape.cells();
    assert_eq!(cells[6..], ["1.000", "", "", ""]);
}

#[test]
fn iou_falls_in_the_bins_of_greater_change_for_a_box_that_keeps_its_shape() {
    let truth = widening();
    let stiff: Vec<Rect> = truth
        .iter()
        .map(|t| Rect::new(t.x + t.w / 2.0 - 10.0, 50.0, 20.0, 20.0))
        .collect();

    let found = diagnose(&comparison(&truth, &[stiff]));

    let shape = &found.trackers[0].shape;
    assert_eq!(shape.aspect.slope, 0.0);
    let ious: Vec<f64> = shape.by_aspect.iter().map(|bin| bin.mean_iou).collect();
    assert!(ious.windows(2).all(|two| two[0] > two[1]), "{ious:?}");
    let frames: usize = shape.by_aspect.iter().map(|bin| bin.frames).sum();
    assert_eq!(frames, found.common_frames);
}

#[test]
fn shape_counts_only_frames_in_which_every_tracker_is_on_the_target() {
    let truth = widening();
    let mut lost = truth.clone();
    for rect in &mut lost[21..] {
        rect.y += 400.0;
    }

    let found = diagnose(&comparison(&truth, &[truth.clone(), lost]));

    assert_eq!(found.common_frames, 20);
    assert_eq!(found.trackers[0].on_target, 100.0);
    assert_eq!(found.trackers[1].on_target, 50.0);
}

/// Forty frames of a target that moves right by 3 pixels per frame.
fn moving() -> Vec<Rect> {
    (0..40)
        .map(|i| Rect::new(3.0 * i as f64, 50.0, 20.0, 20.0))
        .collect()
}

/// Makes the box of a frame from its number and the true box.
type Change = fn(usize, Rect) -> Rect;

/// The target's boxes, from frame 15 on changed.
fn lost_by(change: Change) -> Vec<Rect> {
    let changed = |(i, rect)| if i < 15 { rect } else { change(i, rect) };
    moving().into_iter().enumerate().map(changed).collect()
}

#[test]
fn losses_are_named_after_what_the_box_did() {
    let cases: [(Cause, Change); 6] = [
        (Cause::NoBox, |_, _| Rect::NONE),
        (Cause::Jumped, |_, t| {
            Rect::new(t.x, t.y + 200.0, 20.0, 20.0)
        }),
        (Cause::Stayed, |_, _| Rect::new(42.0, 50.0, 20.0, 20.0)),
        (Cause::Slid, |i, t| {
            let away = (i - 14) as f64;
            Rect::new(t.x - 6.0 * away, t.y + 6.0 * away, 20.0, 20.0)
        }),
        (Cause::Grew, |i, t| {
            let grown = 5.0 * (i - 14) as f64;
            Rect::new(
                t.x - 2.0 * grown,
                t.y - grown,
                20.0 + 2.0 * grown,
                20.0 + 2.0 * grown,
            )
        }),
        (Cause::Shrank, |i, t| {
            let side = (20.0 - 4.0 * (i - 14) as f64).max(2.0);
            Rect::new(t.x, t.y, side, side)
        }),
    ];
    for (cause, change) in cases {
        let boxes = lost_by(change);

        let found = diagnose(&comparison(&moving(), &[boxes]));

        let losses = &found.trackers[0].losses;
        assert_eq!(losses.len(), 1, "{cause:?}: {losses:?}");
        assert_eq!(losses[0].cause, cause, "{losses:?}");
        assert_eq!(losses[0].back, None);
        assert!(
            losses[0].frame >= 15 && losses[0].last_on >= 14,
            "{losses:?}"
        );
    }
}

#[test]
fn loss_ends_where_the_box_is_on_the_target_again() {
    let boxes = lost_by(|i, t| Rect::new(t.x, if i < 25 { 400.0 } else { t.y }, 20.0, 20.0));

    let found = diagnose(&comparison(&moving(), &[boxes]));

    let loss = &found.trackers[0].losses[0];
    assert_eq!((loss.frame, loss.last_on, loss.back), (15, 14, Some(25)));
    assert_eq!(loss.lost_for, 10);
    assert!((loss.distance - 17.5).abs() < 1e-9, "{loss:?}");
}

#[test]
fn loss_of_a_hidden_target_has_that_cause() {
    let mut truth = moving();
    for rect in &mut truth[15..18] {
        *rect = Rect::NONE;
    }
    let boxes = lost_by(|_, t| Rect::new(t.x, 400.0, 20.0, 20.0));

    let found = diagnose(&comparison(&truth, &[boxes]));

    assert_eq!(found.trackers[0].losses[0].cause, Cause::Hidden);
    assert_eq!(found.visible_frames, 36);
}

#[test]
fn few_frames_off_the_target_are_a_slip() {
    let boxes = lost_by(|i, t| Rect::new(t.x, if i < 19 { 400.0 } else { t.y }, 20.0, 20.0));

    let found = diagnose(&comparison(&moving(), &[boxes]));

    assert_eq!(found.trackers[0].losses, []);
}

#[test]
fn sheet_of_a_loss_shows_its_frames() {
    let folder = Folder::new("sheet");
    let picture = image::RgbImage::from_pixel(160, 120, image::Rgb([90, 90, 90]));
    let path = folder.join("frame.png");
    picture.save(&path).unwrap();
    let boxes = lost_by(|_, t| Rect::new(t.x, 90.0, 20.0, 20.0));
    let compared = comparison(&moving(), &[boxes]);
    let pass = &compared.trackers[0].sequences[0];
    let sequence = Sequence {
        annotation: pass.annotation.clone(),
        frames: vec![path; 40],
    };
    let loss = &losses::of(pass)[0];

    let sheet = sheet::sheet(loss, pass, &sequence).unwrap();

    // The first frame and 6 of the 7 around frame 15: frame -5 does not exist.
    assert_eq!(sheet.dimensions(), (4 * 196 + 4, 2 * 196 + 4));
    let colors: Vec<_> = [[255u8, 255, 255], [213, 94, 0]].map(image::Rgb).to_vec();
    for color in colors {
        assert!(sheet.pixels().any(|pixel| *pixel == color), "{color:?}");
    }
}
