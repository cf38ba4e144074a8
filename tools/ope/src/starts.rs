//! Four passes over a sequence in place of one: from its first and its middle frame forwards, from its last and its middle frame
//! backwards.
//!
//! One-pass evaluation counts everything after the first slip: on a few short sequences one slip more or less moves the mean by
//! points. Other starts even that out, at four starts for about three times the frames. As the anchors of the VOT challenges
//! (Kristan et al., VOT2020), except that a pass always runs to the end.

use crate::annotations::Annotation;
use crate::dataset::{Attributes, Sequence};

/// Where a pass starts and which way it goes.
const STARTS: [Start; 4] = [
    Start {
        suffix: "",
        middle: false,
        backwards: false,
    },
    Start {
        suffix: ".middle",
        middle: true,
        backwards: false,
    },
    Start {
        suffix: ".backwards",
        middle: false,
        backwards: true,
    },
    Start {
        suffix: ".middle-backwards",
        middle: true,
        backwards: true,
    },
];

#[derive(Clone, Copy, Debug)]
struct Start {
    suffix: &'static str,
    middle: bool,
    backwards: bool,
}

impl Start {
    /// Frames of a sequence of `n`, in the order of this pass.
    fn order(self, n: usize) -> Vec<usize> {
        match (self.middle, self.backwards) {
            (false, false) => (0..n).collect(),
            (true, false) => (n / 2..n).collect(),
            (false, true) => (0..n).rev().collect(),
            (true, true) => (0..n.div_ceil(2)).rev().collect(),
        }
    }

    /// What is annotated along the pass; `None` where it starts without a target, or nothing comes after it.
    fn annotation(self, whole: &Annotation, order: &[usize]) -> Option<Annotation> {
        let first = *order.first()?;
        let starts = whole.is_present(first) && whole.boxes.get(first)?.is_usable();
        (starts && order.len() > 1).then(|| Annotation {
            name: format!("{}{}", whole.name, self.suffix),
            boxes: order
                .iter()
                .filter_map(|&i| whole.boxes.get(i).copied())
                .collect(),
            present: whole
                .present
                .as_ref()
                .map(|_| order.iter().map(|&i| whole.is_present(i)).collect()),
            scale: whole.scale,
        })
    }
}

/// The annotations of all passes; a sequence of which only the first box is public keeps its one pass.
pub fn annotations(whole: Vec<Annotation>) -> Vec<Annotation> {
    passes(
        whole,
        |whole| whole,
        |start, whole| start.annotation(whole, &start.order(whole.boxes.len())),
    )
}

/// The same with their pictures.
pub fn sequences(whole: Vec<Sequence>) -> Vec<Sequence> {
    let pass = |start: Start, whole: &Sequence| {
        let order = start.order(whole.frames.len());
        let annotation = start.annotation(&whole.annotation, &order)?;
        Some(Sequence {
            annotation,
            frames: order.iter().map(|&i| whole.frames[i].clone()).collect(),
        })
    };
    passes(whole, |whole| &whole.annotation, pass)
}

fn passes<T>(
    whole: Vec<T>,
    annotation: impl Fn(&T) -> &Annotation,
    pass: impl Fn(Start, &T) -> Option<T>,
) -> Vec<T> {
    let mut passes = Vec::new();
    for whole in whole {
        if annotation(&whole).boxes.len() > 1 {
            passes.extend(STARTS.into_iter().filter_map(|start| pass(start, &whole)));
        } else {
            passes.push(whole);
        }
    }
    passes
}

/// Every pass has its sequence's attributes.
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
    use crate::bbox::BBox;
    use std::path::PathBuf;

    fn sequence(n: usize) -> Sequence {
        let boxes = (0..n)
            .map(|i| BBox::new(i as f64, 0.0, 10.0, 10.0))
            .collect();
        let annotation = Annotation {
            name: "a".into(),
            boxes,
            present: Some(vec![true; n]),
            scale: 0.5,
        };
        Sequence {
            annotation,
            frames: (0..n).map(|i| PathBuf::from(i.to_string())).collect(),
        }
    }

    #[test]
    fn four_passes_with_their_pictures() {
        let passes = sequences(vec![sequence(5)]);
        let found: Vec<(&str, String)> = passes
            .iter()
            .map(|pass| {
                let frames = pass
                    .frames
                    .iter()
                    .map(|path| path.display().to_string())
                    .collect();
                (pass.annotation.name.as_str(), frames)
            })
            .collect();
        let expected = [
            ("a", "01234"),
            ("a.middle", "234"),
            ("a.backwards", "43210"),
            ("a.middle-backwards", "210"),
        ];
        assert_eq!(
            found,
            expected.map(|(name, frames)| (name, frames.to_owned()))
        );
        for pass in &passes {
            let along: Vec<f64> = pass
                .frames
                .iter()
                .map(|path| path.to_string_lossy().parse().unwrap())
                .collect();
            assert!(pass.annotation.boxes.iter().map(|b| b.x).eq(along));
            assert_eq!(
                pass.annotation.present.as_ref().map(Vec::len),
                Some(pass.frames.len())
            );
        }
        let apart: Vec<Annotation> = passes.into_iter().map(|pass| pass.annotation).collect();
        assert_eq!(annotations(vec![sequence(5).annotation]), apart);
    }

    #[test]
    fn a_pass_needs_a_target_to_start_with() {
        let mut whole = sequence(6);
        whole.annotation.boxes[5].w = f64::NAN;
        whole.annotation.present.as_mut().unwrap()[3] = false;
        let names: Vec<String> = sequences(vec![whole])
            .into_iter()
            .map(|pass| pass.annotation.name)
            .collect();
        assert_eq!(names, ["a", "a.middle-backwards"]);
        let hidden = Sequence {
            annotation: sequence(1).annotation,
            ..sequence(4)
        };
        assert_eq!(
            sequences(vec![hidden.clone()]),
            [hidden],
            "only the first box is public"
        );
    }
}
