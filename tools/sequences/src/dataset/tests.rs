use super::*;
use testing::{Folder, shared};

fn pictures(folder: &Folder, at: &str, pattern: impl Fn(usize) -> String, count: usize) {
    for i in 1..=count {
        folder.write(&format!("{at}/{}", pattern(i)), "");
    }
}

fn boxes(folder: &Folder, path: &str, count: usize) {
    folder.write(path, "1,2,30,40\n".repeat(count));
}

fn six(i: usize) -> String {
    format!("{i:06}.jpg")
}

/// Names, frame counts and first pictures.
fn load(dataset: Dataset, root: &Path) -> (Vec<(String, usize, String)>, Notes) {
    let mut notes = Notes::default();
    let sequences = dataset.load(root, &mut notes).unwrap();
    let summary = |s: &Sequence| {
        (
            s.annotation.name.clone(),
            s.frames.len(),
            file_name(&s.frames[0]),
        )
    };
    (sequences.iter().map(summary).collect(), notes)
}

fn row(name: &str, frames: usize, first: &str) -> (String, usize, String) {
    (name.into(), frames, first.into())
}

#[test]
fn uav123_is_cut_from_its_videos_at_every_rate() {
    let folder = Folder::new("uav123");
    for (set, count) in [("UAV123", 900), ("UAV123_10fps", 300)] {
        pictures(&folder, &format!("{set}/data_seq/{set}/bird1"), six, count);
        pictures(&folder, &format!("{set}/data_seq/{set}/boat5"), six, 10);
    }
    boxes(&folder, "UAV123/anno/UAV123/bird1_2.txt", 126); // its frames are 775..=1477 of 900
    boxes(&folder, "UAV123/anno/UAV20L/bird1.txt", 900);
    boxes(&folder, "UAV123_10fps/anno/UAV123_10fps/bird1_1.txt", 85);
    boxes(&folder, "UAV123_10fps/anno/UAV123_10fps/bird1_2.txt", 42);
    boxes(&folder, "UAV123_10fps/anno/UAV123_10fps/boat5.txt", 10);
    folder.write(
        "UAV123_10fps/anno/UAV123_10fps/att/boat5.txt",
        "1,0,0,0,0,0,0,0,0,0,1,0\n",
    );
    assert_eq!(
        load(Dataset::Uav123, folder.path()).0,
        [row("bird1_2", 126, "000775.jpg")]
    );
    assert_eq!(
        load(Dataset::Uav20l, folder.path()).0,
        [row("bird1", 900, "000001.jpg")]
    );
    let (found, notes) = load(Dataset::Uav123At10Fps, folder.path());
    let expected = [
        row("bird1_1", 85, "000001.jpg"),
        row("bird1_2", 42, "000259.jpg"),
        row("boat5", 10, "000001.jpg"),
    ];
    assert_eq!(found, expected);
    let expected = "note: UAV123_10fps: expected 123 sequences, found 3\n";
    assert_eq!(notes.to_string(), expected);
    let attributes = Dataset::Uav123At10Fps.attributes(folder.path()).unwrap();
    let names: Vec<_> = attributes
        .iter()
        .map(|(name, of)| (&name[..], &of[0][..]))
        .collect();
    assert_eq!(
        names,
        [("camera motion", "boat5"), ("scale variation", "boat5")]
    );
}

#[test]
fn annotations_beside_pictures_are_found_with_them() {
    let folder = Folder::new("beside");
    pictures(&folder, "Gull2/img", |i| format!("{i:05}.jpg"), 5);
    boxes(&folder, "Gull2/groundtruth_rect.txt", 5);
    pictures(&folder, "deep/Jogging/img", |i| format!("{i:04}.jpg"), 3);
    boxes(&folder, "deep/Jogging/groundtruth_rect.1.txt", 3);
    boxes(&folder, "deep/Jogging/groundtruth_rect.2.txt", 3);
    pictures(&folder, "David/img", |i| format!("{i:04}.jpg"), 771);
    boxes(&folder, "David/groundtruth_rect.txt", 471);
    pictures(
        &folder,
        "val/GOT-10k_Val_000001",
        |i| format!("{i:08}.jpg"),
        4,
    );
    boxes(&folder, "val/GOT-10k_Val_000001/groundtruth.txt", 4);
    let beside = [
        row("GOT-10k_Val_000001", 4, "00000001.jpg"),
        row("Gull2", 5, "00001.jpg"),
    ];
    let jogging = [
        row("Jogging.1", 3, "0001.jpg"),
        row("Jogging.2", 3, "0001.jpg"),
    ];
    let (found, notes) = load(Dataset::Otb100, folder.path());
    assert_eq!(found[0], row("David", 471, "0300.jpg"));
    assert_eq!((&found[1..3], &found[3..]), (&beside[..], &jogging[..]));
    assert_eq!(notes.count(), 1, "{notes}");
    let (found, notes) = load(Dataset::Folder, folder.path());
    assert_eq!((found[0].1, found.len()), (471, 5));
    assert!(
        notes
            .to_string()
            .contains("David: 771 frames and 471 boxes"),
        "{notes}"
    );
}

#[test]
fn uavdt_is_found_in_its_own_and_in_repackaged_folders() {
    for (annotations, images) in [
        ("UAV-benchmark-SOT_v1.0/anno", "UAV-benchmark-S"),
        ("annotations", "sequences"),
        ("anno", "seq"),
    ] {
        let folder = Folder::new("uavdt");
        pictures(
            &folder,
            &format!("{images}/S0101"),
            |i| format!("img{i:06}.jpg"),
            4,
        );
        boxes(&folder, &format!("{annotations}/S0101_gt.txt"), 6);
        boxes(&folder, &format!("{annotations}/S0102_gt.txt"), 6);
        folder.write(
            "UAV-benchmark-SOT_v1.0/att/S0101_att.txt",
            "0,1,0,0,0,0,0,0,0\n",
        );
        let (found, notes) = load(Dataset::Uavdt, folder.path());
        assert_eq!(found, [row("S0101", 4, "img000001.jpg")]);
        assert!(
            notes
                .to_string()
                .contains("S0101: 4 frames and 6 boxes: the rest is left out"),
            "{notes}"
        );
        assert!(
            notes
                .to_string()
                .contains("S0102: left out: no pictures in a folder S0102"),
            "{notes}"
        );
        let attributes = Dataset::Uavdt.attributes(folder.path()).unwrap();
        assert_eq!(attributes["camera motion"], ["S0101"]);
    }
}

#[test]
fn visdrone_keeps_all_frames_where_only_the_first_box_is_public() {
    let folder = Folder::new("visdrone");
    pictures(
        &folder,
        "set/sequences/uav0_s",
        |i| format!("img{i:07}.jpg"),
        4,
    );
    boxes(&folder, "set/initialization/uav0_s.txt", 1);
    let (found, notes) = load(Dataset::Visdrone, folder.path());
    assert_eq!(found, [row("uav0_s", 4, "img0000001.jpg")]);
    let expected = "note: uav0_s: only the first of 4 frames is annotated\n";
    assert_eq!(notes.to_string(), expected);
    boxes(&folder, "set/annotations/uav0_s.txt", 4);
    folder.write(
        "set/attributes/uav0_s_attr.txt",
        "1,0,0,0,0,0,0,0,0,0,0,0\n",
    );
    let (found, notes) = load(Dataset::Visdrone, folder.path());
    assert_eq!((found[0].1, notes.count()), (4, 0));
    assert_eq!(
        Dataset::Visdrone.attributes(folder.path()).unwrap()["aspect ratio change"],
        ["uav0_s"]
    );
    folder.write("set/attributes/uav0_s_attr.txt", "1,0\n");
    assert!(Dataset::Visdrone.attributes(folder.path()).is_err());
}

#[test]
fn absent_frames_follow_the_lists_of_lasot_and_got10k() {
    let folder = Folder::new("absent");
    pictures(
        &folder,
        "airplane/airplane-1/img",
        |i| format!("{i:08}.jpg"),
        3,
    );
    boxes(&folder, "airplane/airplane-1/groundtruth.txt", 3);
    folder.write("airplane/airplane-1/full_occlusion.txt", "0,1,0\n");
    folder.write("airplane/airplane-1/out_of_view.txt", "0,0,1\n");
    let read = |dataset: Dataset| dataset.annotations(folder.path(), &mut Notes::default());
    assert_eq!(
        read(Dataset::Lasot).unwrap()[0].present,
        Some(vec![true, false, false])
    );
    assert_eq!(
        load(Dataset::Lasot, folder.path()).0,
        [row("airplane-1", 3, "00000001.jpg")]
    );
    assert_eq!(read(Dataset::Got10k).unwrap()[0].present, None);
    folder.write("airplane/airplane-1/absence.label", "0\n0\n1\n");
    assert_eq!(
        read(Dataset::Got10k).unwrap()[0].present,
        Some(vec![true, true, false])
    );
    folder.write("airplane/airplane-1/absence.label", "0\n");
    let error = read(Dataset::Got10k).unwrap_err().to_string();
    assert!(error.contains("expected 3 flags"), "{error}");
}

#[test]
fn root_without_sequences_is_refused() {
    let folder = Folder::new("nothing");
    for dataset in Dataset::ALL {
        assert!(dataset.load(folder.path(), &mut Notes::default()).is_err());
        assert!(
            dataset
                .load(&folder.path().join("none"), &mut Notes::default())
                .is_err()
        );
    }
    boxes(&folder, "a/groundtruth.txt", 3);
    let error = Dataset::Dtb70
        .load(folder.path(), &mut Notes::default())
        .unwrap_err()
        .to_string();
    let expected = "expected pictures of DTB70, found none \
                    (DTB70: expected 70 sequences, found 1; \
                    a: left out: no pictures in a/img, a/imgs, a/color or a)";
    assert!(error.ends_with(expected), "{error}");
}

#[test]
fn development_sequences_load_without_notes() {
    let Some(root) = shared("data/dev_seqs") else {
        return;
    };
    let mut notes = Notes::default();
    let found = Dataset::Folder.load(&root, &mut notes).unwrap();
    assert_eq!((found.len(), notes.count()), (20, 0), "{notes}");
    let gull = found.iter().find(|s| s.annotation.name == "Gull2").unwrap();
    assert_eq!((gull.frames.len(), gull.annotation.scale), (60, 0.75));
}

#[test]
fn datasets_parse_from_both_of_their_names() {
    for dataset in Dataset::ALL {
        assert_eq!(dataset.option().parse(), Ok(dataset));
        assert_eq!(dataset.name().parse(), Ok(dataset));
    }
    assert_eq!("UAV123@10fps".parse(), Ok(Dataset::Uav123At10Fps));
    assert!(
        "uav"
            .parse::<Dataset>()
            .unwrap_err()
            .contains("uav20l, dtb70")
    );
}
