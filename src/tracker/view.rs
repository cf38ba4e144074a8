//! Which part of the surroundings one search takes in.
//!
//! The network is fully convolutional. A crop of another side at the same scale gives fewer or more
//! of the same cells, at a cost proportional to its area.

use super::select::Selector;
use weights_format::Architecture;

/// How much one search takes in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Extent {
    /// The middle of the search region: 239 of 303 pixels, 0.62 of the work.
    Inner,
    /// The search region that the model was trained with.
    #[default]
    Full,
    /// More than the search region: 399 pixels, 1.7 times the work.
    Wide,
}

/// Cells that [`Extent::Inner`] lacks on every side, as a share of the score map's side.
const INNER_LACKS: f64 = 4.0 / 17.0;
/// Cells that [`Extent::Wide`] adds on every side, as a share of the score map's side.
const WIDE_ADDS: f64 = 6.0 / 17.0;

/// One extent's crop and its selector.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Side of the crop in pixels.
    pub side: usize,
    /// Chooses among the cells of the crop's score map.
    pub selector: Selector,
}

/// One view per extent.
#[derive(Clone, Debug)]
pub(crate) struct Views {
    inner: View,
    full: View,
    wide: View,
}

impl Views {
    pub(crate) fn new(architecture: &Architecture) -> Views {
        let cells = architecture.score_size();
        let full = Selector::new(architecture);
        let view = |more: isize| {
            let pixels = 2 * more * Architecture::TOTAL_STRIDE as isize;
            View {
                side: architecture.search_size.saturating_add_signed(pixels),
                selector: full.resized(more),
            }
        };
        let share_of_cells = |share: f64| (share * cells as f64).round() as isize;
        let fewer = share_of_cells(INNER_LACKS).min((cells as isize - 1) / 2);
        Views {
            inner: view(-fewer),
            full: view(0),
            wide: view(share_of_cells(WIDE_ADDS)),
        }
    }

    /// The view of one extent.
    pub(crate) fn of(&self, extent: Extent) -> &View {
        match extent {
            Extent::Inner => &self.inner,
            Extent::Full => &self.full,
            Extent::Wide => &self.wide,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::Widths;

    #[test]
    fn views_of_other_extents_show_the_same_cells() {
        let architecture = Architecture::new(Widths::FULL, None);
        let views = Views::new(&architecture);
        for (extent, side, cells) in [
            (Extent::Inner, 239, 9),
            (Extent::Full, 303, 17),
            (Extent::Wide, 399, 29),
        ] {
            let view = views.of(extent);
            let as_trained = Architecture {
                search_size: side,
                ..architecture
            };

            assert_eq!((view.side, view.selector.side()), (side, cells));
            assert_eq!(as_trained.score_size(), cells);
            assert_eq!(as_trained.score_offset() as f64, view.selector.offset());
        }
    }
}
