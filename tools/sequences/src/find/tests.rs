use super::*;
use crate::rect::Rect;
use testing::{Folder, shared};

fn pictures(folder: &Folder, at: &str, count: usize) {
    for i in 1..=count {
        folder.write(&format!("{at}/{i:06}.jpg"), "");
    }
}

fn annotate(folder: &Folder, file: &str, count: usize) {
    let mut text = String::new();
    for i in 0..count {
        text += &if i == 1 {
            "NaN,NaN,NaN,NaN\n".to_owned()
        } else {
            format!("{i},2\t30 4.5\n")
        };
    }
    folder.write(file, text);
}

#[test]
fn sequences_of_every_layout_are_found_at_once() {
    let folder = Folder::new("find");
    pictures(&folder, "DTB70/Gull2/img", 5);
    annotate(&folder, "DTB70/Gull2/groundtruth_rect.txt", 5);
    folder.write(
        "DTB70/Gull2/meta.json",
        r#"{"scale": 0.5, "in_train": true}"#,
    );
    folder.write("DTB70/Gull2/result.txt", "1,2,3,4\n");
    pictures(&folder, "got/GOT-10k_Train_000001", 3);
    annotate(&folder, "got/GOT-10k_Train_000001/groundtruth.txt", 3);
    folder.write("got/list.txt", "GOT-10k_Train_000001\n");
    folder.write("got/GOT-10k_Train_000001/absence.label", "0\n0\n0\n");
    pictures(&folder, "UAV123_10fps/data_seq/UAV123_10fps/bird1", 820);
    annotate(&folder, "UAV123_10fps/anno/UAV123_10fps/bird1_2.txt", 235);
    annotate(&folder, "UAV123_10fps/anno/UAV123_10fps/att/bird1_2.txt", 1);
    pictures(&folder, "UAVDT/sequences/S0101", 4);
    annotate(&folder, "UAVDT/anno/S0101_gt.txt", 6);
    pictures(&folder, "VisDrone/sequences/uav0_s", 2);
    annotate(&folder, "VisDrone/annotations/uav0_s.txt", 2);
    annotate(&folder, "VisDrone/annotations/uav1_s.txt", 2);
    let mut notes = Notes::default();

    let found = find(folder.path(), &mut notes).unwrap();

    let summary: Vec<_> = found
        .iter()
        .map(|s| (&s.annotation.name[..], s.frames.len()))
        .collect();
    let expected = [
        ("DTB70/Gull2", 5),
        ("UAV123_10fps/bird1_2", 235),
        ("anno/S0101", 4),
        ("annotations/uav0_s", 2),
        ("got/GOT-10k_Train_000001", 3),
    ];
    assert_eq!(summary, expected);
    assert!(found[1].frames[0].ends_with("bird1/000259.jpg"));
    let gull = &found[0].annotation;
    assert_eq!((gull.scale, gull.in_train), (0.5, true));
    assert_eq!(gull.boxes[0], Rect::new(0.0, 2.0, 30.0, 4.5));
    assert!(gull.boxes[1].has_nan());
    let text = notes.to_string();
    assert!(text.contains("4 frames and 6 boxes"), "{text}");
    assert!(text.contains("no pictures in a folder uav1_s"), "{text}");
    assert_eq!(notes.count(), 2);
    let all = pictures_below(folder.path()).unwrap();
    assert_eq!(all.len(), 5 + 3 + 820 + 4 + 2);
}

#[test]
fn pictures_without_an_annotation_are_noted() {
    let folder = Folder::new("find");
    pictures(&folder, "set/a/img", 3);
    annotate(&folder, "set/a/gt.txt", 3);
    pictures(&folder, "set/b/visible", 3);
    annotate(&folder, "set/b/groundtruth.txt", 3);
    let mut notes = Notes::default();

    let found = find(folder.path(), &mut notes).unwrap();

    assert_eq!(found, []);
    let text = notes.to_string();
    assert!(
        text.contains("set/a/img: pictures without an annotation"),
        "{text}"
    );
    assert!(
        text.contains("b: no pictures in b/img, b/imgs, b/color or b"),
        "{text}"
    );
    assert_eq!(notes.count(), 2, "{text}");
}

#[test]
fn sequence_annotated_twice_is_left_out_with_a_note() {
    let folder = Folder::new("find");
    pictures(&folder, "set/a/img", 3);
    annotate(&folder, "set/a/groundtruth.txt", 3);
    annotate(&folder, "set/a/groundtruth_rect.txt", 3);
    pictures(&folder, "set/b/img", 3);
    annotate(&folder, "set/b/groundtruth.txt", 3);
    let mut notes = Notes::default();

    let found = find(folder.path(), &mut notes).unwrap();

    assert_eq!(found.len(), 1);
    let text = notes.to_string();
    assert!(
        text.contains("groundtruth.txt and groundtruth_rect.txt"),
        "{text}"
    );
}

#[test]
fn development_sequences_are_found_without_notes() {
    let Some(root) = shared("data/dev_seqs") else {
        return;
    };
    let mut notes = Notes::default();

    let found = find(&root, &mut notes).unwrap();

    let in_train = found.iter().filter(|s| s.annotation.in_train).count();
    assert_eq!(
        (found.len(), in_train, notes.count()),
        (20, 5, 0),
        "{notes}"
    );
}
