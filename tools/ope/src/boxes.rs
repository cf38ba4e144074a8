//! Boxes of the evaluation and boxes of the tracker, one made from the other.

use sequences::Rect;
use track_cpu::BBox;

/// A box as the tracker takes it, in single precision.
pub fn to_tracker(rect: Rect) -> BBox {
    let [x, y, w, h] = rect.to_f32();
    BBox::new(x, y, w, h)
}

/// A box of the tracker in double precision.
pub fn from_tracker(bbox: BBox) -> Rect {
    Rect::from([bbox.x, bbox.y, bbox.w, bbox.h])
}
