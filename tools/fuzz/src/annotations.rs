//! Files of boxes, as text and as annotations with their names.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sequences::text::{decode, parse_boxes};
use sequences::{Annotation, Convention};

fuzz_target!(|bytes: &[u8]| {
    let Ok(boxes) = parse_boxes(&decode(bytes)) else {
        return;
    };
    assert!(!boxes.is_empty(), "a file without a row is an error");
    let found = boxes.clone();
    let truth = Annotation::new("fuzzed", boxes);
    for convention in Convention::ALL {
        if let Some(curves) = convention.curves(&truth, &found) {
            assert!(!curves.auc().is_nan(), "a score is a number");
        }
    }
});
