//! What several tests need.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A folder of its own, removed with everything in it when dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// An empty folder.
    pub fn new(name: &str) -> Folder {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path =
            std::env::temp_dir().join(format!("trainer-{name}-{}-{number}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// `path` within the reference data, or `None` after saying that the test is skipped.
///
/// The data lie in `$TRACK_CPU_SHARED` or in `../shared` beside the repository.
pub fn shared(path: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let root = std::env::var_os("TRACK_CPU_SHARED").map_or(beside, PathBuf::from);
    let found = root.join(path);
    if found.exists() {
        return Some(found);
    }
    eprintln!(
        "SKIPPED: {} is not here (set TRACK_CPU_SHARED to the reference data)",
        found.display()
    );
    None
}

/// A few pictures of colored rectangles with boxes, as an annotation file.
pub fn pictures(folder: &Folder) -> String {
    let mut text = String::from("path,x,y,w,h\n");
    for i in 0..6u32 {
        let (x, y, w, h) = (40 + 7 * i, 50 + 5 * i, 30 + 3 * i, 44 - 4 * i);
        let picture = image::RgbImage::from_fn(180, 160, |px, py| {
            let inside = (x..x + w).contains(&px) && (y..y + h).contains(&py);
            let stripes = ((px + py * (i + 1)) / 6 % 2) as u8;
            if inside {
                image::Rgb([255 * stripes, 40 * i as u8, 200])
            } else {
                image::Rgb([90, 110 + 20 * stripes, 70])
            }
        });
        picture
            .save(folder.path().join(format!("{i}.png")))
            .unwrap();
        text += &format!("{i}.png,{x},{y},{w},{h}\n");
    }
    let file = folder.path().join("boxes.csv");
    std::fs::write(&file, text).unwrap();
    file.display().to_string()
}
