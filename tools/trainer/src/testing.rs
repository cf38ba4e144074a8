//! Helpers of tests.

use crate::data::picture::Picture;
use autodiff::ProcessGroup;
use std::sync::{Arc, Barrier, Mutex};

pub use ::testing::{Folder, shared};

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

/// A picture of one gray value.
pub fn plain(value: u8, width: usize, height: usize) -> Arc<Picture> {
    Arc::new(Picture::new(width, height, vec![value; 3 * width * height]))
}

/// One of several processes that are threads of this one.
#[derive(Clone, Debug)]
pub struct Member {
    rank: usize,
    size: usize,
    table: Arc<(Mutex<Vec<Vec<u8>>>, Barrier)>,
}

impl Member {
    /// All members of a group.
    pub fn group(size: usize) -> Vec<Member> {
        let table = Arc::new((Mutex::new(vec![Vec::new(); size]), Barrier::new(size)));
        let member = |rank| Member {
            rank,
            size,
            table: table.clone(),
        };
        (0..size).map(member).collect()
    }

    /// What every member puts on the table, in the order of ranks.
    fn meet(&self, own: &[u8]) -> Vec<Vec<u8>> {
        let (table, barrier) = &*self.table;
        table.lock().unwrap()[self.rank] = own.to_vec();
        barrier.wait();
        let all = table.lock().unwrap().clone();
        barrier.wait();
        all
    }
}

impl ProcessGroup for Member {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn gather(&self, own: &[u8], all: &mut [u8]) {
        all.copy_from_slice(&self.meet(own).concat());
    }

    fn exchange(&self, own: &[u8], received: &mut [u8]) {
        let len = own.len() / self.size;
        let parts = self.meet(own);
        let to_us = parts.iter().map(|sent| &sent[len * self.rank..][..len]);
        received.copy_from_slice(&to_us.collect::<Vec<_>>().concat());
    }
}
