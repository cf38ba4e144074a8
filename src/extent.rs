//! How much of the region around the target one look takes in.
//!
//! The network is fully convolutional: a crop of another side at the same scale gives fewer or more of the same cells, at the cost of
//! its own area.

use crate::select::Selector;
use weights_format::Architecture;

/// How much one look takes in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Extent {
    /// The middle: 239 of 303 pixels, at 0.62 of the work.
    Inner,
    /// The search region that the model was made for.
    #[default]
    Full,
    /// More than it: 399 pixels, at 1.7 times the work.
    Wide,
}

/// Cells that the inner part lacks on every side, and the wide one has more, of a score map of 17.
const LESS: f64 = 4.0 / 17.0;
const MORE: f64 = 6.0 / 17.0;

/// One extent's crop and what knows its score map.
#[derive(Clone, Debug)]
pub(crate) struct View {
    /// Side of the crop, in pixels.
    pub side: usize,
    /// Chooses among its cells.
    pub selector: Selector,
}

/// The views of every extent.
#[derive(Clone, Debug)]
pub(crate) struct Views([View; 3]);

impl Views {
    pub(crate) fn new(architecture: &Architecture) -> Views {
        let (score_size, full) = (architecture.score_size(), Selector::new(architecture));
        let view = |more: isize| View {
            side: architecture
                .search_size
                .saturating_add_signed(2 * more * Architecture::TOTAL_STRIDE as isize),
            selector: full.resized(more),
        };
        let cells = |share: f64| (share * score_size as f64).round() as isize;
        let less = cells(LESS).min((score_size as isize - 1) / 2);
        Views([view(-less), view(0), view(cells(MORE))])
    }

    pub(crate) fn of(&self, extent: Extent) -> &View {
        &self.0[extent as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::Widths;

    #[test]
    fn other_extents_show_the_same_cells() {
        let architecture = Architecture::new(Widths::FULL, None);
        let views = Views::new(&architecture);
        for (extent, side, cells, middle) in [
            (Extent::Inner, 239, 9, 119.0),
            (Extent::Full, 303, 17, 151.0),
            (Extent::Wide, 399, 29, 199.0),
        ] {
            let View {
                side: found,
                selector,
            } = views.of(extent);
            let other = Architecture {
                search_size: side,
                ..architecture
            };
            assert_eq!((*found, selector.side()), (side, cells));
            assert_eq!(other.score_size(), cells);
            assert_eq!(selector.geometry(), (other.score_offset() as f64, middle));
        }
    }
}
