//! The order in which a frame is searched for a lost target: tiles of one search each, the nearest
//! to the predicted place first.

/// Most tiles of one sweep; larger frames get larger steps.
const MAX_TILES: f64 = 1024.0;
/// Tiles that a sweep should not exceed as long as zooming out helps.
const FEW_TILES: f64 = 24.0;
/// Most that a search is zoomed out: the target is then smaller in it than the network is used to.
const MAX_ZOOM: f64 = 2.0;

/// The tiles that are left of one walk over the frame.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sweep {
    left: Vec<(f32, f32)>, // the next one last
    zoom: f64,
}

impl Sweep {
    /// Plans the tiles of a `width` x `height` frame that come within `radius` of `around`, for
    /// searches that cover `reach` pixels each at zoom 1.
    pub(crate) fn plan(
        &mut self,
        (width, height): (usize, usize),
        reach: f64,
        around: (f32, f32),
        radius: f64,
    ) {
        let (width, height) = (width as f64, height as f64);
        let reach = reach.max(1.0);
        let tiles =
            (width.min(2.0 * radius) / reach).ceil() * (height.min(2.0 * radius) / reach).ceil();
        self.zoom = (tiles / FEW_TILES).sqrt().clamp(1.0, MAX_ZOOM);
        let step = (reach * self.zoom).max((width * height / MAX_TILES).sqrt());
        let (columns, rows) = (
            (width / step).ceil().max(1.0),
            (height / step).ceil().max(1.0),
        );
        self.left.clear();
        for row in 0..rows as usize {
            for column in 0..columns as usize {
                let x = (column as f64 + 0.5) * width / columns;
                let y = (row as f64 + 0.5) * height / rows;
                self.left.push((x as f32, y as f32));
            }
        }
        let distance = |&(x, y): &(f32, f32)| (x - around.0).hypot(y - around.1);
        self.left
            .sort_by(|a, b| distance(b).total_cmp(&distance(a)));
        // The nearest tile stays in any case: there is always something to search.
        let beyond = |tile: &(f32, f32)| f64::from(distance(tile)) > radius + step;
        let far = self
            .left
            .iter()
            .take_while(|tile| beyond(tile))
            .count()
            .min(self.left.len() - 1);
        self.left.drain(..far);
    }

    /// The next tile's center and zoom; `None` at the end of the sweep.
    pub(crate) fn next(&mut self) -> Option<((f32, f32), f64)> {
        self.left.pop().map(|tile| (tile, self.zoom))
    }

    /// Drops all tiles.
    pub(crate) fn clear(&mut self) {
        self.left.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(sweep: &mut Sweep) -> Vec<((f32, f32), f64)> {
        std::iter::from_fn(|| sweep.next()).collect()
    }

    #[test]
    fn sweep_covers_the_frame_nearest_first() {
        let mut sweep = Sweep::default();
        sweep.plan((640, 360), 68.0, (600.0, 10.0), 2000.0);
        let tiles = all(&mut sweep);
        let zoom = tiles[0].1;
        assert!((1.0..=MAX_ZOOM).contains(&zoom));
        let far = |x: f32, y: f32| {
            tiles
                .iter()
                .map(|((a, b), _)| (x - a).abs().max((y - b).abs()))
                .fold(f32::MAX, f32::min)
        };
        for (x, y) in [
            (0.0, 0.0),
            (639.0, 0.0),
            (320.0, 180.0),
            (5.0, 359.0),
            (639.0, 359.0),
        ] {
            assert!(
                f64::from(far(x, y)) <= 0.5 * 68.0 * zoom + 1.0,
                "({x}, {y})"
            );
        }
        let distance = |((x, y), _): &((f32, f32), f64)| (x - 600.0).hypot(y - 10.0);
        assert!(
            tiles
                .windows(2)
                .all(|pair| distance(&pair[0]) <= distance(&pair[1]))
        );
    }

    #[test]
    fn small_radius_gives_few_tiles() {
        let mut sweep = Sweep::default();
        sweep.plan((640, 360), 68.0, (300.0, 200.0), 70.0);
        let tiles = all(&mut sweep);
        assert!(tiles.len() < 24 && tiles[0].1 == 1.0, "{tiles:?}");
        sweep.plan((640, 360), 68.0, (-900.0, 200.0), 70.0);
        assert_eq!(all(&mut sweep).len(), 1);
    }

    #[test]
    fn large_target_needs_one_tile_and_tiny_one_a_bounded_number() {
        let mut sweep = Sweep::default();
        sweep.plan((640, 360), 2000.0, (0.0, 0.0), 2000.0);
        assert_eq!(all(&mut sweep), [((320.0, 180.0), 1.0)]);
        sweep.plan((32768, 32768), 1.0, (0.0, 0.0), 1e6);
        assert!(all(&mut sweep).len() <= MAX_TILES as usize + 64);
    }
}
