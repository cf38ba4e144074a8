//! From a target in a picture to its crops (docs/method.md, sections 2.2 and 3.2).

use super::augment::Augment;
use super::picture::Picture;
use super::warp::{Grid, warp};
use crate::rng::Rng;
use std::sync::Arc;
use track_cpu::BBox;
use track_cpu::crop::{Region, scale, stretch};

/// A target in a picture.
#[derive(Clone, Debug)]
pub struct View {
    /// The picture.
    pub picture: Arc<Picture>,
    /// The target's box in it.
    pub bbox: BBox,
}

/// Corners of a box in crop pixels, pixel centers inclusive: left, top, right, bottom
/// (docs/method.md, section 3.2).
pub type Corners = [f32; 4];

/// Side of the template crop.
pub const TEMPLATE_SIZE: usize = 127;

/// Context around the target, as a share of (w + h).
const CONTEXT: f64 = 0.5;

/// Orientation of all crops of a pair: quarter turns, then mirroring.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pose {
    /// Quarter turns, 0..4.
    pub quarters: u8,
    /// Whether left and right are exchanged.
    pub mirrored: bool,
}

/// How a search crop is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Orientation, as that of the template crop.
    pub pose: Pose,
    /// Side of the crop in pixels.
    pub size: usize,
    /// Whether the frame is paired with itself; it is then turned and stretched more.
    pub still: bool,
    /// Change of the target's aspect since the template that the crop takes back, as the tracker
    /// does; 1 for none.
    pub change: f64,
}

/// Random change of a search crop, in crop pixels and factors.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Jitter {
    scale: f64,  // of the target
    aspect: f64, // factor of its width and divisor of its height
    shear: f64,  // crop pixels to the side per crop pixel down
    angle: f64,  // radians
    shift: [f64; 2],
}

const STILL: Jitter = Jitter {
    scale: 1.0,
    aspect: 1.0,
    shear: 0.0,
    angle: 0.0,
    shift: [0.0; 2],
};

/// 2x2 matrix, row-major.
type Matrix = [[f64; 2]; 2];

impl Pose {
    /// Picture offset of a crop offset at `scale` crop pixels per picture pixel.
    fn matrix(self, scale: f64, jitter: &Jitter) -> Matrix {
        let (sin, cos) = jitter.angle.sin_cos();
        // Whole quarters are exact: no rounding of sines.
        let (sin, cos) = match self.quarters % 4 {
            0 => (sin, cos),
            1 => (cos, -sin),
            2 => (-sin, -cos),
            _ => (-cos, sin),
        };
        let across = if self.mirrored { -1.0 } else { 1.0 } / (scale * jitter.aspect);
        let down = jitter.aspect / scale;
        let [[a, b], [c, d]] = [[cos * across, -sin * down], [sin * across, cos * down]];
        [[a, b + a * jitter.shear], [c, d + c * jitter.shear]]
    }
}

/// The template crop, `[127, 127, 3]` BGR: the tracker's crop, turned by the pose.
pub fn template(view: &View, pose: Pose) -> Vec<u8> {
    let BBox { w, h, .. } = view.bbox;
    let scale = scale(f64::from(w), f64::from(h), CONTEXT, TEMPLATE_SIZE);
    let region = Region::around(&view.bbox.center(), scale, 1.0, TEMPLATE_SIZE);
    let crop_scale = (TEMPLATE_SIZE - 1) as f64 / (region.side - 1.0);
    sample(
        view,
        &pose.matrix(crop_scale, &STILL),
        [0.0; 2],
        TEMPLATE_SIZE,
    )
}

/// A search crop, `[size, size, 3]` BGR, and the target's corners in it.
///
/// Scale, place, angle, aspect and shear are random within the reach of `augment`. If no random
/// change keeps the whole box in the crop, nothing is changed. Pixels outside the picture are
/// filled from `beside`, the surroundings of another target, or else with the border color of the
/// picture.
pub fn search(
    view: &View,
    beside: Option<&View>,
    cut: Cut,
    augment: &Augment,
    rng: &mut Rng,
) -> (Vec<u8>, Corners) {
    let Cut { pose, size, .. } = cut;
    let stretch = stretch(cut.change, 1.0);
    let w = f64::from(view.bbox.w) / stretch;
    let h = f64::from(view.bbox.h) * stretch;
    let scale = scale(w, h, CONTEXT, TEMPLATE_SIZE);
    // The crop's width lies along the picture's height after one or three quarter turns.
    let aspect = if pose.quarters.is_multiple_of(2) {
        1.0 / stretch
    } else {
        stretch
    };
    for _ in 0..50 {
        let mut jitter = jitter(size, cut.still, augment, rng);
        jitter.aspect *= aspect;
        if augment.slant > 0.0 {
            jitter = straighten(jitter, &view.bbox, pose, f64::from(augment.slant));
        }
        let matrix = pose.matrix(scale * jitter.scale, &jitter);
        let corners = corners(&view.bbox, &matrix, jitter.shift, size);
        let inside = |v: &f32| (0.0..=(size - 1) as f32).contains(v);
        if corners.iter().all(inside) {
            let grid = grid(&view.bbox, &matrix, jitter.shift, size);
            let mut crop = warp(&view.picture, &grid);
            if let Some(other) = beside {
                fill_outside(&mut crop, &grid, &view.picture, || {
                    surroundings(other, pose, size, rng)
                });
            }
            return (crop, corners);
        }
    }
    let unchanged = Jitter { aspect, ..STILL };
    let matrix = pose.matrix(scale, &unchanged);
    (
        sample(view, &matrix, [0.0; 2], size),
        corners(&view.bbox, &matrix, [0.0; 2], size),
    )
}

/// A search crop with the target anywhere, within it or beyond its edge.
fn surroundings(view: &View, pose: Pose, size: usize, rng: &mut Rng) -> Vec<u8> {
    let BBox { w, h, .. } = view.bbox;
    let scale =
        scale(f64::from(w), f64::from(h), CONTEXT, TEMPLATE_SIZE) * f64::from(rng.factor(0.3));
    let reach = size as f32 / 2.0;
    let shift = [rng.range(-reach, reach), rng.range(-reach, reach)].map(f64::from);
    sample(view, &pose.matrix(scale, &STILL), shift, size)
}

/// Replaces the pixels outside the picture, if there are any.
fn fill_outside(crop: &mut [u8], grid: &Grid, picture: &Picture, other: impl FnOnce() -> Vec<u8>) {
    let end = grid.side - 1;
    if [(0, 0), (end, 0), (0, end), (end, end)]
        .iter()
        .all(|(x, y)| grid.meets(picture, *x, *y))
    {
        return; // pictures are convex
    }
    for (i, (pixel, other)) in crop
        .chunks_exact_mut(3)
        .zip(other().chunks_exact(3))
        .enumerate()
    {
        if !grid.meets(picture, i % grid.side, i / grid.side) {
            pixel.copy_from_slice(other);
        }
    }
}

fn jitter(size: usize, still: bool, augment: &Augment, rng: &mut Rng) -> Jitter {
    let more = if still { 3.0 } else { 1.0 };
    let mut spread = |reach: f32| f64::from(rng.range(-reach, reach));
    let reach = augment.shift * size as f32 / 2.0;
    let (scale, aspect) = (
        spread(augment.scale).exp(),
        spread(augment.aspect * more).exp(),
    );
    let (angle, shift) = (
        spread(augment.rotation * more).to_radians(),
        [spread(reach), spread(reach)],
    );
    let turned = rng.chance(0.6);
    let mut jitter = Jitter {
        scale,
        aspect,
        shear: 0.0,
        angle: if turned { angle } else { 0.0 },
        shift,
    };
    if rng.sometimes(augment.stretched) {
        jitter.aspect = f64::from(rng.factor(augment.stretch));
        jitter.shear = f64::from(rng.range(-augment.shear, augment.shear));
    }
    jitter
}

/// Halves angle and shear until the box of the ellipse is a tight one for every shape.
///
/// In a slanted picture the target's width adds to its height and the reverse, by an amount that
/// depends on its unknown shape. `most` bounds that amount as a share of the side it adds to.
fn straighten(mut jitter: Jitter, bbox: &BBox, pose: Pose, most: f64) -> Jitter {
    for _ in 0..6 {
        let cross = extents(bbox, &pose.matrix(1.0, &jitter))
            .map(|[one, other]| one.min(other) / one.max(other).max(1e-9));
        if cross.iter().all(|share| *share <= most) {
            return jitter;
        }
        jitter.angle /= 2.0;
        jitter.shear /= 2.0;
    }
    Jitter {
        angle: 0.0,
        shear: 0.0,
        ..jitter
    }
}

/// Samples the crop whose pixel `center + shift` is the box's center.
fn sample(view: &View, matrix: &Matrix, shift: [f64; 2], side: usize) -> Vec<u8> {
    warp(&view.picture, &grid(&view.bbox, matrix, shift, side))
}

fn grid(bbox: &BBox, matrix: &Matrix, shift: [f64; 2], side: usize) -> Grid {
    let center = bbox.center();
    let reach = (side - 1) as f64 / 2.0;
    let from = [-reach - shift[0], -reach - shift[1]]; // crop pixel (0, 0)
    let origin = [0, 1].map(|k| matrix[k][0] * from[0] + matrix[k][1] * from[1]);
    Grid {
        origin: [
            origin[0] + f64::from(center.cx),
            origin[1] + f64::from(center.cy),
        ],
        across: [matrix[0][0], matrix[1][0]],
        down: [matrix[0][1], matrix[1][1]],
        side,
    }
}

/// What a box's width and height each contribute to its extent in the crop, times the matrix's
/// determinant: across, then down.
fn extents(bbox: &BBox, matrix: &Matrix) -> [[f64; 2]; 2] {
    let [[a, b], [c, d]] = *matrix;
    let (w, h) = (f64::from(bbox.w), f64::from(bbox.h));
    [[d * w, b * h], [c * w, a * h]].map(|terms| terms.map(f64::abs))
}

/// The target's box in the crop: the box of the ellipse inscribed in the target's box.
///
/// The rule is exact for stretch, mirroring and quarter turns. For a small turn or shear it lies
/// between the boxes of a rectangle and a diamond.
fn corners(bbox: &BBox, matrix: &Matrix, shift: [f64; 2], side: usize) -> Corners {
    let [[a, b], [c, d]] = *matrix;
    let determinant = a * d - b * c;
    let extent = extents(bbox, matrix).map(|[one, other]| one.hypot(other) / determinant.abs());
    let middle = shift.map(|s| (side - 1) as f64 / 2.0 + s);
    let half = extent.map(|e| (e - 1.0) / 2.0);
    [
        middle[0] - half[0],
        middle[1] - half[1],
        middle[0] + half[0],
        middle[1] + half[1],
    ]
    .map(|v| v as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Isa;
    use kernels::par::Threads;
    use track_cpu::crop::Cropper;

    /// A black picture with a white rectangle that fills the box.
    fn view(bbox: BBox) -> View {
        let (width, height) = (200, 160);
        let mut data = vec![0; 3 * width * height];
        for y in bbox.y as usize..(bbox.y + bbox.h) as usize {
            for x in bbox.x as usize..(bbox.x + bbox.w) as usize {
                data[(y * width + x) * 3..][..3].fill(255);
            }
        }
        View {
            picture: Arc::new(Picture::new(width, height, data)),
            bbox,
        }
    }

    /// A crop of a pair of frames, with nothing taken back.
    fn cut(pose: Pose, size: usize) -> Cut {
        Cut {
            pose,
            size,
            still: false,
            change: 1.0,
        }
    }

    /// Tight box of what is brighter than half.
    fn bright(crop: &[u8], side: usize) -> Corners {
        let mut found = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
        for (i, pixel) in crop.chunks(3).enumerate() {
            if pixel[0] > 127 {
                let (x, y) = ((i % side) as f32, (i / side) as f32);
                found = [
                    found[0].min(x),
                    found[1].min(y),
                    found[2].max(x),
                    found[3].max(y),
                ];
            }
        }
        found
    }

    #[test]
    fn upright_template_equals_the_trackers() {
        let view = view(BBox::new(60.0, 50.0, 37.0, 21.0));
        let scale = scale(37.0, 21.0, 0.5, 127);
        let region = Region::around(&view.bbox.center(), scale, 1.0, 127);
        let mut expected = vec![0; 127 * 127 * 3];
        let picture = &view.picture;
        Cropper::default().cut(
            Isa::detect(),
            &Threads::new(1),
            &picture.frame(),
            &region,
            picture.border,
            &mut expected,
        );
        let found = template(&view, Pose::default());
        let worst = found
            .iter()
            .zip(&expected)
            .map(|(a, b)| a.abs_diff(*b))
            .max();
        assert!(worst <= Some(1), "{worst:?}");
    }

    #[test]
    fn target_in_every_pose_has_its_corners() {
        let augment = Augment {
            rotation: 0.0,
            ..Augment::strong()
        };
        let mut rng = Rng::new(3, 3, 3);
        for size in [239, 303] {
            for quarters in 0..4 {
                for mirrored in [false, true] {
                    for bbox in [
                        BBox::new(60.0, 50.0, 37.0, 21.0),
                        BBox::new(2.0, 3.0, 16.0, 30.0),
                    ] {
                        let pose = Pose { quarters, mirrored };
                        let view = view(bbox);
                        let cut = Cut {
                            still: true,
                            ..cut(pose, size)
                        };
                        let (crop, corners) = search(&view, None, cut, &augment, &mut rng);
                        for (found, expected) in bright(&crop, size).iter().zip(corners) {
                            let error = (found - expected).abs();
                            assert!(
                                error < 2.5,
                                "{found}, expected {expected} at {pose:?} {bbox:?}"
                            );
                        }
                        let middle = bright(&template(&view, pose), 127);
                        let center = [(middle[0] + middle[2]) / 2.0, (middle[1] + middle[3]) / 2.0];
                        assert!(center.iter().all(|c| (c - 63.0).abs() < 1.5), "{center:?}");
                    }
                }
            }
        }
    }

    /// A black picture with a white ellipse inscribed in the box.
    fn ellipse(bbox: BBox) -> View {
        let mut view = view(bbox);
        let picture = Arc::make_mut(&mut view.picture);
        let center = bbox.center();
        for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
            let x = ((i % picture.width) as f32 + 0.5 - center.cx) / (bbox.w / 2.0);
            let y = ((i / picture.width) as f32 + 0.5 - center.cy) / (bbox.h / 2.0);
            pixel.fill(if x.hypot(y) <= 1.0 { 255 } else { 0 });
        }
        view
    }

    #[test]
    fn stretched_and_sheared_target_keeps_a_tight_box() {
        let augment = Augment {
            stretched: 1.0,
            ..Augment::shape()
        };
        let mut rng = Rng::new(4, 4, 4);
        let (mut least, mut most) = (f32::MAX, f32::MIN);
        for i in 0..300 {
            let size = [[40.0, 40.0], [64.0, 20.0], [24.0, 60.0]][i % 3];
            let bbox = BBox::new(70.0, 50.0, size[0], size[1]);
            let pose = Pose {
                quarters: (i % 4) as u8,
                mirrored: i % 2 == 0,
            };
            let cut = Cut {
                still: i % 5 == 0,
                ..cut(pose, 303)
            };

            // The same random numbers for both, and so the same change.
            let mut again = rng.clone();
            let (round, corners) = search(&ellipse(bbox), None, cut, &augment, &mut again);
            let (full, same) = search(&view(bbox), None, cut, &augment, &mut rng);

            assert_eq!(corners, same);
            let extent = [corners[2] - corners[0] + 1.0, corners[3] - corners[1] + 1.0];
            // A pixel of the picture is up to two pixels of the crop.
            for (crop, name, share) in [(&round, "ellipse", 0.02), (&full, "rectangle", 0.09)] {
                for (k, (found, expected)) in bright(crop, 303).iter().zip(corners).enumerate() {
                    let error = (found - expected).abs();
                    assert!(
                        error < 2.2 + share * extent[k % 2],
                        "{name} {bbox:?} {pose:?}: {found}, expected {expected}"
                    );
                }
            }
            let change = (extent[0] / extent[1]).ln();
            let sides = if pose.quarters.is_multiple_of(2) {
                size
            } else {
                [size[1], size[0]]
            };
            let change = change - (sides[0] / sides[1]).ln();
            (least, most) = (least.min(change), most.max(change));
        }
        assert!(
            least < -0.5 && most > 0.5,
            "aspect changes by {least}..{most}"
        );
    }

    #[test]
    fn pose_turns_template_and_search_crop_alike() {
        // A bright dot right of the target's center goes down with one quarter turn of the
        // picture's grid.
        let mut picture = Picture::new(101, 101, vec![0; 3 * 101 * 101]);
        picture.data[(50 * 101 + 60) * 3..][..3].fill(255);
        let bbox = BBox::new(35.0, 35.0, 31.0, 31.0);
        let view = View {
            picture: Arc::new(picture),
            bbox,
        };
        let none = Augment::none();
        let quiet = Augment {
            scale: 0.0,
            shift: 0.0,
            ..none
        };
        for (quarters, mirrored) in [(0, false), (1, false), (2, true), (3, true), (3, false)] {
            let pose = Pose { quarters, mirrored };
            let center = |crop: &[u8], side: usize| {
                let best = crop
                    .chunks(3)
                    .enumerate()
                    .max_by_key(|(_, p)| p[0])
                    .unwrap()
                    .0;
                let middle = (side - 1) as f32 / 2.0;
                [(best % side) as f32 - middle, (best / side) as f32 - middle]
            };
            let z = center(&template(&view, pose), 127);
            let x = center(
                &search(&view, None, cut(pose, 303), &quiet, &mut Rng::new(0, 0, 0)).0,
                303,
            );
            assert!(
                (z[0] - x[0]).abs() < 2.0 && (z[1] - x[1]).abs() < 2.0,
                "{pose:?}: {z:?} {x:?}"
            );
        }
    }

    #[test]
    fn target_whose_change_is_taken_back_has_the_templates_aspect_in_every_pose() {
        // The target was square in the template's frame.
        let bbox = BBox::new(60.0, 50.0, 48.0, 27.0);
        let augment = Augment {
            scale: 0.0,
            ..Augment::none()
        };
        for quarters in 0..4 {
            let pose = Pose {
                quarters,
                mirrored: quarters == 1,
            };
            let cut = Cut {
                change: 48.0 / 27.0,
                ..cut(pose, 303)
            };

            let (crop, corners) = search(&view(bbox), None, cut, &augment, &mut Rng::new(5, 5, 5));

            let extent = [corners[2] - corners[0] + 1.0, corners[3] - corners[1] + 1.0];
            assert!((extent[0] - extent[1]).abs() < 0.01, "{pose:?}: {extent:?}");
            let square = f64::from(extent[0]) - 36.0 * scale(36.0, 36.0, CONTEXT, TEMPLATE_SIZE);
            assert!(square.abs() < 0.01, "{pose:?}: {extent:?}");
            for (found, expected) in bright(&crop, 303).iter().zip(corners) {
                assert!(
                    (found - expected).abs() < 2.5,
                    "{pose:?}: {found}, expected {expected}"
                );
            }
        }
    }

    #[test]
    fn pixels_outside_the_picture_come_from_beside() {
        let paint = |value| View {
            picture: Arc::new(Picture::new(60, 60, vec![value; 3 * 60 * 60])),
            bbox: BBox::new(20.0, 20.0, 20.0, 20.0),
        };
        let (view, other) = (paint(90), paint(30));
        for i in 0..20 {
            let mut rng = Rng::new(i, 0, 0);
            let pose = Pose {
                quarters: i as u8 % 4,
                mirrored: i % 3 == 0,
            };
            let cut = Cut {
                still: true,
                ..cut(pose, 303)
            };
            let (crop, corners) = search(&view, Some(&other), cut, &Augment::strong(), &mut rng);
            let dark = crop.iter().filter(|v| **v == 30).count();
            assert!(
                dark > crop.len() / 8 && crop.iter().all(|v| [30, 90].contains(v)),
                "{dark}"
            );
            let middle = [0, 1].map(|k| (corners[k] + corners[k + 2]) as usize / 2);
            assert_eq!(crop[(middle[1] * 303 + middle[0]) * 3], 90);
        }
    }

    #[test]
    fn scale_and_place_stay_within_their_bounds() {
        let view = view(BBox::new(60.0, 50.0, 37.0, 37.0));
        let mut rng = Rng::new(1, 2, 3);
        let side = f64::from(37.0f32) * scale(37.0, 37.0, 0.5, 127);
        let (mut sizes, mut places) = (Vec::new(), Vec::new());
        for _ in 0..300 {
            let cut = cut(Pose::default(), 303);
            let (_, [x0, y0, x1, y1]) = search(&view, None, cut, &Augment::none(), &mut rng);
            sizes.push(f64::from(x1 - x0 + 1.0) / side);
            places.extend([
                f64::from(x0 + x1) / 2.0 - 151.0,
                f64::from(y0 + y1) / 2.0 - 151.0,
            ]);
        }
        let bounds = |v: &[f64]| {
            v.iter()
                .fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)))
        };
        let ((least, most), (left, right)) = (bounds(&sizes), bounds(&places));
        assert!(
            least > 1.0 / 1.301 && least < 0.8 && most < 1.301 && most > 1.25,
            "{least}..{most}"
        );
        assert!(
            left > -60.7 && left < -57.0 && right < 60.7 && right > 57.0,
            "{left}..{right}"
        );
    }
}
