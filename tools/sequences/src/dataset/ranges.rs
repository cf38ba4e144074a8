//! The frames of a video that a sequence consists of.

use super::Dataset;

/// UAV123's sequences at 30 and 10 frames per second, the latter from the former by
/// floor((f - 1) / 3) + 1.
const UAV123: &str = include_str!("uav123_frames.csv");
/// UAV20L's sequences.
const UAV20L: &str = include_str!("uav20l_frames.csv");

/// OTB's sequences that are annotated on a part of their video only.
///
/// Source: the benchmark's web page.
const OTB: [(&str, usize, usize); 5] = [
    ("David", 300, 770),
    ("Football1", 1, 74),
    ("Freeman3", 1, 460),
    ("Freeman4", 1, 283),
    ("Diving", 1, 215),
];

/// The part of a video that is a sequence. Frames are counted from 1, both ends are included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// The video's folder.
    pub video: &'static str,
    /// The first frame.
    pub first: usize,
    /// The last frame.
    pub last: usize,
}

/// The part that a sequence covers; `None` if it covers all of the video of its name.
pub fn part(dataset: Dataset, sequence: &str) -> Option<Part> {
    let (table, column) = match dataset {
        Dataset::Uav123 => (UAV123, 2),
        Dataset::Uav123At10Fps => (UAV123, 4),
        Dataset::Uav20l => (UAV20L, 2),
        Dataset::Otb100 => {
            let row = OTB
                .iter()
                .find(|row| row.0.eq_ignore_ascii_case(sequence))?;
            return Some(Part {
                video: row.0,
                first: row.1,
                last: row.2,
            });
        }
        _ => return None,
    };
    let row = table
        .lines()
        .skip(1)
        .find(|line| line.split(',').next() == Some(sequence))?;
    let fields: Vec<&str> = row.split(',').collect();
    let number = |i: usize| fields.get(i)?.trim().parse().ok();
    Some(Part {
        video: fields.get(1)?,
        first: number(column)?,
        last: number(column + 1)?,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(table: &str, dataset: Dataset) -> (usize, usize) {
        let names = table
            .lines()
            .skip(1)
            .filter_map(|line| line.split(',').next());
        let parts: Vec<Part> = names.map(|name| part(dataset, name).unwrap()).collect();
        assert!(
            parts
                .iter()
                .all(|part| part.first >= 1 && part.last >= part.first)
        );
        (
            parts.len(),
            parts.iter().map(|part| part.last - part.first + 1).sum(),
        )
    }

    #[test]
    fn tables_have_the_published_counts() {
        assert_eq!(frames(UAV123, Dataset::Uav123), (123, 112_578));
        assert_eq!(frames(UAV123, Dataset::Uav123At10Fps), (123, 37_607));
        assert_eq!(frames(UAV20L, Dataset::Uav20l), (20, 58_670));
    }

    #[test]
    fn frames_at_10_fps_follow_from_those_at_30() {
        for name in UAV123
            .lines()
            .skip(1)
            .filter_map(|line| line.split(',').next())
        {
            let all = part(Dataset::Uav123, name).unwrap();
            let tenth = part(Dataset::Uav123At10Fps, name).unwrap();
            assert_eq!(tenth.first, (all.first - 1) / 3 + 1, "{name}");
            assert_eq!(tenth.last, (all.last - 1) / 3 + 1, "{name}");
        }
    }
}
