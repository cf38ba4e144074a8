//! Benchmarks on disk, in every layout in which they are published or repackaged.
//!
//! | benchmark | annotations | pictures |
//! |---|---|---|
//! | UAV123, @10fps, UAV20L | `anno/<set>/<sequence>.txt`, flags in `att/` | `data_seq/<set>/<video>/`, cut |
//! | DTB70, OTB100, a plain folder | `<sequence>/groundtruth*.txt` | beside it, in `img`, `imgs`, `color` |
//! | UAVDT | `anno/<sequence>_gt.txt`, flags `_att.txt` | a folder `<sequence>` anywhere |
//! | VisDrone | `annotations/<sequence>.txt`, or `initialization/` | a folder `<sequence>` anywhere |
//! | GOT-10k, LaSOT | `<sequence>/groundtruth.txt`, absence lists | beside it, or in `img` |
//!
//! Folders are recognized by their names at any depth below the root, so that wrapping folders do
//! not matter. File names are matched in any case; hidden files and `__MACOSX` are ignored.

mod attributes;
pub(crate) mod pictures;
pub(crate) mod ranges;
pub(crate) mod tree;

use crate::annotation::{Annotation, is_groundtruth, none_because, sequence_name, single};
use crate::error::Error;
use crate::folder::{file_name, last_names};
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
    /// UAV123@10fps: the sequences of UAV123, every third frame.
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
    /// The pictures in order: as many as boxes, or more where only the first box is public.
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

    /// The annotations below `root`, by name. Pictures are not searched.
    ///
    /// A sequence with two annotations, or with one that cannot be used, is left out and noted.
    ///
    /// # Errors
    /// If the root cannot be read, or no annotation can be used.
    pub fn annotations(self, root: &Path, notes: &mut Notes) -> Result<Vec<Annotation>, Error> {
        let read = self.read_annotations(root, &Tree::read(root)?, notes)?;
        Ok(read.into_iter().map(|(annotation, _)| annotation).collect())
    }

    /// The sequences below `root`, by name.
    ///
    /// A sequence without usable pictures or annotation is left out and noted.
    ///
    /// # Errors
    /// If the root cannot be read, or no sequence can be used.
    pub fn load(self, root: &Path, notes: &mut Notes) -> Result<Vec<Sequence>, Error> {
        let tree = Tree::read(root)?;
        let mut raised = Notes::default();
        let mut sequences = Vec::new();
        for (annotation, path) in self.read_annotations(root, &tree, &mut raised)? {
            let name = annotation.name.clone();
            let boxes = annotation.boxes.len();
            match pictures::of(self, &name, &path, boxes, &tree, &mut raised) {
                Ok(frames) => sequences.extend(matched(annotation, frames, &mut raised)),
                Err(reason) => raised.add(name, format!("left out: {reason}")),
            }
        }
        if self.is_beside() {
            self.note_unannotated(root, &tree, &mut raised);
        }
        if sequences.is_empty() {
            let expected = format!("pictures of {}", self.name());
            return Err(Error::content(root, expected, none_because(&raised)));
        }
        notes.extend(raised);
        Ok(sequences)
    }

    /// The attributes of sequences, from the attribute files below `root`; empty without such
    /// files.
    ///
    /// # Errors
    /// If a file cannot be used.
    pub fn attributes(self, root: &Path) -> Result<Attributes, Error> {
        attributes::read(self, &Tree::read(root)?)
    }

    /// Notes the folders of pictures that no annotation belongs to.
    fn note_unannotated(self, root: &Path, tree: &Tree, notes: &mut Notes) {
        let annotations = self.annotation_files(tree);
        let folders: Vec<&Path> = annotations
            .values()
            .flatten()
            .filter_map(|path| path.parent())
            .collect();
        for pictures in tree.pictures.keys() {
            if !folders.iter().any(|folder| pictures.starts_with(folder)) {
                let name = pictures.strip_prefix(root).unwrap_or(pictures);
                notes.add(name.display(), "pictures without a groundtruth*.txt");
            }
        }
    }

    /// Every sequence's annotation with its file.
    fn read_annotations(
        self,
        root: &Path,
        tree: &Tree,
        notes: &mut Notes,
    ) -> Result<Vec<(Annotation, PathBuf)>, Error> {
        let mut raised = Notes::default();
        let mut read = Vec::new();
        for (name, paths) in self.annotation_files(tree) {
            match self.read_annotation(&name, &paths) {
                Ok(annotation) => read.push((annotation, paths[0].clone())),
                Err(reason) => raised.add(name, format!("left out: {reason}")),
            }
        }
        if read.is_empty() {
            let files = if self.is_beside() {
                "<sequence>/groundtruth*.txt"
            } else {
                "anno/<sequence>.txt"
            };
            let expected = format!("annotations of {} ({files})", self.name());
            let texts = tree.texts.iter().take(3).map(|path| last_names(path, 2));
            let texts: Vec<String> = texts.collect();
            let found = if raised.count() == 0 && !texts.is_empty() {
                format!("none (but texts: {})", texts.join(", "))
            } else {
                none_because(&raised)
            };
            return Err(Error::content(root, expected, found));
        }
        if let Some(expected) = self.sequences().filter(|expected| *expected != read.len()) {
            let found = read.len();
            raised.add(
                self.name(),
                format!("expected {expected} sequences, found {found}"),
            );
        }
        notes.extend(raised);
        Ok(read)
    }

    fn read_annotation(self, name: &str, paths: &[PathBuf]) -> Result<Annotation, String> {
        let path = single(paths)?;
        let read = || {
            let mut annotation = Annotation::read(name, path)?;
            annotation.present = self.present(path, annotation.boxes.len())?;
            Ok(annotation)
        };
        read().map_err(|error: Error| error.to_string())
    }

    /// The annotation files of every sequence; more than one where a sequence is annotated twice.
    fn annotation_files(self, tree: &Tree) -> BTreeMap<String, Vec<PathBuf>> {
        let mut files: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
        for path in &tree.texts {
            if !self.is_annotation(path, tree) {
                continue;
            }
            let name = if self.is_beside() {
                name_beside(path)
            } else {
                sequence_name(path)
            };
            if let Some(name) = name {
                files.entry(name).or_default().push(path.clone());
            }
        }
        files
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
            return is_groundtruth(path);
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

    /// Whether the target is present per frame, for the benchmarks that list it.
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
            for (present, absent) in present.iter_mut().zip(flags) {
                *present &= absent == 0.0;
            }
        }
        Ok(present)
    }
}

impl FromStr for Dataset {
    type Err = String;

    /// From its name on a command line or the one that toolkits write, in any case.
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

/// The sequence's name from its folder; with the target's number if the folder holds several:
/// `Jogging.1`.
pub(crate) fn name_beside(path: &Path) -> Option<String> {
    let folder = path.parent().map(file_name)?;
    let stem = path.file_stem()?.to_string_lossy();
    Some(match stem.rsplit_once('.') {
        Some((_, target)) => format!("{folder}.{target}"),
        None => folder,
    })
}

/// The sequence of an annotation and its pictures. If their counts differ, the longer is cut and a
/// note says so.
///
/// A single box belongs to a sequence whose other boxes are not public: all pictures stay.
pub(crate) fn matched(
    mut annotation: Annotation,
    mut frames: Vec<PathBuf>,
    notes: &mut Notes,
) -> Option<Sequence> {
    let name = &annotation.name;
    let boxes = annotation.boxes.len();
    let pictures = frames.len();
    if pictures == 0 {
        notes.add(name, "left out: none of its frames is among the pictures");
        return None;
    }
    if boxes == 1 && pictures > 1 {
        let text = format!("only the first of {pictures} frames is annotated");
        notes.add(name, text);
    } else if boxes != pictures {
        let text = format!("{pictures} frames and {boxes} boxes: the rest is left out");
        notes.add(name, text);
        frames.truncate(boxes);
        annotation.truncate(pictures);
    }
    Some(Sequence { annotation, frames })
}

#[cfg(test)]
mod cases;
#[cfg(test)]
mod tests;
