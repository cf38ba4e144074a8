use super::*;

const GOOD: Rect = Rect::new(10.0, 10.0, 20.0, 20.0);
const FAR: Rect = Rect::new(200.0, 10.0, 20.0, 20.0);

fn annotation(boxes: &[Rect]) -> Annotation {
    Annotation::new("a", boxes.to_vec())
}

/// Precision, and success at overlap above 0, under each rule in the order of `ALL`.
fn rates(annotated: &[Rect], found: &[Rect]) -> [Option<(f64, f64)>; 4] {
    let annotation = annotation(annotated);
    Convention::ALL.map(|rule| {
        let curves = rule.curves(&annotation, found)?;
        Some((curves.precision(), curves.success[0]))
    })
}

/// Asserts the rates under got10k, pysot, OTB and drop.
fn assert_rates(annotated: &[Rect], found: &[Rect], expected: [(f64, f64); 4]) {
    let rates = rates(annotated, found);
    for (rate, expected) in rates.iter().zip(expected) {
        let rate = rate.unwrap();
        let error = (rate.0 - expected.0).abs() + (rate.1 - expected.1).abs();
        assert!(error < 1e-12, "{rates:?}, expected {expected:?}");
    }
}

#[test]
fn perfect_boxes_have_full_precision_under_every_rule() {
    let boxes = [GOOD, FAR, Rect::new(50.5, 60.25, 30.0, 7.0)];
    for rule in Convention::ALL {
        let curves = rule.curves(&annotation(&boxes), &boxes).unwrap();

        assert!((curves.auc() - 20.0 / 21.0).abs() < 1e-12, "{rule:?}");
        assert_eq!(curves.precision[0], 1.0);
        assert_eq!(rule.norm_precision(&curves), 1.0);
    }
}

#[test]
fn first_result_is_ignored_except_by_pysot() {
    let hit = (1.0, 1.0);

    assert_rates(&[GOOD, GOOD], &[FAR, GOOD], [hit, (0.5, 0.5), hit, hit]);
}

#[test]
fn nan_annotation_is_a_hit_of_precision_under_pysot_and_otb() {
    let third = (2.0 / 3.0, 2.0 / 3.0);
    let found = [GOOD, GOOD, FAR, GOOD];

    assert_rates(
        &[GOOD, Rect::NONE, GOOD, GOOD],
        &found,
        [third, (0.75, 0.5), (0.75, 0.5), third],
    );
    let all = rates(&[Rect::NONE; 2], &[GOOD; 2]);
    assert_eq!(all, [None, Some((1.0, 0.0)), Some((1.0, 0.0)), None]);
}

#[test]
fn annotation_without_area_counts_as_it_is_only_under_got10k() {
    assert_rates(
        &[GOOD, Rect::default(), GOOD, GOOD],
        &[GOOD, FAR, GOOD, GOOD],
        [(0.75, 0.75), (1.0, 0.75), (1.0, 0.75), (1.0, 1.0)],
    );
}

#[test]
fn annotation_at_the_edge_has_no_overlap_under_pysot_and_otb() {
    // The center is above 0 and x is not: pysot measures the error, OTB does not.
    let edge = Rect::new(0.0, 10.0, 20.0, 20.0);
    let hit = (1.0, 1.0);
    let half = (0.5, 0.5);

    assert_rates(
        &[GOOD, edge],
        &[GOOD, edge],
        [hit, (1.0, 0.5), (1.0, 0.5), hit],
    );
    assert_rates(&[GOOD, edge], &[GOOD, FAR], [half, half, (1.0, 0.5), half]);
}

#[test]
fn unusable_result_repeats_the_previous_frame_under_otb_alone() {
    let unusable = [
        Rect::NONE,
        Rect::default(),
        Rect::new(10.0, 10.0, -20.0, 20.0),
    ];
    for rect in unusable {
        let all = rates(&[GOOD; 3], &[GOOD, GOOD, rect]);

        assert_eq!(all[2], Some((1.0, 1.0)));
        for i in [0, 1, 3] {
            assert!(
                (all[i].unwrap().1 - 2.0 / 3.0).abs() < 1e-12,
                "{i} {rect:?}"
            );
        }
    }
}

#[test]
fn unusable_result_on_a_nan_annotation_is_kept_and_then_repeated_under_otb() {
    let truth = annotation(&[GOOD, Rect::NONE, GOOD]);

    let judged = Convention::Otb.judge(&truth, &[GOOD, Rect::NONE, Rect::NONE]);

    assert!(judged[2].unwrap().error.is_nan());
}

#[test]
fn absent_frame_is_divided_by_but_not_judged_under_pysot_alone() {
    let mut truth = annotation(&[GOOD; 4]);
    truth.present = Some(vec![true, true, false, true]);
    let precision = |rule: Convention| rule.curves(&truth, &[GOOD; 4]).unwrap().precision();

    assert_eq!(Convention::ALL.map(precision), [1.0, 0.75, 1.0, 1.0]);
}

#[test]
fn missing_result_is_a_miss_under_every_rule() {
    let half = (0.5, 0.5);
    let none = (0.0, 0.0);

    assert_rates(&[GOOD, GOOD], &[GOOD], [half; 4]);
    assert_rates(&[GOOD, GOOD], &[], [none; 4]);
    // A frame whose annotation is NaN is a hit of precision under pysot and OTB only if it has a
    // result.
    assert_rates(
        &[GOOD, Rect::NONE],
        &[GOOD],
        [(1.0, 1.0), half, half, (1.0, 1.0)],
    );
}

#[test]
fn results_after_the_last_annotation_do_not_count() {
    assert_rates(&[GOOD, GOOD], &[GOOD, GOOD, FAR, FAR], [(1.0, 1.0); 4]);
    assert_eq!(rates(&[], &[GOOD]), [None; 4]);
}

#[test]
fn errors_are_in_pixels_of_the_video() {
    let mut truth = annotation(&[GOOD, GOOD]);
    truth.scale = 0.5;
    let found = [GOOD, Rect::new(16.0, 18.0, 20.0, 20.0)];

    let judged = Convention::Got10k.judge(&truth, &found);

    assert_eq!(judged[1].unwrap().error, 20.0);
}

#[test]
fn normalized_error_divides_each_component_by_its_side() {
    let wide = Rect::new(10.0, 10.0, 20.0, 40.0);
    let found = Rect::new(16.0, 18.0, 20.0, 20.0);
    // The centers are 6 and 8 - 10 pixels apart.
    let expected = (6.0f64 / 20.0).hypot(2.0 / 40.0);
    for rule in Convention::ALL {
        let judged = rule.judge(&annotation(&[wide, wide]), &[wide, found]);

        assert!((judged[1].unwrap().norm_error - expected).abs() < 1e-12);
    }
}
