//! Outputs that would destroy an input, and runs that are refused.

use std::path::Path;

use super::scene::{self, FRAMES, INIT, LAST, sequence};
use super::{Case, Expect};

/// Refused as a wrong argument; the inputs stay as they are.
const CLASH: Expect = Expect {
    code: 2,
    lines: Some(0),
    last: None,
    says: &["nothing was written"],
    prints: &[],
    unchanged: &["seq", "seq/1.jpg"],
    absent: &[],
    present: &[],
};

/// The frames in `seq`, as one stream in `clip.ppm`, and the boxes of an earlier run.
fn make(folder: &Path) {
    sequence(folder);
    std::fs::write(folder.join("clip.ppm"), scene::ppms()).unwrap();
    std::fs::write(folder.join("boxes.txt"), "1,2,3,4\n".repeat(FRAMES)).unwrap();
    std::fs::write(folder.join("old.gif"), "an earlier film").unwrap();
    std::fs::write(folder.join("net.safetensors"), "weights").unwrap();
    #[cfg(unix)]
    {
        use std::os::unix::fs::symlink;
        std::fs::hard_link(folder.join("clip.ppm"), folder.join("hard.ppm")).unwrap();
        std::fs::hard_link(folder.join("seq/2.jpg"), folder.join("hard.jpg")).unwrap();
        symlink("clip.ppm", folder.join("soft.ppm")).unwrap();
        symlink("seq", folder.join("soft")).unwrap();
    }
}

fn track(name: &'static str, args: &str) -> Case {
    Case::new(name, &format!("track --init {INIT} {args}"), make)
}

pub fn cases() -> Vec<Case> {
    let video = Expect {
        unchanged: &["clip.ppm"],
        ..CLASH
    };
    let mut cases = vec![
        track("boxes over the video", "-i clip.ppm -o clip.ppm").expect(video),
        track(
            "boxes over the video by another path",
            "-i clip.ppm -o seq/../clip.ppm",
        )
        .expect(video),
        track("boxes over a frame", "-i seq -o seq/3.jpg").expect(CLASH),
        track("boxes beside the frames", "-i seq -o seq/boxes.txt").expect(CLASH),
        track(
            "boxes over a frame of a pattern",
            "-i seq/*.jpg -o seq/3.jpg",
        )
        .expect(CLASH),
        track("boxes over the only picture", "-i seq/1.jpg -o seq/1.jpg").expect(CLASH),
        track(
            "boxes over the model",
            "-i seq -m net.safetensors -o net.safetensors",
        )
        .expect(Expect {
            code: 4, // not a model, which is found first
            says: &["net.safetensors"],
            unchanged: &["net.safetensors"],
            ..CLASH
        }),
        track("pictures over the frames", "-i seq --overlay seq").expect(CLASH),
        track(
            "pictures over the frames of a pattern",
            "-i seq/*.jpg --overlay seq",
        )
        .expect(CLASH),
        track("film among the frames", "-i seq --overlay seq/film.gif").expect(CLASH),
        track(
            "boxes and film in one file",
            "-i seq -o new.gif --overlay ./new.gif",
        )
        .expect(Expect {
            absent: &["new.gif"],
            ..CLASH
        }),
        Case {
            stdin: Some("clip.ppm"),
            ..track("boxes over standard input", "-i - -o clip.ppm")
        }
        .expect(video),
        Case::new(
            "refused box keeps the old outputs",
            "track -i seq --init 900,900,24,18 -o boxes.txt --overlay old.gif",
            make,
        )
        .expect(Expect {
            code: 6,
            says: &["outside"],
            unchanged: &["boxes.txt", "old.gif"],
            ..CLASH
        }),
        track(
            "unreadable first frame keeps the old boxes",
            "-i seq/1.jpg -o boxes.txt",
        )
        .expect(Expect {
            code: 3,
            says: &["1.jpg"],
            unchanged: &["boxes.txt"],
            ..CLASH
        }),
        track(
            "missing input keeps the old boxes",
            "-i none.mp4 -o boxes.txt",
        )
        .expect(Expect {
            code: 3,
            says: &["none.mp4"],
            unchanged: &["boxes.txt"],
            ..CLASH
        }),
        track(
            "missing model keeps the old boxes",
            "-i seq -m none -o boxes.txt",
        )
        .expect(Expect {
            code: 4,
            says: &["none"],
            unchanged: &["boxes.txt"],
            ..CLASH
        }),
        track(
            "outputs in folders of their own",
            "-i seq -o boxes.txt --overlay drawn",
        )
        .expect(Expect {
            code: 0,
            says: &[],
            present: &["drawn/000000.jpg", "drawn/000007.jpg"],
            ..CLASH
        }),
        track(
            "pictures in a folder below the frames",
            "-i seq --overlay seq/drawn",
        )
        .expect(Expect {
            code: 0,
            lines: Some(FRAMES),
            last: Some(LAST),
            says: &[],
            unchanged: &["seq/1.jpg"],
            present: &["seq/drawn/000007.jpg"],
            ..CLASH
        }),
    ];
    let empty_first = |folder: &Path| {
        make(folder);
        std::fs::remove_file(folder.join("hard.jpg")).ok();
        std::fs::write(folder.join("seq/1.jpg"), b"").unwrap();
    };
    for case in &mut cases {
        if case.name.starts_with("unreadable") {
            case.make = Box::new(empty_first);
        }
    }
    #[cfg(unix)]
    cases.extend([
        track(
            "boxes over a hard link of the video",
            "-i clip.ppm -o hard.ppm",
        )
        .expect(video),
        track("boxes over a link to the video", "-i clip.ppm -o soft.ppm").expect(video),
        track(
            "boxes over the video behind a link",
            "-i soft.ppm -o clip.ppm",
        )
        .expect(video),
        track("boxes over a hard link of a frame", "-i seq -o hard.jpg").expect(CLASH),
        track(
            "pictures through a link to the frames",
            "-i seq --overlay soft",
        )
        .expect(CLASH),
    ]);
    cases
}
