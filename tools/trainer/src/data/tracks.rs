//! Targets and their annotated frames: the common form of all real data.

use super::pairs::{PairRules, leaves_context};
use super::picture::{Album, PictureId};
use super::rows::Row;
use super::sequences::Sequence;
use super::skipped::Skipped;
use crate::rng::Rng;
use std::collections::BTreeMap;
use track_cpu::BBox;

/// One annotated frame of a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// The picture.
    pub picture: PictureId,
    /// The target's box in it.
    pub bbox: BBox,
    /// Number of the frame within the video.
    pub number: u32,
}

/// A target and its frames in the order of time; at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Its name.
    pub name: String,
    /// Its frames.
    pub shots: Vec<Shot>,
}

/// Number of a track among [`Tracks`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Target {
    group: usize,
    track: usize,
}

/// Tracks in groups. A group is drawn in proportion to the square root of its frames, and so is a
/// track within it. Otherwise one long video or a thousand similar stills would crowd out the rest.
#[derive(Clone, Debug, Default)]
pub struct Tracks {
    groups: Vec<Group>,
    cumulative: Vec<f64>,
    rules: PairRules,
}

#[derive(Clone, Debug, Default)]
struct Group {
    tracks: Vec<Track>,
    cumulative: Vec<f64>,
}

impl Tracks {
    /// Tracks by the name of their group.
    pub fn new(groups: BTreeMap<String, Vec<Track>>, rules: PairRules) -> Tracks {
        let frames = |track: &Track| track.shots.len() as f64;
        let groups: Vec<_> = groups
            .into_values()
            .filter(|tracks| !tracks.is_empty())
            .map(|tracks| Group {
                cumulative: running(tracks.iter().map(|t| frames(t).sqrt())),
                tracks,
            })
            .collect();
        let total = |group: &Group| group.tracks.iter().map(frames).sum::<f64>();
        let cumulative = running(groups.iter().map(|group| total(group).sqrt()));
        Tracks {
            groups,
            cumulative,
            rules,
        }
    }

    /// The rows of an annotation file, those of one track together; rows that the rules refuse are
    /// skipped.
    pub fn from_rows(
        rows: Vec<Row>,
        album: &mut Album,
        rules: PairRules,
        skipped: &mut Skipped,
    ) -> Tracks {
        let mut targets: BTreeMap<(String, String), Vec<Shot>> = BTreeMap::new();
        for (i, row) in rows.into_iter().enumerate() {
            if !rules.accepts(&row.bbox) {
                let reason = format!(
                    "box of {} x {} pixels: too thin or too small",
                    row.bbox.w, row.bbox.h
                );
                skipped.add(
                    format!("{} frame {}", row.path.display(), row.frame),
                    reason,
                );
                continue;
            }
            let track = row
                .track
                .unwrap_or_else(|| format!("{}#{i}", row.path.display()));
            let shot = Shot {
                picture: album.add(row.path),
                bbox: row.bbox,
                number: row.frame,
            };
            targets.entry((row.group, track)).or_default().push(shot);
        }
        let mut groups: BTreeMap<String, Vec<Track>> = BTreeMap::new();
        for ((group, name), mut shots) in targets {
            shots.sort_by_key(|shot| shot.number);
            groups.entry(group).or_default().push(Track { name, shots });
        }
        Tracks::new(groups, rules)
    }

    /// One track per sequence, grouped by data set; frames without a box, or with one that the
    /// rules refuse, are left out.
    ///
    /// Boxes of more than 60 % of the frame are refused too, but for rules that are `compat`.
    pub fn from_sequences(
        sequences: Vec<Sequence>,
        album: &mut Album,
        rules: PairRules,
        skipped: &mut Skipped,
    ) -> Tracks {
        let mut groups: BTreeMap<String, Vec<Track>> = BTreeMap::new();
        for sequence in sequences {
            let Ok((width, height)) = image::image_dimensions(&sequence.frames[0]) else {
                skipped.add(
                    sequence.name,
                    "its first frame is not a readable picture".into(),
                );
                continue;
            };
            let good = |bbox: &BBox| {
                rules.accepts(bbox)
                    && (rules.compat || leaves_context(bbox, width as usize, height as usize))
            };
            let mut shots = Vec::new();
            let boxes = sequence.boxes.iter().flatten().count();
            for ((i, path), bbox) in sequence.frames.into_iter().enumerate().zip(sequence.boxes) {
                if let Some(bbox) = bbox.filter(good) {
                    shots.push(Shot {
                        picture: album.add(path),
                        bbox,
                        number: i as u32,
                    });
                }
            }
            if shots.len() < boxes {
                let refused = boxes - shots.len();
                skipped.add(
                    sequence.name.clone(),
                    format!("{refused} of {boxes} boxes: too thin, too small or too large"),
                );
            } else if boxes == 0 {
                skipped.add(sequence.name.clone(), "no frame has a box".into());
            }
            if shots.is_empty() {
                continue;
            }
            let group = sequence
                .name
                .split('/')
                .next()
                .unwrap_or_default()
                .to_owned();
            groups.entry(group).or_default().push(Track {
                name: sequence.name,
                shots,
            });
        }
        Tracks::new(groups, rules)
    }

    /// How many tracks there are.
    pub fn len(&self) -> usize {
        self.groups.iter().map(|group| group.tracks.len()).sum()
    }

    /// Whether there is no track.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// How many frames there are.
    pub fn shots(&self) -> usize {
        self.groups
            .iter()
            .flat_map(|group| &group.tracks)
            .map(|track| track.shots.len())
            .sum()
    }

    /// The track of a number.
    ///
    /// Panics if the number is another collection's.
    pub fn track(&self, target: Target) -> &Track {
        &self.groups[target.group].tracks[target.track]
    }

    /// A track.
    pub fn draw(&self, rng: &mut Rng) -> Target {
        self.draw_of(rng.weighted(&self.cumulative), rng)
    }

    fn draw_of(&self, group: usize, rng: &mut Rng) -> Target {
        Target {
            group,
            track: rng.weighted(&self.groups[group].cumulative),
        }
    }

    /// Another track of the same group; `None` if the drawn one is `target` itself.
    pub fn draw_kin(&self, target: Target, rng: &mut Rng) -> Option<&Track> {
        let kin = self.draw_of(target.group, rng);
        (kin != target).then(|| self.track(kin))
    }

    /// A track and two of its frames, by the rules.
    pub fn draw_pair(&self, rng: &mut Rng) -> (Target, [Shot; 2]) {
        let target = self.draw(rng);
        (
            target,
            self.rules.draw(rng, &self.track(target).shots).into(),
        )
    }
}

/// Running sums.
pub(super) fn running(weights: impl Iterator<Item = f64>) -> Vec<f64> {
    weights
        .scan(0.0, |sum, weight| {
            *sum += weight;
            Some(*sum)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_drawn_by_the_root_of_their_frames() {
        let mut album = Album::new(0);
        let mut rows = Vec::new();
        let add = |rows: &mut Vec<Row>, group: &str, track: Option<&str>, frame| {
            let path = format!("{group}{}.png", rows.len()).into();
            let (track, group) = (track.map(String::from), group.to_string());
            rows.push(Row {
                path,
                bbox: BBox::new(0.0, 0.0, 9.0, 9.0),
                track,
                frame,
                group,
            });
        };
        (0..100).for_each(|i| add(&mut rows, "video", Some("one"), 99 - i));
        (0..900).for_each(|_| add(&mut rows, "stills", None, 0));
        add(&mut rows, "stills", None, 0);
        rows.last_mut().unwrap().bbox.w = 1.0;
        let mut skipped = Skipped::default();
        let tracks = Tracks::from_rows(rows, &mut album, PairRules::default(), &mut skipped);
        assert_eq!(skipped.count(), 1);
        assert_eq!(
            (tracks.len(), tracks.shots(), album.len()),
            (901, 1000, 1000)
        );
        let mut rng = Rng::new(1, 1, 1);
        let videos = (0..4000)
            .filter(|_| tracks.track(tracks.draw(&mut rng)).name == "one")
            .count();
        assert!(
            (850..1150).contains(&videos),
            "{videos} of 4000, expected a quarter"
        );
        let video = (0..)
            .map(|_| tracks.draw(&mut rng))
            .find(|t| tracks.track(*t).name == "one")
            .unwrap();
        assert!(
            tracks.draw_kin(video, &mut rng).is_none(),
            "the only one of its group"
        );
        let still = (0..)
            .map(|_| tracks.draw(&mut rng))
            .find(|t| t.group != video.group)
            .unwrap();
        let kin = tracks.draw_kin(still, &mut rng).unwrap();
        assert!(kin.name.starts_with("stills") && kin.name != tracks.track(still).name);
        assert!(
            tracks
                .track(video)
                .shots
                .is_sorted_by_key(|shot| shot.number)
        );
    }
}
