//! Benchmarks as they lie on disk, in every layout that they are handed out or repackaged in.
//!
//! | benchmark | annotations | pictures |
//! |---|---|---|
//! | UAV123, UAV123@10fps, UAV20L | `anno/<set>/<sequence>.txt`, flags in `att/` | `data_seq/<set>/<video>/`, cut by a table |
//! | DTB70, OTB100, a plain folder | `<sequence>/groundtruth*.txt` | beside it, or in `img`, `imgs`, `color` |
//! | UAVDT | `anno/<sequence>_gt.txt`, flags `<sequence>_att.txt` | a folder `<sequence>` anywhere |
//! | VisDrone | `annotations/<sequence>.txt`, or `initialization/` | a folder `<sequence>` anywhere |
//! | GOT-10k, LaSOT | `<sequence>/groundtruth.txt`, absence lists | beside it, or in `img` |
//!
//! Folders are recognized by their names wherever they lie below the root, so that wrapping folders do not matter.

mod attributes;
mod pictures;
mod ranges;
mod tree;

use crate::annotations::{self, Annotation, file_name};
use crate::error::Error;
use crate::notes::Notes;
use crate::text;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use tree::Tree;

/// A benchmark whose layout is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dataset {
    /// UAV123: 123 sequences at 30 frames per second.
    Uav123,
    /// UAV123@10fps: the same ones, every third frame.
    Uav123At10Fps,
    /// UAV20L: 20 long sequences.
    Uav20l,
    /// DTB70: 70 sequences.
    Dtb70,
    /// UAVDT, single objects: 50 sequences.
    Uavdt,
    /// VisDrone-SOT, the test-dev set of 2018: 35 sequences; other years have other counts.
    Visdrone,
    /// OTB100: 100 sequences on 98 videos.
    Otb100,
    /// GOT-10k.
    Got10k,
    /// LaSOT.
    Lasot,
    /// Any folder of sequences, each with its `groundtruth*.txt`.
    Folder,
}

/// One sequence of a benchmark.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// Name and boxes; a single box where only the first is public.
    pub annotation: Annotation,
    /// The pictures in order: as many as there are boxes, or more where only the first box is public.
    pub frames: Vec<PathBuf>,
}

/// Attributes of sequences: each one's name with the sequences that have it.
pub type Attributes = BTreeMap<String, Vec<String>>;

impl Dataset {
    /// All of them.
    pub const ALL: [Dataset; 10] = [
        Dataset::Uav123,
        Dataset::Uav123At10Fps,
        Dataset::Uav20l,
        Dataset::Dtb70,
        Dataset::Uavdt,
        Dataset::Visdrone,
        Dataset::Otb100,
        Dataset::Got10k,
        Dataset::Lasot,
        Dataset::Folder,
    ];

    /// Its name as the got10k toolkit and the authors' archives write it.
    pub fn name(self) -> &'static str {
        match self {
            Dataset::Uav123 => "UAV123",
            Dataset::Uav123At10Fps => "UAV123_10fps",
            Dataset::Uav20l => "UAV20L",
            Dataset::Dtb70 => "DTB70",
            Dataset::Uavdt => "UAVDT",
            Dataset::Visdrone => "VisDrone",
            Dataset::Otb100 => "OTB100",
            Dataset::Got10k => "GOT-10k",
            Dataset::Lasot => "LaSOT",
            Dataset::Folder => "folder",
        }
    }

    /// Its name on a command line.
    pub fn option(self) -> &'static str {
        match self {
            Dataset::Uav123 => "uav123",
            Dataset::Uav123At10Fps => "uav123_10fps",
            Dataset::Uav20l => "uav20l",
            Dataset::Dtb70 => "dtb70",
            Dataset::Uavdt => "uavdt",
            Dataset::Visdrone => "visdrone",
            Dataset::Otb100 => "otb100",
            Dataset::Got10k => "got10k",
            Dataset::Lasot => "lasot",
            Dataset::Folder => "folder",
        }
    }

    /// How many sequences it has, where that is one number.
    pub fn sequences(self) -> Option<usize> {
        match self {
            Dataset::Uav123 | Dataset::Uav123At10Fps => Some(123),
            Dataset::Uav20l => Some(20),
            Dataset::Dtb70 => Some(70),
            Dataset::Uavdt => Some(50),
            Dataset::Otb100 => Some(100),
            Dataset::Visdrone | Dataset::Got10k | Dataset::Lasot | Dataset::Folder => None,
        }
    }

    /// The annotations below `root`, by name, without looking at pictures.
    ///
    /// # Errors
    /// If a folder or file cannot be used, two are of one sequence, or there is none.
    pub fn annotations(self, root: &Path, notes: &mut Notes) -> Result<Vec<Annotation>, Error> {
        let tree = Tree::read(root)?;
        self.read_annotations(root, &tree, notes)
    }

    /// The sequences below `root`, by name. One whose pictures are missing is left out and noted.
    ///
    /// # Errors
    /// As of [`annotations`](Self::annotations), and if no sequence has pictures.
    pub fn load(self, root: &Path, notes: &mut Notes) -> Result<Vec<Sequence>, Error> {
        let tree = Tree::read(root)?;
        let files = self.annotation_files(root, &tree)?;
        let annotations = self.read_annotations(root, &tree, notes)?;
        let mut sequences = Vec::new();
        for annotation in annotations {
            let frames = pictures::of(self, &annotation, &files[&annotation.name], &tree);
            match frames {
                Ok(frames) => sequences.extend(matched(annotation, frames, notes)),
                Err(reason) => notes.add(format!("{}: left out: {reason}", annotation.name)),
            }
        }
        if sequences.is_empty() {
            return Err(Error::content(
                root,
                format!("pictures of {}", self.name()),
                "none",
            ));
        }
        Ok(sequences)
    }

    /// The attributes that the files below `root` give to sequences; none where there are no such files.
    ///
    /// # Errors
    /// If a file cannot be used.
    pub fn attributes(self, root: &Path) -> Result<Attributes, Error> {
        attributes::read(self, &Tree::read(root)?)
    }

    fn read_annotations(
        self,
        root: &Path,
        tree: &Tree,
        notes: &mut Notes,
    ) -> Result<Vec<Annotation>, Error> {
        let mut read = Vec::new();
        for (name, path) in self.annotation_files(root, tree)? {
            let boxes = text::read_boxes(&path)?;
            let present = self.present(&path, boxes.len())?;
            let scale = annotations::scale_beside(&path)?;
            read.push(Annotation {
                name,
                boxes,
                present,
                scale,
            });
        }
        if let Some(expected) = self.sequences().filter(|expected| *expected != read.len()) {
            notes.add(format!(
                "{} has {expected} sequences, {} are here",
                self.name(),
                read.len()
            ));
        }
        Ok(read)
    }

    /// Every sequence's annotation.
    fn annotation_files(
        self,
        root: &Path,
        tree: &Tree,
    ) -> Result<BTreeMap<String, PathBuf>, Error> {
        let mut files: BTreeMap<String, PathBuf> = BTreeMap::new();
        for path in tree
            .texts
            .iter()
            .filter(|path| self.is_annotation(path, tree))
        {
            let name = if self.is_beside() {
                name_beside(path)
            } else {
                annotations::sequence_name(path)
            };
            let Some(name) = name else { continue };
            if let Some(other) = files.insert(name.clone(), path.clone()) {
                let found = format!("{} and {}", other.display(), path.display());
                return Err(Error::content(
                    root,
                    format!("one annotation of {name}"),
                    found,
                ));
            }
        }
        if files.is_empty() {
            return Err(Error::content(
                root,
                format!("annotations of {}", self.name()),
                "none",
            ));
        }
        Ok(files)
    }

    /// Whether annotations lie beside the pictures.
    fn is_beside(self) -> bool {
        matches!(
            self,
            Dataset::Dtb70 | Dataset::Otb100 | Dataset::Got10k | Dataset::Lasot | Dataset::Folder
        )
    }

    /// Whether a text file holds a sequence's boxes.
    fn is_annotation(self, path: &Path, tree: &Tree) -> bool {
        if self.is_beside() {
            return file_name(path).starts_with("groundtruth");
        }
        let folder = path.parent().map(file_name).unwrap_or_default();
        let is_parent = |name: &str| folder.eq_ignore_ascii_case(name);
        match self {
            Dataset::Uav123 | Dataset::Uav123At10Fps | Dataset::Uav20l => {
                let named = tree.has_texts_in(self.name());
                if named {
                    is_parent(self.name())
                } else {
                    is_parent("anno")
                }
            }
            Dataset::Visdrone
                if !tree.has_texts_in("annotations") && !tree.has_texts_in("anno") =>
            {
                is_parent("initialization")
            }
            _ => is_parent("anno") || is_parent("annotations"),
        }
    }

    /// Where the target is there, of the benchmarks that list it.
    fn present(self, annotation: &Path, frames: usize) -> Result<Option<Vec<bool>>, Error> {
        let lists: &[&str] = match self {
            Dataset::Got10k => &["absence.label"],
            Dataset::Lasot => &["full_occlusion.txt", "out_of_view.txt"],
            _ => return Ok(None),
        };
        let mut present = None;
        for list in lists {
            let path = annotation.with_file_name(list);
            if !path.is_file() {
                continue;
            }
            let flags = text::read_all_numbers(&path)?;
            if flags.len() != frames {
                return Err(Error::content(
                    &path,
                    format!("{frames} flags, one per frame"),
                    flags.len(),
                ));
            }
            let present = present.get_or_insert_with(|| vec![true; frames]);
            present
                .iter_mut()
                .zip(flags)
                .for_each(|(present, absent)| *present &= absent == 0.0);
        }
        Ok(present)
    }
}

impl FromStr for Dataset {
    type Err = String;

    /// From its name on a command line, or the one that toolkits write; the case does not matter.
    fn from_str(text: &str) -> Result<Dataset, String> {
        let name = text.replace('@', "_");
        let is = |dataset: &Dataset| {
            [dataset.option(), dataset.name()]
                .iter()
                .any(|n| name.eq_ignore_ascii_case(n))
        };
        let all = || Dataset::ALL.map(Dataset::option).join(", ");
        Dataset::ALL
            .into_iter()
            .find(is)
            .ok_or_else(|| format!("expected one of {}, found {text:?}", all()))
    }
}

/// The sequence's name from its folder; of several targets in one, with the target's number: `Jogging.1`.
fn name_beside(path: &Path) -> Option<String> {
    let folder = path.parent().map(file_name)?;
    let stem = file_name(path);
    let target = stem
        .strip_suffix(".txt")?
        .rsplit_once('.')
        .map(|(_, target)| target.to_owned());
    Some(target.map_or(folder.clone(), |target| format!("{folder}.{target}")))
}

/// As many frames as boxes; a single box stands for a sequence whose other boxes are not public.
fn matched(
    mut annotation: Annotation,
    mut frames: Vec<PathBuf>,
    notes: &mut Notes,
) -> Option<Sequence> {
    let (name, boxes) = (&annotation.name, annotation.boxes.len());
    if frames.is_empty() {
        notes.add(format!("{name}: left out: no frame of it"));
        return None;
    }
    if boxes == 1 && frames.len() > 1 {
        notes.add(format!(
            "{name}: only the first of {} frames is annotated",
            frames.len()
        ));
    } else if boxes != frames.len() {
        notes.add(format!(
            "{name}: {} frames and {boxes} boxes: the shorter counts",
            frames.len()
        ));
        frames.truncate(boxes);
        annotation.boxes.truncate(frames.len());
    }
    Some(Sequence { annotation, frames })
}

#[cfg(test)]
mod tests;
