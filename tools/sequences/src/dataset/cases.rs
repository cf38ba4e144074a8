//! Folders as users provide them, each with what is read from it.

use super::*;
use testing::Folder;

/// Boxes of eight frames.
fn boxes() -> String {
    "20,40,24,18\n".repeat(8)
}

fn pictures(folder: &Folder, at: &str, extension: &str) {
    for i in 1..=8 {
        folder.write(&format!("{at}/{i:04}.{extension}"), "");
    }
}

/// A change to a folder that holds the sequence `b` in good order.
type Change = fn(&Folder);

/// Frames by sequence, and words that the notes contain.
struct Case {
    name: &'static str,
    dataset: Dataset,
    change: Change,
    expected: &'static [(&'static str, usize)],
    words: &'static [&'static str],
}

const CASES: &[Case] = &[
    Case {
        name: "hidden files of macOS",
        dataset: Dataset::Folder,
        change: |folder| {
            folder.write("b/img/._0001.jpg", "\0\x05\x16\x07");
            folder.write("b/._groundtruth.txt", "\0\x05\x16\x07");
            folder.write("b/img/.DS_Store", "");
            folder.write("__MACOSX/b/img/._0001.jpg", "\0\x05\x16\x07");
            folder.write("__MACOSX/b/groundtruth.txt", "\0\x05\x16\x07");
        },
        expected: &[("b", 8)],
        words: &[],
    },
    Case {
        name: "thumbnails of network storage",
        dataset: Dataset::Folder,
        change: |folder| {
            folder.write("b/img/@eaDir/0001.jpg/SYNOPHOTO_THUMB_M.jpg", "");
        },
        expected: &[("b", 8)],
        words: &[],
    },
    Case {
        name: "a folder whose name is that of a picture",
        dataset: Dataset::Folder,
        change: |folder| {
            folder.write("b/img/old.jpg/1.jpg", "");
        },
        expected: &[("b", 8)],
        words: &[],
    },
    Case {
        name: "UAV123 from a zip made on a Mac",
        dataset: Dataset::Uav123,
        change: |folder| {
            folder.write("anno/UAV123/bike1.txt", boxes());
            pictures(folder, "data_seq/UAV123/bike1", "jpg");
            folder.write(
                "__MACOSX/data_seq/UAV123/bike1/._0001.jpg",
                "\0\x05\x16\x07",
            );
        },
        expected: &[("bike1", 8)],
        words: &["expected 123 sequences, found 1"],
    },
    Case {
        name: "another case of the annotation's name",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "a/img", "JPG");
            folder.write("a/GroundTruth_Rect.TXT", boxes());
        },
        expected: &[("a", 8), ("b", 8)],
        words: &[],
    },
    Case {
        name: "pictures in a folder of another name",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "a/visible", "jpg");
            folder.write("a/groundtruth.txt", boxes());
        },
        expected: &[("b", 8)],
        words: &[
            "a: left out: no pictures in a/img, a/imgs, a/color or a",
            "a/visible",
        ],
    },
    Case {
        name: "pictures without an annotation",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "a/img", "jpg");
            folder.write("a/gt.txt", boxes());
        },
        expected: &[("b", 8)],
        words: &["a/img: pictures without a groundtruth*.txt"],
    },
    Case {
        name: "two annotations of one sequence",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "a/img", "jpg");
            folder.write("a/groundtruth.txt", boxes());
            folder.write("a/groundtruth_rect.txt", boxes());
        },
        expected: &[("b", 8)],
        words: &["a: left out: 2 annotations: groundtruth.txt and groundtruth_rect.txt"],
    },
    Case {
        name: "a stray line in an annotation",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "a/img", "jpg");
            folder.write("a/groundtruth.txt", boxes() + "done.\n");
        },
        expected: &[("b", 8)],
        words: &["a: left out: ", "line 9", "done."],
    },
    Case {
        name: "masks of the same names beside the pictures",
        dataset: Dataset::Folder,
        change: |folder| pictures(folder, "b/img", "png"),
        expected: &[("b", 8)],
        words: &["b: used only the .jpg of 8 .jpg, 8 .png"],
    },
    Case {
        name: "pictures of two kinds, neither as many as the boxes",
        dataset: Dataset::Folder,
        change: |folder| {
            folder.write("b/img/extra.jpg", "");
            folder.write("b/img/thumbnail.png", "");
        },
        expected: &[],
        words: &["b: left out: pictures of several kinds for 8 boxes: 9 .jpg, 1 .png"],
    },
    Case {
        name: "masks that say so beside the pictures",
        dataset: Dataset::Folder,
        change: |folder| {
            for i in 1..=8 {
                folder.write(&format!("b/img/{i:04}_mask.png"), "");
            }
        },
        expected: &[("b", 8)],
        words: &[],
    },
    Case {
        name: "pictures of two extensions that are all frames",
        dataset: Dataset::Folder,
        change: |folder| {
            pictures(folder, "b/img", "png");
            folder.write("b/groundtruth.txt", boxes().repeat(2));
        },
        expected: &[("b", 16)],
        words: &[],
    },
    Case {
        name: "fewer pictures than boxes",
        dataset: Dataset::Folder,
        change: |folder| {
            folder.write("b/groundtruth.txt", boxes() + "20,40,24,18\n");
        },
        expected: &[("b", 8)],
        words: &["b: 8 frames and 9 boxes: the rest is left out"],
    },
];

#[test]
fn folders_of_users_are_read_or_the_reason_is_given() {
    for case in CASES {
        let folder = Folder::new("case");
        pictures(&folder, "b/img", "jpg");
        folder.write("b/groundtruth.txt", boxes());
        (case.change)(&folder);
        let mut notes = Notes::default();

        let loaded = case.dataset.load(folder.path(), &mut notes);

        // Without any usable sequence, the error carries the notes.
        let (sequences, said) = match loaded {
            Ok(sequences) => (sequences, notes.to_string()),
            Err(error) => (Vec::new(), error.to_string()),
        };
        let found: Vec<_> = sequences
            .iter()
            .map(|s| (s.annotation.name.as_str(), s.frames.len()))
            .collect();
        assert_eq!(found, case.expected, "{}: {said}", case.name);
        for word in case.words {
            assert!(said.contains(word), "{}: {word:?} not in {said}", case.name);
        }
        assert_eq!(
            said.is_empty(),
            case.words.is_empty(),
            "{}: {said}",
            case.name
        );
    }
}

#[test]
fn root_without_annotations_is_refused_with_the_texts_it_holds() {
    let folder = Folder::new("case");
    pictures(&folder, "a/img", "jpg");
    folder.write("a/gt.txt", boxes());

    let error = Dataset::Folder.load(folder.path(), &mut Notes::default());

    let message = error.unwrap_err().to_string();
    let expected = "annotations of folder (<sequence>/groundtruth*.txt), found none \
                    (but texts: a/gt.txt)";
    assert!(message.contains(expected), "{message}");
}
