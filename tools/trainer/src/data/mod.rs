//! Training data: from files and rendered flights to pairs of crops.
//!
//! | file | what is in it |
//! |---|---|
//! | `spec` | what the user says to train on |
//! | `rows`, `sequences` | annotation files and folders of sequences, read |
//! | `tracks`, `pairs` | targets and their frames; which two make a pair |
//! | `picture` | decoded pictures, kept in memory within a bound |
//! | `flights` | rendered flights |
//! | `cutout` | parts cut out of pictures |
//! | `paste` | what is pasted into the search picture around its target |
//! | `synthetic` | pairs of a cutout before two backgrounds |
//! | `geometry`, `warp` | from a target in a picture to its crops |
//! | `augment`, `photo`, `filters` | what is changed about them |
//! | `feed` | batches made ahead, on threads of their own |
//!
//! Sample number `i` depends on the seed and `i` only.

pub mod augment;
pub mod cutout;
pub mod feed;
pub mod filters;
pub mod flights;
pub mod geometry;
pub mod pairs;
pub mod paste;
pub mod photo;
pub mod picture;
pub mod rows;
pub mod sequences;
pub mod skipped;
pub mod spec;
pub mod synthetic;
pub mod tracks;
pub mod warp;

use crate::error::Error;
use crate::rng::Rng;
use augment::Augment;
use cutout::{Cutout, textured_box};
use flights::Flights;
use geometry::{Corners, Cut, Pose, View};
use pairs::PairRules;
use paste::Crowd;
use picture::{Album, Picture, PictureId};
use serde::{Deserialize, Serialize};
use skipped::Skipped;
use spec::{DataSpec, What};
use std::path::Path;
use std::sync::Arc;
use tracks::{Shot, Target, Tracks, running};

/// How pairs are made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DataOptions {
    /// Seed of all random choices.
    pub seed: u64,
    /// Share of pairs whose template is another target's.
    pub negatives: f32,
    /// Changes of the crops.
    pub augment: Augment,
    /// Rules for the two frames of a pair.
    pub rules: PairRules,
    /// Most bytes of decoded pictures that are kept.
    pub cache_bytes: usize,
    /// Pairs that one rendered flight serves.
    pub pairs_per_flight: f64,
}

impl Default for DataOptions {
    fn default() -> DataOptions {
        DataOptions {
            seed: 0,
            negatives: 0.1,
            augment: Augment::strong(),
            rules: PairRules::default(),
            cache_bytes: 8 << 30,
            pairs_per_flight: 120.0,
        }
    }
}

/// One pair of crops with its target.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// The template crop, `[127, 127, 3]` BGR.
    pub template: Vec<u8>,
    /// The search crop, `[search_size, search_size, 3]` BGR.
    pub search: Vec<u8>,
    /// The template crop of the target in the search picture, `[127, 127, 3]` BGR (docs/method.md,
    /// section 3.7, Z').
    pub again: Vec<u8>,
    /// Side of the search crop.
    pub search_size: usize,
    /// The target in the search crop.
    pub corners: Corners,
    /// Whether the template shows another target.
    pub negative: bool,
    /// Number of the source, in the order of the options.
    pub source: usize,
}

/// Sources of pairs, mixed.
#[derive(Debug)]
pub struct Dataset {
    options: DataOptions,
    album: Album,
    sources: Vec<Source>,
    names: Vec<String>,
    cumulative: Vec<f64>,
    material: Vec<PictureId>, // what distractors and occluders are cut out of
}

#[derive(Debug)]
enum Source {
    Tracks(Tracks),
    Flights(Flights),
    Patches(Vec<PictureId>),
    Paste(Vec<PictureId>),
}

/// Attempts to draw a pair whose pictures can be read.
const TRIES: usize = 1000;

/// Two views of one target.
struct Pair {
    first: View,
    second: View,
    /// Whether both show one moment.
    still: bool,
    /// How many distractors belong to it.
    distractors: usize,
    /// Which target it is of, if other targets of its kind are known.
    target: Option<(usize, Target)>, // with the number of the source
}

impl Dataset {
    /// Opens all sources. What is skipped on the way is printed to standard error.
    ///
    /// # Errors
    /// If a source cannot be read, or nothing of it can be used, or no picture of it can be read.
    pub fn open(specs: &[DataSpec], options: DataOptions) -> Result<Dataset, Error> {
        if specs.is_empty() {
            return Err(Error::option("--data", "at least one source", "none"));
        }
        let mut album = Album::new(options.cache_bytes);
        let mut sources = Vec::with_capacity(specs.len());
        let total: f64 = specs.iter().map(|spec| spec.share).sum();
        for spec in specs {
            let mut skipped = Skipped::default();
            let source = open(spec, total, &options, &mut album, &mut skipped)?;
            eprint!("{skipped}");
            if source.is_empty() {
                let (data, what) = (spec.to_string(), source.unit().to_string());
                return Err(Error::NoData {
                    data,
                    what,
                    skipped: skipped.count(),
                });
            }
            eprintln!("{spec}: {}", source.describe());
            sources.push(source);
        }
        let material = (0..album.len() as u32).map(PictureId).collect();
        let names = specs.iter().map(DataSpec::to_string).collect();
        let cumulative = running(specs.iter().map(|spec| spec.share));
        let dataset = Dataset {
            options,
            album,
            sources,
            names,
            cumulative,
            material,
        };
        for (source, spec) in specs.iter().enumerate() {
            if !dataset.is_readable(source) {
                let (data, what) = (spec.to_string(), "readable picture".to_owned());
                return Err(Error::NoData {
                    data,
                    what,
                    skipped: dataset.unreadable(),
                });
            }
        }
        Ok(dataset)
    }

    /// Whether a source yields a pair within [`TRIES`] attempts.
    fn is_readable(&self, source: usize) -> bool {
        let mut rng = Rng::new(self.options.seed, 0x7e57, 0);
        matches!(self.sources[source], Source::Flights(_))
            || (0..TRIES).any(|_| self.pair_of(source, 0, &mut rng).is_some())
    }

    /// Number of picture files that could not be read so far.
    pub fn unreadable(&self) -> usize {
        self.album.unreadable()
    }

    /// The sources as the user wrote them.
    pub fn sources(&self) -> &[String] {
        &self.names
    }

    /// How pairs are made.
    pub fn options(&self) -> &DataOptions {
        &self.options
    }

    /// Sample number `index`, with a search crop of `search_size` pixels.
    ///
    /// Panics if the pictures of the sources cannot be read any more.
    pub fn sample(&self, index: u64, search_size: usize) -> Sample {
        let mut rng = Rng::new(self.options.seed, 0xda7a, index);
        let negative = rng.chance(self.options.negatives);
        let (source, mut pair) = self.pair(index, &mut rng);
        let other = negative.then(|| self.pair(index, &mut rng).1.first);
        self.populate(&mut pair, index, &mut rng);

        let augment = &self.options.augment;
        let beside = rng
            .chance(augment.beside)
            .then(|| self.beside(&pair, index, &mut rng));
        let quarter = augment.quarter * if pair.still { 2.0 } else { 1.0 };
        let pose = Pose {
            quarters: if rng.chance(quarter) {
                1 + rng.below(3) as u8
            } else {
                0
            },
            mirrored: rng.chance(augment.mirror),
        };
        let template = geometry::template(other.as_ref().unwrap_or(&pair.first), pose);
        let again = geometry::template(&pair.second, pose);
        let aspect = |view: &View| f64::from(view.bbox.w) / f64::from(view.bbox.h);
        let change = if rng.sometimes(augment.unstretched) {
            aspect(&pair.second) / aspect(&pair.first)
        } else {
            1.0
        };
        let cut = Cut {
            pose,
            size: search_size,
            still: pair.still,
            change,
        };
        let (search, corners) =
            geometry::search(&pair.second, beside.as_ref(), cut, augment, &mut rng);
        let crops = [template, search, again];
        let [template, search, again] = photo::develop(crops, pair.still, augment, &mut rng);
        Sample {
            template,
            search,
            again,
            search_size,
            corners,
            negative,
            source,
        }
    }

    /// Two unchanged views of one target at different moments; `None` if no source has any.
    pub fn moments(&self, index: u64) -> Option<(View, View)> {
        let mut rng = Rng::new(self.options.seed, 0x303e, index);
        let mut pairs = (0..TRIES).map(|_| self.pair(index, &mut rng).1);
        pairs
            .find(|pair| !pair.still)
            .map(|pair| (pair.first, pair.second))
    }

    /// Two views of one target and the number of their source. If a picture cannot be read, another
    /// pair is drawn.
    fn pair(&self, index: u64, rng: &mut Rng) -> (usize, Pair) {
        for _ in 0..TRIES {
            let source = rng.weighted(&self.cumulative);
            if let Some(pair) = self.pair_of(source, index, rng) {
                return (source, pair);
            }
        }
        panic!("no readable picture in {TRIES} tries");
    }

    fn pair_of(&self, source: usize, index: u64, rng: &mut Rng) -> Option<Pair> {
        let pair = |first, second, still| {
            Some(Pair {
                first,
                second,
                still,
                distractors: 0,
                target: None,
            })
        };
        match &self.sources[source] {
            Source::Tracks(tracks) => {
                let (target, [first, second]) = tracks.draw_pair(rng);
                let still = tracks.track(target).shots.len() == 1;
                let pair = pair(self.view(first)?, self.view(second)?, still)?;
                Some(Pair {
                    target: Some((source, target)),
                    ..pair
                })
            }
            Source::Flights(flights) => {
                let (first, second) = flights.draw_pair(index, rng)?;
                pair(first, second, false)
            }
            Source::Patches(pictures) => {
                let picture = self.album.get(*rng.pick(pictures))?;
                let (aspect, side) = (rng.factor(0.5), rng.log_range(16.0, 80.0));
                let bbox = textured_box(&picture, aspect, side, rng);
                let view = View { picture, bbox };
                pair(view.clone(), view, true)
            }
            Source::Paste(pictures) => {
                let first = self.album.get(*rng.pick(pictures))?;
                let same = rng.chance(0.6);
                let second = if same {
                    first.clone()
                } else {
                    self.album.get(*rng.pick(pictures))?
                };
                let mut cutout = self.cutout(pictures, rng)?;
                if rng.chance(self.options.augment.round) {
                    cutout = cutout.rounded(rng);
                }
                let bends = rng.sometimes(self.options.augment.bend);
                let (first, second) =
                    synthetic::made_up_pair([&first, &second], &cutout, bends, rng)?;
                let distractors = *rng.pick(&[0, 0, 1, 1, 2, 3]);
                Some(Pair {
                    first,
                    second,
                    still: true,
                    distractors,
                    target: None,
                })
            }
        }
    }

    fn view(&self, shot: Shot) -> Option<View> {
        Some(View {
            picture: self.album.get(shot.picture)?,
            bbox: shot.bbox,
        })
    }

    /// Another target of the same kind.
    fn kin(&self, target: Option<(usize, Target)>, rng: &mut Rng) -> Option<View> {
        let (source, target) = target?;
        let Source::Tracks(tracks) = &self.sources[source] else {
            return None;
        };
        let kin = tracks.draw_kin(target, rng)?;
        self.view(*rng.pick(&kin.shots))
    }

    /// A target whose surroundings fill the search crop: one of the same kind in another picture,
    /// or any other.
    fn beside(&self, pair: &Pair, index: u64, rng: &mut Rng) -> View {
        let kin = self.kin(pair.target.filter(|_| pair.still), rng);
        let elsewhere = kin.filter(|view| !Arc::ptr_eq(&view.picture, &pair.first.picture));
        elsewhere.unwrap_or_else(|| self.pair(index, rng).1.first)
    }

    /// A random cutout of one of the pictures.
    fn cutout(&self, pictures: &[PictureId], rng: &mut Rng) -> Option<Cutout> {
        let picture: Arc<Picture> = self.album.get(*rng.pick(pictures))?;
        let (aspect, side) = (rng.factor(1.0), rng.log_range(24.0, 120.0));
        Some(Cutout::random(&picture, aspect, side, rng))
    }

    /// Puts neighbors, an occluder, a mask and a shadow into the second view, as often as the
    /// augmentation says.
    ///
    /// The target's box stays: it is the extent of the target, also where that is covered.
    fn populate(&self, pair: &mut Pair, index: u64, rng: &mut Rng) {
        let augment = &self.options.augment;
        let mut count = pair.distractors;
        if rng.chance(augment.distractors) && count == 0 {
            count = *rng.pick(&[1, 1, 2]);
        }
        let occluded = rng.chance(augment.occluder);
        let masked = rng.sometimes(augment.mask);
        let shadowed = rng.sometimes(augment.shadow);
        if count == 0 && !occluded && !masked && !shadowed {
            return;
        }
        let mut picture = Picture::clone(&pair.second.picture);
        let bbox = pair.second.bbox;
        if shadowed {
            paste::shadow(&mut picture, &bbox, rng);
        }
        if masked {
            paste::mask(&mut picture, &pair.second.picture, &bbox, rng);
        }
        // A share are the target itself in other colors, a share of its kind; of the others half
        // are parts of pictures and half are other targets.
        let target = pair.target;
        let next = |rng: &mut Rng| {
            if rng.sometimes(augment.twin) {
                return Some(Cutout::of(&pair.second, rng).recolored(rng));
            }
            if let Some(view) = self.kin(target.filter(|_| rng.chance(augment.kin)), rng) {
                return Some(Cutout::of(&view, rng));
            }
            if self.material.is_empty() || rng.chance(0.5) {
                Some(Cutout::of(&self.pair(index, rng).1.first, rng))
            } else {
                self.cutout(&self.material, rng)
            }
        };
        let crowd = Crowd {
            overlap: augment.overlap,
            adjacent: augment.adjacent,
        };
        paste::distractors(&mut picture, &bbox, count, crowd, next, rng);
        if occluded && let Some(cutout) = next(rng) {
            paste::occlude(&mut picture, &bbox, &cutout, rng);
        }
        pair.second.picture = Arc::new(picture);
    }
}

fn open(
    spec: &DataSpec,
    total: f64,
    options: &DataOptions,
    album: &mut Album,
    skipped: &mut Skipped,
) -> Result<Source, Error> {
    Ok(match &spec.what {
        What::Scenes => Source::Flights(Flights::new(
            options.seed,
            spec.share / total,
            options.pairs_per_flight,
        )),
        What::Annotated(path) => Source::Tracks(tracks_of(path, options, album, skipped)?),
        What::Patches(path) => Source::Patches(pictures_of(path, album, skipped)?),
        What::Paste(path) => Source::Paste(pictures_of(path, album, skipped)?),
    })
}

fn tracks_of(
    path: &Path,
    options: &DataOptions,
    album: &mut Album,
    skipped: &mut Skipped,
) -> Result<Tracks, Error> {
    if !path.is_dir() {
        let rows = rows::read(path, skipped)?;
        return Ok(Tracks::from_rows(rows, album, options.rules, skipped));
    }
    let sequences = sequences::find(path, skipped)?;
    Ok(Tracks::from_sequences(
        sequences,
        album,
        options.rules,
        skipped,
    ))
}

/// All pictures below a folder, or those of an annotation file.
fn pictures_of(
    path: &Path,
    album: &mut Album,
    skipped: &mut Skipped,
) -> Result<Vec<PictureId>, Error> {
    let mut files: Vec<_> = if path.is_dir() {
        sequences::pictures_below(path)?
    } else {
        let rows = rows::read(path, skipped)?;
        rows.into_iter().map(|row| row.path).collect()
    };
    files.sort();
    files.dedup();
    Ok(files.into_iter().map(|file| album.add(file)).collect())
}

impl Source {
    fn unit(&self) -> &'static str {
        match self {
            Source::Tracks(_) => "annotated frame",
            Source::Flights(_) => "flight",
            Source::Patches(_) | Source::Paste(_) => "picture",
        }
    }

    fn is_empty(&self) -> bool {
        match self {
            Source::Tracks(tracks) => tracks.is_empty(),
            Source::Flights(_) => false,
            Source::Patches(pictures) | Source::Paste(pictures) => pictures.is_empty(),
        }
    }

    fn describe(&self) -> String {
        match self {
            Source::Tracks(tracks) => {
                format!("{} targets, {} frames", tracks.len(), tracks.shots())
            }
            Source::Flights(_) => "rendered flights without end".into(),
            Source::Patches(pictures) | Source::Paste(pictures) => {
                format!("{} pictures", pictures.len())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Folder, pictures};

    /// FNV-1a over the bytes and boxes of samples.
    fn fingerprint(augment: Augment, count: u64) -> u64 {
        let folder = Folder::new("fingerprint");
        let boxes = pictures(&folder);
        let specs = [
            boxes.clone(),
            format!("paste:{boxes}"),
            format!("patches:{boxes}"),
        ]
        .map(|text| text.parse().unwrap());
        let options = DataOptions {
            seed: 3,
            augment,
            ..DataOptions::default()
        };
        let dataset = Dataset::open(&specs, options).unwrap();
        let mut hash = 0xcbf2_9ce4_8422_2325;
        let mut add = |byte: u8| hash = (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
        for index in 0..count {
            let sample = dataset.sample(index, 191);
            for crop in [&sample.template, &sample.search, &sample.again] {
                crop.iter().copied().for_each(&mut add);
            }
            for corner in sample.corners {
                corner
                    .to_bits()
                    .to_le_bytes()
                    .into_iter()
                    .for_each(&mut add);
            }
        }
        hash
    }

    /// Checkpoints continue on the samples they would have seen: whatever makes samples faster
    /// keeps their bits.
    #[test]
    // Other systems may round `powf` differently.
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    fn presets_keep_the_bits_of_their_samples() {
        let expected = [
            ("none", 7497412465699244356),
            ("light", 268510087556596650),
            ("strong", 14010077508359557798),
            ("shape", 11996778216362517955),
        ];

        let found = expected.map(|(name, _)| {
            let augment = Augment::from_name(name).unwrap();
            (name, fingerprint(augment, 60))
        });

        assert_eq!(found, expected);
    }
}
