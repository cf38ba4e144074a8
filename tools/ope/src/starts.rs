//! Four passes over a sequence in place of one: from its first and its middle frame forwards, from
//! its last and its middle frame backwards.
//!
//! One-pass evaluation counts everything after the first slip, so that on a few sequences one slip
//! more or less changes the mean by points. Four starts even that out, for about three times the
//! frames. The idea is that of the anchors of the VOT challenges (Kristan et al., VOT2020), except
//! that every pass runs to the end.
//!
//! A pass starts at the frame nearest to its nominal start that shows the target.

use sequences::dataset::Attributes;
use sequences::{Annotation, Sequence};

/// Where a pass starts and which way it goes.
#[derive(Clone, Copy, Debug)]
struct Start {
    suffix: &'static str,
    from_middle: bool,
    is_backwards: bool,
}

const STARTS: [Start; 4] = [
    Start {
        suffix: "",
        from_middle: false,
        is_backwards: false,
    },
    Start {
        suffix: ".middle",
        from_middle: true,
        is_backwards: false,
    },
    Start {
        suffix: ".backwards",
        from_middle: false,
        is_backwards: true,
    },
    Start {
        suffix: ".middle-backwards",
        from_middle: true,
        is_backwards: true,
    },
];

impl Start {
    /// The frame at which the pass starts in a sequence of `n` frames that are all visible.
    fn nominal(self, n: usize) -> usize {
        match (self.from_middle, self.is_backwards) {
            (false, false) => 0,
            (true, false) => n / 2,
            (false, true) => n.saturating_sub(1),
            (true, true) => n.div_ceil(2).saturating_sub(1),
        }
    }

    /// The frames of a sequence in the order of this pass; `None` if no frame shows the target, or
    /// no frame is left after the start.
    fn order(self, whole: &Annotation) -> Option<Vec<usize>> {
        let n = whole.boxes.len();
        let nominal = self.nominal(n);
        let start = (0..n)
            .filter(|i| whole.is_visible(*i))
            .min_by_key(|i| i.abs_diff(nominal))?;
        let order: Vec<usize> = if self.is_backwards {
            (0..=start).rev().collect()
        } else {
            (start..n).collect()
        };
        (order.len() > 1).then_some(order)
    }

    /// The annotation in the order of the pass.
    fn annotation(self, whole: &Annotation, order: &[usize]) -> Annotation {
        let present = |_: &Vec<bool>| order.iter().map(|&i| whole.is_present(i)).collect();
        Annotation {
            name: format!("{}{}", whole.name, self.suffix),
            boxes: order.iter().map(|&i| whole.boxes[i]).collect(),
            present: whole.present.as_ref().map(present),
            ..whole.clone()
        }
    }
}

/// Whether more than the first frame is annotated. Other sequences keep their one pass.
fn has_passes(whole: &Annotation) -> bool {
    whole.boxes.len() > 1
}

/// The annotations of all passes.
pub fn annotations(whole: Vec<Annotation>) -> Vec<Annotation> {
    let mut passes = Vec::new();
    for whole in whole {
        if !has_passes(&whole) {
            passes.push(whole);
            continue;
        }
        for start in STARTS {
            if let Some(order) = start.order(&whole) {
                passes.push(start.annotation(&whole, &order));
            }
        }
    }
    passes
}

/// The annotations of all passes with their pictures.
pub fn sequences(whole: Vec<Sequence>) -> Vec<Sequence> {
    let mut passes = Vec::new();
    for whole in whole {
        if !has_passes(&whole.annotation) {
            passes.push(whole);
            continue;
        }
        for start in STARTS {
            if let Some(order) = start.order(&whole.annotation) {
                passes.push(Sequence {
                    annotation: start.annotation(&whole.annotation, &order),
                    frames: order.iter().map(|&i| whole.frames[i].clone()).collect(),
                });
            }
        }
    }
    passes
}

/// The sequence that a pass goes through.
pub fn sequence_of(pass: &str) -> &str {
    let suffixes = STARTS.iter().map(|start| start.suffix).skip(1);
    let mut stripped = suffixes.filter_map(|suffix| pass.strip_suffix(suffix));
    stripped.next().unwrap_or(pass)
}

/// The attributes of passes: each pass has those of its sequence.
pub fn attributes(mut attributes: Attributes) -> Attributes {
    for names in attributes.values_mut() {
        let passes = |name: &String| STARTS.map(|start| format!("{name}{}", start.suffix));
        *names = names.iter().flat_map(passes).collect();
    }
    attributes
}

#[cfg(test)]
mod tests {
    use super::*;
    use sequences::Rect;
    use std::path::PathBuf;

    fn sequence(n: usize) -> Sequence {
        let boxes = (0..n).map(|i| Rect::new(i as f64, 0.0, 10.0, 10.0));
        let annotation = Annotation {
            present: Some(vec![true; n]),
            scale: 0.5,
            ..Annotation::new("a", boxes.collect())
        };
        Sequence {
            annotation,
            frames: (0..n).map(|i| PathBuf::from(i.to_string())).collect(),
        }
    }

    /// Name and frames of every pass.
    fn passes(whole: Sequence) -> Vec<(String, String)> {
        let frames = |pass: &Sequence| {
            pass.frames
                .iter()
                .map(|f| f.display().to_string())
                .collect()
        };
        sequences(vec![whole])
            .iter()
            .map(|pass| (pass.annotation.name.clone(), frames(pass)))
            .collect()
    }

    fn expected(passes: &[(&str, &str)]) -> Vec<(String, String)> {
        let owned = |(name, frames): &(&str, &str)| ((*name).to_owned(), (*frames).to_owned());
        passes.iter().map(owned).collect()
    }

    #[test]
    fn visible_sequence_has_four_passes() {
        let found = passes(sequence(5));

        let all = [
            ("a", "01234"),
            ("a.middle", "234"),
            ("a.backwards", "43210"),
            ("a.middle-backwards", "210"),
        ];
        assert_eq!(found, expected(&all));
        assert!(all.iter().all(|(pass, _)| sequence_of(pass) == "a"));
    }

    #[test]
    fn pass_carries_the_boxes_of_its_frames() {
        let passes = sequences(vec![sequence(5)]);

        for pass in &passes {
            let frames = pass
                .frames
                .iter()
                .map(|f| f.to_string_lossy().parse::<f64>().unwrap());
            assert!(pass.annotation.boxes.iter().map(|b| b.x).eq(frames));
            let present = pass.annotation.present.as_ref().map(Vec::len);
            assert_eq!(present, Some(pass.frames.len()));
        }
        let apart: Vec<Annotation> = passes.into_iter().map(|pass| pass.annotation).collect();
        assert_eq!(annotations(vec![sequence(5).annotation]), apart);
    }

    #[test]
    fn pass_whose_start_is_hidden_starts_at_the_nearest_visible_frame() {
        let mut whole = sequence(8);
        whole.annotation.boxes[0] = Rect::NONE;
        whole.annotation.boxes[7].w = f64::NAN;
        whole.annotation.present.as_mut().unwrap()[4] = false;
        whole.annotation.boxes[3].h = 0.0;

        let found = passes(whole);

        let all = [
            ("a", "1234567"),
            ("a.middle", "567"),
            ("a.backwards", "6543210"),
            ("a.middle-backwards", "210"),
        ];
        assert_eq!(found, expected(&all));
    }

    #[test]
    fn sequence_with_one_public_box_keeps_its_one_pass() {
        let hidden = Sequence {
            annotation: sequence(1).annotation,
            ..sequence(4)
        };

        assert_eq!(sequences(vec![hidden.clone()]), [hidden]);
    }

    #[test]
    fn sequence_without_a_visible_frame_has_no_pass() {
        let mut whole = sequence(3);
        whole.annotation.boxes = vec![Rect::NONE; 3];

        assert_eq!(passes(whole), []);
    }
}
