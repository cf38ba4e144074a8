//! Whether a picture shows anything at all: a covered lens, a clear sky or a flat thermal image
//! give the network a response, but no evidence.

use crate::bbox::FrameBox;
use crate::frame::Frame;

/// Cells along each side of the region around a box.
const CELLS: usize = 8;
/// Pixels that are averaged per cell and axis, so that sensor noise does not count.
const SAMPLES: usize = 3;
/// Side of the region, in sides of the box, and in pixels more.
const REGION: (f32, f32) = (2.0, 16.0);
/// Contrast below which there is nothing to be seen; real targets have 6 and more.
const LEAST_CONTRAST: f32 = 2.0;

/// Whether there is nothing to be seen in and around a box.
pub(super) fn is_blank(frame: &Frame<'_>, bbox: &FrameBox) -> bool {
    contrast(frame, bbox) < LEAST_CONTRAST
}

/// Contrast of the cells in and around a box, in gray levels.
fn contrast(frame: &Frame<'_>, bbox: &FrameBox) -> f32 {
    let w = REGION.0 * bbox.w + REGION.1;
    let h = REGION.0 * bbox.h + REGION.1;
    let pixels = CELLS * SAMPLES;
    let place = |center: f32, side: f32, i: usize, most: usize| {
        let at = center + side * ((i as f32 + 0.5) / pixels as f32 - 0.5);
        (at.max(0.0) as usize).min(most - 1)
    };
    let mut cells = [0.0f32; CELLS * CELLS];
    for i in 0..pixels {
        let y = place(bbox.cy, h, i, frame.height());
        for j in 0..pixels {
            let pixel = frame.bgr(place(bbox.cx, w, j, frame.width()), y);
            let [blue, green, red] = pixel.map(u32::from);
            let light = blue + 2 * green + red;
            cells[i / SAMPLES * CELLS + j / SAMPLES] += light as f32;
        }
    }
    let scale = 1.0 / (4 * SAMPLES * SAMPLES) as f32;
    for cell in &mut cells {
        *cell *= scale;
    }
    deviation_from_plane(&cells)
}

/// Standard deviation of cells from the plane that fits them best: a sky grows brighter toward the
/// horizon, and shows nothing.
fn deviation_from_plane(cells: &[f32; CELLS * CELLS]) -> f32 {
    let count = cells.len() as f32;
    let offset = |i: usize| i as f32 - (CELLS as f32 - 1.0) / 2.0;
    let mut mean = 0.0;
    let mut slope = [0.0; 2]; // along columns and rows
    let mut squares = 0.0; // of the offsets along one axis
    for (i, cell) in cells.iter().enumerate() {
        mean += cell / count;
        slope[0] += cell * offset(i % CELLS);
        slope[1] += cell * offset(i / CELLS);
        squares += offset(i % CELLS).powi(2);
    }
    let mut variance = 0.0;
    for (i, cell) in cells.iter().enumerate() {
        let plane = mean + (slope[0] * offset(i % CELLS) + slope[1] * offset(i / CELLS)) / squares;
        variance += (cell - plane).powi(2) / count;
    }
    variance.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ChannelOrder;

    const BOX: FrameBox = FrameBox {
        cx: 50.0,
        cy: 40.0,
        w: 20.0,
        h: 12.0,
    };

    fn is_blank_with(pixel: impl Fn(usize, usize) -> u8) -> bool {
        let data: Vec<u8> = (0..100 * 80).map(|i| pixel(i % 100, i / 100)).collect();
        is_blank(
            &Frame::new(&data, 100, 80, ChannelOrder::Gray).unwrap(),
            &BOX,
        )
    }

    #[test]
    fn flat_or_slightly_noisy_pictures_are_blank() {
        assert!(is_blank_with(|_, _| 0));
        assert!(is_blank_with(|_, _| 200));
        assert!(is_blank_with(|x, y| (60 + x / 2 + y) as u8));
        assert!(is_blank_with(
            |x, y| 100 + (x * 7919 + y * 104_729) as u8 % 4
        ));
    }

    #[test]
    fn faint_target_is_not_blank() {
        assert!(!is_blank_with(|x, y| {
            if (40..60).contains(&x) && (34..46).contains(&y) {
                112
            } else {
                100
            }
        }));
    }

    #[test]
    fn box_beyond_the_frame_is_judged_by_the_nearest_pixels() {
        let data = vec![9u8; 4];
        let frame = Frame::new(&data, 2, 2, ChannelOrder::Gray).unwrap();

        assert!(is_blank(&frame, &FrameBox { cx: -900.0, ..BOX }));
    }
}
