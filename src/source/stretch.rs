//! Samples of 16 bits to 8: thermal cameras use a small part of their range.
//!
//! The rule: the first frame's range runs from its 0.1th to its 99.9th percentile, widened by an
//! eighth on either side. It becomes 0 to 255; what lies outside is clipped. With every later frame
//! the range moves a fiftieth of the way to that frame's own range, so that the same temperature
//! keeps its gray value over a second or two while the picture follows a slow drift.

/// Share of the samples that may lie outside the range on either side.
const OUTLIERS: f64 = 0.001;
/// How far the range is widened on either side, as a share of its width.
const HEADROOM: f32 = 0.125;
/// How far the range moves towards that of each later frame.
const RATE: f32 = 0.02;
/// Least width of the range, in levels: noise alone is not stretched over all gray values.
const LEAST_WIDTH: f32 = 16.0;

/// Turns frames of 16-bit samples into 8-bit ones by a rule that is stable over time.
#[derive(Clone, Debug, Default)]
pub struct Stretch {
    range: Option<Range>,
    histogram: Vec<u32>, // [65536]
}

/// The levels that become 0 and 255.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range {
    low: f32,
    high: f32,
}

impl Stretch {
    /// Stretches the next frame's samples into `out`, which gets as many bytes.
    pub fn to_bytes(&mut self, samples: &[u16], out: &mut Vec<u8>) {
        let own = self.measure(samples);
        let range = match self.range {
            None => own,
            Some(Range { low, high }) => Range {
                low: low + RATE * (own.low - low),
                high: high + RATE * (own.high - high),
            },
        };
        self.range = Some(range);

        let scale = 255.0 / (range.high - range.low);
        out.clear();
        // A float-to-integer cast saturates, which is the clipping.
        out.extend(
            samples
                .iter()
                .map(|&sample| ((f32::from(sample) - range.low) * scale).round() as u8),
        );
    }

    /// The range that one frame asks for.
    fn measure(&mut self, samples: &[u16]) -> Range {
        self.histogram.clear();
        self.histogram.resize(1 << 16, 0);
        for &sample in samples {
            self.histogram[usize::from(sample)] += 1;
        }
        let outliers = (samples.len() as f64 * OUTLIERS) as u32;
        let low = first_above(self.histogram.iter(), outliers) as f32;
        let high = 65535.0 - first_above(self.histogram.iter().rev(), outliers) as f32;

        let width = (high - low).max(LEAST_WIDTH) * (1.0 + 2.0 * HEADROOM);
        let middle = (low + high) / 2.0;
        Range {
            low: middle - width / 2.0,
            high: middle + width / 2.0,
        }
    }
}

/// Index of the bin in which the sum of all bins so far exceeds `count`.
fn first_above<'a>(bins: impl Iterator<Item = &'a u32>, count: u32) -> usize {
    let mut sum = 0;
    for (index, bin) in bins.enumerate() {
        sum += bin;
        if sum > count {
            return index;
        }
    }
    0 // no samples at all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(stretch: &mut Stretch, samples: &[u16]) -> Vec<u8> {
        let mut out = vec![7; 3];
        stretch.to_bytes(samples, &mut out);
        out
    }

    #[test]
    fn narrow_range_fills_most_gray_values() {
        let samples: Vec<u16> = (2960..3018).collect();

        let found = bytes(&mut Stretch::default(), &samples);

        assert_eq!(found.len(), samples.len());
        assert!(
            found[0] < 35 && found[57] > 220,
            "{} to {}",
            found[0],
            found[57]
        );
        assert!(found.is_sorted());
    }

    #[test]
    fn flat_frame_becomes_middle_gray() {
        assert_eq!(bytes(&mut Stretch::default(), &[3000; 4]), [128; 4]);
        assert_eq!(bytes(&mut Stretch::default(), &[0; 2]), [128; 2]);
        assert_eq!(bytes(&mut Stretch::default(), &[65535; 2]), [128; 2]);
        assert!(bytes(&mut Stretch::default(), &[]).is_empty());
    }

    #[test]
    fn single_hot_pixel_does_not_set_the_range() {
        let mut samples: Vec<u16> = (0..2000).map(|i| 3000 + i % 64).collect();
        samples[77] = 65535;

        let found = bytes(&mut Stretch::default(), &samples);

        assert_eq!(found[77], 255);
        assert!(found.iter().any(|v| *v < 40) && found.iter().any(|v| (200..255).contains(v)));
    }

    #[test]
    fn same_level_keeps_its_gray_when_the_scene_changes() {
        let mut stretch = Stretch::default();
        let plain: Vec<u16> = (3000..3100).collect();
        let mut with_fire = plain.clone();
        with_fire[90..].fill(9000);

        let before = bytes(&mut stretch, &plain);
        let after = bytes(&mut stretch, &with_fire);
        for _ in 0..400 {
            bytes(&mut stretch, &with_fire);
        }
        let later = bytes(&mut stretch, &with_fire);

        assert!(before[50].abs_diff(after[50]) < 100 && after[95] == 255);
        assert!(later[50] < 60, "the range has followed: {}", later[50]);
    }
}
