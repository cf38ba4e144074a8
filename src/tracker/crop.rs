//! The context-padded square crop around a target: geometry and sampling.
//!
//! Source: docs/method.md, sections 2.2 and 5.4.

use crate::bbox::{CropBox, FrameBox};
use crate::frame::Frame;
use kernels::Isa;
use kernels::par::Threads;
use kernels::resample::{Grid, Scratch, resample};

/// A region of the frame and the square crop it is resampled to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Center in frame pixels, horizontally; sub-pixel.
    pub cx: f64,
    /// Center in frame pixels, vertically; sub-pixel.
    pub cy: f64,
    /// Side of a square of the region's area in frame pixels, a whole number.
    pub side: f64,
    /// Factor of that side for the width, and divisor for the height; 1 for a square region.
    pub stretch: f64,
    /// Side of the crop in pixels.
    pub crop_side: usize,
}

/// Crop pixels per frame pixel for a target of `w` x `h`.
///
/// The scale maps the target with its context to the template's side:
/// `template_size / sqrt((w + p)(h + p))` with `p = context_amount * (w + h)`.
/// Template and search crop share this scale; it is *not* recomputed from a region's rounded side.
pub fn scale(w: f64, h: f64, context_amount: f64, template_size: usize) -> f64 {
    let context = context_amount * (w + h);
    template_size as f64 / ((w + context) * (h + context)).sqrt()
}

/// Greatest change of aspect that a stretched region takes back, as a natural logarithm: a factor
/// of two.
const MAX_CHANGE: f64 = 0.7;

/// Stretch of the search region that takes back a `share` of the change of the target's aspect
/// since its first frame, where `change` is its aspect now over its aspect then.
///
/// The network follows only part of a change between template and search crop. In a stretched
/// region the target keeps the aspect that the template has, and the network has to follow the rest
/// of the change only.
pub fn stretch(change: f64, share: f64) -> f64 {
    let taken_back = (share * change.ln()).clamp(-MAX_CHANGE, MAX_CHANGE);
    (taken_back / 2.0).exp()
}

impl Region {
    /// The region around `target` for a crop of `crop_side` pixels at `scale` crop pixels per frame
    /// pixel, stretched as [`stretch`] says.
    ///
    /// Its side is rounded, ties to even, and at least 2.
    pub fn around(target: &FrameBox, scale: f64, stretch: f64, crop_side: usize) -> Region {
        let side = (crop_side as f64 / scale).round_ties_even().max(2.0);
        Region {
            cx: f64::from(target.cx),
            cy: f64::from(target.cy),
            side,
            stretch,
            crop_side,
        }
    }

    /// Where the crop's pixels lie in the frame: in a square region, the outermost pixel centers of
    /// both coincide.
    fn grid(&self) -> Grid {
        let reach = (self.side - 1.0) / 2.0;
        let step = (self.side - 1.0) / (self.crop_side - 1) as f64;
        Grid {
            x0: self.cx - reach * self.stretch,
            y0: self.cy - reach / self.stretch,
            step_x: step * self.stretch,
            step_y: step / self.stretch,
            side: self.crop_side,
        }
    }
}

/// Where a crop lies in the frame: converts boxes between crop and frame pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Placement {
    cx: f32,      // frame pixel at the crop's middle
    cy: f32,      // likewise
    middle: f64,  // crop pixel of the crop's middle
    scale_x: f64, // crop pixels per frame pixel, across
    scale_y: f64, // likewise, down
}

/// Width and height in crop pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CropSize {
    pub w: f64,
    pub h: f64,
}

impl Placement {
    /// The crop of [`Region::around`] with the same arguments.
    pub(crate) fn new(target: &FrameBox, scale: f64, stretch: f64, crop_side: usize) -> Placement {
        Placement {
            cx: target.cx,
            cy: target.cy,
            middle: (crop_side / 2) as f64,
            scale_x: scale / stretch,
            scale_y: scale * stretch,
        }
    }

    /// The crop's middle in crop pixels, along either axis.
    pub(crate) fn middle(&self) -> f64 {
        self.middle
    }

    /// The same box in frame pixels.
    pub(crate) fn to_frame(self, bbox: &CropBox) -> FrameBox {
        let position = |middle: f32, crop: f32, scale: f64| {
            (f64::from(middle) + (f64::from(crop) - self.middle) / scale) as f32
        };
        FrameBox {
            cx: position(self.cx, bbox.cx, self.scale_x),
            cy: position(self.cy, bbox.cy, self.scale_y),
            w: (f64::from(bbox.w) / self.scale_x) as f32,
            h: (f64::from(bbox.h) / self.scale_y) as f32,
        }
    }

    /// The same box in crop pixels.
    pub(crate) fn to_crop(self, bbox: &FrameBox) -> CropBox {
        let position = |middle: f32, frame: f32, scale: f64| {
            (self.middle + (f64::from(frame) - f64::from(middle)) * scale) as f32
        };
        let size = self.size_in_crop(bbox);
        CropBox {
            cx: position(self.cx, bbox.cx, self.scale_x),
            cy: position(self.cy, bbox.cy, self.scale_y),
            w: size.w as f32,
            h: size.h as f32,
        }
    }

    /// The size of a box of frame pixels in crop pixels.
    pub(crate) fn size_in_crop(&self, bbox: &FrameBox) -> CropSize {
        CropSize {
            w: f64::from(bbox.w) * self.scale_x,
            h: f64::from(bbox.h) * self.scale_y,
        }
    }
}

/// Cuts crops and keeps the scratch space for it.
#[derive(Clone, Debug, Default)]
pub struct Cropper {
    scratch: Scratch,
}

impl Cropper {
    /// Resamples `region` of `frame` into `out` (`[crop_side, crop_side, 3]`, BGR).
    ///
    /// `border` (BGR) fills what lies outside the frame.
    /// Bilinear with exact weights, as OpenCV 5's `warpAffine`.
    /// Panics if `out` does not have the crop's size.
    pub fn cut(
        &mut self,
        isa: Isa,
        threads: &Threads,
        frame: &Frame<'_>,
        region: &Region,
        border: [u8; 3],
        out: &mut [u8],
    ) {
        resample(
            isa,
            threads,
            frame.pixels(),
            border,
            &region.grid(),
            &mut self.scratch,
            out,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bbox::BBox;
    use crate::frame::ChannelOrder;

    #[test]
    fn crops_of_the_worked_example_have_its_scale_and_grid() {
        // docs/method.md, section 2.2
        let target = BBox::new(100.0, 50.0, 40.0, 80.0).center();
        let scale = scale(40.0, 80.0, 0.5, 127);
        assert!((127.0 / scale - 118.32160).abs() < 1e-5);
        assert!((scale - 1.0733459).abs() < 1e-7);
        let template = Region::around(&target, scale, 1.0, 127);
        assert_eq!(template.side, 118.0);
        let grid = template.grid();
        assert!((grid.step_x - 0.92857143).abs() < 1e-8);
        assert_eq!((grid.x0, grid.y0), (61.0, 31.0));
        let search = Region::around(&target, scale, 1.0, 303);
        assert_eq!(search.side, 282.0);
        let grid = search.grid();
        assert!((grid.step_x - 0.93046358).abs() < 1e-8);
        assert_eq!((grid.x0, grid.y0), (-21.0, -51.0));
    }

    fn cut(frame: &Frame<'_>, region: &Region, border: [u8; 3]) -> Vec<u8> {
        let mut out = vec![0; region.crop_side * region.crop_side * 3];
        Cropper::default().cut(
            Isa::detect(),
            &Threads::new(1),
            frame,
            region,
            border,
            &mut out,
        );
        out
    }

    #[test]
    fn crop_of_a_constant_frame_is_constant() {
        let data = [10u8, 20, 30].repeat(50 * 40);
        let frame = Frame::new(&data, 50, 40, ChannelOrder::Bgr).unwrap();
        let target = FrameBox {
            cx: 12.3,
            cy: 31.7,
            w: 11.0,
            h: 7.0,
        };
        let region = Region::around(&target, scale(11.0, 7.0, 0.5, 127), 1.0, 303);
        assert!(
            cut(&frame, &region, frame.mean_bgr(Isa::detect()))
                .chunks(3)
                .all(|p| p == [10, 20, 30])
        );
    }

    #[test]
    fn crop_outside_the_frame_is_border_and_between_pixels_is_their_mean() {
        let data = [0u8, 100, 200, 50];
        let frame = Frame::new(&data, 2, 2, ChannelOrder::Gray).unwrap();
        let outside = Region {
            cx: -50.0,
            cy: 300.0,
            side: 9.0,
            stretch: 1.0,
            crop_side: 5,
        };
        assert!(
            cut(&frame, &outside, [1, 2, 3])
                .chunks(3)
                .all(|p| p == [1, 2, 3])
        );
        let middle = Region {
            cx: 0.5,
            cy: 0.5,
            side: 2.0,
            stretch: 1.0,
            crop_side: 3,
        };
        let crop = cut(&frame, &middle, [9; 3]);
        assert_eq!(crop[3..6], [50; 3]);
        assert_eq!(crop[12..15], [88; 3]); // 87.5, ties to even
    }

    #[test]
    fn stretch_takes_a_bounded_share_of_the_change_back() {
        assert_eq!(stretch(1.0, 1.0), 1.0);
        assert_eq!(stretch(1.7, 0.0), 1.0);
        assert!((stretch(1.44, 1.0) - 1.2).abs() < 1e-12);
        assert!((stretch(1.0 / 1.44, 0.5) - 1.0 / 1.2_f64.sqrt()).abs() < 1e-12);
        assert_eq!(stretch(9.0, 1.0), (MAX_CHANGE / 2.0).exp());
    }

    #[test]
    fn target_in_a_stretched_region_has_the_aspect_it_had() {
        // A white target that was square and is now 64 x 16.
        let (width, height) = (320, 240);
        let target = BBox::new(100.0, 100.0, 64.0, 16.0);
        let mut data = vec![0; width * height];
        for row in data.chunks_mut(width).skip(100).take(16) {
            row[100..164].fill(255);
        }
        let frame = Frame::new(&data, width, height, ChannelOrder::Gray).unwrap();
        let stretch = 2.0; // a square target is 32 x 32
        let scale = scale(32.0, 32.0, 0.5, 127);
        let region = Region::around(&target.center(), scale, stretch, 303);

        let crop = cut(&frame, &region, [0; 3]);

        let bright = |pixels: &mut dyn Iterator<Item = usize>| {
            pixels.filter(|pixel| crop[3 * pixel] > 127).count() as f64
        };
        let across = bright(&mut (0..303).map(|x| 151 * 303 + x));
        let down = bright(&mut (0..303).map(|y| y * 303 + 151));
        let seen = Placement::new(&target.center(), scale, stretch, 303).to_crop(&target.center());
        assert!((seen.w - seen.h).abs() < 1e-3, "{seen:?}");
        assert!(
            (across - f64::from(seen.w)).abs() < 1.5,
            "{across} {seen:?}"
        );
        assert!((down - f64::from(seen.h)).abs() < 1.5, "{down} {seen:?}");
    }

    #[test]
    fn box_converted_to_the_crop_and_back_is_the_same() {
        let target = BBox::new(100.0, 50.0, 40.0, 80.0).center();
        let placement = Placement::new(&target, 1.5, 1.25, 303);
        let beside = FrameBox {
            cx: target.cx + 10.0,
            ..target
        };

        let in_crop = placement.to_crop(&beside);

        let expected = CropBox {
            cx: 163.0,
            cy: 151.0,
            w: 48.0,
            h: 150.0,
        };
        assert_eq!(in_crop, expected);
        assert_eq!(placement.to_frame(&in_crop), beside);
    }
}
